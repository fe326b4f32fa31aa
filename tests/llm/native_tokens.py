"""What llama.cpp makes of messages and tokens, asked through the library's own listener on the loopback."""

from __future__ import annotations

import json
import signal
import urllib.request
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from interplan_llm.models import native
from interplan_llm.models.protocol import Message


class Native:
    """A running model and the questions that planners never put to it."""

    def __init__(self, server: Any) -> None:
        self._server = server

    @property
    def address(self) -> str:
        return self._server.listening_address

    def prompt_text(self, messages: Sequence[Message]) -> str:
        turns = [{"role": message.role, "content": message.text} for message in messages]
        return self._said("/apply-template", {"messages": turns})["prompt"]

    def tokens(self, text: str) -> list[int]:
        """As in a prompt: with control tokens read, and those added that belong to each prompt."""
        return self._said("/tokenize", {"content": text, "add_special": True, "parse_special": True})["tokens"]

    def log_probabilities(self, tokens: Sequence[int], count: int = 20) -> dict[int, float]:
        """Of the likeliest next tokens."""
        asked = {"prompt": list(tokens), "n_predict": 1, "n_probs": count, "temperature": 0.0, "cache_prompt": False}
        letters = {"grammar": "root ::= [a-z]"}  # of an end, or of half a letter, it tells nothing
        (first,) = self._said("/completion", {**asked, **letters})["completion_probabilities"]
        return {each["id"]: each["logprob"] for each in first["top_logprobs"]}

    def _said(self, where: str, body: dict[str, Any]) -> dict[str, Any]:
        headers = {"Authorization": "Bearer sesame", "Content-Type": "application/json"}
        request = urllib.request.Request(self.address + where, json.dumps(body).encode(), headers)
        with urllib.request.urlopen(request, timeout=120.0) as answer:
            return json.load(answer)


@contextmanager
def native_model(path: Path, adapter: Path | None = None) -> Generator[Native]:
    """A model for the length of a block; Ctrl-C stays ours."""
    kept = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    adapters = [] if adapter is None else [(str(adapter), 1.0)]
    server = native.start(str(path), adapters, threads=1, context_tokens=2048, key="sesame")
    for number, handler in kept.items():
        signal.signal(number, handler)
    yield Native(server)
    del server
