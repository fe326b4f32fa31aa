"""What a lanelet or an area is for, by its tags."""

from __future__ import annotations

from enum import Enum

from interplan_sumo.maps.importers.lanelet2.lanelets import truth


class Kind(Enum):
    """What becomes of a lanelet."""

    LANE = "lane"
    CROSSWALK = "crosswalk"
    WALKWAY = "walkway"
    DRIVABLE = "drivable"
    """Not for cars, but paved: they may stand on it."""
    OTHER = "other"


_PARTICIPANT = "participant:"
_CAR_LANES = frozenset({"", "road", "highway", "play_street", "exit"})
_KINDS = {
    "crosswalk": Kind.CROSSWALK,
    "walkway": Kind.WALKWAY,
    "shared_walkway": Kind.WALKWAY,
    "stairs": Kind.WALKWAY,
    "pedestrian_lane": Kind.WALKWAY,
    "bus_lane": Kind.DRIVABLE,
    "bicycle_lane": Kind.DRIVABLE,
    "emergency_lane": Kind.DRIVABLE,
    "road_shoulder": Kind.DRIVABLE,
}


def kind_of(tags: dict[str, str]) -> Kind:
    """What to make of a lanelet; tags such as participant:vehicle=no outrank its subtype."""
    subtype = tags.get("subtype", "")
    kind = Kind.LANE if subtype in _CAR_LANES else _KINDS.get(subtype, Kind.OTHER)
    if kind is Kind.CROSSWALK:
        return kind
    if truth(tags.get("no_drivable_lane", ""), False):
        return Kind.DRIVABLE
    allowed = _allowed(tags)
    if allowed is None:
        return kind
    if any(_is_car(participant) for participant in allowed):
        return Kind.LANE
    if kind is not Kind.LANE:
        return kind
    return Kind.DRIVABLE if "pedestrian" not in allowed else Kind.WALKWAY


def reason_of(tags: dict[str, str]) -> str:
    """Why a lanelet is no lane for cars, in words."""
    subtype = tags.get("subtype", "")
    if truth(tags.get("no_drivable_lane", ""), False):
        return "lane out of use"
    if subtype in _CAR_LANES:
        return "lane closed to cars"
    return subtype.replace("_", " ") if subtype in _KINDS else f"lanelet of subtype {subtype[:40]!r}"


def _allowed(tags: dict[str, str]) -> set[str] | None:
    """The participants that may pass, where tags name them; None if the subtype has to tell.

    Naming one shuts out all others, as in Lanelet2. Naming only some that may
    not pass leaves cars to the subtype, unless they are among these.
    """
    named = {key.removeprefix(_PARTICIPANT): value for key, value in tags.items() if key.startswith(_PARTICIPANT)}
    allowed = {key for key, value in named.items() if truth(value, False)}
    return allowed if allowed or any(_is_car(participant) for participant in named) else None


def _is_car(participant: str) -> bool:
    return participant == "vehicle" or f"{participant}:".startswith("vehicle:car:")
