"""What a chat server understands, found out by asking it: many ignore in silence what they do not know."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from interplan_llm.models.answers import read_choice, read_json
from interplan_llm.models.constraints import grammar_of, response_format, schema_of
from interplan_llm.models.endpoint import HttpFailure
from interplan_llm.models.protocol import Capabilities, Message, ModelFailure, Request

PROBE_TIMEOUT_S = 120.0
"""For all questions together: the first one may make the server load the model."""

Post = Callable[[Mapping[str, Any]], dict[str, Any]]

_QUESTION = Request((Message("user", "Say hello."),))
_UNASKED = ("zx-71", "qj-94")
"""Nothing that a model would say to the question, unless it is held to it."""

_BAD_REQUEST = (400, 422)


@dataclass(frozen=True, slots=True)
class Dialect:
    """How a server wants to be asked."""

    limit: str = "max_tokens"
    """Name of the field; OpenAI's newer models want `max_completion_tokens`."""
    temperature: bool = True
    """Whether a temperature may be given; reasoning models refuse it."""
    seed: bool = True
    capabilities: Capabilities = field(default_factory=Capabilities)

    def plain(self, request: Request) -> dict[str, Any]:
        """A question and its sampling, without what may be answered."""
        messages = [{"role": message.role, "content": message.text} for message in request.messages]
        fields: dict[str, Any] = {"messages": messages, self.limit: request.max_tokens}
        if self.temperature:
            fields["temperature"] = request.temperature
        if self.seed:
            fields["seed"] = request.seed
        return fields


_DIALECTS = (
    Dialect(),
    Dialect(limit="max_completion_tokens"),
    Dialect(limit="max_completion_tokens", temperature=False),
    Dialect(seed=False),
    Dialect(limit="max_completion_tokens", temperature=False, seed=False),
)


def probe(post: Post) -> Dialect:
    """The dialect of a server; ModelFailure if it answers nothing at all.

    An option counts as understood if the server takes it and the answer
    obeys: a question about nothing, answered with one of two words that
    nobody would say.
    """
    dialect, plain = _first_accepted(post)
    asked = dialect.plain(_QUESTION)

    def obeys(option: Mapping[str, Any]) -> bool:
        text = _text(_tried(post, {**asked, **option}))
        return text is not None and _is_unasked(text)

    capabilities = Capabilities(
        choice=obeys({"structured_outputs": {"choice": list(_UNASKED)}}),
        grammar=obeys({"grammar": grammar_of(_UNASKED)}),
        json_schema=obeys({"response_format": response_format(schema_of(_UNASKED))}),
        logprobs=_has_logprobs(_tried(post, {**asked, "logprobs": True})),
        seed=dialect.seed,
        prompt_cache=_counts_cached_tokens(plain),
    )
    return replace(dialect, capabilities=capabilities)


def _first_accepted(post: Post) -> tuple[Dialect, dict[str, Any]]:
    """The first dialect that is not refused as a bad request; the failure of the plainest one if all are."""
    refused: HttpFailure | None = None
    for dialect in _DIALECTS:
        try:
            return dialect, post(dialect.plain(_QUESTION))
        except HttpFailure as failure:
            if failure.cause != "refused" or failure.status not in _BAD_REQUEST:
                raise
            refused = refused or failure
    assert refused is not None
    raise refused


def _tried(post: Post, body: Mapping[str, Any]) -> dict[str, Any]:
    """The answer, empty where the server refuses the option or breaks on it; other failures are no answer and rise."""
    try:
        return post(body)
    except HttpFailure as failure:
        if failure.cause in ("refused", "server", "parse", "too_long"):
            return {}
        raise


def _text(value: Mapping[str, Any]) -> str | None:
    try:
        text = value["choices"][0]["message"]["content"]
    except (LookupError, TypeError):
        return None
    return text if isinstance(text, str) else None


def _is_unasked(text: str) -> bool:
    """Whether the text is one of the words, bare or as the schema wants it, and nothing else."""
    if text.strip() in _UNASKED:
        return True
    try:
        read_json(text)
        return read_choice(text, _UNASKED) in _UNASKED
    except ModelFailure:
        return False


def _has_logprobs(value: Mapping[str, Any]) -> bool:
    try:
        return value["choices"][0]["logprobs"]["content"] is not None
    except (LookupError, TypeError):
        return False


def _counts_cached_tokens(value: Mapping[str, Any]) -> bool:
    try:
        return value["usage"]["prompt_tokens_details"]["cached_tokens"] is not None
    except (LookupError, TypeError):
        return False
