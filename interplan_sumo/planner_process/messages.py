"""Messages: what the benchmark and a planner say to each other, in two forms: msgpack, and JSON lines.

Requests are made of the same plain values for both: an array of numbers is packed as the form has it. Replies are
declared types, so that nothing that was not asked for is ever built from foreign bytes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Annotated, Any, Final, Literal

import msgspec
import numpy as np
from msgspec import Meta, Struct
from numpy.typing import ArrayLike, NDArray

from interplan_sumo.planner import Mission, Observation, Past
from interplan_sumo.world.actors import ACTOR_COLUMNS, Actors
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.signals import Signals
from interplan_sumo.world.trajectory import Trajectory

PROTOCOL: Final = "interplan-sumo/planner"
VERSION: Final = 1
MOST_SAID_BYTES: Final = 1 << 16
"""Of any reply that is no plan."""
MOST_PLAN_BYTES: Final = 1 << 20
"""Of a plan: 26,000 poses."""

Pack = Callable[[NDArray[Any]], Any]
"""An array as a message holds it."""
Text = Annotated[str, Meta(max_length=MOST_SAID_BYTES)]


# --- the handshake: one JSON line each ---------------------------------------------------------


class Greeting(Struct, frozen=True):
    """The first line that a planner says, once it can drive."""

    protocol: Literal["interplan-sumo/planner"]
    versions: Annotated[tuple[int, ...], Meta(max_length=100)] = ()
    """Of the protocol, those that it speaks."""
    form: Literal["msgpack", "json"] = "msgpack"
    report: bool = False
    """Whether it answers `report`."""
    error: Text | None = None
    """Why it cannot drive at all."""


class Welcome(Struct, frozen=True):
    """What the benchmark answers."""

    version: int = VERSION
    protocol: str = PROTOCOL


# --- replies -----------------------------------------------------------------------------------


class Done(Struct, frozen=True, tag="ok"):
    """A map was kept, or a drive is begun."""


class Failed(Struct, frozen=True, tag="error"):
    """The planner cannot do it."""

    message: Text


class ReportReply(Struct, frozen=True, tag="report"):
    """What the planner says of the drive."""

    report: dict[str, Any] | None


class PackedPlan(Struct, frozen=True, tag="plan"):
    """A trajectory, each column as little-endian float64."""

    time_s: bytes
    x_m: bytes
    y_m: bytes
    heading_rad: bytes
    speed_mps: bytes | None = None
    wall_s: float | None = None
    """What it took, by the planner's own clock."""


class ListedPlan(Struct, frozen=True, tag="plan"):
    """A trajectory, each column as a list."""

    time_s: list[float]
    x_m: list[float]
    y_m: list[float]
    heading_rad: list[float]
    speed_mps: list[float] | None = None
    wall_s: float | None = None


PlanReply = PackedPlan | ListedPlan


def trajectory(reply: PlanReply) -> Trajectory:
    """The plan of a reply; ValueError if it is none."""
    return Trajectory(
        _unpacked(reply.time_s), _unpacked(reply.x_m), _unpacked(reply.y_m), _unpacked(reply.heading_rad),
        None if reply.speed_mps is None else _unpacked(reply.speed_mps),
    )  # fmt: skip


def packed_plan(plan: Trajectory, wall_s: float) -> PackedPlan:
    """A trajectory as it goes to the benchmark; whatever is wrong with it raises."""
    speed_mps = None if plan.speed_mps is None else packed(plan.speed_mps)
    return PackedPlan(
        packed(plan.time_s), packed(plan.x_m), packed(plan.y_m), packed(plan.heading_rad), speed_mps, wall_s
    )


# --- forms -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Form:
    """How messages are written."""

    name: Literal["msgpack", "json"]
    pack: Pack
    encode: Callable[[Any], bytes]
    """A request as bytes."""
    done: Callable[[bytes], Done | Failed]
    """Replies from bytes, by what was asked: whatever they raise, the bytes are no such reply."""
    plan: Callable[[bytes], PlanReply | Failed]
    report: Callable[[bytes], ReportReply | Failed]


def packed(values: ArrayLike) -> bytes:
    """Numbers as little-endian float64."""
    return np.ascontiguousarray(values, dtype="<f8").tobytes()


def _packed(array: NDArray[Any]) -> bytes:
    return array.tobytes() if array.dtype == np.int8 else packed(array)


def _unpacked(values: bytes | list[float]) -> NDArray[np.float64]:
    return np.frombuffer(values, dtype="<f8") if isinstance(values, bytes) else np.array(values)


def _plain(value: Any) -> Any:
    """numpy's scalars, which are no numbers to msgspec."""
    return value.item()


MSGPACK: Final = Form(
    "msgpack",
    _packed,
    msgspec.msgpack.Encoder(enc_hook=_plain).encode,
    msgspec.msgpack.Decoder(Done | Failed).decode,
    msgspec.msgpack.Decoder(PackedPlan | Failed).decode,
    msgspec.msgpack.Decoder(ReportReply | Failed).decode,
)
JSON_LINES: Final = Form(
    "json",
    lambda array: array.tolist(),
    msgspec.json.Encoder(enc_hook=_plain).encode,
    msgspec.json.Decoder(Done | Failed).decode,
    msgspec.json.Decoder(ListedPlan | Failed).decode,
    msgspec.json.Decoder(ReportReply | Failed).decode,
)
FORMS: Final = {form.name: form for form in (MSGPACK, JSON_LINES)}


# --- requests ----------------------------------------------------------------------------------


def start_request(mission: Mission, slot: int) -> dict[str, Any]:
    """A mission on the map that was sent under this number."""
    return {
        "type": "start",
        "map": slot,
        "route": mission.route,
        "goal": asdict(mission.goal),
        "shape": asdict(mission.shape),
        "dt_s": mission.dt_s,
    }


def plan_request(observation: Observation, pack: Pack, *, with_past: bool) -> dict[str, Any]:
    """The present; with the 2 s before it where the planner cannot know them."""
    request: dict[str, Any] = {
        "type": "plan",
        "time_s": observation.time_s,
        "ego": observation.ego,
        "actors": _actors_message(observation.actors, pack),
        "signals": {
            "connector_ids": observation.signals.connector_ids,
            "status": pack(observation.signals.status),
        },
    }
    if with_past:
        past = zip(observation.past.egos, observation.past.actors, strict=True)
        request["past"] = [{"ego": ego, "actors": _actors_message(actors, pack)} for ego, actors in past]
    return request


def _actors_message(actors: Actors, pack: Pack) -> dict[str, Any]:
    message: dict[str, Any] = {name: pack(getattr(actors, name)) for name in ACTOR_COLUMNS}
    message["ids"] = actors.ids
    return message


# --- requests as our own host reads them ---------------------------------------------------------


class PackedActors(Struct, frozen=True, gc=False):
    ids: tuple[str, ...]
    kind: bytes
    x_m: bytes
    y_m: bytes
    heading_rad: bytes
    length_m: bytes
    width_m: bytes
    vx_mps: bytes
    vy_mps: bytes

    def actors(self) -> Actors:
        columns = [np.frombuffer(getattr(self, n), np.int8 if n == "kind" else "<f8") for n in ACTOR_COLUMNS]
        return Actors.trusted(self.ids, *columns)


class PackedSignals(Struct, frozen=True, gc=False):
    connector_ids: tuple[str, ...]
    status: bytes

    def signals(self) -> Signals:
        return Signals(self.connector_ids, np.frombuffer(self.status, np.int8))


class PastFrame(Struct, frozen=True, gc=False):
    ego: EgoState
    actors: PackedActors


class PlanRequest(Struct, frozen=True, tag="plan"):
    time_s: float
    ego: EgoState
    actors: PackedActors
    signals: PackedSignals
    past: tuple[PastFrame, ...] | None = None

    def observation(self, past: Past) -> Observation:
        """With the past as it was kept."""
        return Observation(self.time_s, self.ego, self.actors.actors(), self.signals.signals(), past)


class ReportRequest(Struct, frozen=True, tag="report"):
    pass
