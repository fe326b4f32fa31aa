"""Do jaywalkers ask the question they are there for? Who drives on hits one, who brakes in time touches none.

Two speeds are tried, from the scenario's start: its start speed, which is what
"holds lane and speed" means (decisions.md), and the speed limit of the site,
which is what a driver reaches who speeds up to the limit and holds that: nobody
shall get by unhurt by starting to hold a little later.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_sumo.scenario.constant_velocity import OVERLAP_M, STEP_S, beside, ego_ahead, ego_boxes
from interplan_sumo.scenario.jaywalking import PedestrianWalk, trigger_distance_m, walk
from interplan_sumo.scenario.route import route_centerline, start_arc_m
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import Floats, box_corners, box_polygons, penetration_m
from interplan_sumo.world.roads import USUAL_LIMIT_MPS, Roads

BRAKING_MPS2: Final = 3.0
"""Who brakes like this from the trigger on touches nobody (decisions.md)."""
HIGHEST_LIMIT_MPS: Final = 50.0 / 3.6
"""Of a site with jaywalkers (decisions.md)."""
LIMIT_SLACK_MPS: Final = 0.05
"""Maps round their limits: 13.9 m/s is 50 km/h."""
HIDERS: Final = ("bus", "truck")


def crossing_problems(scenario: Scenario, roads: Roads) -> list[str]:
    """What is wrong with the jaywalkers of a scenario, whatever its family; nothing without any."""
    if not scenario.jaywalkers:
        return []
    walks = _walks(scenario, roads)
    problems = [*_where_they_stand(scenario, roads, walks), *_occluder(scenario, roads, walks)]
    site, limit_mps = scenario.jaywalkers[0].start.lane, _limit_mps(scenario, roads)
    if limit_mps > HIGHEST_LIMIT_MPS + LIMIT_SLACK_MPS:
        problems.append(
            f"jaywalkers[0].start.lane: the speed limit of lane {site} is {3.6 * limit_mps:.0f} km/h, expected at most "
            f"{3.6 * HIGHEST_LIMIT_MPS:.0f} km/h where people step into the road"
        )
    for speed_mps, said in _speeds(scenario, limit_mps):
        braked = approach(scenario, roads, walks, speed_mps, BRAKING_MPS2)
        touched = np.argwhere(braked.depth_m >= 0.0)
        if touched.size:
            walker, frame = min(touched.tolist(), key=lambda cell: cell[1])
            problems.append(
                f"jaywalkers[{walker}]: a drive at {said}, that brakes with {BRAKING_MPS2:.0f} m/s2 from the trigger "
                f"on touches this pedestrian after {frame * STEP_S:.1f} s, expected it never to; start it farther from "
                "the lane, or lead it away from the ego"
            )
    return problems


def unhurt_problems(scenario: Scenario, roads: Roads) -> list[str]:
    """Who drives on hits somebody; nothing without jaywalkers."""
    if not scenario.jaywalkers:
        return []
    problems: list[str] = []
    for speed_mps, said in _speeds(scenario, _limit_mps(scenario, roads)):
        held = approach(scenario, roads, _walks(scenario, roads), speed_mps)
        if not (held.depth_m > OVERLAP_M).any():
            near_m = -float(held.depth_m.max(initial=-np.inf))
            problems.append(
                f"jaywalkers: a drive that holds its lane and {said}, misses everyone by {near_m:.2f} m or more, "
                "expected it to hit somebody; change where they start or how fast they walk"
            )
    return problems


def _walks(scenario: Scenario, roads: Roads) -> list[PedestrianWalk]:
    return [walk(jaywalker, roads, route_centerline(roads, scenario)) for jaywalker in scenario.jaywalkers]


def _limit_mps(scenario: Scenario, roads: Roads) -> float:
    """Where the first pedestrian steps into the road."""
    return roads[scenario.jaywalkers[0].start.lane].speed_limit_mps or USUAL_LIMIT_MPS


def _speeds(scenario: Scenario, limit_mps: float) -> list[tuple[float, str]]:
    start_mps = scenario.start_speed_mps
    speeds = [(start_mps, f"its start speed, {start_mps:.1f} m/s")]
    if abs(limit_mps - start_mps) > LIMIT_SLACK_MPS:
        speeds.append((limit_mps, f"the limit, {limit_mps:.1f} m/s"))
    return speeds


@dataclass(frozen=True, slots=True, eq=False)
class JaywalkerApproach:
    """A drive towards jaywalkers along the ego's lane, in frames of 0.1 s."""

    ego: Floats
    """(K, 4, 2) corners."""
    walkers: Floats
    """(W, K, 3) poses of the pedestrians."""
    set_off: NDArray[np.int64]
    """(W,) the frame in which each is triggered; K if never."""
    depth_m: Floats
    """(W, K) by how much the ego's box penetrates each pedestrian's; negative: apart."""


def approach(
    scenario: Scenario, roads: Roads, walks: list[PedestrianWalk], speed_mps: float, braking_mps2: float = 0.0
) -> JaywalkerApproach:
    """Drive from the start at constant speed, and brake to a stand from when the first pedestrian sets off.

    As the episode goes: whoever is triggered by the ego of one frame has
    walked one step in the next, and triggers look at the speed of the frame.
    """
    frames = np.arange(round(scenario.duration_s / STEP_S), dtype=np.float64)
    time_s: Floats = frames * STEP_S
    held = _along(scenario, roads, speed_mps * time_s)
    set_off = _set_off(scenario, roads, walks, held, np.full_like(time_s, speed_mps))
    first = int(set_off.min())
    if braking_mps2 > 0.0 and first < len(frames):
        braking_s: Floats = np.clip(time_s - time_s[first], 0.0, speed_mps / braking_mps2)
        rolling_s: Floats = np.clip(time_s, 0.0, time_s[first])
        held = _along(scenario, roads, speed_mps * (rolling_s + braking_s) - braking_mps2 * braking_s**2 / 2.0)
        set_off = _set_off(scenario, roads, walks, held, speed_mps - braking_mps2 * braking_s)
    walkers = np.stack([each.poses((frames - off) * STEP_S) for each, off in zip(walks, set_off, strict=True)])
    boxes = (_corners(each, poses) for each, poses in zip(walks, walkers, strict=True))
    depth_m = np.stack([penetration_m(held, corners) for corners in boxes])
    return JaywalkerApproach(held, walkers, set_off, depth_m)


def _along(scenario: Scenario, roads: Roads, driven_m: Floats) -> Floats:
    """(K, 4, 2) the ego's corners that far along its lane; at the end of the road it has gone."""
    line = ego_ahead(scenario, roads, float(driven_m[-1]) + PACIFICA.length_m)
    return ego_boxes(beside(line, driven_m, scenario.start.left_m))


def _set_off(
    scenario: Scenario, roads: Roads, walks: list[PedestrianWalk], ego: Floats, speed_mps: Floats
) -> NDArray[np.int64]:
    """(W,) the first frame whose ego triggers each pedestrian; the number of frames if none does."""
    centre_m, _ = route_centerline(roads, scenario).project(ego.mean(axis=1))
    trigger_m = np.array([trigger_distance_m(float(speed)) for speed in speed_mps])
    found: list[int] = []
    for each in walks:
        ahead_m = each.conflict_m - centre_m - PACIFICA.length_m / 2.0
        near = np.flatnonzero((-PACIFICA.length_m <= ahead_m) & (ahead_m <= trigger_m))
        found.append(int(near[0]) if near.size else len(ego))
    return np.array(found)


def _corners(each: PedestrianWalk, poses: Floats) -> Floats:
    """(K, 4, 2) boxes of a pedestrian at poses (K, 3)."""
    x_m, y_m, heading_rad = poses.T
    return box_corners(x_m, y_m, heading_rad, *(np.full_like(x_m, size_m) for size_m in each.size_m))


def _where_they_stand(scenario: Scenario, roads: Roads, walks: list[PedestrianWalk]) -> list[str]:
    """Nobody waits, or stays after the walk, in the ego's way; and at the start everybody still waits."""
    problems: list[str] = []
    way = ego_ahead(scenario, roads, 1000.0).linestring
    start_m = start_arc_m(roads, scenario)
    trigger_m = trigger_distance_m(scenario.start_speed_mps)
    for i, each in enumerate(walks):
        ends = _corners(each, each.poses(np.array([-1.0, each.duration_s])))
        for place, corners in zip(("start", "end"), ends, strict=True):
            gap_m = float(shapely.distance(shapely.Polygon(corners), way)) - PACIFICA.width_m / 2.0
            if gap_m <= 0.0:
                problems.append(
                    f"jaywalkers[{i}].{place}: stands in the way of an ego that keeps its lane, "
                    f"expected {-gap_m:.1f} m farther to the side"
                )
        ahead_m = each.conflict_m - start_m - PACIFICA.length_m / 2.0
        if ahead_m <= trigger_m:
            problems.append(
                f"jaywalkers[{i}]: the ego's front starts {ahead_m:.1f} m before the crossing and sets this pedestrian "
                f"off at once, expected more than {trigger_m:.1f} m; start the ego farther back"
            )
    return problems


def _occluder(scenario: Scenario, roads: Roads, walks: list[PedestrianWalk]) -> list[str]:
    """The named bus is one, and for a while hides somebody from an ego that comes nearer, holding lane and speed."""
    if scenario.occluder is None:
        return []
    hider = scenario.obstacles[scenario.occluder]
    if hider.kind not in HIDERS:
        return [f"occluder: obstacles[{scenario.occluder}] is a {hider.kind}, expected a {' or a '.join(HIDERS)}"]
    pose = hider.pose(roads)
    (box,) = box_polygons(pose.x_m, pose.y_m, pose.heading_rad, *hider.size_m)
    drive = approach(scenario, roads, walks, scenario.start_speed_mps)
    eyes = drive.ego.mean(axis=1)
    centre_m, _ = route_centerline(roads, scenario).project(eyes)
    for each, poses in zip(walks, drive.walkers, strict=True):
        before = centre_m < each.conflict_m
        sight = shapely.linestrings(np.stack((eyes[before], poses[before, :2]), axis=1))
        if bool(np.any(shapely.crosses(sight, box))):
            return []
    return [
        f"occluder: obstacles[{scenario.occluder}] never comes between the ego and a pedestrian; "
        "move it towards the ego's side of them, or leave the occluder out"
    ]
