"""The channel: whatever comes through it, the parent neither raises, nor hangs, nor takes memory."""

from __future__ import annotations

import os
import threading
import time
import tracemalloc
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from interplan_sumo.planner_process.awake import LONGEST_STEP_S, AwakeClock
from interplan_sumo.planner_process.channel import KEPT_BYTES, ChannelError, Overdue, PlannerChannel
from interplan_sumo.planner_process.conversation import answer, ask, greeting_of
from interplan_sumo.planner_process.messages import (
    JSON_LINES,
    MOST_PLAN_BYTES,
    MSGPACK,
    Form,
    PackedPlan,
    packed,
    trajectory,
)

LIMIT_S = 0.01
AHEAD = np.arange(5.0)
COLUMN = packed(AHEAD)
WHOLE = msgspec.msgpack.encode(PackedPlan(COLUMN, COLUMN, COLUMN, COLUMN, None, 0.001))


@contextmanager
def open_channel() -> Generator[tuple[PlannerChannel, int, int, int]]:
    """A channel, and the ends that a planner has: requests, replies, what it prints to."""
    (asked, ask), (hear, told), (read, printed) = os.pipe(), os.pipe(), os.pipe()
    channel = PlannerChannel(ask, hear, read, lambda: True)
    try:
        yield channel, asked, told, printed
    finally:
        channel.close()
        for each in (asked, told, printed):
            with suppress(OSError):
                os.close(each)


def framed(message: bytes) -> bytes:
    return len(message).to_bytes(4, "little") + message


def exchanged(data: bytes, form: Form = MSGPACK, read: Callable[[bytes], Any] | None = None) -> Any:
    """What is made of these bytes where a plan was asked for."""
    with open_channel() as (channel, asked, told, _):

        def spoken() -> None:
            os.read(asked, 1 << 16)
            with suppress(BrokenPipeError):
                os.write(told, data)

        planner = threading.Thread(target=spoken)
        planner.start()
        try:
            ask(channel, form, {"type": "plan"}, LIMIT_S)
            return answer(channel, form, read or form.plan, MOST_PLAN_BYTES, LIMIT_S)
        finally:
            channel.close()
            planner.join()


@st.composite
def damaged(draw: st.DrawFn) -> bytes:
    """A plan with some bytes changed, cut somewhere."""
    whole = bytearray(framed(WHOLE))
    for _ in range(draw(st.integers(1, 6))):
        whole[draw(st.integers(0, len(whole) - 1))] = draw(st.integers(0, 255))
    return bytes(whole[: draw(st.integers(0, len(whole)))])


@pytest.mark.slow
@settings(max_examples=100, deadline=None)
@given(st.one_of(st.binary(max_size=400), st.binary(max_size=300).map(framed), damaged()))
def test_no_bytes_make_the_parent_raise_or_hang(data: bytes) -> None:
    began_s = time.monotonic()
    for form in (MSGPACK, JSON_LINES):
        with suppress(ChannelError):
            reply = exchanged(data if form is MSGPACK else data + b"\n", form)
            with suppress(ValueError):
                trajectory(reply) if hasattr(reply, "x_m") else reply
    with open_channel() as (channel, _, told, _), suppress(ChannelError):
        os.write(told, data + b"\n")
        greeting_of(channel, LIMIT_S)
    assert time.monotonic() - began_s < 10.0


@pytest.mark.parametrize(
    ("form", "message"),
    [
        (MSGPACK, b"\x91" * MOST_PLAN_BYTES),
        (MSGPACK, b"\xdd\x00\x0f\xff\x00" + b"\x80" * (MOST_PLAN_BYTES - 5)),
        (MSGPACK, b"\x82\xa4type\xa4plan\xa1x\xdd\x00\x0f\xf0\x00" + b"\x80" * (MOST_PLAN_BYTES - 20)),
        (JSON_LINES, b"[" * (MOST_PLAN_BYTES - 1)),
        (JSON_LINES, b'{"type":"plan","time_s":[' + b"0," * (MOST_PLAN_BYTES // 2 - 20) + b"0]}"),
    ],
)
def test_no_message_takes_more_memory_than_fifty_megabytes(form: Form, message: bytes) -> None:
    tracemalloc.start()
    try:
        with pytest.raises((ValueError, RecursionError)):
            form.plan(message)
        assert tracemalloc.get_traced_memory()[1] < 50 << 20
    finally:
        tracemalloc.stop()


def test_a_plan_comes_through_to_the_last_bit() -> None:
    plan = trajectory(exchanged(framed(WHOLE)))
    assert plan.x_m.tobytes() == AHEAD.tobytes()


@pytest.mark.parametrize("extra", [0, 1])
def test_a_message_may_be_as_long_as_the_bound(extra: int) -> None:
    with open_channel() as (channel, _, told, _):
        os.write(told, framed(b"x" * (100 + extra)))
        if extra:
            with pytest.raises(ChannelError, match="announced a message of 101 bytes, at most 100"):
                channel.receive(100, LIMIT_S)
        else:
            assert channel.receive(100, LIMIT_S) == b"x" * 100


def test_who_answers_twice_is_found_out_at_the_next_request() -> None:
    with open_channel() as (channel, _, told, _):
        os.write(told, framed(b"one") + framed(b"two"))
        assert channel.receive(100, LIMIT_S) == b"one"
        with pytest.raises(ChannelError, match="without having been asked"):
            channel.send(b"more", LIMIT_S)


def test_a_request_that_nobody_reads_is_given_up_in_time() -> None:
    with open_channel() as (channel, _, _, _), pytest.raises(Overdue):
        channel.send(b"x" * (1 << 20), LIMIT_S)


def test_what_is_printed_is_read_and_its_end_kept() -> None:
    with open_channel() as (channel, _, told, printed):
        for _ in range(3):
            os.write(printed, b"y" * 60_000)
            os.write(told, framed(b"one"))
            assert channel.receive(100, 1.0) == b"one"
        os.write(printed, b"last words \xff")
        assert channel.printed.endswith("last words \ufffd")
        assert len(channel.printed) == KEPT_BYTES


@pytest.mark.parametrize(("gap_s", "counted_s"), [(LONGEST_STEP_S, LONGEST_STEP_S), (3600.0, LONGEST_STEP_S)])
def test_a_pause_of_the_machine_does_not_count(gap_s: float, counted_s: float) -> None:
    at_s = [0.0]
    clock = AwakeClock(lambda: at_s[0])
    at_s[0] = gap_s
    assert clock.now_s() == counted_s
    at_s[0] += 0.1
    assert clock.now_s() == pytest.approx(counted_s + 0.1)
