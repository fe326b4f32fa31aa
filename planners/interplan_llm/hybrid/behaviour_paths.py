"""From a behaviour to where PDM may drive: a line from the ego's pose, shifted copies of it, and a limit."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from interplan_llm.hybrid.behaviours import Behaviour
from interplan_llm.hybrid.scene import BlockedLane, DecisionScene, LaneView, SceneObserver
from interplan_planners.common.paths import DrivingPath, lane_change_path, quintic_offset, shifted
from interplan_planners.common.pdm import PdmCorridor
from interplan_sumo.world.geometry import Floats, Polyline, Pose

LATERAL_OFFSETS_M = (0.0, -1.0, -0.1, 0.1, 1.0)
"""PDM++'s proposals beside the line; the line itself first, so that it wins ties."""
CENTER_WORTH = 0.02
"""A proposal beside the line must be this much better than those on it: else a car beside it stays there, for the way
back costs a hair of progress."""
CHANGE_S, CHANGE_M = 4.0, 14.0
"""Time, and least way, from one lane to the next."""
RETURN_S, RETURN_M = 2.5, 10.0
"""Back to the line of the own lane."""
PASSING_OFFSETS_M = (0.0, -0.2, -0.1, 0.1, 0.2)
"""The same beside what is passed, where a metre is too much."""
PASS_RAMP_S, PASS_RAMP_M = 4.0, 14.0
"""Time, and least way, to the offset at which something is passed, and back from it."""
ON_LINE_M = 0.2
LOST_M = 1.2
"""Farther than this from its line the car gets a new one."""
SAME_M = 0.5
"""What has moved, or grown, less than this is passed as before."""
STANDSTILL_MPS = 1e-3
"""A limit of exactly 0 divides by zero in the IDM."""


@dataclass(frozen=True, eq=False)
class _Aim:
    """What the car is about, for as long as it is."""

    passes: bool
    """Whether it goes round what blocks the way, or just along it."""
    lanes: tuple[str, ...]
    """Of the way that the line leads to."""
    beyond: tuple[float, float, float]
    """Where what is passed ends, and the offset there; zeros where nothing is passed."""
    corridor: PdmCorridor

    def serves(self, passes: bool, lane: str, beyond: tuple[float, float, float], axle: Pose) -> bool:
        """Whether it is still the thing to do, and the car is still near its line."""
        same = passes is self.passes and all(abs(a - b) < SAME_M for a, b in zip(beyond, self.beyond, strict=True))
        return same and self.holds(lane, axle)

    def holds(self, lane: str, axle: Pose) -> bool:
        """Whether its line belongs to a lane, and the car is near it."""
        return lane in self.lanes and abs(self.corridor.center.line.project_point(axle.x_m, axle.y_m)[1]) < LOST_M


class BehaviourPaths:
    """Makes corridors of behaviours; keeps the one under way while nothing about it changes."""

    def __init__(self, watch: SceneObserver) -> None:
        self._watch = watch
        self._aim: _Aim | None = None

    def corridor(self, behaviour: Behaviour, scene: DecisionScene, axle: Pose) -> PdmCorridor:
        """Where the behaviour leads; `axle` is the ego's rear axle, which follows lines.

        Who stops does it on the line that the car is on, and can go on with what it was about.
        """
        target = _target(behaviour, scene)
        passes = behaviour is Behaviour.OVERTAKE
        beyond = (0.0, 0.0, 0.0)
        if passes and target.blocked is not None:
            end = target.way.path.line.pose_at(target.blocked.end_m)
            beyond = (end.x_m, end.y_m, target.blocked.passes[0][1])
        held, lane, stands = self._aim, target.way.lanes[0], behaviour is Behaviour.STOP
        goes_on = held is not None and (held.holds(lane, axle) if stands else held.serves(passes, lane, beyond, axle))
        if held is None or not goes_on:
            held = _Aim(passes, target.way.lanes, beyond, self._made(behaviour, scene, target, axle))
            self._aim = held
        return replace(held.corridor, limit_mps=STANDSTILL_MPS) if stands else held.corridor

    def _made(self, behaviour: Behaviour, scene: DecisionScene, target: LaneView, axle: Pose) -> PdmCorridor:
        line = self._line(behaviour, scene, target, axle)
        center = DrivingPath(line)
        passes = behaviour is Behaviour.OVERTAKE
        offsets_m = PASSING_OFFSETS_M if passes else LATERAL_OFFSETS_M
        paths = [DrivingPath(shifted(line, offset)) if offset else center for offset in offsets_m]
        route = self._watch.route
        at = route.ground.under(np.array((axle.x_m,)), np.array((axle.y_m,)))
        against = passes and target.blocked is not None and target.blocked.against_traffic
        ground = self._watch.free_ground if against or not at.on_route[0] else route.ground
        worth = (CENTER_WORTH, *([0.0] * (len(paths) - 1)))
        return PdmCorridor(paths, center, ground, route.red_lights, route.limit_mps(target.way.lanes[0]), worth)

    def _line(self, behaviour: Behaviour, scene: DecisionScene, target: LaneView, axle: Pose) -> Polyline:
        line = target.way.path.line
        if behaviour is Behaviour.OVERTAKE and target.blocked is not None:
            return passing_line(line, axle, target.blocked, scene.speed_mps, self._watch.mission.shape.length_m)
        merges = behaviour in (Behaviour.MERGE_LEFT, Behaviour.MERGE_RIGHT)
        if not merges and abs(line.project_point(axle.x_m, axle.y_m)[1]) < ON_LINE_M:
            return line
        time_s, least_m = (CHANGE_S, CHANGE_M) if merges else (RETURN_S, RETURN_M)
        return lane_change_path(line, axle, max(time_s * scene.speed_mps, least_m))


def _target(behaviour: Behaviour, scene: DecisionScene) -> LaneView:
    lane = {Behaviour.MERGE_LEFT: scene.left, Behaviour.MERGE_RIGHT: scene.right}.get(behaviour, scene.current)
    assert lane is not None, f"{behaviour} was not offered"
    return lane


def passing_line(line: Polyline, axle: Pose, blocked: BlockedLane, speed_mps: float, length_m: float) -> Polyline:
    """A lane's line, shifted beside what blocks it: out before it, along it, and back when the ego's rear is past.

    It begins where the rear axle is, whatever the offset there.
    """
    _, offset_m = blocked.passes[0]
    arc_m, left_m = line.project_point(axle.x_m, axle.y_m)
    room_m = blocked.start_m - length_m - arc_m
    ramp_m = max(PASS_RAMP_S * speed_mps, PASS_RAMP_M)
    out_from_m = max(blocked.start_m - length_m - ramp_m, arc_m)
    out_m = max(min(ramp_m, blocked.start_m - length_m - out_from_m), min(PASS_RAMP_M, max(room_m, 4.0)))
    back_from_m = blocked.end_m + 0.5 * length_m
    grid = np.arange(max(arc_m - 10.0, 0.0), min(back_from_m + ramp_m, line.length_m), 1.0)
    arcs: Floats = np.unique(np.concatenate((line.arc_m, grid)))
    arcs = arcs[np.concatenate(([True], np.diff(arcs) > 0.05))]
    base = Polyline(line.poses_at(arcs)[:, :2])
    at = line.project(base.points)[0]
    out = left_m + (offset_m - left_m) * (1.0 - quintic_offset((at - out_from_m) / out_m, 1.0, 0.0))
    back = quintic_offset((at - back_from_m) / ramp_m, 1.0, 0.0)
    return shifted(base, np.where(at < back_from_m, out, offset_m * back))
