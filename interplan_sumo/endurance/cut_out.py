"""Cut out: the seconds around an event as a trace of its own, and as a scenario that anybody can drive again.

In the scenario the others do what they did, whoever drives (`replayed`), and
the lights show what they showed; the way is the trip's. It begins as long before
the event as the trace does.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from interplan_sumo.endurance.trip_way import TripWay
from interplan_sumo.errors import ScenarioError
from interplan_sumo.scenario.recorded import STEP_S, ego_scene, floored_m, replayed_track
from interplan_sumo.scenario.route import start_arc_m
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.recording import RecordedTrack, Recording
from interplan_sumo.world.roads import Lane, Roads
from interplan_sumo.world.trace import ActorTable, EgoTrack, Trace

BEFORE_S: Final = 10.0
AFTER_S: Final = 5.0
"""15 s in all, where the trip has them."""
LONGEST_S: Final = 90.0
"""It begins up to so much earlier where the ego was inside a junction: scenarios begin on lanes."""
PAST_S: Final = 2.0
"""What a planner looks back on."""
GOAL_M: Final = 150.0
"""So far ahead of the start is the goal, along the trip's way."""
NEAR_M: Final = 60.0
"""Who is never nearer to the ego in this time is left out of the scenario."""
EGO: Final = "endure-ego"


def window(trace: Trace, frame: int, roads: Roads) -> tuple[int, int]:
    """The first frame of the cut-out around an event, and the first one behind it; it begins on a lane."""
    step_s, ego = trace.dt_s, trace.ego
    first = max(0, frame - round(BEFORE_S / step_s))
    for earlier in range(first, max(-1, first - round(LONGEST_S / step_s)), -1):
        if roads.lanes_at(float(ego.x_m[earlier]), float(ego.y_m[earlier])):
            first = earlier
            break
    return first, min(len(trace), frame + round(AFTER_S / step_s) + 1)


def cut_trace(trace: Trace, first: int, end: int) -> Trace:
    """These frames as a trace that begins at 0 s."""
    ego, actors = trace.ego, trace.actors
    rows = slice(int(actors.starts[first]), int(actors.starts[end]))
    columns = {name: getattr(ego, name)[first:end] for name in EgoTrack.__dataclass_fields__}
    columns["time_us"] = columns["time_us"] - columns["time_us"][0]
    names = ("ids", "kind", "x_m", "y_m", "heading_rad", "length_m", "width_m", "vx_mps", "vy_mps", "behaviour")
    table = ActorTable(
        frame=actors.frame[rows] - first,
        **{name: getattr(actors, name)[rows] for name in names},
        starts=actors.starts[first : end + 1] - actors.starts[first],
        ax_without_ego=None if actors.ax_without_ego is None else actors.ax_without_ego[rows],
    )
    began_s = float(ego.time_us[first]) * 1e-6
    plans = tuple(replace(plan, time_s=plan.time_s - began_s) for plan in trace.plans[first:end])
    return Trace(EgoTrack(**columns), table, trace.signals[first:end], plans, trace.plan_wall_s[first:end], trace.shape)


def cut_scenario(id: str, trip: Scenario, roads: Roads, trace: Trace, first: int, end: int) -> Scenario | None:
    """The frames as a scenario; None if the ego was on no lane when they begin."""
    past = min(first, round(PAST_S / trace.dt_s))
    recording = _recording(trace, roads, first - past, end, past)
    duration_s = round((end - first - 1) * trace.dt_s, 1)
    try:
        bare, *_ = ego_scene(
            recording, roads, ego_id=EGO, at_s=0.0, agents="replayed", goal_m=GOAL_M, duration_s=duration_s
        )
        tracks = (replayed_track(each, STEP_S, past, end - first) for each in recording.tracks if each.id != EGO)
        others = tuple(each for each in tracks if not isinstance(each, str))
        return _on_its_way(
            replace(bare, id=id, family="endure", replayed=others, maps_beside=trip.maps_beside), trip, roads
        )
    except ScenarioError:
        return None


def _on_its_way(scenario: Scenario, trip: Scenario, roads: Roads) -> Scenario:
    """With the way that the trip had from there, if the start lies on it."""
    block = roads[scenario.start.lane].roadblock_id
    if block not in trip.route:
        return scenario
    on = replace(trip, start=scenario.start, route=trip.route[trip.route.index(block) :], replayed=(), lights=())
    way = TripWay(on, roads)
    goal = way.at(start_arc_m(roads, on) + GOAL_M) or trip.goal
    blocks = list(on.route)
    upto = blocks.index(roads[goal.lane].roadblock_id)
    if not isinstance(roads[goal.lane], Lane):  # inside a junction: the lane behind it
        after = roads.connectors[goal.lane].to_lane_id
        goal, upto = replace(goal, lane=after, arc_m=roads[after].centerline.length_m / 2.0), upto + 1
    kept = replace(
        scenario, route=tuple(blocks[: upto + 1]), goal=replace(goal, arc_m=floored_m(goal.arc_m), left_m=0.0)
    )
    kept.check(roads)
    return kept


def _recording(trace: Trace, roads: Roads, first: int, end: int, past: int) -> Recording:
    """The frames as somebody would have recorded them."""
    ego, actors = trace.ego, trace.actors
    poses = np.stack((ego.x_m, ego.y_m, ego.heading_rad), axis=1)[first:end]
    cosine, sine = np.cos(ego.heading_rad[first:end]), np.sin(ego.heading_rad[first:end])
    vx, vy = ego.vx_mps[first:end], ego.vy_mps[first:end]
    speed = np.stack((vx * cosine - vy * sine, vx * sine + vy * cosine), axis=1)
    own = RecordedTrack(EGO, ActorKind.VEHICLE, PACIFICA.length_m, PACIFICA.width_m, 0, poses, speed)
    rows_of: dict[str, list[int]] = {}
    for row in range(int(actors.starts[first]), int(actors.starts[end])):
        rows_of.setdefault(str(actors.ids[row]), []).append(row)
    tracks = [own]
    for name, rows in rows_of.items():
        frames = actors.frame[rows]
        if np.hypot(actors.x_m[rows] - ego.x_m[frames], actors.y_m[rows] - ego.y_m[frames]).min() > NEAR_M:
            continue
        gap = np.flatnonzero(np.diff(frames) != 1)
        kept = rows[int(gap[-1]) + 1 :] if len(gap) else rows  # who went out of sight and came back: since then
        at = np.stack((actors.x_m[kept], actors.y_m[kept], actors.heading_rad[kept]), axis=1)
        moves = np.stack((actors.vx_mps[kept], actors.vy_mps[kept]), axis=1)
        kind = ActorKind(int(actors.kind[kept[0]]))
        size = (float(actors.length_m[kept[0]]), float(actors.width_m[kept[0]]))
        tracks.append(RecordedTrack(name, kind, *size, int(actors.frame[kept[0]]) - first, at, moves))
    connectors = trace.signals[first].connector_ids
    shown = np.array([signals.status for signals in trace.signals[first:end]], dtype=np.int64)
    shown = shown.reshape(end - first, len(connectors))
    lights = {name: shown[:, column] for column, name in enumerate(connectors)}
    return Recording(
        f"a trip in {roads.name}", roads.crs, trace.dt_s, tuple(sorted(tracks, key=lambda each: each.id)), EGO,
        start_step=past, map_name=roads.name, lights=lights,
    )  # fmt: skip
