"""Small questions, and a clock and a bed of their own: no test waits for a back-off."""

from __future__ import annotations

from typing import Any

from interplan_llm.models.protocol import Message, Request

CHOICES = ("follow", "merge_left", "stop")
SYSTEM = Message("system", "You choose what an automated car does for the next second. Answer with one option.")


def question(text: str = "A car stands 12 m ahead.", **fields: Any) -> Request:
    """One of CHOICES is asked for, unless `fields` say otherwise."""
    asked: dict[str, Any] = {"choices": CHOICES, "timeout_s": 5.0, **fields}
    return Request((SYSTEM, Message("user", text)), **asked)


class Time:
    """A clock that only sleeping moves."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.slept_s: list[float] = []

    def clock(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.slept_s.append(seconds)
        self.now_s += seconds
