"""Which lanes of an OpenDRIVE file are for cars, and what the others are."""

from __future__ import annotations

from interplan_sumo.maps.importers.opendrive.elements import XodrAccess, XodrLane

_FOR_CARS = frozenset(
    "driving entry exit mwyEntry mwyExit onRamp offRamp connectingRamp slipLane bidirectional shared".split()
)
TWO_WAY = "bidirectional"
_REASONS = {
    "none": "strip of no use",
    "stop": "lane for stopping",
    "shoulder": "shoulder",
    "biking": "bicycle lane",
    "sidewalk": "sidewalk",
    "walking": "sidewalk",
    "border": "border",
    "curb": "curb",
    "median": "median",
    "restricted": "restricted lane",
    "parking": "parking lane",
    "special1": "special lane",
    "special2": "special lane",
    "special3": "special lane",
    "roadWorks": "lane under construction",
    "tram": "tram lane",
    "rail": "railway",
    "bus": "bus lane",
    "taxi": "taxi lane",
    "HOV": "lane for shared cars",
}
_CLOSED_GROUND = frozenset(("none", "sidewalk", "walking", "border", "curb", "median", "rail"))
_WALKWAYS = frozenset(("sidewalk", "walking"))
_CARS = frozenset(("passengercar", "autonomoustraffic", "throughtraffic", "car", "none", "simulator"))
"""Who stands for cars in rules of access, in lower case."""


def reason_of(lane: XodrLane, offset_m: float) -> str | None:
    """Why cars may not use a lane so far behind the start of its section; None if they may."""
    if lane.kind not in _FOR_CARS:
        return _REASONS.get(lane.kind, "lane of another kind")
    rules = [rule for rule in lane.access if rule.offset_m <= offset_m]
    rules = [rule for rule in rules if rule.offset_m == rules[-1].offset_m]
    return next(filter(None, map(_refusal, rules)), None)


def _refusal(rule: XodrAccess) -> str | None:
    users = {user.lower() for user in rule.users}
    if not users or bool(users & _CARS) == rule.allows:
        return None
    return f"lane for {' and '.join(sorted(rule.users))} only" if rule.allows else "lane closed to cars"


def is_ground(lane: XodrLane) -> bool:
    """Whether a car may stand on a lane that is not for cars."""
    return lane.kind not in _CLOSED_GROUND


def is_walkway(lane: XodrLane) -> bool:
    return lane.kind in _WALKWAYS


def is_parking_lane(lane: XodrLane) -> bool:
    return lane.kind == "parking"
