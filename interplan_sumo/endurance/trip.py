"""A trip: one ego with one planner, from where it starts until its segment is driven or it comes to grief.

The planner is started once, with the whole way. A trip ends with its run-out, at
a contact, after a minute's stall, off the road, or where a jam holds it for good;
what follows is another segment's, elsewhere: so segments are independent of one
another, and a collision has no second part.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np

from interplan_sumo.endurance.opportunities import by_kind
from interplan_sumo.endurance.rare_events import RareEventDraws
from interplan_sumo.endurance.records import RareEventRecord
from interplan_sumo.endurance.segment_plan import RUN_OUT_S, SEGMENT_M
from interplan_sumo.endurance.staged import Staging
from interplan_sumo.errors import PlannerError, TrafficError
from interplan_sumo.planner_seat import PlannerSeat
from interplan_sumo.simulation.episode import DT_S, EpisodeFault, Loop, Phase
from interplan_sumo.simulation.sumo_traffic import SumoTraffic
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import EgoShape, EgoState
from interplan_sumo.world.geometry import box_corners, penetration_m
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.signals import SignalStatus

TripEnd = Literal["driven", "contact", "stall", "off_road", "jam", "time", "fault"]
STALL_S: Final = 60.0
"""So long in all an ego stands without moving on, in a junction, or with nobody before it and no red light."""
JAM_S: Final = 240.0
"""So long it may stand for others."""
STANDS_MPS: Final = 0.1
BEFORE_M: Final = 12.0
"""From bumper to bumper: who stands nearer ahead is waited for."""
AT_LIGHT_M: Final = 40.0
"""From the front bumper to a red light that is waited for."""
OFF_ROAD_S: Final = 1.0
"""An ego whose centre has been off all roads for so long does not come back."""
RUN_OUT_ROOM_M: Final = 120.0
"""The counted part ends at the latest so far before the goal."""
DRAW_STEPS: Final = 10
"""Rare events are drawn once a second."""


@dataclass(slots=True)
class Stretches:
    """Distance and time between draws, each with the weight that the segment had there."""

    metres: float = 0.0
    seconds: float = 0.0
    weighted_metres: float = 0.0
    weighted_seconds: float = 0.0

    def add(self, metres: float, seconds: float, weight: float) -> None:
        """A step."""
        self.metres += metres
        self.seconds += seconds
        self.weighted_metres += weight * metres
        self.weighted_seconds += weight * seconds


@dataclass(slots=True)
class Trip:
    """How one was driven."""

    loop: Loop
    end: TripEnd
    stretches: Stretches
    rare_events: list[RareEventRecord]
    weights: list[float]
    """Of each frame: that of the draws up to then."""
    counted_frames: int
    """What happens later belongs to the run-out."""
    plan_s: float
    """Wall-clock seconds in which the planner planned."""
    fault: EpisodeFault | None = None


@dataclass(slots=True)
class _Watch:
    """What may end a trip, looked at in every frame."""

    roads: Roads
    shape: EgoShape
    way_connectors: tuple[str, ...]
    stalled_s: float = 0.0
    stood_s: float = 0.0
    off_s: float = 0.0
    _in_junction: bool = field(default=False, init=False)

    def look(self, loop: Loop) -> TripEnd | None:
        """Why it ends with this frame, if it does."""
        ego, actors = loop.ego, loop.scene.actors
        if touches(ego, self.shape, actors):
            return "contact"
        on_road = (self.off_s == 0.0 and self.stood_s > 0.0) or _on_road(self.roads, ego)
        self.off_s = 0.0 if on_road else self.off_s + DT_S
        if self.off_s >= OFF_ROAD_S:
            return "off_road"
        if ego.speed_mps >= STANDS_MPS:
            self.stalled_s = self.stood_s = 0.0
            return None
        if self.stood_s == 0.0:
            self._in_junction = not self.roads.lanes_at(ego.x_m, ego.y_m)
        self.stood_s += DT_S
        waits = not self._in_junction and (someone_before(ego, self.shape, actors) or self._at_red(loop))
        self.stalled_s += 0.0 if waits else DT_S
        if self.stalled_s >= STALL_S - 1e-6:
            return "stall"
        return "jam" if self.stood_s >= JAM_S - 1e-6 else None

    def _at_red(self, loop: Loop) -> bool:
        """Whether the next light on its way is not green and near."""
        ego, shown = loop.ego, loop.scene.signals
        closed = shown.with_status(SignalStatus.RED) | shown.with_status(SignalStatus.YELLOW)
        for connector in self.way_connectors:
            if connector not in closed:
                continue
            start = self.roads[connector].centerline.points[0]
            dx, dy = float(start[0]) - ego.x_m, float(start[1]) - ego.y_m
            ahead_m = dx * np.cos(ego.heading_rad) + dy * np.sin(ego.heading_rad) - self.shape.length_m / 2.0
            if (
                -self.shape.length_m < ahead_m <= AT_LIGHT_M
                and abs(dy * np.cos(ego.heading_rad) - dx * np.sin(ego.heading_rad)) <= AT_LIGHT_M
            ):
                return True
        return False


def _on_road(roads: Roads, ego: EgoState) -> bool:
    return bool(roads.at(ego.x_m, ego.y_m)) or bool(roads.drivable((ego.x_m, ego.y_m))[0])


def touches(ego: EgoState, shape: EgoShape, actors: Actors) -> bool:
    """Whether the ego's box touches anybody's."""
    reach_m = np.hypot(shape.length_m, shape.width_m) / 2.0
    away_m = np.hypot(actors.x_m - ego.x_m, actors.y_m - ego.y_m)
    near = np.flatnonzero(away_m <= reach_m + np.hypot(actors.length_m, actors.width_m) / 2.0)
    if not len(near):
        return False
    own = box_corners(ego.x_m, ego.y_m, ego.heading_rad, shape.length_m, shape.width_m)
    return bool((penetration_m(np.repeat(own.reshape(1, 4, 2), len(near), axis=0), actors.corners[near]) >= 0.0).any())


def someone_before(ego: EgoState, shape: EgoShape, actors: Actors) -> bool:
    """Whether somebody is close ahead of the ego, in its way as it is turned."""
    dx, dy = actors.x_m - ego.x_m, actors.y_m - ego.y_m
    ahead_m = dx * np.cos(ego.heading_rad) + dy * np.sin(ego.heading_rad)
    aside_m = np.abs(dy * np.cos(ego.heading_rad) - dx * np.sin(ego.heading_rad))
    half_m = np.hypot(actors.length_m, actors.width_m) / 2.0
    near = (ahead_m > 0.0) & (ahead_m - half_m <= shape.length_m / 2.0 + BEFORE_M)
    return bool((near & (aside_m - actors.width_m / 2.0 <= shape.width_m / 2.0)).any())


def drive_trip(
    loop: Loop,
    traffic: SumoTraffic,
    staging: Staging,
    seat: PlannerSeat,
    draws: RareEventDraws,
    on_phase: Callable[[Phase], None],
    most_m: float = SEGMENT_M,
) -> Trip:
    """Drive one; planner and traffic faults end it and are told apart in the result."""
    trip = Trip(loop, "time", Stretches(), [], [], 0, 0.0)
    try:
        _drive(trip, traffic, staging, seat, draws, on_phase, most_m)
    except (PlannerError, TrafficError) as error:
        kind = "planner" if isinstance(error, PlannerError) else "traffic"
        frames = max(len(loop.record.egos) - 1, 0)
        trip.fault, trip.end = EpisodeFault(kind, f"{error} (t = {frames * DT_S:.1f} s)"), "fault"
    trip.counted_frames = trip.counted_frames or len(loop.record.egos)
    trip.plan_s = sum(loop.record.plan_wall_s)
    return trip


def _drive(
    trip: Trip,
    traffic: SumoTraffic,
    staging: Staging,
    seat: PlannerSeat,
    draws: RareEventDraws,
    on_phase: Callable[[Phase], None],
    most_m: float,
) -> None:
    loop = trip.loop

    def meanwhile() -> None:
        on_phase("simulate")
        loop.react()
        on_phase("plan")

    mission = loop.open()
    start_m, _ = loop.route.project_point(loop.ego.x_m, loop.ego.y_m)
    most_m = min(most_m, max(loop.goal_m - start_m - RUN_OUT_ROOM_M, most_m / 2.0))
    blocks = set(loop.scenario.route)
    connectors = tuple(name for name, each in loop.roads.connectors.items() if each.roadblock_id in blocks)
    lit = tuple(name for name in connectors if loop.roads.connectors[name].has_traffic_light)
    watch = _Watch(loop.roads, loop.shape, lit)
    on_phase("start")
    seat.start(mission)
    step = 0
    while loop.begin_frame():
        trip.weights.append(draws.weight)
        ended = watch.look(loop)
        if ended is not None:
            trip.end = ended
            return
        if trip.counted_frames and (step - trip.counted_frames) * DT_S >= RUN_OUT_S:
            trip.end = "driven"
            return
        staging.notice(loop.ego)
        if step % DRAW_STEPS == 0 and not trip.counted_frames:
            _draw(trip, traffic, staging, draws, step // DRAW_STEPS)
        on_phase("plan")
        timed = seat.plan_while(loop.observation, meanwhile)
        loop.record.plan_wall_s.append(timed.wall_s)
        on_phase("simulate")
        before = loop.ego
        loop.advance(timed.plan)
        step += 1
        if not trip.counted_frames:
            moved_m = float(np.hypot(loop.ego.x_m - before.x_m, loop.ego.y_m - before.y_m))
            trip.stretches.add(moved_m, DT_S, draws.weight)
            if trip.stretches.metres >= most_m:
                trip.counted_frames = step
    trip.end = "driven" if loop.reached_goal else "time"


def _draw(trip: Trip, traffic: SumoTraffic, staging: Staging, draws: RareEventDraws, second: int) -> None:
    """One second's draws, and the beginning of what has been drawn."""
    ego = trip.loop.ego
    found = staging.look(ego, traffic.agents)
    begun = draws.begins(second, by_kind(found), active=staging.is_active)
    if begun is None:
        return
    what = next(each for each in found if each.kind == begun.kind and each.name == begun.opportunity)
    staging.begin(what, ego, traffic.agents)
    trip.rare_events.append(
        RareEventRecord(begun.kind, ego.time_s, begun.opportunity, begun.weight_before, begun.weight, begun.passed)
    )
