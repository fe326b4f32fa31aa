"""Scenes from recordings: a scenario that begins where a recorded car was, among the road users around it.

Either they follow their recorded tracks (`replayed`) or SUMO drives them on
from where they were. What cannot be used is reported, never dropped unseen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import floor, inf
from typing import Final, Literal

import numpy as np

from interplan_sumo.errors import ScenarioError, UnknownNameError
from interplan_sumo.scenario.matching import LaneMatch, MatchedPath, matched_path
from interplan_sumo.scenario.recorded_lights import with_recorded_lights
from interplan_sumo.scenario.recorded_parts import PAST_STEPS, REPLAYED, EgoPast, ReplayedKind, ReplayedTrack
from interplan_sumo.scenario.scenario import LanePosition, Scenario, TrafficDemand
from interplan_sumo.scenario.surroundings import Surroundings, surroundings
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import Floats, Pose, wrap_angle
from interplan_sumo.world.recording import RecordedTrack, Recording
from interplan_sumo.world.roads import Connector, Roads

Agents = Literal["sumo", "replayed"]
FAMILY: Final = "recorded"
STEP_S: Final = 0.1
"""Of a scenario; recordings with another step are interpolated."""
GOAL_M: Final = 150.0
"""So far ahead the goal of a scene lies that SUMO drives on, at least."""
OF_TRACK: Final = 0.8
"""After this share of the track the goal of a replayed scene lies: who is little slower than that car comes past."""
LEAST_GOAL_M: Final = 20.0
"""Nearer than this it is no goal, and lies `GOAL_M` ahead instead."""
SUMO_DURATION_S: Final = 30.0
LEAST_DURATION_S: Final = 1.0
END_M: Final = 5.0
"""The goal keeps this far from where the roads end."""
ON_LANE_M: Final = 1.0
"""The ego starts at most this far beside the centre line: its box stays in the lane."""
DECIMALS_M: Final = 3
DECIMALS_RAD: Final = 5
_KIND: Final[dict[ActorKind, str]] = {kind: name for name, kind in REPLAYED.items()}


@dataclass(frozen=True, slots=True)
class RecordedScene:
    """What was made of one instant of a recording."""

    scenario: Scenario
    left_out: tuple[tuple[str, str], ...]
    """Ids of tracks that are not in the scenario, each with the reason."""
    notes: tuple[str, ...]
    """What was assumed about the ego's way, and which recorded lights could not be used."""


def scene(
    recording: Recording,
    roads: Roads,
    *,
    ego_id: str | None = None,
    at_s: float = 0.0,
    agents: Agents = "sumo",
    goal_m: float | None = None,
    duration_s: float | None = None,
) -> RecordedScene:
    """The scenario that begins `at_s` after the recording does, with the ego in the place of track `ego_id`.

    By default the ego is the car that measured. Its route follows its track;
    where that is shorter than `goal_m` the route goes straight on up to there
    or to where the roads end. By default the goal lies after four fifths of the track if agents are
    replayed, as the drive ends with it, and else 150 m ahead. The default duration is the rest of the recording
    for replayed agents, 30 s for those that SUMO drives. ScenarioError if there
    is no such track, or if it does not follow the lanes.
    """
    bare, ego, step, notes = ego_scene(
        recording, roads, ego_id=ego_id, at_s=at_s, agents=agents, goal_m=goal_m, duration_s=duration_s
    )
    others = [track for track in recording.tracks if track is not ego]
    if agents == "replayed":
        scenario, left_out = _replayed(bare, recording, others, step)
    else:
        around = surroundings(others, step, bare, roads)
        scenario, left_out = _driven(bare, around), around.left_out
    return RecordedScene(scenario, left_out, notes)


def ego_scene(
    recording: Recording, roads: Roads, *, ego_id: str | None, at_s: float, agents: Agents,
    goal_m: float | None, duration_s: float | None,
) -> tuple[Scenario, RecordedTrack, int, tuple[str, ...]]:  # fmt: skip
    """`scene` with the ego and the recorded lights only; the ego's track, the step that it begins at, and notes."""
    if recording.crs != roads.crs:
        raise ScenarioError(
            f"recording {recording.name} is in {recording.crs}, map {roads.name} in {roads.crs}; "
            "import the map that belongs to it"
        )
    if goal_m is not None and not (np.isfinite(goal_m) and goal_m > PACIFICA.length_m):
        raise ScenarioError(f"goal_m is {goal_m}, expected more than the ego's length, {PACIFICA.length_m} m")
    step = _step(recording, at_s)
    ego = _ego(recording, ego_id, step)
    row = step - ego.first_step
    path = matched_path(roads, ego.poses[row:])
    if path is None:
        raise ScenarioError(
            f"recording {recording.name}: track {ego.id} is on no lane of map {roads.name} at {at_s:g} s; "
            "name another time with --at, or another track with --ego"
        )
    lasts_s = _duration_s(recording, step, agents, duration_s)
    seen = ego.poses[row : row + 1 + round(lasts_s / recording.step_s)]
    came_m = _travelled_m(seen) if agents == "replayed" else None
    route, goal, notes = _way(recording, roads, ego, path, goal_m, came_m)
    bare = Scenario(
        id=f"{roads.name}.{FAMILY}/{ego.id}-{(step - recording.start_step) * recording.step_s:.1f}s-{agents}",
        family=FAMILY,
        map=roads.name,
        start=_start(path.first),
        start_speed_mps=round(float(np.hypot(*ego.velocity_mps[row])), DECIMALS_M),
        goal=goal,
        route=route,
        duration_s=lasts_s,
    )
    bare = replace(bare, past=_past(ego, row, recording.step_s, bare.start.pose(roads)))
    bare.check(roads)
    bare, unfit = with_recorded_lights(bare, recording, roads, step)
    return bare, ego, step, (*notes, *filter(None, (unfit,)))


# --- the ego -------------------------------------------------------------------------------------


def _step(recording: Recording, at_s: float) -> int:
    last_s = (recording.steps - 1 - recording.start_step) * recording.step_s
    if not (np.isfinite(at_s) and 0.0 <= at_s <= last_s):
        raise ScenarioError(f"recording {recording.name} lasts from 0 to {last_s:g} s, there is no scene at {at_s:g} s")
    return recording.start_step + round(at_s / recording.step_s)


def _ego(recording: Recording, ego_id: str | None, step: int) -> RecordedTrack:
    """The track that the ego takes the place of."""
    vehicles = {track.id: track for track in recording.tracks if track.kind is ActorKind.VEHICLE}
    wanted = recording.ego_id if ego_id is None else ego_id
    if wanted is None:
        far = sorted(vehicles.values(), key=lambda track: (-_travelled_m(track.poses), track.id))
        names = ", ".join(track.id for track in far[:5]) or "none"
        raise ScenarioError(
            f"recording {recording.name} does not say which car measured; name a track with --ego, "
            f"such as one of those that go farthest: {names}"
        )
    if wanted not in vehicles:
        raise UnknownNameError("vehicle track", wanted, vehicles, f"(recording {recording.name})")
    track = vehicles[wanted]
    if track.at(step) is None:
        raise ScenarioError(
            f"recording {recording.name}: track {wanted} is there from {track.first_step * recording.step_s:.1f} to "
            f"{(track.end_step - 1) * recording.step_s:.1f} s, not at {step * recording.step_s:.1f} s"
        )
    return track


def _travelled_m(poses: Floats) -> float:
    return float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum())


def _start(first: LaneMatch) -> LanePosition:
    left_m = min(max(first.left_m, -ON_LANE_M), ON_LANE_M)
    return LanePosition(first.lane, floored_m(first.arc_m), round(left_m, DECIMALS_M))


def _past(ego: RecordedTrack, row: int, step_s: float, start: Pose) -> EgoPast | None:
    """The track before a row, moved and turned so that it ends in the start; None where it is too short."""
    at = row + np.arange(-PAST_STEPS, 0) * STEP_S / step_s
    if at[0] < -1e-6:
        return None
    rows = np.arange(row + 1)
    x, y = (np.interp(at, rows, ego.poses[: row + 1, i]) for i in (0, 1))
    heading = np.interp(at, rows, np.unwrap(ego.poses[: row + 1, 2]))
    vx, vy = (np.interp(at, rows, ego.velocity_mps[: row + 1, i]) for i in (0, 1))
    speed_mps = vx * np.cos(heading) + vy * np.sin(heading)
    x0, y0, heading0 = (float(value) for value in ego.poses[row])
    turn = start.heading_rad - heading0
    dx, dy, cos, sin = x - x0, y - y0, np.cos(turn), np.sin(turn)
    return EgoPast(
        _column(start.x_m + cos * dx - sin * dy, DECIMALS_M),
        _column(start.y_m + sin * dx + cos * dy, DECIMALS_M),
        _column(wrap_angle(heading + turn), DECIMALS_RAD),
        _column(speed_mps, DECIMALS_M),
    )


def floored_m(arc_m: float) -> float:
    """An arc length to the millimetre, never beyond the end of its lane."""
    return floor(arc_m * 10**DECIMALS_M) / 10**DECIMALS_M


def _way(
    recording: Recording,
    roads: Roads,
    ego: RecordedTrack,
    path: MatchedPath,
    goal_m: float | None,
    came_m: float | None,
) -> tuple[tuple[str, ...], LanePosition, tuple[str, ...]]:
    """Route, goal and notes: along the recorded path, then straight on until the goal is `goal_m` away.

    By default after `OF_TRACK` of how far the recorded car `came_m` in the time, if the drive ends with that and it
    is far enough, else `GOAL_M` at least.
    """
    chain, is_simple = _one_lane_per_block(roads, path.chain)
    ends = _ends_m(roads, chain, path.first)
    recorded_m = ends[-1] - roads[chain[-1]].centerline.length_m + path.last.arc_m if is_simple else ends[-1]
    notes: list[str] = []
    if not path.is_whole:
        notes.append(f"track {ego.id} leaves the lanes after {recorded_m:.0f} m; the route goes on along them")
    if not is_simple:
        notes.append(f"track {ego.id} comes back to where it was; the route ends before")
    if goal_m is None and came_m is not None:
        there = _latest(roads, chain, ends, OF_TRACK * min(came_m, recorded_m))
        if there is not None and there[1] >= LEAST_GOAL_M:
            return *_route_to(roads, chain, ends, *there), tuple(notes)
    goal_m = GOAL_M if goal_m is None else goal_m
    wanted_m = max(goal_m, recorded_m)
    while ends[-1] < wanted_m or isinstance(roads[chain[-1]], Connector):
        after = _straightest(roads, chain)
        if after is None:
            break
        chain.append(after)
        ends.append(ends[-1] + roads[after].centerline.length_m)
    number, at_m = _first(roads, chain, ends, wanted_m)
    if not roads.outgoing(chain[-1]) and at_m > ends[-1] - END_M:  # not on the stub at the edge of a map
        number, at_m = _latest(roads, chain, ends, ends[-1] - END_M) or (number, at_m)
    if at_m <= PACIFICA.length_m:
        raise ScenarioError(
            f"recording {recording.name}: the roads end {at_m:.1f} m ahead of track {ego.id}; name an earlier time "
            "with --at, or another track with --ego"
        )
    if at_m > recorded_m:
        notes.append(f"the track shows {recorded_m:.0f} m of the way, the goal lies {at_m:.0f} m ahead: straight on")
    if at_m < goal_m - END_M:
        notes.append(f"the roads end before {goal_m:.0f} m")
    return *_route_to(roads, chain, ends, number, at_m), tuple(notes)


def _one_lane_per_block(roads: Roads, chain: tuple[str, ...]) -> tuple[list[str], bool]:
    """The lane in which each roadblock is left, up to where one would be entered again; whether that is all."""
    lanes: list[str] = []
    seen: set[str] = set()
    for lane in chain:
        block = roads[lane].roadblock_id
        if lanes and roads[lanes[-1]].roadblock_id == block:
            lanes[-1] = lane
        elif block in seen:
            return lanes, False
        else:
            lanes.append(lane)
            seen.add(block)
    return lanes, True


def _ends_m(roads: Roads, chain: list[str], first: LaneMatch) -> list[float]:
    """How far ahead of the start each lane of a chain ends."""
    start = roads[first.lane].centerline.pose_at(first.arc_m)
    begin_m, _ = roads[chain[0]].centerline.project_point(start.x_m, start.y_m)
    return (np.cumsum([roads[lane].centerline.length_m for lane in chain]) - begin_m).tolist()


def _straightest(roads: Roads, chain: list[str]) -> str | None:
    """The way on that turns least, into a roadblock that the chain does not hold yet."""
    seen = {roads[lane].roadblock_id for lane in chain}
    ways = [lane for lane in roads.outgoing(chain[-1]) if roads[lane].roadblock_id not in seen]
    return min(ways, key=lambda lane: (abs(roads[lane].centerline.turned_rad), lane), default=None)


def _first(roads: Roads, chain: list[str], ends: list[float], wanted_m: float) -> tuple[int, float]:
    """The first lane that reaches as far as wanted, and how far ahead a place there is; never on a connector."""
    lanes = _lanes(roads, chain)
    number = next((i for i in lanes if ends[i] >= wanted_m), lanes[-1] if lanes else len(chain) - 1)
    length_m = roads[chain[number]].centerline.length_m
    edge_m = min(END_M, length_m / 2.0)
    return number, max(min(wanted_m, ends[number] - edge_m), ends[number] - length_m + edge_m)


def _latest(roads: Roads, chain: list[str], ends: list[float], most_m: float) -> tuple[int, float] | None:
    """The last lane that begins before a distance, and how far ahead a place there is which is no farther; or None."""
    begun = [i for i in _lanes(roads, chain) if ends[i] - roads[chain[i]].centerline.length_m < most_m]
    return (begun[-1], min(most_m, ends[begun[-1]])) if begun else None


def _lanes(roads: Roads, chain: list[str]) -> list[int]:
    return [i for i, lane in enumerate(chain) if not isinstance(roads[lane], Connector)]


def _route_to(
    roads: Roads, chain: list[str], ends: list[float], number: int, at_m: float
) -> tuple[tuple[str, ...], LanePosition]:
    """Route and goal: the chain up to one of its lanes, and the place there that is so far ahead."""
    lane = chain[number]
    arc_m = floored_m(at_m - ends[number] + roads[lane].centerline.length_m)
    return roads.route_through(chain[: number + 1]), LanePosition(lane, arc_m)


def _duration_s(recording: Recording, step: int, agents: Agents, wanted_s: float | None) -> float:
    """In whole steps of the scenario; replayed agents last no longer than the recording."""
    rest_s = floor((recording.steps - 1 - step) * recording.step_s / STEP_S + 1e-6) * STEP_S
    most_s = rest_s if agents == "replayed" else inf
    found = min(wanted_s if wanted_s is not None else rest_s if agents == "replayed" else SUMO_DURATION_S, most_s)
    if found < LEAST_DURATION_S:
        raise ScenarioError(
            f"recording {recording.name}: {found:.1f} s are left, expected {LEAST_DURATION_S:g} s or more; "
            "name an earlier time with --at"
        )
    return round(found, 1)


# --- the others ----------------------------------------------------------------------------------


def _driven(bare: Scenario, around: Surroundings) -> Scenario:
    """SUMO drives those that stood in or moved along a lane."""
    traffic = TrafficDemand(behaviour="urban")  # has drivers for every kind of vehicle
    return replace(bare, traffic=traffic, vehicles=around.vehicles, obstacles=around.obstacles)


def _replayed(
    bare: Scenario, recording: Recording, others: list[RecordedTrack], step: int
) -> tuple[Scenario, tuple[tuple[str, str], ...]]:
    """Everyone follows their track."""
    steps = round(bare.duration_s / STEP_S) + 1
    found: list[ReplayedTrack] = []
    left_out: list[tuple[str, str]] = []
    for track in others:
        replay = replayed_track(track, recording.step_s, step, steps)
        if isinstance(replay, str):
            left_out.append((track.id, replay))
        else:
            found.append(replay)
    if not found:
        raise ScenarioError(
            f"recording {recording.name} shows nobody but the ego in these {bare.duration_s:g} s; "
            "let SUMO drive the others, with --agents sumo"
        )
    return replace(bare, replayed=tuple(found)), tuple(left_out)


def replayed_track(track: RecordedTrack, step_s: float, start: int, steps: int) -> ReplayedTrack | str:
    """A track from step `start` of a recording on, at `steps` instants 0.1 s apart; why it is none of them otherwise.

    Between two steps of the recording everything is interpolated; nothing is invented before or behind the track.
    """
    begin = (track.first_step - start) * step_s / STEP_S
    end = (track.end_step - 1 - start) * step_s / STEP_S
    first, last = max(0, -floor(-begin + 1e-6)), min(steps - 1, floor(end + 1e-6))
    if end < -1e-6:
        return "it was gone before"
    if first > last:
        return "it appears only after the end" if begin > steps - 1 else "it is there between two instants only"
    at = (np.arange(first, last + 1) * STEP_S / step_s + start - track.first_step).clip(0.0, len(track.poses) - 1)
    rows = np.arange(len(track.poses))
    x, y = (np.interp(at, rows, track.poses[:, i]) for i in (0, 1))
    heading = wrap_angle(np.interp(at, rows, np.unwrap(track.poses[:, 2])))
    vx, vy = (np.interp(at, rows, track.velocity_mps[:, i]) for i in (0, 1))
    kind: ReplayedKind = _KIND[track.kind]  # type: ignore[assignment]
    size = (round(track.length_m, DECIMALS_M), round(track.width_m, DECIMALS_M))
    columns = (_column(x, DECIMALS_M), _column(y, DECIMALS_M), _column(heading, DECIMALS_RAD))
    return ReplayedTrack(track.id, kind, *size, first, *columns, _column(vx, DECIMALS_M), _column(vy, DECIMALS_M))


def _column(values: Floats, decimals: int) -> tuple[float, ...]:
    """Rounded, without minus zero: it would be another hash."""
    return tuple((np.round(values, decimals) + 0.0).tolist())
