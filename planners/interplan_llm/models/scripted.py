"""A model whose answers are given by code: for tests, and for yardsticks that need no model."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from itertools import cycle

from interplan_llm.models.answers import answered
from interplan_llm.models.protocol import Capabilities, ModelFailure, Reply, Request

Answers = Callable[[Request], str] | Iterable[str | ModelFailure]


class ScriptedModel:
    """Says what a function returns for each request, or one text of a list after the other.

    A ModelFailure in the list, or raised by the function, fails that
    question. A list that is used up fails with `missing`.
    """

    def __init__(self, answers: Answers, *, name: str = "scripted") -> None:
        self.name = name
        self._answer = answers if callable(answers) else _in_turn(iter(answers))

    @property
    def capabilities(self) -> Capabilities:
        return Capabilities(choice=True, seed=True)

    def ask(self, request: Request) -> Reply:
        began_s = time.perf_counter()
        text = self._answer(request)
        latency_s = time.perf_counter() - began_s
        return answered(
            request, Reply(text, latency_s=latency_s, model=self.name, provider="scripted", finish_reason="stop")
        )

    def close(self) -> None:
        pass


def always(*texts: str) -> ScriptedModel:
    """These texts in turn, over and over."""
    return ScriptedModel(cycle(texts), name=f"scripted:{','.join(texts)}")


def _in_turn(answers: Iterator[str | ModelFailure]) -> Callable[[Request], str]:
    def answer(_: Request) -> str:
        following = next(answers, None)
        if following is None:
            raise ModelFailure("missing", "the script has no further answer")
        if isinstance(following, ModelFailure):
            raise following
        return following

    return answer
