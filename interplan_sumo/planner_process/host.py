"""Host: the planner's side of the channel for planners in Python: builds one and answers for it.

Started by `process`; whatever the planner does to this process, the benchmark is in another one.
"""

from __future__ import annotations

import faulthandler
import os
import sys
import time
from collections import deque
from collections.abc import Callable
from io import TextIOWrapper
from typing import Any, BinaryIO

import msgspec

from interplan_sumo.errors import InputError, clean_line
from interplan_sumo.plan_check import check_type
from interplan_sumo.planner import Past, Planner, load_planner
from interplan_sumo.planner_process.channel import LENGTH_BYTES
from interplan_sumo.planner_process.launcher import REPLIES, REQUESTS
from interplan_sumo.planner_process.map_message import MapRequest, StartRequest
from interplan_sumo.planner_process.messages import (
    MSGPACK,
    PROTOCOL,
    VERSION,
    Done,
    Failed,
    Greeting,
    PackedPlan,
    PlanRequest,
    ReportReply,
    ReportRequest,
    packed_plan,
)
from interplan_sumo.planner_seat import blame, own_report
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.roads import Roads

Reply = Done | Failed | ReportReply | PackedPlan


class Host:
    """A planner, the maps that it was sent, and the past that it was shown."""

    def __init__(self, planner: Planner) -> None:
        self._planner = planner
        self._maps: dict[int, Roads] = {}
        self._egos: deque[EgoState] = deque()
        self._actors: deque[Actors] = deque()

    def answer(self, request: MapRequest | StartRequest | PlanRequest | ReportRequest) -> Reply:
        """Do what is asked; whatever the planner raises is in the answer."""
        match request:
            case MapRequest():
                self._maps[request.map] = request.roads()
                return Done()
            case StartRequest():
                mission = request.mission(self._maps[request.map])
                return _called(lambda: self._planner.start(mission), "start()") or Done()
            case PlanRequest():
                return self._plan(request)
            case ReportRequest():
                return ReportReply(own_report(self._planner))

    def _plan(self, request: PlanRequest) -> PackedPlan | Failed:
        if request.past is not None:
            self._egos = deque((each.ego for each in request.past), len(request.past))
            self._actors = deque((each.actors.actors() for each in request.past), len(request.past))
        observation = request.observation(Past(tuple(self._egos), tuple(self._actors)))
        # Kept before the planner can do anything to them: what it changes is its own copy.
        self._egos.append(observation.ego)
        self._actors.append(observation.actors)
        found: list[PackedPlan] = []

        def call() -> None:
            began_s = time.perf_counter()
            plan = self._planner.plan(observation)
            wall_s = time.perf_counter() - began_s
            found.append(packed_plan(check_type(plan), wall_s))

        return _called(call, "plan()") or found[0]


def _called(call: Callable[[], object], what: str) -> Failed | None:
    try:
        call()
    except BaseException as error:
        return Failed(clean_line(blame(error, what)))
    return None


def run(about: dict[str, Any]) -> None:
    """Build the planner that `command` describes, and answer until nobody asks any more."""
    sys.argv = [about["planner"]]
    requests, replies = os.fdopen(REQUESTS, "rb"), os.fdopen(REPLIES, "wb", buffering=0)
    for each in (requests, replies):  # what the planner starts has no business with them
        os.set_inheritable(each.fileno(), False)
    faulthandler.enable()
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(line_buffering=True)  # what it prints is there when it fails
    home = os.getpid()
    greeting, host = _greeting(about["planner"])
    replies.write(msgspec.json.encode(greeting) + b"\n")
    if host is None or not requests.readline():
        return
    decoder = msgspec.msgpack.Decoder(MapRequest | StartRequest | PlanRequest | ReportRequest)
    while True:
        head = requests.read(LENGTH_BYTES)
        if len(head) < LENGTH_BYTES:
            return
        request = decoder.decode(requests.read(int.from_bytes(head, "little")))
        reply = host.answer(request)
        if os.getpid() != home:  # the planner forked, and its copy came back from plan()
            os._exit(0)
        _write(replies, _encoded(reply))


def _greeting(spec: str) -> tuple[Greeting, Host | None]:
    try:
        planner = load_planner(spec)
        told = callable(getattr(planner, "report", None))
        return Greeting(PROTOCOL, (VERSION,), "msgpack", told), Host(planner)
    except InputError as error:
        why = str(error)
    except BaseException as error:
        why = blame(error, f"planner {spec!r} could not be built: it")
    return Greeting(PROTOCOL, (VERSION,), error=clean_line(why)), None


def _encoded(reply: Reply) -> bytes:
    try:
        return MSGPACK.encode(reply)
    except Exception as error:  # only a report holds what a planner made
        return MSGPACK.encode(ReportReply({"error": clean_line(blame(error, "report()"))}))


def _write(replies: BinaryIO, message: bytes) -> None:
    left = memoryview(len(message).to_bytes(LENGTH_BYTES, "little") + message)
    while left:
        left = left[replies.write(left) :]
