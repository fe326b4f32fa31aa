"""What a language model is asked and what it returns, the same for every provider."""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass
from typing import Any, Literal, Protocol, get_args, runtime_checkable

from interplan_sumo.errors import InterplanError

Role = Literal["system", "user", "assistant"]

Cause = Literal[
    "timeout", "connection", "rate_limit", "server", "refused", "too_long", "parse", "not_offered", "missing"
]
"""Why there is no usable answer: no answer in time; no connection, or one that broke; HTTP 429; HTTP 5xx; any other
refusal (4xx, a redirect); a question or an answer over the limit; text that holds no answer; an answer that was not
among the choices; nothing recorded."""

CAUSES: tuple[Cause, ...] = get_args(Cause)
MAX_TEXT_BYTES = 100_000
"""Longer answers are not read."""
MAX_TIMEOUT_S = 1e6
"""Eleven days; threads and sockets cannot wait for ever."""
_BETWEEN = re.compile(r"[\s_-]+")


def check_timeout(timeout_s: float) -> None:
    """ValueError for a time for which no answer can be waited."""
    if not 0.0 < timeout_s <= MAX_TIMEOUT_S:
        raise ValueError(f"timeout_s is {timeout_s}, expected more than 0 and at most {MAX_TIMEOUT_S:g}")


def normal(word: str) -> str:
    """A word in lower case with single spaces in it: two spellings are the same word if this is."""
    return _BETWEEN.sub(" ", word.casefold()).strip()


@dataclass(frozen=True, slots=True)
class Message:
    """One turn of a conversation."""

    role: Role
    text: str


@dataclass(frozen=True, slots=True)
class Request:
    """A question: free text, one of `choices`, or JSON that follows `schema`.

    Raises ValueError, or TypeError for a schema that is not JSON, if no model could answer as asked.
    """

    messages: tuple[Message, ...]
    choices: tuple[str, ...] | None = None
    """What may be answered; words that differ in more than case, spaces, hyphens and underscores."""
    vocabulary: tuple[str, ...] = ()
    """Further words that have a meaning but are not offered now: said, they fail as `not_offered`."""
    schema: dict[str, Any] | None = None
    """A closed JSON schema: `additionalProperties` false and every property required, as OpenAI demands."""
    grammar: str | None = None
    """The schema in GBNF, where it must say more than a schema can: blanks, digits. For the embedded model only."""
    constrained: bool = True
    """Hold the model to the choices or the schema where its provider can; False lets it think aloud first."""
    max_tokens: int = 32
    temperature: float = 0.0
    seed: int = 0
    timeout_s: float = 60.0
    """Wall clock for everything, repeated attempts included."""

    def __post_init__(self) -> None:
        if not self.messages:
            raise ValueError("a request needs at least one message")
        if self.choices is not None:
            self._check_choices(self.choices)
        if self.schema is not None:
            json.dumps(self.schema, allow_nan=False)
        if self.grammar is not None and self.schema is None:
            raise ValueError("a grammar needs the schema that it narrows, for providers that take no grammar")
        if self.max_tokens < 1:
            raise ValueError(f"max_tokens is {self.max_tokens}, expected at least 1")
        if not (math.isfinite(self.temperature) and self.temperature >= 0.0):
            raise ValueError(f"temperature is {self.temperature}, expected 0 or more")
        check_timeout(self.timeout_s)

    def _check_choices(self, choices: tuple[str, ...]) -> None:
        if self.schema is not None:
            raise ValueError("a request has choices or a schema, not both")
        if not choices:
            raise ValueError("choices are empty; give None for free text")
        for word in (*choices, *self.vocabulary):
            if not word.isprintable() or not normal(word) or set(word) & set('<>"\\'):
                raise ValueError(f'{word!r} cannot be a choice: printable, without < > " and backslash, not blank')
        if len({normal(word) for word in choices}) != len(choices):
            raise ValueError(f"choices must differ in more than case and spaces: {', '.join(choices)}")


@dataclass(frozen=True, slots=True)
class Reply:
    """An answer that can be used."""

    text: str
    """As the model gave it."""
    choice: str | None = None
    """The one of `Request.choices` that it means, where there were any."""
    data: Any = None
    """The JSON value that it holds, where a schema was given; its shape is for the caller to check."""
    prompt_tokens: int = 0
    """0 where the provider does not say, as for `completion_tokens`."""
    completion_tokens: int = 0
    latency_s: float = 0.0
    """From the question to the answer, repeated attempts and waiting between them included."""
    model: str = ""
    provider: str = ""
    finish_reason: str = ""


@dataclass(frozen=True, slots=True)
class Capabilities:
    """What a provider can do: found out by trying, not believed."""

    json_schema: bool = False
    choice: bool = False
    """Takes a list of choices as such."""
    grammar: bool = False
    """Takes a GBNF grammar."""
    logprobs: bool = False
    seed: bool = False
    prompt_cache: bool = False
    """Reuses the beginning of the previous prompt."""


class ModelFailure(InterplanError):  # noqa: N818 - an expected outcome that callers count
    """No usable answer. `reply` is the one that could not be used, if there was any."""

    def __init__(self, cause: Cause, message: str, *, latency_s: float = 0.0, reply: Reply | None = None) -> None:
        super().__init__(message)
        self.cause: Cause = cause
        self.message = message
        self.latency_s = latency_s
        self.reply = reply


@runtime_checkable
class LanguageModel(Protocol):
    """Answers one question at a time; whatever goes wrong while it does is a ModelFailure."""

    @property
    def name(self) -> str:
        """What answers, exactly enough that equal names and equal questions may be expected to give equal answers."""
        ...

    @property
    def capabilities(self) -> Capabilities: ...

    def ask(self, request: Request) -> Reply: ...

    def close(self) -> None:
        """Give back what it holds; may be called twice."""
        ...
