"""A list of choices in the forms that servers understand: a GBNF grammar, a JSON schema."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any


def grammar_of(choices: Sequence[str]) -> str:
    """A GBNF grammar whose sentences are the choices; they hold neither quotes nor backslashes."""
    return "root ::= " + " | ".join(f'"{choice}"' for choice in choices)


def schema_of(choices: Sequence[str]) -> dict[str, Any]:
    """The schema of an object whose only property `choice` is one of the choices."""
    return {
        "type": "object",
        "properties": {"choice": {"type": "string", "enum": list(choices)}},
        "required": ["choice"],
        "additionalProperties": False,
    }


def response_format(schema: Mapping[str, Any]) -> dict[str, Any]:
    """OpenAI's `response_format` for a schema."""
    return {"type": "json_schema", "json_schema": {"name": "answer", "strict": True, "schema": dict(schema)}}
