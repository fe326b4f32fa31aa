"""Speed limits: from rules and tags of the file, else from the law that Lanelet2 assumes."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from interplan_sumo.maps.importers.lanelet2.osm import OsmFile, Relation

KMH = 1.0 / 3.6
_UNITS = {
    "": KMH,
    "km/h": KMH,
    "kmh": KMH,
    "kmph": KMH,
    "kph": KMH,
    "mph": 0.44704,
    "m/s": 1.0,
    "mps": 1.0,
    "ms": 1.0,
}
_SPEED = re.compile(r"(\d{1,6}(?:[.,]\d{1,12})?) ?([a-z/]*)")
_FASTEST_MPS = 150.0

# Signs of the German catalogue (VzKat): zone 30, town limits, home zone (walking pace, 7 km/h in Lanelet2's rules).
_SIGNS_KMH = {"274": None, "274.1": 30.0, "310": 50.0, "311": 100.0, "325.1": 7.0, "325": 7.0}
_SIGNS_WITH_KMH = ("274", "274.1")
"""Those that hold a number; 274.2 ends a zone."""
_SIGN = re.compile(r"de ?(\d{3}(?:[._]\d)?)(?:-(\d{1,3}))?")
_PLAIN_SIGN = re.compile(r"(?:speed_?limit|maxspeed)[_ -]?(\d{1,3})")

# What Lanelet2's traffic rules take where a map says nothing; they know German law only. On motorways it is advice.
_DEFAULTS_KMH = {
    ("urban", "road"): 50.0,
    ("nonurban", "road"): 100.0,
    ("urban", "highway"): 130.0,
    ("nonurban", "highway"): 130.0,
    ("urban", "play_street"): 7.0,
    ("nonurban", "play_street"): 7.0,
    ("urban", "exit"): 50.0,
}


class LimitOrigin(Enum):
    """Where a speed limit comes from."""

    FILE = "file"
    LAW = "law"
    NOWHERE = "nowhere"


@dataclass(frozen=True, slots=True)
class Limit:
    """The speed limit of a lanelet."""

    mps: float | None
    origin: LimitOrigin
    unreadable: str | None = None
    """What the file says, where that is no speed."""


def speed_mps(text: str) -> float | None:
    """A speed such as "50", "50 km/h", "30 mph" or "13.9 m/s" (km/h unless it says otherwise); None if it is none."""
    match = _SPEED.fullmatch(" ".join(text.lower().split()))
    if not match or match[2] not in _UNITS:
        return None
    return _plausible(float(match[1].replace(",", ".")) * _UNITS[match[2]])


def sign_mps(text: str) -> float | None:
    """The limit that a traffic sign sets, such as "de274-60", "de274.1" or "50 km/h"; None for any other sign."""
    low = text.lower().strip()
    sign = _SIGN.fullmatch(low)
    if sign:
        code = sign[1].replace("_", ".")
        kmh = float(sign[2]) if sign[2] and code in _SIGNS_WITH_KMH else _SIGNS_KMH.get(code)
        return None if kmh is None else _plausible(kmh * KMH)
    plain = _PLAIN_SIGN.fullmatch(low)
    return speed_mps(plain[1] if plain else low)


def limit_of(file: OsmFile, tags: Mapping[str, str], rules: tuple[Relation, ...]) -> Limit:
    """The limit of a lanelet with these tags and regulatory elements; rules outrank tags, as in Lanelet2."""
    stated = [text for rule in rules if rule.tags.get("subtype") == "speed_limit" for text in _signs(file, rule)]
    for text in stated:
        if (limit := sign_mps(text)) is not None:
            return Limit(limit, LimitOrigin.FILE)
    for key in ("speed_limit:vehicle:car", "speed_limit:vehicle", "speed_limit"):
        if key in tags:
            stated.append(tags[key])
            if (limit := speed_mps(tags[key])) is not None:
                return Limit(limit, LimitOrigin.FILE)
    unreadable = stated[0] if stated else None
    kmh = _DEFAULTS_KMH.get((tags.get("location", "urban"), tags.get("subtype") or "road"))
    if kmh is None or tags.get("region", "de").lower()[:2] != "de":
        return Limit(None, LimitOrigin.NOWHERE, unreadable)
    return Limit(kmh * KMH, LimitOrigin.LAW, unreadable)


def _signs(file: OsmFile, rule: Relation) -> list[str]:
    """What a rule's own tag and the signs that it refers to say."""
    ways = (file.ways[ref] for ref in rule.refs("refers") if ref in file.ways)
    texts = [rule.tags.get("sign_type", "")]
    for way in ways:
        texts += [way.tags.get("sign_type", ""), way.tags.get("subtype", "")]
    return [text for text in texts if text]


def _plausible(mps: float) -> float | None:
    return mps if 0.0 < mps <= _FASTEST_MPS else None
