"""Conversation: a planner's greeting, and a request and its reply, whatever the other end of the channel may say."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import msgspec

from interplan_sumo.errors import clean_line
from interplan_sumo.planner_process.channel import LENGTH_BYTES, ChannelError, PlannerChannel
from interplan_sumo.planner_process.messages import MOST_SAID_BYTES, VERSION, Form, Greeting, Welcome

_R = TypeVar("_R")
_greetings = msgspec.json.Decoder(Greeting)


def greeting_of(channel: PlannerChannel, limit_s: float) -> Greeting:
    """What a planner says first; one that can drive is welcomed. ChannelError for anything else than a greeting."""
    greeting = _read(_greetings.decode, channel.receive_line(MOST_SAID_BYTES, limit_s))
    if greeting.error is None:
        if VERSION not in greeting.versions:
            raise ChannelError(f"speaks versions {list(greeting.versions)} of the protocol, this is {VERSION}")
        channel.send(msgspec.json.encode(Welcome()) + b"\n", limit_s)
    return greeting


def ask(channel: PlannerChannel, form: Form, request: dict[str, Any], limit_s: float) -> None:
    """Send a request; ChannelError if it is not taken in time."""
    message = form.encode(request)
    length = b"" if form.name == "json" else len(message).to_bytes(LENGTH_BYTES, "little")
    channel.send(length + message + (b"\n" if form.name == "json" else b""), limit_s)


def answer(channel: PlannerChannel, form: Form, read: Callable[[bytes], _R], most_bytes: int, limit_s: float) -> _R:
    """The reply to what was asked; ChannelError if what comes is none, or does not come in time."""
    if form.name == "json":
        return _read(read, channel.receive_line(most_bytes, limit_s))
    return _read(read, channel.receive(most_bytes, limit_s))


def _read(read: Callable[[bytes], _R], said: bytes) -> _R:
    try:
        return read(said)
    except (ValueError, RecursionError, MemoryError) as error:
        raise ChannelError(clean_line(f"was not answered as the protocol has it: {error}")) from None
