"""Random scenarios on the shipped maps and an ego that drives like a lost soul: is the traffic sane?"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from math import atan2, cos, hypot, sin, tan

import numpy as np

from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.store import find_map, load_roads
from interplan_sumo.scenario.route import route_centerline
from interplan_sumo.scenario.scenario import Jaywalker, LanePosition, Obstacle, Scenario, TrafficDemand
from interplan_sumo.simulation.network import read_network
from interplan_sumo.simulation.setup import open_traffic, start_state
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.geometry import Floats, Polyline, penetration_m
from interplan_sumo.world.roads import Roads
from tests.networks import stepped

DT_S = 0.1
OVERLAP_M = 0.05
"""Two agents overlap if their boxes penetrate by more than this."""
STANDING_MPS = 0.5
SIGHT_M = 100.0
"""Nobody comes or goes as near to the ego, but where the map ends."""
JUMP_M = 0.6
"""The centre of an agent may move by its speed and this much more: a lane change's step across, the turn of its body
about its front, and rounding, as SUMO scales the lanes of an edge."""


def random_scenario(
    name: str, rng: np.random.Generator, number: int, *, obstacles: bool = False, jaywalker: bool = False
) -> Scenario:
    """A drive of up to 500 m from a random lane on, with random traffic; `obstacles` and a `jaywalker` on its way."""
    roads = load_roads(name)
    while True:
        lane = list(roads.lanes)[rng.integers(len(roads.lanes))]
        way = _way(roads, lane, rng)
        length_m = roads[lane].centerline.length_m
        if length_m > 40.0 and sum(roads[each].centerline.length_m for each in way) > 150.0:
            break
    start_m = float(rng.uniform(0.1, 0.5) * length_m) if len(way) > 1 else float(rng.uniform(5.0, 0.3 * length_m))
    goal = way[-1]
    demand = TrafficDemand(
        str(rng.choice(("low", "medium", "high"))),  # type: ignore[arg-type]
        str(rng.choice(("conservative", "assertive", "mixed"))),  # type: ignore[arg-type]
        str(rng.choice(("none", "low", "medium", "high"))),  # type: ignore[arg-type]
    )
    places = _places(roads, way, start_m, rng)
    things = tuple(
        Obstacle(place, str(rng.choice(("car", "truck", "cone", "barrier"))), float(rng.uniform(-0.8, 0.8)))  # type: ignore[arg-type]
        for place in places[: int(rng.integers(1, 4))]
    )
    walkers = (_across(roads, places[-1], rng),) if places else ()
    return Scenario(
        id=f"random/{number}",
        family="random",
        map=name,
        start=LanePosition(lane, start_m),
        start_speed_mps=float(rng.uniform(0.0, 12.0)),
        goal=LanePosition(goal, roads[goal].centerline.length_m * 0.9),
        route=tuple(roads[each].roadblock_id for each in way),
        traffic=demand,
        obstacles=things if obstacles else (),
        jaywalkers=walkers if jaywalker else (),
    )


def _way(roads: Roads, lane: str, rng: np.random.Generator) -> list[str]:
    """Lanes and connectors from a lane on, ending on a lane."""
    way, driven_m = [lane], roads[lane].centerline.length_m
    while driven_m < 500.0:
        ways = roads.outgoing(way[-1])
        if not ways:
            break
        connector = ways[int(rng.integers(len(ways)))]
        (after,) = roads.outgoing(connector)
        if roads[after].roadblock_id in {roads[each].roadblock_id for each in way}:
            break
        way += [connector, after]
        driven_m += roads[connector].centerline.length_m + roads[after].centerline.length_m
    return way


def _places(roads: Roads, way: list[str], start_m: float, rng: np.random.Generator) -> list[LanePosition]:
    """Random places on the way's lanes and their neighbours, 30 m and more ahead of the start, nearest first."""
    found: list[tuple[float, LanePosition]] = []
    driven_m = -start_m
    for each in way:
        length_m = roads[each].centerline.length_m
        first_m = max(3.0, 30.0 - driven_m)
        if each in roads.lanes and first_m < length_m - 3.0 and driven_m < 150.0:
            arc_m = float(rng.uniform(first_m, length_m - 3.0))
            siblings = roads.roadblocks[roads[each].roadblock_id].lane_ids
            lane = siblings[int(rng.integers(len(siblings)))]
            arc_m = min(arc_m, roads[lane].centerline.length_m - 1.0)
            found.append((driven_m + arc_m, LanePosition(lane, arc_m, float(rng.uniform(-1.8, 1.8)))))
        driven_m += length_m
    return [place for _, place in found]


def _across(roads: Roads, place: LanePosition, rng: np.random.Generator) -> Jaywalker:
    """From 1 m beside the outermost lane of one side to 1 m beside that of the other."""
    lanes = roads.roadblocks[roads[place.lane].roadblock_id].lane_ids
    ends: list[LanePosition] = []
    for lane, side in ((lanes[0], 1.0), (lanes[-1], -1.0)):
        line = roads[lane].centerline
        arc_m = min(place.arc_m, line.length_m - 0.5)
        boundary = roads[lane].left_boundary if side > 0.0 else roads[lane].right_boundary
        half_m = float(np.hypot(*(boundary.points - (line.pose_at(arc_m).x_m, line.pose_at(arc_m).y_m)).T).min())
        ends.append(LanePosition(lane, arc_m, side * (half_m + 1.0)))
    if rng.random() < 0.5:
        ends.reverse()
    return Jaywalker(ends[0], ends[1], float(rng.uniform(1.0, 1.9)))


def lost_soul(line: Polyline, start: EgoState, rng: np.random.Generator, steps: int) -> list[EgoState]:
    """An ego that drives along a line at a wandering offset: changes lanes, stops, backs, leaves the road, returns."""
    egos, x, y, heading, speed = [start], start.x_m, start.y_m, start.heading_rad, start.speed_mps
    offset_m, wished_mps, steer = 0.0, speed, 0.0
    for step in range(1, steps + 1):
        if step % 25 == 1:
            offset_m = float(rng.choice((0.0, 1.75, -1.75, 3.5, -3.5, 7.0, -12.0, 15.0)))
        if step % 40 == 1:
            wished_mps = float(rng.choice((0.0, -2.5, 4.0, 8.0, 12.0, 15.0)))
        speed += float(np.clip(wished_mps - speed, -0.6, 0.25))
        arc_m, _ = line.project_point(x, y)
        aim = line.pose_at(min(arc_m + 10.0, line.length_m), offset_m)
        wanted = float(np.clip(1.2 * _wrapped(atan2(aim.y_m - y, aim.x_m - x) - heading), -0.5, 0.5))
        steer += float(np.clip((wanted if speed >= 0.0 else -wanted) - steer, -0.08, 0.08))
        heading = _wrapped(heading + DT_S * speed * tan(steer) / PACIFICA.wheelbase_m)
        x, y = x + DT_S * speed * cos(heading), y + DT_S * speed * sin(heading)
        egos.append(EgoState(DT_S * step, x, y, heading, vx_mps=speed))
    return egos


def _wrapped(angle_rad: float) -> float:
    return atan2(sin(angle_rad), cos(angle_rad))


@dataclass(frozen=True)
class Audit:
    """What went wrong in a run, in words, how many agents have entered, and a digest of all that happened."""

    faults: list[str]
    entered: int
    hash: str


def overlapping(actors: Actors, frozen: frozenset[str] = frozenset()) -> list[tuple[str, str, float]]:
    """Pairs that penetrate by more than 5 cm, with the depth; pairs of two `frozen` actors excepted."""
    first, second = np.triu_indices(len(actors), 1)
    near = np.hypot(actors.x_m[first] - actors.x_m[second], actors.y_m[first] - actors.y_m[second]) < 20.0
    first, second = first[near], second[near]
    depth = penetration_m(actors.corners[first], actors.corners[second])
    return [
        (actors.ids[a], actors.ids[b], float(d))
        for a, b, d in zip(first, second, depth, strict=True)
        if d > OVERLAP_M
        and not (actors.ids[a] in frozen and actors.ids[b] in frozen)
        and not _walked_into(actors, int(a), int(b))
    ]


def _walked_into(actors: Actors, a: int, b: int) -> bool:
    """Whether a pedestrian is in touch with a car that stands: pedestrians yield to nobody."""
    return any(
        actors.kind[one] == ActorKind.PEDESTRIAN and actors.speed_mps[other] < STANDING_MPS
        for one, other in ((a, b), (b, a))
    )


def audited(scenario: Scenario, *, seed: int = 0, steps: int = 300, wild: bool = True) -> Audit:
    """Drive the scenario with a lost soul (`wild`), or stand still, before which no agent may appear in sight."""
    roads = load_roads(scenario.map)
    start = start_state(scenario, roads) if wild else start_state(replace(scenario, start_speed_mps=0.0), roads)
    line = route_centerline(roads, scenario)
    egos = lost_soul(line, start, np.random.default_rng(seed), steps) if wild else [start] * (steps + 1)
    faults, digest, overlapped, entered = list[str](), hashlib.sha256(), set[tuple[str, str]](), 0
    (begins, ends), newest = _limits(scenario), frozenset[str]()
    with open_traffic(scenario, roads, seed=seed) as traffic:
        before = traffic.observe().actors
        standing = frozenset(before.ids) - traffic.behaviours.keys()
        for step, now in enumerate(stepped(traffic, lambda step: egos[min(step, steps)], steps + 1)):
            at = f"t={step / 10:.1f}:"
            for column in (now.x_m, now.y_m, now.heading_rad, now.vx_mps, now.vy_mps):
                digest.update(np.ascontiguousarray(column).tobytes())
            for a, b, depth in overlapping(now, standing):
                if (a, b) not in overlapped:
                    overlapped.add((a, b))
                    faults.append(f"{at} {a} and {b} overlap {depth:.2f} m")
            faults += [f"{at} {fault}" for fault in _jumps(before, now, newest, ends, egos[min(step, steps)])]
            newest = frozenset(now.ids) - frozenset(before.ids)
            came = [row for row, name in enumerate(now.ids) if name in newest]
            entered += len(came)
            for x, y in ((float(now.x_m[row]), float(now.y_m[row])) for row in came if not wild):
                if hypot(x - start.x_m, y - start.y_m) < SIGHT_M and np.hypot(*(begins - (x, y)).T).min() > 20.0:
                    faults.append(f"{at} one appears in sight")
            before = now
    return Audit(faults, entered, digest.hexdigest())


def _limits(scenario: Scenario) -> tuple[Floats, Floats]:
    """(N, 2) where the network begins and where it ends, in the map frame: only there agents may come and go."""
    files = find_map(scenario.map)
    network, ids = read_network(files.network), NetworkIds.read(files.ids)
    lanes = [lane for lane in network.lanes.values() if not lane.internal]
    begins = [lane.line.points[0] for lane in lanes if not network.incoming.get(lane.id)]
    ends = [lane.line.points[-1] for lane in lanes if not network.links[lane.id]]
    return np.array(begins) + ids.origin_m, np.array(ends) + ids.origin_m


def _jumps(before: Actors, after: Actors, newest: frozenset[str], ends: Floats, ego: EgoState) -> list[str]:
    """Agents that vanish in sight or jump, and those among the `newest` that brake at once."""
    faults: list[str] = []
    row_of = {name: row for row, name in enumerate(after.ids)}
    for row, name in enumerate(before.ids):
        x, y = float(before.x_m[row]), float(before.y_m[row])
        if name not in row_of:
            away_m = float(np.hypot(*(ends - (x, y)).T).min())
            if away_m > 30.0 and hypot(x - ego.x_m, y - ego.y_m) < SIGHT_M:
                faults.append(f"{name} vanished in sight, {away_m:.0f} m from the end of the network")
            continue
        there = row_of[name]
        moved_m = hypot(after.x_m[there] - x, after.y_m[there] - y)
        if moved_m > DT_S * max(before.speed_mps[row], after.speed_mps[there]) + JUMP_M:
            faults.append(f"{name} jumped {moved_m:.2f} m")
        if name in newest and before.speed_mps[row] - after.speed_mps[there] > 4.0 * DT_S:
            faults.append(f"{name} brakes hard as soon as it has come")
    return faults
