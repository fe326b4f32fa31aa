"""From the text of a model to an answer: a choice that was offered, or plain JSON. Nothing is ever evaluated."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NoReturn

from interplan_llm.models.protocol import MAX_TEXT_BYTES, ModelFailure, Reply, Request, normal

MAX_JSON_DEPTH = 16
MAX_JSON_VALUES = 10_000

_MARKED = re.compile(r"<<([^<>]*)>>")
_FENCED = re.compile(r"```[a-z]*\n(.*?)```", re.DOTALL)
_SHOWN_CHARS = 60
"""As much of an unusable answer as a message quotes."""


def answered(request: Request, reply: Reply) -> Reply:
    """`reply` with its choice or data read from its text; ModelFailure that carries the reply if it holds none."""
    try:
        if len(reply.text) > MAX_TEXT_BYTES:
            raise ModelFailure("too_long", f"the answer has {len(reply.text)} characters, over {MAX_TEXT_BYTES}")
        if request.choices is not None:
            return replace(reply, choice=read_choice(reply.text, request.choices, request.vocabulary))
        if request.schema is not None:
            return replace(reply, data=read_json(reply.text))
    except ModelFailure as failure:
        raise ModelFailure(failure.cause, failure.message, latency_s=reply.latency_s, reply=reply) from None
    return reply


def read_choice(text: str, choices: Sequence[str], vocabulary: Sequence[str] = ()) -> str:
    """The choice that a text means.

    In this order: the text is a choice; it is a JSON object whose `choice` is
    one; its last `<<marked>>` word is one; exactly one word of choices and
    vocabulary occurs in it as a whole word. Case, spaces, hyphens and
    underscores do not matter. Raises ModelFailure: `not_offered` for a word
    of the vocabulary that is not a choice, `parse` for everything else.
    """
    if len(text) > MAX_TEXT_BYTES:
        raise ModelFailure("too_long", f"the answer has {len(text)} characters, over {MAX_TEXT_BYTES}")
    offered = {normal(word): word for word in choices}
    known = {**{normal(word): word for word in vocabulary}, **offered}
    said = _said(text, known)
    if said in offered:
        return offered[said]
    if said in known:
        raise ModelFailure("not_offered", f"the answer {known[said]!r} was not offered; offered: {', '.join(choices)}")
    raise ModelFailure("parse", f"no choice in the answer {_shown(text)}; offered: {', '.join(choices)}")


def read_json(text: str) -> Any:
    """The JSON value of a text, or of the last fenced block in it.

    Numbers must be finite, keys unique; at most `MAX_JSON_DEPTH` levels and
    `MAX_JSON_VALUES` values. Raises ModelFailure (`parse`, `too_long`).
    """
    if len(text) > MAX_TEXT_BYTES:
        raise ModelFailure("too_long", f"the answer has {len(text)} characters, over {MAX_TEXT_BYTES}")
    fenced = _FENCED.findall(text)
    try:
        value = json.loads(fenced[-1] if fenced else text, object_pairs_hook=_unique, parse_constant=_not_finite)
        _check(value)
    except RecursionError:
        raise ModelFailure("parse", f"the JSON of the answer has more than {MAX_JSON_DEPTH} levels") from None
    except ValueError as error:
        raise ModelFailure("parse", f"no JSON in the answer {_shown(text)}: {error}") from None
    return value


def _said(text: str, known: dict[str, str]) -> str:
    """The one word that the text says, in normal form; empty if none or several."""
    whole = normal(text.strip(" \t\r\n\"'`.*"))
    if whole in known:
        return whole
    if text.lstrip().startswith("{"):
        return _said_in_json(text)
    marked = _MARKED.findall(text)
    if marked:
        return normal(marked[-1])
    longest_first = sorted(known, key=len, reverse=True)
    pattern = "|".join(re.escape(word) for word in longest_first)
    found = set(re.findall(rf"(?<!\w)(?:{pattern})(?!\w)", normal(text)))
    return found.pop() if len(found) == 1 else ""


def _said_in_json(text: str) -> str:
    try:
        value = read_json(text)
    except ModelFailure:
        return ""
    word = value.get("choice") if isinstance(value, dict) else None
    return normal(word) if isinstance(word, str) else ""


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise ValueError("a key occurs twice")
    return found


def _not_finite(text: str) -> NoReturn:
    raise ValueError(f"{text} is not a finite number")


def _check(value: Any) -> None:
    """ValueError for a JSON value that is too deep, too large or holds a number that is not finite."""
    level, values = [value], 0
    for _ in range(MAX_JSON_DEPTH):
        values += len(level)
        if values > MAX_JSON_VALUES:
            raise ValueError(f"more than {MAX_JSON_VALUES} values")
        for number in level:
            if isinstance(number, int | float) and not _finite(number):
                raise ValueError("a number is not finite")
        level = [inner for outer in level for inner in _inside(outer)]
        if not level:
            return
    raise ValueError(f"more than {MAX_JSON_DEPTH} levels")


def _inside(value: Any) -> list[Any]:
    if isinstance(value, dict):
        return list(value.values())
    return value if isinstance(value, list) else []


def _finite(number: float) -> bool:
    try:
        return math.isfinite(number)
    except OverflowError:  # an integer beyond the range of float
        return False


def _shown(text: str) -> str:
    return repr(text if len(text) <= _SHOWN_CHARS else f"{text[:_SHOWN_CHARS]}...")
