"""Recording: where everybody was in a drive, unrolled along the corridor, to plan the next try against.

Most agents do in the next try what they did in this one. What lies beyond the
last recorded frame is taken to go on as it did.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.scenario.route import route_centerline
from interplan_sumo.simulation.episode import DT_S
from interplan_sumo.simulation.pedestrians import Crowd
from interplan_sumo.verification.corridor import FrenetCorridor
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.geometry import Floats, Ints, wrap_angle
from interplan_sumo.world.signals import Signals, SignalStatus
from interplan_sumo.world.trace import Trace

SAME_WAY = 0.7
"""From this cosine of its heading with the line's on an agent drives the ego's way."""


@dataclass(frozen=True, slots=True, eq=False)
class ObservedTraffic:
    """N others over F frames, 0.1 s apart; not a number where one is absent."""

    near_m: Floats
    """(N, F) arc at which each begins."""
    far_m: Floats
    """(N, F) arc at which it ends."""
    right_m: Floats
    """(N, F) offset of its right side from the line, left positive."""
    left_m: Floats
    """(N, F)"""
    along_mps: Floats
    """(N, F) speed along the line, negative against it."""
    across_mps: Floats
    """(N, F) speed to the left."""
    follows: NDArray[np.bool_]
    """(N, F) whether it drives the ego's way, and so stays behind the ego once it is."""
    walks: NDArray[np.bool_]
    """(N,) whether it is a pedestrian."""
    behaviour: NDArray[np.object_]
    """(N,) name of its behaviour type, '' of pedestrians."""

    @property
    def frames(self) -> int:
        return self.near_m.shape[1]

    def joined(self, other: ObservedTraffic) -> ObservedTraffic:
        """This and another recording of as many frames."""
        return ObservedTraffic(*(np.concatenate((getattr(self, f.name), getattr(other, f.name))) for f in fields(self)))


def recording(corridor: FrenetCorridor, trace: Trace, frames: int) -> ObservedTraffic:
    """The agents of a drive: what stands from the start and who crosses on foot are left out."""
    actors = trace.actors
    rows = np.flatnonzero(actors.behaviour.astype(bool))
    ids, first = np.unique(actors.ids[rows].astype(str), return_index=True)
    number = np.searchsorted(ids, actors.ids[rows].astype(str))
    boxes = np.stack(
        [getattr(actors, n)[rows] for n in ("x_m", "y_m", "heading_rad", "length_m", "width_m", "vx_mps", "vy_mps")],
        axis=1,
    )
    behaviour = actors.behaviour[rows[first]]
    return _unrolled(corridor, boxes, number, actors.frame[rows], len(trace), frames, behaviour, walks=False)


def walkers(
    corridor: FrenetCorridor, states: Sequence[EgoState], frames: int
) -> tuple[ObservedTraffic, tuple[int | None, ...]]:
    """The jaywalkers that an ego with these states sets off, and the frame in which each sets off (None: never)."""
    scenario = corridor.scenario
    ids = tuple(f"{i:04d}" for i in range(len(scenario.jaywalkers)))
    crowd = Crowd(scenario, corridor.roads, route_centerline(corridor.roads, scenario), ids, DT_S)
    seen: list[Actors] = []
    for k in range(frames):
        seen.append(crowd.observe())
        if k < len(states):
            crowd.notice(states[k], PACIFICA)
        crowd.advance()
    many = len(ids)
    names = ("x_m", "y_m", "heading_rad", "length_m", "width_m", "vx_mps", "vy_mps")
    boxes = np.stack([np.concatenate([getattr(a, name) for a in seen]) for name in names], axis=1)
    number, frame = np.tile(np.arange(many), frames), np.repeat(np.arange(frames), many)
    moving = np.array([a.speed_mps > 0.0 for a in seen]).reshape(frames, many)
    began = tuple(int(np.argmax(column)) if column.any() else None for column in moving.T)
    nameless = np.full(many, "", dtype=object)
    return _unrolled(corridor, boxes, number, frame, frames, frames, nameless, walks=True), began


def red_frames(corridor: FrenetCorridor, signals: Sequence[Signals], frames: int) -> dict[str, NDArray[np.bool_]]:
    """(F,) per connector on the lane paths with a light: in which frames it shows red.

    Lights do not depend on the ego; beyond the last frame they stay as they are.
    """
    ours = {lane for lane_path in corridor.lane_paths for lane in lane_path.lanes if lane in corridor.roads.connectors}
    lit = sorted(lane for lane in ours if corridor.roads.connectors[lane].has_traffic_light)
    found: dict[str, NDArray[np.bool_]] = {}
    for lane in lit:
        shown = [_status(each, lane) is SignalStatus.RED for each in signals[:frames]]
        shown += [shown[-1] if shown else False] * (frames - len(shown))
        found[lane] = np.array(shown, dtype=np.bool_)
    return found


def _status(signals: Signals, connector: str) -> SignalStatus | None:
    if connector not in signals.connector_ids:
        return None
    return SignalStatus(int(signals.status[signals.connector_ids.index(connector)]))


def _unrolled(
    corridor: FrenetCorridor,
    boxes: Floats,
    number: Ints,
    frame: Ints,
    recorded: int,
    frames: int,
    behaviour: NDArray[np.object_],
    *,
    walks: bool,
) -> ObservedTraffic:
    """From boxes (R, 7): x, y, heading, length, width, vx, vy of one box each, with its number and frame."""
    arc, left, line_heading = corridor.unrolled(boxes[:, :2])
    turned = boxes[:, 2] - line_heading
    cos, sin = np.cos(turned), np.sin(turned)
    half_along = np.abs(cos) * boxes[:, 3] / 2.0 + np.abs(sin) * boxes[:, 4] / 2.0
    half_across = np.abs(sin) * boxes[:, 3] / 2.0 + np.abs(cos) * boxes[:, 4] / 2.0
    along = boxes[:, 5] * np.cos(line_heading) + boxes[:, 6] * np.sin(line_heading)
    across = -boxes[:, 5] * np.sin(line_heading) + boxes[:, 6] * np.cos(line_heading)
    follows = (np.abs(wrap_angle(turned)) < np.arccos(SAME_WAY)) & (not walks)
    kept, many = frame < frames, len(behaviour)

    def table(values: Floats) -> Floats:
        cells = np.full((many, frames), np.nan)
        cells[number[kept], frame[kept]] = values[kept]
        return cells

    near, far, right, left_side, along, across, follow = (
        table(np.asarray(values, dtype=np.float64))
        for values in (
            arc - half_along, arc + half_along, left - half_across, left + half_across, along, across, follows,
        )
    )  # fmt: skip
    last = min(recorded, frames) - 1
    if 0 <= last < frames - 1:
        ahead_s = DT_S * np.arange(1, frames - last)
        for place, speed in ((near, along), (far, along), (right, across), (left_side, across)):
            place[:, last + 1 :] = place[:, last, None] + speed[:, last, None] * ahead_s
        for column in (along, across, follow):
            column[:, last + 1 :] = column[:, last, None]
    walking = np.full(many, walks)
    return ObservedTraffic(near, far, right, left_side, along, across, np.nan_to_num(follow) > 0.0, walking, behaviour)
