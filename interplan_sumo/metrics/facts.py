"""Facts: everything that several metrics derive from one drive, worked out once."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.errors import InputError
from interplan_sumo.metrics.association import (
    Containment,
    CornerPlaces,
    Place,
    body_lanes,
    centre_places,
    corner_places,
)
from interplan_sumo.metrics.collisions import Collision, find_collisions
from interplan_sumo.metrics.comfort_signals import FEWEST_FRAMES, comfort_signals
from interplan_sumo.metrics.expert_route import RouteBlock, progress_per_frame, project_m, route_blocks
from interplan_sumo.scenario.route import goal_arc_m, route_centerline
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.geometry import Floats, Ints, Polyline, box_corners
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trace import EgoTrack, Trace


@dataclass(frozen=True, eq=False)
class Facts:
    """One drive, the map it took place on, and what the two say together.

    N is the number of frames. Positions are (N, 2), map frame.
    """

    trace: Trace
    roads: Roads
    expert: EgoTrack
    """The drive against which progress is measured; may be longer or shorter than the trace."""
    scenario: Scenario | None = None
    """What was staged; nuPlan's metrics do without."""
    results: dict[object, Any] = field(default_factory=dict[object, Any], init=False, repr=False)
    """What metrics have said so far, by their functions."""

    @property
    def frames(self) -> int:
        """How many the drive has."""
        return len(self.trace)

    @cached_property
    def time_s(self) -> Floats:
        """(N,) since the first frame."""
        time_us = self.trace.ego.time_us
        return (time_us - time_us[0]) * 1e-6 if len(time_us) else np.zeros(0)

    @cached_property
    def step_us(self) -> float:
        """Mean step in microseconds; 0.1 s where there is only one frame."""
        steps = np.diff(self.trace.ego.time_us)
        return float(np.mean(steps)) if len(steps) else 1e5

    @cached_property
    def speed_mps(self) -> Floats:
        """(N,) magnitude of the velocity at the rear axle, never negative."""
        return np.hypot(self.trace.ego.vx_mps, self.trace.ego.vy_mps)

    @cached_property
    def centre(self) -> Floats:
        """(N, 2) box centre."""
        return np.column_stack((self.trace.ego.x_m, self.trace.ego.y_m))

    @cached_property
    def rear_axle(self) -> Floats:
        """(N, 2) rear axle."""
        return np.column_stack(self.trace.ego.rear_axle(self.trace.shape))

    @cached_property
    def corners(self) -> Floats:
        """(N, 4, 2) box corners: front left, rear left, rear right, front right."""
        return self.trace.ego.corners(self.trace.shape)

    @cached_property
    def comfort_signals(self) -> dict[str, Floats]:
        """Accelerations, jerks and turning (N,) by name; empty for a drive too short to have them."""
        if self.frames < FEWEST_FRAMES:
            return {}
        # differences of seconds, as in nuPlan: large time stamps lose digits here that show in second derivatives
        step_s = float(np.mean(np.diff(self.trace.ego.time_us / 1e6)))
        return comfort_signals(self.trace.ego, self.trace.shape.rear_axle_to_center_m, step_s)

    # --- where the ego is in the lane graph ----------------------------------------------------

    @cached_property
    def containment(self) -> Containment:
        """What holds each centre (rows 0 to N), each rear axle (N to 2N) and each corner (2N to 6N)."""
        return Containment.of(self.roads, np.concatenate((self.centre, self.rear_axle, self.corners.reshape(-1, 2))))

    @cached_property
    def places(self) -> tuple[Place, ...]:
        """(N,) the lane or connectors that the centre drives on."""
        return centre_places(self.roads, self.containment, self.centre)

    @cached_property
    def corner_places(self) -> tuple[CornerPlaces, ...]:
        """(N,) the lanes or connectors of the four corners."""
        rows = np.arange(2 * self.frames, 6 * self.frames).reshape(-1, 4)
        return corner_places(self.roads, self.containment, rows.tolist())

    @cached_property
    def body_lanes(self) -> tuple[frozenset[str] | None, ...]:
        """(N,) lanes that hold the whole body; empty where none does, None where it is astride."""
        return body_lanes(self.roads, self.corner_places)

    @cached_property
    def in_one_lane(self) -> NDArray[np.bool_]:
        """(N,) whether all corners are in one lane, or in lanes that continue each other."""
        return np.array([bool(lanes) for lanes in self.body_lanes], dtype=np.bool_)

    @cached_property
    def in_intersection(self) -> NDArray[np.bool_]:
        """(N,) whether the rear axle is inside an intersection."""
        return self.containment.in_intersection[self.frames : 2 * self.frames]

    # --- whom it met ---------------------------------------------------------------------------

    @cached_property
    def collisions(self) -> tuple[Collision, ...]:
        """First contact with each track, in order of time."""
        heading = self.trace.ego.heading_rad
        return find_collisions(
            self.corners, self.rear_axle, heading, self.speed_mps, self.in_one_lane, self.trace.actors
        )

    @cached_property
    def not_hit(self) -> NDArray[np.bool_]:
        """(R,) rows of the actor table whose track the ego has not touched in this frame or before."""
        actors = self.trace.actors
        free = np.ones(len(actors), dtype=np.bool_)
        for collision in self.collisions:
            since = int(actors.starts[collision.frame])
            free[since:] &= actors.ids[since:] != collision.track
        return free

    @cached_property
    def actor_xy(self) -> Floats:
        """(R, 2) box centre of each row of the actor table."""
        return np.column_stack((self.trace.actors.x_m, self.trace.actors.y_m))

    @cached_property
    def actor_speed_mps(self) -> Floats:
        """(R,) magnitude of the velocity of each row of the actor table."""
        return np.hypot(self.trace.actors.vx_mps, self.trace.actors.vy_mps)

    @cached_property
    def row_before(self) -> Ints:
        """(R,) row of the same track one frame before; -1 where it was not there."""
        actors = self.trace.actors
        names = actors.ids.tolist()
        number_of = {name: number for number, name in enumerate(dict.fromkeys(names))}
        track = np.fromiter(map(number_of.__getitem__, names), np.int64, len(names))
        row_of = np.full((self.frames + 1, len(number_of)), -1)
        row_of[actors.frame + 1, track] = np.arange(len(names))
        return row_of[actors.frame, track]

    # --- what the expert did -------------------------------------------------------------------

    @cached_property
    def expert_centre(self) -> Floats:
        """(M, 2) box centres of the expert."""
        return np.column_stack((self.expert.x_m, self.expert.y_m))

    @cached_property
    def expert_places(self) -> tuple[Place, ...]:
        """(M,) the lane or connectors that the expert drives on."""
        return centre_places(self.roads, Containment.of(self.roads, self.expert_centre), self.expert_centre)

    @cached_property
    def expert_blocks(self) -> tuple[RouteBlock, ...]:
        """The roadblocks that the expert passes, in order."""
        return route_blocks(self.roads, self.expert_places)

    @cached_property
    def block_gains_m(self) -> tuple[Floats, Floats]:
        """Progress per frame along the expert's roadblocks, of the ego (N,) and of the expert (M,)."""
        blocks = self.expert_blocks
        return progress_per_frame(blocks, self.centre), progress_per_frame(blocks, self.expert_centre)

    # --- the scenario's own line ---------------------------------------------------------------

    @cached_property
    def staged(self) -> Scenario:
        """The scenario; InputError without one."""
        if self.scenario is None:
            raise InputError("interPlan's metrics need the scenario; give it, or score with profile nuplan")
        return self.scenario

    @cached_property
    def obstacle_corners(self) -> tuple[Floats, ...]:
        """What must be passed: the four corners (4, 2) of each obstacle.

        Where pedestrians cross it is the points (K, 2) of each way across
        instead, and what stands beside them, such as a bus, is scenery.
        """
        if self.scenario is None:
            return ()
        if self.scenario.jaywalkers:
            ways = [[place.pose(self.roads) for place in walker.places] for walker in self.scenario.jaywalkers]
            return tuple(np.array([(pose.x_m, pose.y_m) for pose in way]) for way in ways)
        boxes = [(obstacle.pose(self.roads), obstacle.size_m) for obstacle in self.scenario.obstacles]
        return tuple(box_corners(pose.x_m, pose.y_m, pose.heading_rad, *size)[0] for pose, size in boxes)

    @cached_property
    def route_line(self) -> Polyline:
        """The scenario's route as one line."""
        return route_centerline(self.roads, self.staged)

    @cached_property
    def route_arc_m(self) -> Floats:
        """(N,) arc length of the centre on the route line, at most the goal's."""
        return self._route_arc_m(self.centre)

    @cached_property
    def expert_route_ends_m(self) -> Floats:
        """(2,) the same of the first and the last centre of the expert; none where it has none."""
        return self._route_arc_m(self.expert_centre[[0, -1]] if len(self.expert_centre) else self.expert_centre)

    @cached_property
    def expert_route_arc_m(self) -> Floats:
        """(M,) the same of the expert's centres; where their ends are enough, `expert_route_ends_m` is quicker."""
        return self._route_arc_m(self.expert_centre)

    def _route_arc_m(self, xy: Floats) -> Floats:
        return np.minimum(project_m(self.route_line, xy), goal_arc_m(self.roads, self.staged))
