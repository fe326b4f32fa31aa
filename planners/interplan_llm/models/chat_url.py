"""A model behind any OpenAI-compatible chat URL: OpenAI, vLLM, Ollama, the llama.cpp server."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

from interplan_llm.models.answers import answered
from interplan_llm.models.constraints import grammar_of, response_format, schema_of
from interplan_llm.models.endpoint import Endpoint, HttpFailure, address
from interplan_llm.models.probing import PROBE_TIMEOUT_S, Dialect, probe
from interplan_llm.models.protocol import Capabilities, ModelFailure, Reply, Request
from interplan_sumo.errors import InputError

BACKOFF_S = (0.5, 1.0, 2.0)
"""Waits before the second, third and fourth attempt."""

RETRY_AFTER_CAP_S = 30.0
"""A server that asks for a longer wait is not waited for."""

_WORTH_REPEATING = ("connection", "rate_limit", "server")
_CHAT = "/chat/completions"


class ChatUrl:
    """One model of one server. What the server can do is tried out once, before the first question.

    The key comes from the environment and goes to this server only.
    """

    def __init__(
        self,
        base_url: str,
        model: str,
        *,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """InputError for a URL that is none, an empty model name, or without the library."""
        where = address(base_url)
        if not model:
            raise InputError(f"no model named for {where.url}; write {where.url}#MODEL")
        self.name = f"{where.url}#{model}"
        self._model = model
        self._endpoint = Endpoint(where)
        self._clock = clock
        self._sleep = sleep
        self._dialect: Dialect | None = None

    def __repr__(self) -> str:
        return f"ChatUrl({self.name!r})"

    @property
    def capabilities(self) -> Capabilities:
        """What the server can do; asks it the first time, which may load the model there. ModelFailure if it cannot."""
        return self._known(self._clock() + PROBE_TIMEOUT_S).capabilities

    def ask(self, request: Request) -> Reply:
        """The answer; ModelFailure with its cause and the time that it took."""
        began = self._clock()
        try:
            dialect = self._known(began + request.timeout_s)
            asked = self._clock()
            value = self._persistent(_body(self._model, request, dialect), began + request.timeout_s)
            reply = self._reply(value, self._clock() - asked)
        except ModelFailure as failure:
            failure.latency_s = self._clock() - began
            raise
        return answered(request, reply)

    def close(self) -> None:
        self._endpoint.close()

    def _known(self, deadline: float) -> Dialect:
        if self._dialect is None:
            self._dialect = probe(lambda body: self._persistent({"model": self._model, **body}, deadline))
        return self._dialect

    def _persistent(self, body: Mapping[str, Any], deadline: float) -> dict[str, Any]:
        """The answer to a body, asked again where that can help and the deadline allows."""
        waits = iter(BACKOFF_S)
        while True:
            try:
                return self._endpoint.post(_CHAT, body, self._left(deadline))
            except HttpFailure as failure:
                wait_s = next(waits, None)
                if wait_s is None or failure.cause not in _WORTH_REPEATING:
                    raise
                if failure.retry_after_s is not None:
                    wait_s = max(wait_s, failure.retry_after_s)
                if wait_s > RETRY_AFTER_CAP_S or self._clock() + wait_s >= deadline:
                    raise
            self._sleep(wait_s)

    def _left(self, deadline: float) -> float:
        left_s = deadline - self._clock()
        if left_s <= 0.0:
            raise HttpFailure("timeout", f"no answer from {self._endpoint.where.url} in time")
        return left_s

    def _reply(self, value: Mapping[str, Any], latency_s: float) -> Reply:
        try:
            chosen = value["choices"][0]
            text, finish = chosen["message"]["content"], chosen.get("finish_reason")
        except (LookupError, TypeError, AttributeError):
            raise ModelFailure("parse", f"{self._endpoint.where.url} answered no message") from None
        if not isinstance(text, str):
            raise ModelFailure("parse", f"{self._endpoint.where.url} answered a message without text")
        usage = value.get("usage")
        return Reply(
            text=text,
            prompt_tokens=_count(usage, "prompt_tokens"),
            completion_tokens=_count(usage, "completion_tokens"),
            latency_s=latency_s,
            model=self._model,
            provider=self._endpoint.where.url,
            finish_reason=finish if isinstance(finish, str) else "",
        )


def _body(model: str, request: Request, dialect: Dialect) -> dict[str, Any]:
    """A question in the words that the server was seen to understand."""
    body: dict[str, Any] = {"model": model, **dialect.plain(request)}
    can = dialect.capabilities
    if not request.constrained:
        return body
    if request.choices is not None and can.choice:
        body["structured_outputs"] = {"choice": list(request.choices)}
    elif request.choices is not None and can.grammar:
        body["grammar"] = grammar_of(request.choices)
    elif request.choices is not None and can.json_schema:
        body["response_format"] = response_format(schema_of(request.choices))
    elif request.schema is not None and can.json_schema:
        body["response_format"] = response_format(request.schema)
    return body


def _count(usage: Any, key: str) -> int:
    count = usage.get(key) if isinstance(usage, dict) else None
    return count if isinstance(count, int) and not isinstance(count, bool) and count >= 0 else 0
