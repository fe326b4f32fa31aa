"""Where the others will be if they keep to their lanes: as fast as the road, the lights and those ahead let them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, sqrt

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_planners.common.forecast import Forecast
from interplan_planners.common.paths import centerline
from interplan_planners.common.ragged import stacked
from interplan_sumo.planner import Observation
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import EgoShape
from interplan_sumo.world.geometry import Floats, Polyline, wrap_angle
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.signals import SignalStatus

STEP_S = 0.2
MOVING_MPS = 0.3
"""Slower ones are taken to stay where they are."""
CHAIN_M = 120.0
"""How far beyond its end a lane is followed."""
LARGEST_TURN_RAD = 1.0
"""Who is turned more than this to every lane under it keeps to none."""
FALLBACK_LIMIT_MPS = 14.0
# How others are taken to drive: nuPlan's IDM.
ACCELERATION_MPS2, BRAKING_MPS2, HEADWAY_S, MIN_GAP_M = 1.0, 2.0, 1.5, 1.0
HARDEST_BRAKING_MPS2 = 6.0
RELAXED_MPS2 = 0.4
"""A gap that is only short, not closing, is widened no faster than with this."""
NOT_FASTER_MPS2, STARTED_MPS = 0.1, 3.0
"""What those before the ego accelerate at most once they are faster than the second."""
BEND_MPS2 = 3.0
CHANGE_FRAMES, PAST_STEP_S = 5, 0.1
"""Over so much of the past it is seen who accelerates or brakes."""
GOES_ON_S, NOTED_BRAKING_MPS2, MOST_EAGER_MPS2 = 2.0, -0.6, 4.0
"""Who brakes harder than the second goes on braking for some time; so does who accelerates harder than is usual."""
TURNED_FOR_S = 1.6
"""Who is turned to its lane goes on like that for so long, less and less."""
IN_LANE_M = 1.6
"""Who is farther from a lane's line leads nobody on it."""
LEAD_WITHIN_M = 90.0
BESIDE_M = 0.3
"""Whose front is farther than this beyond the ego's rear is beside the ego, and does not brake for it."""
EGO = -1
"""Stands for the ego where a row of the actors is expected."""


@dataclass(frozen=True, slots=True, eq=False)
class Chain:
    """A lane and where it leads, straightest first."""

    lanes: tuple[str, ...]
    starts_m: Floats
    line: Polyline
    limit_mps: float
    bend_mps: Floats
    """(S,) what bends allow, for each metre."""


@dataclass(frozen=True, slots=True, eq=False)
class PredictedTraffic:
    """Everybody as of now: the forecast, and which lane each is on."""

    actors: Actors
    forecast: Forecast
    lane_of: tuple[str | None, ...]
    """The lane or connector that an actor follows; None for those that follow none."""
    arc_m: Floats
    """(A,) of the box centre along it; 0 for those that follow none."""
    left_m: Floats
    """(A,) offset to its left."""
    turned_rad: Floats
    """(A,) heading relative to it."""
    changes_mps2: Floats
    """(A,) accelerations of late."""
    expected_mps2: Floats
    """(A,) accelerations that lane, red lights and those ahead ask for; -inf for who follows no lane, or stands."""
    eager: NDArray[np.bool_]
    """(A,) who is forecast to go on accelerating harder than is usual."""


class Prediction:
    """Forecasts along lanes. Remembers what it has learned of the map, and nothing of the actors."""

    def __init__(self, roads: Roads) -> None:
        self._roads = roads
        self._ids = (*roads.lanes, *roads.connectors)
        self._tree = shapely.STRtree([roads[lane_id].polygon for lane_id in self._ids])
        self._chains: dict[str, Chain] = {}

    def chain(self, lane_id: str) -> Chain:
        """Where a lane leads."""
        if lane_id not in self._chains:
            self._chains[lane_id] = self._followed(lane_id)
        return self._chains[lane_id]

    def crosses(self, lane_id: str, way_id: str) -> bool:
        """Whether the way from a lane into a connector leads into a junction: others leave or arrive there, too."""
        connector = self._roads.connectors.get(way_id)
        if connector is None or connector.from_lane_id != lane_id:
            return False
        branches = len(self._roads.outgoing(lane_id)) > 1
        return branches or connector.has_traffic_light or len(self._roads.incoming(connector.to_lane_id)) > 1

    def _followed(self, lane_id: str) -> Chain:
        roads = self._roads
        lanes, beyond_m = [lane_id], 0.0
        while beyond_m < CHAIN_M:
            ahead = [i for i in roads.outgoing(lanes[-1]) if i not in lanes]
            if not ahead:
                break
            lanes.append(straightest(roads, ahead))
            beyond_m += roads[lanes[-1]].centerline.length_m
        line = centerline(roads, lanes)
        starts_m = np.concatenate(([0.0], np.cumsum([roads[i].centerline.length_m for i in lanes])[:-1]))
        own = [limit for i in lanes if (limit := roads[i].speed_limit_mps)]
        metres = np.arange(int(line.length_m) + 1, dtype=np.float64)
        before = np.interp(metres - 2.0, line.arc_m, line.vertex_heading_rad)
        after = np.interp(metres + 2.0, line.arc_m, line.vertex_heading_rad)
        bend_mps = np.sqrt(BEND_MPS2 / np.maximum(np.abs(after - before) / 4.0, 1e-6))
        return Chain(tuple(lanes), starts_m, line, own[0] if own else FALLBACK_LIMIT_MPS, bend_mps)

    def traffic(self, observation: Observation, shape: EgoShape, horizon_s: float) -> PredictedTraffic:
        """Everybody at `seen`, forecast along the lanes for `horizon_s`."""
        actors = observation.actors
        steps = round(horizon_s / STEP_S)
        lane_of, arc_m, left_m, turned_rad = self._places(actors)
        speed = np.where(actors.kind <= ActorKind.BICYCLE, actors.speed_mps, 0.0)
        rides = np.array([lane is not None for lane in lane_of], dtype=np.bool_)
        backs = actors.vx_mps * np.cos(actors.heading_rad) + actors.vy_mps * np.sin(actors.heading_rad) < 0.0
        follows = rides & ~backs & (speed > MOVING_MPS) & (np.abs(turned_rad) < LARGEST_TURN_RAD)
        ahead_s = STEP_S * np.arange(steps + 1)

        x_m = actors.x_m[:, None] + actors.vx_mps[:, None] * ahead_s
        y_m = actors.y_m[:, None] + actors.vy_mps[:, None] * ahead_s
        still = speed <= MOVING_MPS
        x_m[still], y_m[still] = actors.x_m[still, None], actors.y_m[still, None]
        heading = np.repeat(actors.heading_rad[:, None], steps + 1, axis=1)
        speeds = np.repeat(np.where(backs, -speed, np.where(still, 0.0, speed))[:, None], steps + 1, axis=1)

        rows = np.flatnonzero(follows)
        changes_mps2, expected_mps2 = _changes_mps2(observation), np.full(len(actors), -inf)
        leads = _leads_ego(observation)
        eager = follows & ~leads & (changes_mps2 > ACCELERATION_MPS2)
        if rows.size:
            queue = self._queue(observation, shape, rows, lane_of, arc_m, left_m, speed)
            changes = changes_mps2[rows]
            eager_mps2 = np.where(eager[rows], np.minimum(changes, MOST_EAGER_MPS2), ACCELERATION_MPS2)
            most_mps2 = np.where(leads[rows], NOT_FASTER_MPS2, inf)
            braking_mps2 = np.where(changes < NOTED_BRAKING_MPS2, changes, inf)
            start_m, start_mps, gap_m = arc_m[rows], speed[rows], np.maximum(queue.gap_m, 0.5)
            expected_mps2[rows] = queue.asks_mps2(start_m, start_mps, gap_m, queue.lead_mps, ACCELERATION_MPS2)
            moved_m, along_mps = _rolled(queue, start_m, start_mps, eager_mps2, most_mps2, braking_mps2, steps)
            speeds[rows] = along_mps
            by_lane: dict[str, list[int]] = {}
            for place, row in enumerate(rows.tolist()):
                lane = lane_of[row]
                assert lane is not None
                by_lane.setdefault(lane, []).append(place)
            for lane, places in by_lane.items():
                line, here = self.chain(lane).line, rows[places]
                at_m = arc_m[here, None] + moved_m[places]
                poses = line.poses_at(at_m.ravel()).reshape(len(places), steps + 1, 3)
                beyond_m = np.maximum(at_m - line.length_m, 0.0)
                towards = poses[..., 2]
                # who is turned, as in a lane change, goes on like that for a while, then along the lane again
                fading = np.maximum(0.0, 1.0 - ahead_s / TURNED_FOR_S)
                drift_mps = speed[here] * np.sin(np.clip(turned_rad[here], -0.3, 0.3))
                until_s = np.minimum(ahead_s, TURNED_FOR_S)
                off_m = left_m[here, None] + drift_mps[:, None] * until_s * (1.0 - 0.5 * until_s / TURNED_FOR_S)
                x_m[here] = poses[..., 0] - off_m * np.sin(towards) + beyond_m * np.cos(towards)
                y_m[here] = poses[..., 1] + off_m * np.cos(towards) + beyond_m * np.sin(towards)
                heading[here] = towards + turned_rad[here, None] * fading
        is_agent = actors.kind <= ActorKind.BICYCLE
        forecast = Forecast(actors.ids, is_agent, actors.length_m, actors.width_m, x_m, y_m, heading, speeds, STEP_S)
        return PredictedTraffic(
            actors, forecast, lane_of, arc_m, left_m, turned_rad, changes_mps2, expected_mps2, eager
        )

    def _places(self, actors: Actors) -> tuple[tuple[str | None, ...], Floats, Floats, Floats]:
        """Per actor: the lane under it whose direction fits best, where on it, how far beside it, how turned."""
        count = len(actors)
        lane_of: list[str | None] = [None] * count
        arc_m, left_m, turned_rad = np.zeros(count), np.zeros(count), np.zeros(count)
        vehicles = np.flatnonzero((actors.kind == ActorKind.VEHICLE) | (actors.kind == ActorKind.BICYCLE))
        if not vehicles.size:
            return tuple(lane_of), arc_m, left_m, turned_rad
        points = shapely.points(actors.x_m[vehicles], actors.y_m[vehicles])
        at, found = self._tree.query(points, predicate="within")
        best: dict[int, tuple[float, int]] = {}
        for place, polygon in sorted(zip(at.tolist(), found.tolist(), strict=True)):
            row = int(vehicles[place])
            line = self._roads[self._ids[polygon]].centerline
            s_m, d_m = line.project_point(float(actors.x_m[row]), float(actors.y_m[row]))
            turned = float(wrap_angle(float(actors.heading_rad[row]) - line.pose_at(s_m).heading_rad))
            rank = abs(turned) + 0.1 * abs(d_m)
            if row not in best or rank < best[row][0] - 1e-9:
                best[row] = (rank, polygon)
                lane_of[row] = self._ids[polygon]
                arc_m[row], left_m[row], turned_rad[row] = s_m, d_m, turned
        return tuple(lane_of), arc_m, left_m, turned_rad

    def _queue(
        self,
        observation: Observation,
        shape: EgoShape,
        rows: NDArray[np.int64],
        lane_of: tuple[str | None, ...],
        arc_m: Floats,
        left_m: Floats,
        speed_mps: Floats,
    ) -> _Queue:
        """Who is ahead of each of those that follow lanes, the ego and red lights included."""
        actors, ego = observation.actors, observation.ego
        on: dict[str, list[tuple[float, int]]] = {}
        for row, lane in enumerate(lane_of):
            if lane is not None and abs(left_m[row]) < IN_LANE_M:
                on.setdefault(lane, []).append((float(arc_m[row]), row))
        # whoever reaches into a lane is noticed there
        for polygon in self._tree.query(ego.polygon(shape), predicate="intersects").tolist():
            lane = self._ids[polygon]
            line = self._roads[lane].centerline
            s_m, _ = line.project_point(ego.x_m, ego.y_m)
            if abs(wrap_angle(ego.heading_rad - line.pose_at(s_m).heading_rad)) < LARGEST_TURN_RAD:
                on.setdefault(lane, []).append((s_m, EGO))
        red = observation.signals.with_status(SignalStatus.RED)

        count = len(rows)
        gap_m, lead_mps = np.full(count, inf), np.zeros(count)
        lead, limit_mps = np.full(count, count, dtype=np.int64), np.empty(count)
        place_of = {row: place for place, row in enumerate(rows.tolist())}
        bends: list[Floats] = []
        for row, place in place_of.items():
            lane = lane_of[row]
            assert lane is not None
            chain, at_m = self.chain(lane), float(arc_m[row])
            limit_mps[place] = max(chain.limit_mps, float(speed_mps[row]))
            bends.append(chain.bend_mps)
            front_m = at_m + 0.5 * float(actors.length_m[row])
            for link, start_m in zip(chain.lanes, chain.starts_m.tolist(), strict=True):
                if start_m - front_m > LEAD_WITHIN_M:
                    break
                if link != lane and link in red and start_m > front_m - 1.0:
                    gap_m[place] = start_m - front_m
                    break
                ahead = [
                    (start_m + s, j)
                    for s, j in on.get(link, ())
                    if j != row and start_m + s > (at_m if j != EGO else front_m + 0.5 * shape.length_m - BESIDE_M)
                ]
                if ahead:
                    s_m, j = min(ahead)
                    length_m = shape.length_m if j == EGO else float(actors.length_m[j])
                    gap_m[place] = s_m - 0.5 * length_m - front_m
                    lead[place] = place_of.get(j, count)
                    lead_mps[place] = ego.speed_mps if j == EGO else float(speed_mps[j])
                    break
        return _Queue(gap_m, lead, lead_mps, limit_mps, stacked(bends))


@dataclass(frozen=True, slots=True, eq=False)
class _Queue:
    """What R drivers have ahead of them."""

    gap_m: Floats  # (R,) from bumper to bumper, or to a red light; infinite if there is nothing
    lead: NDArray[np.int64]  # (R,) which of them leads; R for somebody else, who goes on at its speed
    lead_mps: Floats  # (R,) its speed now
    limit_mps: Floats  # (R,)
    bend_mps: Floats  # (R, S) what bends allow, for each metre of the driver's chain

    def asks_mps2(
        self, at_m: Floats, v: Floats, gap_m: Floats, lead_mps: Floats, acceleration_mps2: Floats | float
    ) -> Floats:
        """(R,) the IDM's accelerations of drivers at arc lengths of their chains, behind whoever leads each of them."""
        softness = 2.0 * sqrt(ACCELERATION_MPS2 * BRAKING_MPS2)
        metres = np.minimum(at_m.astype(np.int64), self.bend_mps.shape[1] - 1)
        bend = self.bend_mps[np.arange(len(v)), metres]
        wanted = np.maximum(MIN_GAP_M + v * HEADWAY_S + v * (v - lead_mps) / softness, 0.0)
        free = (v / np.maximum(np.minimum(self.limit_mps, bend), 0.5)) ** 4
        return acceleration_mps2 * (1.0 - np.minimum(free, 4.0) - (wanted / gap_m) ** 2)


def _rolled(
    queue: _Queue,
    start_m: Floats,
    speed_mps: Floats,
    eager_mps2: Floats,
    most_mps2: Floats,
    braking_mps2: Floats,
    steps: int,
) -> tuple[Floats, Floats]:
    """Distance travelled and speed (R, steps + 1) of R drivers: IDM behind whoever leads each of them.

    For a while its acceleration is `eager_mps2` (R,), and those who brake go on with `braking_mps2` (R,). Nobody ever
    accelerates harder than `most_mps2` (R,).
    """
    count = len(start_m)
    foreign, lead = queue.lead == count, np.minimum(queue.lead, count - 1)
    moved, v = np.zeros(count), speed_mps.copy()
    moved_m, along_mps = np.zeros((steps + 1, count)), np.empty((steps + 1, count))
    along_mps[0] = v
    for k in range(1, steps + 1):
        lead_moved = np.where(foreign, queue.lead_mps * (k - 1) * STEP_S, moved[lead])
        lead_v = np.where(foreign, queue.lead_mps, v[lead])
        gap = np.maximum(queue.gap_m + lead_moved - moved, 0.5)
        goes_on = k * STEP_S <= GOES_ON_S
        a = queue.asks_mps2(start_m + moved, v, gap, lead_v, eager_mps2 if goes_on else ACCELERATION_MPS2)
        closing = np.maximum(v - lead_v, 0.0)
        needed = -(closing * closing) / (2.0 * np.maximum(gap - MIN_GAP_M, 0.5))
        a = np.minimum(np.maximum(a, needed - RELAXED_MPS2), most_mps2)
        if goes_on:
            a = np.minimum(a, braking_mps2)
        after = np.maximum(v + STEP_S * np.maximum(a, -HARDEST_BRAKING_MPS2), 0.0)
        moved = moved + 0.5 * STEP_S * (v + after)
        v = after
        moved_m[k], along_mps[k] = moved, v
    return moved_m.T, along_mps.T


def straightest(roads: Roads, ways: Sequence[str]) -> str:
    """Of several lanes or connectors the one that bends least; of equals the first."""

    def bend_rad(lane_id: str) -> float:
        headings = roads[lane_id].centerline.segment_heading_rad
        return abs(float(wrap_angle(headings[-1] - headings[0])))

    return min(ways, key=bend_rad)


def _leads_ego(observation: Observation) -> NDArray[np.bool_]:
    """(A,) who drives before the ego in its direction: a gap behind them must not be counted on to grow."""
    actors, ego = observation.actors, observation.ego
    cos, sin = np.cos(ego.heading_rad), np.sin(ego.heading_rad)
    ahead_m = (actors.x_m - ego.x_m) * cos + (actors.y_m - ego.y_m) * sin
    along_mps = actors.vx_mps * cos + actors.vy_mps * sin
    return (ahead_m > 0.0) & (along_mps > STARTED_MPS)


def _changes_mps2(observation: Observation) -> Floats:
    """(A,) accelerations over the last half second; 0 for those who were not seen then."""
    actors, past = observation.actors, observation.past.actors
    if len(past) < CHANGE_FRAMES:
        return np.zeros(len(actors))
    before = past[-CHANGE_FRAMES]
    speed_of = dict(zip(before.ids, before.speed_mps.tolist(), strict=True))
    was_mps = np.array([speed_of.get(name, np.nan) for name in actors.ids])
    return np.nan_to_num(actors.speed_mps - was_mps) / (CHANGE_FRAMES * PAST_STEP_S)
