"""The form of an answer: JSON without a needless character, since each one costs time."""

from __future__ import annotations

import json
import re
from typing import Any, Final

import numpy as np

from interplan_sumo.world.geometry import Floats

STEP_S: Final = 0.5
POINTS: Final = 16
"""Eight seconds (the published numbers)."""
WORDS: Final = 12
WORD_CHARS: Final = 14
THOUGHTS_CHARS: Final = WORDS * (WORD_CHARS + 2)
"""Longest thoughts: words of letters, a blank after each, perhaps a comma, semicolon or full stop before it."""
FARTHEST_M: Final = 999.9

SCHEMA: Final[dict[str, Any]] = {
    "type": "object",
    "properties": {
        "thoughts": {"type": "string", "maxLength": THOUGHTS_CHARS},
        "waypoints": {
            "type": "array",
            "minItems": POINTS,
            "maxItems": POINTS,
            "items": {"type": "array", "minItems": 2, "maxItems": 2, "items": {"type": "number"}},
        },
    },
    "required": ["thoughts", "waypoints"],
    "additionalProperties": False,
}
GRAMMAR: Final = rf"""
root ::= "{{\"thoughts\":\"" thoughts "\",\"waypoints\":[" place ("," place){{{POINTS - 1}}} "]}}"
thoughts ::= word (" " word){{0,{WORDS - 1}}}
word ::= [A-Za-z]{{1,{WORD_CHARS}}} [,;.]?
place ::= "[" number "," number "]"
number ::= "-"? ("0" | [1-9] [0-9]{{0,2}}) ("." [0-9])?
"""
"""The schema in GBNF, and what no schema can say: no blanks, numbers below 1000 with one decimal at most, few words.

Words have no digits: a small model that may write numbers there writes nothing else.
"""

_WORD = rf"[A-Za-z]{{1,{WORD_CHARS}}}[,;.]?"
_THOUGHTS = re.compile(rf"{_WORD}( {_WORD}){{0,{WORDS - 1}}}")


def answer_text(thoughts: str, places: Floats) -> str:
    """The shortest text of an answer in the grammar: places (16, 2) in the car's frame, to the decimetre.

    ValueError for what it cannot say: other shapes, places beyond 999.9 m,
    thoughts of more than 12 words or with anything but letters in them.
    """
    if places.shape != (POINTS, 2):
        raise ValueError(f"places have shape {places.shape}, expected ({POINTS}, 2)")
    rounded = np.round(places, 1) + 0.0
    if not np.all(np.abs(rounded) <= FARTHEST_M):
        raise ValueError(f"a place lies beyond {FARTHEST_M} m: {float(np.abs(rounded).max())}")
    if _THOUGHTS.fullmatch(thoughts) is None:
        raise ValueError(f"thoughts must be 1 to {WORDS} words of at most {WORD_CHARS} letters: {thoughts!r}")
    rows = [[int(value) if value.is_integer() else value for value in row] for row in rounded.tolist()]
    return json.dumps({"thoughts": thoughts, "waypoints": rows}, separators=(",", ":"))
