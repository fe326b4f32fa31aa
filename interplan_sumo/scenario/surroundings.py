"""Surroundings: the road users of one instant of a recording as SUMO can stage them, in lanes and as obstacles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import floor
from typing import Final

import numpy as np

from interplan_sumo.scenario.matching import LaneMatch, matches
from interplan_sumo.scenario.route import goal_arc_m, route_centerline
from interplan_sumo.scenario.scenario import (
    VEHICLE_KINDS,
    LanePosition,
    Obstacle,
    ObstacleKind,
    PlacedVehicle,
    Scenario,
    VehicleKind,
)
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import Floats, box_corners, penetration_m, wrap_angle
from interplan_sumo.world.recording import RecordedTrack
from interplan_sumo.world.roads import Lane, Roads

STANDS_MPS: Final = 0.5
"""Nobody slower than this is driving."""
PARKED_M: Final = 1.0
"""What never gets farther than this from where it is, stands for good."""
IN_LANE_M: Final = 0.9
"""What stands nearer to the centre line than this waits in the lane; farther off it is parked beside the traffic."""
ALONG_LANE_M: Final = 1.9
"""Whoever drives nearer to the centre line than this is put on it: half the width of a lane."""
MOVED_M: Final = 3.0
"""A vehicle is moved along its lane by up to this, so that it does not reach beyond its end."""
OFF_LANES_M: Final = 10.0
"""What stands farther than this from every centre line does not concern the traffic."""
BEFORE_GOAL_M: Final = 20.0
"""The goal lies at least this far behind everything that stands, as in every scenario."""
EXACT_M: Final = 0.1
"""An obstacle stands at most this far from where it was recorded."""
LENGTH_M: Final[dict[str, float]] = {"car": 4.6, "truck": 8.0, "bus": 12.0, "motorcycle": 2.2}
"""As in the vehicle-type files."""
WIDTH_M: Final[dict[str, float]] = {"car": 1.85, "truck": 2.4, "bus": 2.55, "motorcycle": 0.9}
_STATIC: Final[dict[ActorKind, ObstacleKind]] = {
    ActorKind.TRAFFIC_CONE: "cone",
    ActorKind.BARRIER: "barrier",
    ActorKind.CZONE_SIGN: "sign",
    ActorKind.GENERIC_OBJECT: "barrier",
}


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What stands and drives around the ego."""

    vehicles: tuple[PlacedVehicle, ...]
    obstacles: tuple[Obstacle, ...]
    left_out: tuple[tuple[str, str], ...]
    """Ids of tracks with the reason."""


def surroundings(tracks: Sequence[RecordedTrack], step: int, bare: Scenario, roads: Roads) -> Surroundings:
    """Everyone who is there at a step of the recording, the nearest to the ego first, as far as they can be staged.

    Whoever comes later cannot be; nor can those who drive inside a junction or
    off the lanes, people who walk, and cyclists.
    """
    start = bare.start.pose(roads)
    taken = [box_corners(start.x_m, start.y_m, start.heading_rad, PACIFICA.length_m, PACIFICA.width_m)]
    vehicles: list[PlacedVehicle] = []
    obstacles: list[Obstacle] = []
    left_out: list[tuple[str, str]] = []

    def away_m(track: RecordedTrack) -> float:
        row = track.at(step)
        return np.inf if row is None else float(np.hypot(*(track.poses[row, :2] - (start.x_m, start.y_m))))

    for track in sorted(tracks, key=lambda track: (away_m(track), track.id)):
        found = _staged(track, step, bare, roads)
        if not isinstance(found, str):
            box = _box(found, roads)
            if any(float(penetration_m(box, other)[0]) > 0.0 for other in taken):
                found = "its box overlaps another one where it would be put"
            else:
                taken.append(box)
        if isinstance(found, str):
            left_out.append((track.id, found))
        elif isinstance(found, Obstacle):
            obstacles.append(found)
        else:
            vehicles.append(found)
    return Surroundings(tuple(vehicles), tuple(obstacles), tuple(sorted(left_out)))


def _staged(track: RecordedTrack, step: int, bare: Scenario, roads: Roads) -> PlacedVehicle | Obstacle | str:
    """What a track is in the scenario, or why it is nothing."""
    row = track.at(step)
    if row is None:
        return "it appears later" if track.first_step > step else "it was gone before"
    pose = track.poses[row]
    speed_mps = float(np.hypot(*track.velocity_mps[row]))
    if track.kind is ActorKind.BICYCLE:
        return "it is a bicycle, which SUMO's traffic here has none of"
    if track.kind in _STATIC:
        return _obstacle(track, _STATIC[track.kind], pose, bare, roads)
    stays = speed_mps < STANDS_MPS and float(np.hypot(*(track.poses[row:, :2] - pose[:2]).T).max()) <= PARKED_M
    if track.kind is ActorKind.PEDESTRIAN:
        if not stays:
            return "it walks, and pedestrians who walk are not driven by SUMO here"
        if not roads.drivable(pose[:2])[0]:
            return "it stands off the road"
        return _obstacle(track, "worker", pose, bare, roads)
    kind: VehicleKind = track.model if track.model in VEHICLE_KINDS else "car"
    near = matches(roads, pose, ALONG_LANE_M)
    lanes = [match for match in near if isinstance(roads[match.lane], Lane)]
    if stays and not any(abs(match.left_m) <= IN_LANE_M for match in near):
        return _obstacle(track, kind if kind in ("truck", "bus") else "car", pose, bare, roads)
    if not near:
        return "it drives off the lanes, or across them"
    if not lanes:
        return "it is inside a junction, where SUMO's vehicles cannot begin"
    return _vehicle(lanes[0], kind, speed_mps, roads)


def _vehicle(match: LaneMatch, kind: VehicleKind, speed_mps: float, roads: Roads) -> PlacedVehicle | str:
    """On the centre line, wholly on the lane."""
    half_m, length_m = LENGTH_M[kind] / 2.0, roads[match.lane].centerline.length_m
    if 2.0 * half_m > length_m - 0.01:
        return f"lane {match.lane} is shorter than a {kind}"
    arc_m = min(max(match.arc_m, half_m + 0.001), length_m - half_m - 0.001)
    if abs(arc_m - match.arc_m) > MOVED_M:
        return f"it reaches beyond lane {match.lane} by more than {MOVED_M:g} m"
    place = LanePosition(match.lane, floor(arc_m * 1000.0) / 1000.0)
    return PlacedVehicle(place, round(speed_mps if speed_mps >= STANDS_MPS else 0.0, 3), kind)


def _obstacle(track: RecordedTrack, kind: ObstacleKind, pose: Floats, bare: Scenario, roads: Roads) -> Obstacle | str:
    """Where it was recorded, given by the nearest lane that it lies beside."""
    found = obstacle_at(roads, kind, pose, (round(track.length_m, 3), round(track.width_m, 3)))
    return f"it stands beside no lane within {OFF_LANES_M:g} m" if found is None else _before_goal(found, bare, roads)


def obstacle_at(
    roads: Roads, kind: ObstacleKind, pose: Floats, size_m: tuple[float, float] | tuple[None, None] = (None, None)
) -> Obstacle | None:
    """An obstacle with its centre at a pose (3,), None where no lane is near; without a size that of its kind."""
    x_m, y_m, heading_rad = (float(value) for value in pose)
    place = place_at(roads, x_m, y_m, OFF_LANES_M)
    if place is None:
        return None
    line = roads[place.lane].centerline
    turned_rad = float(wrap_angle(heading_rad - line.pose_at(line.project_point(x_m, y_m)[0]).heading_rad))
    return Obstacle(place, kind, round(turned_rad, 5), *size_m)


def place_at(roads: Roads, x_m: float, y_m: float, reach_m: float) -> LanePosition | None:
    """The point as a place beside the nearest lane or connector that it lies beside; None if none is within reach."""
    for lane in sorted(roads.lanes_near(x_m, y_m, reach_m), key=lambda each: _away_m(roads, each, x_m, y_m)):
        arc_m, left_m = roads[lane].centerline.project_point(x_m, y_m)
        place = LanePosition(lane, floor(arc_m * 1000.0) / 1000.0, round(left_m, 3))
        there = place.pose(roads)
        if np.hypot(there.x_m - x_m, there.y_m - y_m) <= EXACT_M:
            return place
    return None


def _away_m(roads: Roads, lane: str, x_m: float, y_m: float) -> tuple[float, str]:
    return abs(roads[lane].centerline.project_point(x_m, y_m)[1]), lane


def _before_goal(obstacle: Obstacle, bare: Scenario, roads: Roads) -> Obstacle | str:
    far_m = float(route_centerline(roads, bare).project(_box(obstacle, roads)[0])[0].max())
    if far_m + BEFORE_GOAL_M > goal_arc_m(roads, bare):
        return f"it stands beyond the goal, or less than {BEFORE_GOAL_M:g} m before it"
    return obstacle


def _box(thing: PlacedVehicle | Obstacle, roads: Roads) -> Floats:
    """(1, 4, 2) corners."""
    if isinstance(thing, Obstacle):
        pose, size = thing.pose(roads), thing.size_m
    else:
        pose, size = thing.place.pose(roads), (LENGTH_M[thing.kind], WIDTH_M[thing.kind])
    return box_corners(pose.x_m, pose.y_m, pose.heading_rad, *size)
