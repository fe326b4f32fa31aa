"""Start checks: is a scenario sound before anybody drives it? The rules of the benchmark, one line per breach."""

from __future__ import annotations

from difflib import get_close_matches
from typing import Final

import numpy as np

from interplan_sumo.errors import InputError, ScenarioError, TrafficError, UnknownNameError
from interplan_sumo.families import FAMILIES, find_family
from interplan_sumo.families.crossing import crossing_problems
from interplan_sumo.families.passing import obstacle_corners
from interplan_sumo.maps.store import load_roads
from interplan_sumo.metrics.metric import METRICS
from interplan_sumo.metrics.profile import row_metrics
from interplan_sumo.scenario.constant_velocity import HOLD_S, OVERLAP_M, STEP_S, ego_boxes, ego_held
from interplan_sumo.scenario.jaywalking import walk
from interplan_sumo.scenario.route import goal_arc_m, route_centerline, route_lanes, start_arc_m
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import Floats, box_corners, penetration_m
from interplan_sumo.world.lane_changes import lane_changes_needed
from interplan_sumo.world.roads import Roads

GOAL_PAST_M: Final = 20.0
"""The goal lies at least this far behind the last obstacle or crossing (decisions.md)."""
LIMIT_SLACK_MPS: Final = 0.05


def start_problems(scenario: Scenario, roads: Roads, *, with_traffic: bool = True) -> list[str]:
    """Every breach of the rules at the start: which field, what is wrong, what would be right. Empty if sound.

    `with_traffic` also looks at the moving vehicles, which opens SUMO; without
    it everything is geometry and takes milliseconds. What does not fit the map
    at all is the only thing said. TrafficError that names the scenario, where
    SUMO fails.
    """
    try:
        scenario.check(roads)
        route_lanes(roads, scenario)
    except ScenarioError as error:
        return [_without_id(scenario, error)]
    problems = [
        *_exempt_problems(scenario),
        *_route_problems(scenario, roads),
        *_goal_problems(scenario, roads),
        *_ego_problems(scenario, roads),
        *_standing_problems(scenario, roads),
        *crossing_problems(scenario, roads),
        *(problem for check in find_family(scenario.family).checks for problem in check(scenario, roads)),
    ]
    if with_traffic:
        from interplan_sumo.verification.traffic_checks import traffic_problems  # loads SUMO

        try:
            problems += traffic_problems(scenario, roads)
        except InputError as error:
            problems.append(_without_id(scenario, error))
        except TrafficError as error:
            raise TrafficError(f"{scenario.id}: {error}") from error
    return problems


def validate(scenario: Scenario, *, with_traffic: bool = True) -> list[str]:
    """`start_problems` on the scenario's own map; a map that cannot be used is a problem, too."""
    try:
        roads = load_roads(scenario.map, scenario.maps_beside)
    except InputError as error:
        return [f"map: {error}"]
    return start_problems(scenario, roads, with_traffic=with_traffic)


def notes(scenario: Scenario) -> list[str]:
    """What nobody looked at, and why: a family of another package has checks of its own."""
    name = scenario.family
    if name in FAMILIES:
        return []
    near = get_close_matches(name, FAMILIES, n=1)
    guess = f". Did you mean {near[0]!r}?" if near else ""
    return [f"family: none named {name!r} is installed, so its own checks were not made{guess}"]


def _without_id(scenario: Scenario, error: InputError) -> str:
    return str(error).removeprefix(f"{scenario.id}: ")


def _exempt_problems(scenario: Scenario) -> list[str]:
    """What is exempt is something that drives are judged by."""
    known = {*row_metrics(), *METRICS}
    return [f"exempt: {UnknownNameError('metric', name, known)}" for name in scenario.exempt if name not in known]


def _route_problems(scenario: Scenario, roads: Roads) -> list[str]:
    """The goal lane can be reached from the start lane."""
    need = lane_changes_needed(roads, scenario.route, scenario.goal.lane).get(scenario.start.lane)
    if need is None:
        return [
            f"route: no way leads from the start on lane {scenario.start.lane} to the goal on lane "
            f"{scenario.goal.lane} inside it; start on another lane, or list the roadblocks between"
        ]
    return []


def _goal_problems(scenario: Scenario, roads: Roads) -> list[str]:
    """The goal line lies ahead, and well behind everything that stands or crosses."""
    line, goal_m = route_centerline(roads, scenario), goal_arc_m(roads, scenario)
    start_m = start_arc_m(roads, scenario)
    if goal_m <= start_m + PACIFICA.length_m:
        return [
            f"goal: it lies {goal_m - start_m:.1f} m ahead of the start along the route, "
            f"expected more than the ego's length, {PACIFICA.length_m:.1f} m"
        ]
    corners = obstacle_corners(scenario, roads)
    last: list[tuple[float, str]] = [
        (float(line.project(box)[0].max()), f"obstacles[{i}]") for i, box in enumerate(corners)
    ]
    for i, walker in enumerate(scenario.jaywalkers):
        ends = [(pose.x_m, pose.y_m) for pose in (place.pose(roads) for place in walker.places)]
        last.append((float(line.project(ends)[0].max()), f"jaywalkers[{i}]"))
    farthest_m, name = max(last, default=(-np.inf, ""))
    if goal_m < farthest_m + GOAL_PAST_M:
        return [
            f"goal: it lies {goal_m - farthest_m:.1f} m past {name} along the route, expected at least "
            f"{GOAL_PAST_M:.0f} m; move it {farthest_m + GOAL_PAST_M - goal_m:.1f} m on"
        ]
    return []


def _ego_problems(scenario: Scenario, roads: Roads) -> list[str]:
    """The ego starts lawfully: on the road, not too fast."""
    problems: list[str] = []
    limit_mps = roads[scenario.start.lane].speed_limit_mps
    if limit_mps is not None and scenario.start_speed_mps > limit_mps + LIMIT_SLACK_MPS:
        problems.append(
            f"start_speed_mps: {scenario.start_speed_mps:.1f} is above the limit of lane {scenario.start.lane}, "
            f"expected at most {limit_mps:.1f}"
        )
    pose = scenario.start.pose(roads)
    box = box_corners(pose.x_m, pose.y_m, pose.heading_rad, PACIFICA.length_m, PACIFICA.width_m)
    if not roads.drivable(box[0]).all():
        problems.append("start: the ego's box is not wholly on the drivable area; move it to the middle of a lane")
    return problems


def _standing_problems(scenario: Scenario, roads: Roads) -> list[str]:
    """Nothing that stands overlaps anything else at the start, and the ego reaches none of it within the hold time."""
    names, boxes = _standing(scenario, roads)
    if not names:
        return []
    problems: list[str] = []
    may_overlap = set(find_family(scenario.family).may_overlap(scenario))
    first, second = np.triu_indices(len(boxes), 1)
    depth_m = penetration_m(boxes[first], boxes[second])
    for i in np.flatnonzero(depth_m > OVERLAP_M).tolist():
        one, other = int(first[i]), int(second[i])
        if not {one, other} <= may_overlap:
            problems.append(
                f"{names[other]}: overlaps {names[one]} by {100 * float(depth_m[i]):.0f} cm, "
                f"expected at most {100 * OVERLAP_M:.0f}; move one of them"
            )
    return problems + _soon_hit(scenario, roads, names, boxes)


def _soon_hit(scenario: Scenario, roads: Roads, names: list[str], boxes: Floats) -> list[str]:
    """What the ego overlaps, or reaches within the hold time if it holds lane and speed."""
    near = np.argwhere(_reached(ego_boxes(ego_held(scenario, roads)), boxes))
    soonest: dict[int, int] = {}
    for row, frame in near.tolist():
        soonest[row] = min(frame, soonest.get(row, frame))
    problems: list[str] = []
    for row, frame in sorted(soonest.items()):
        if frame == 0:
            problems.append(f"start: the ego overlaps {names[row]}, expected at most {100 * OVERLAP_M:.0f} cm")
        else:
            problems.append(
                f"start: holding lane and speed the ego hits {names[row]} after {frame * STEP_S:.1f} s, "
                f"expected nothing within {HOLD_S:.0f} s; start it farther back or slower"
            )
    return problems


def _reached(ego: Floats, boxes: Floats) -> np.ndarray:
    """(N, K) whether each of the boxes (N, 4, 2) is penetrated by the ego's (K, 4, 2) of each frame."""
    rows, frames = np.indices((len(boxes), len(ego)))
    depth_m = penetration_m(boxes[rows.ravel()], ego[frames.ravel()])
    return depth_m.reshape(rows.shape) > OVERLAP_M


def _standing(scenario: Scenario, roads: Roads) -> tuple[list[str], Floats]:
    """Names and boxes (N, 4, 2) of the obstacles and of the pedestrians who wait."""
    names = [f"obstacles[{i}]" for i in range(len(scenario.obstacles))]
    corners = [obstacle_corners(scenario, roads)]
    for i, walker in enumerate(scenario.jaywalkers):
        way = walk(walker, roads, route_centerline(roads, scenario))
        names.append(f"jaywalkers[{i}]")
        x_m, y_m, heading_rad = way.poses(np.array([-1.0]))[0].tolist()
        corners.append(box_corners(x_m, y_m, heading_rad, *way.size_m))
    return names, np.concatenate(corners)
