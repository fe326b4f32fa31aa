"""Where a behaviour leads: lines that are kept, proposals beside them, and the ground that may be used."""

from __future__ import annotations

import numpy as np
import pytest
from worlds import cars, ego, junction, mission, straight_road, unmoved

from interplan_llm.hybrid.behaviour_paths import BehaviourPaths, passing_line
from interplan_llm.hybrid.behaviours import Behaviour
from interplan_llm.hybrid.scene import BlockedLane, DecisionScene, SceneObserver
from interplan_planners.common.pdm import PdmCorridor
from interplan_sumo.planner import Mission
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.geometry import Polyline, Pose

ROAD = mission(straight_road(lanes=2, length_m=600.0, limit_mps=12.0), ("11",), goal_arc_m=400.0)
ASIDE = cars((130.0, -1.75), width_m=1.5)  # reaches a metre into the upper lane


class Drive:
    """One episode, of which corridors are made."""

    def __init__(self, job: Mission = ROAD, actors: Actors | None = None) -> None:
        self.watch = SceneObserver(job, 15.0)
        self.actors = actors
        self._behaviour_paths = BehaviourPaths(self.watch)

    def scene(self, state: EgoState) -> DecisionScene:
        return self.watch.scene(unmoved(state, self.actors))

    def corridor(self, behaviour: Behaviour, state: EgoState) -> PdmCorridor:
        return self._behaviour_paths.corridor(behaviour, self.scene(state), state.rear_axle(PACIFICA))


def ends_at_y_m(corridor: PdmCorridor) -> float:
    line = corridor.center.line
    return float(line.points[-1, 1])


def test_who_stops_while_passing_keeps_to_the_line_and_can_go_on() -> None:
    drive = Drive(actors=ASIDE)
    passing = drive.corridor(Behaviour.OVERTAKE, ego(100.0, 0.0, 8.0))
    stopping = drive.corridor(Behaviour.STOP, ego(110.0, 0.2, 8.0))
    assert stopping.center is passing.center
    assert stopping.limit_mps == pytest.approx(0.0, abs=0.01)
    going_on = drive.corridor(Behaviour.OVERTAKE, ego(112.0, 0.2, 1.0))
    assert going_on is passing


def test_who_stops_just_after_setting_out_for_another_lane_goes_back() -> None:
    drive = Drive()
    merging = drive.corridor(Behaviour.MERGE_LEFT, ego(100.0, -3.5, 8.0))
    stopping = drive.corridor(Behaviour.STOP, ego(108.0, -3.0, 8.0))
    assert ends_at_y_m(merging) == pytest.approx(0.0, abs=0.01)
    assert ends_at_y_m(stopping) == pytest.approx(-3.5, abs=0.01)


def test_who_follows_after_a_stop_has_the_limit_again() -> None:
    drive = Drive()
    drive.corridor(Behaviour.STOP, ego(100.0, 0.0, 8.0))
    assert drive.corridor(Behaviour.FOLLOW, ego(105.0, 0.0, 4.0)).limit_mps == pytest.approx(12.0)


@pytest.mark.parametrize(("behaviour", "aside_m"), [(Behaviour.FOLLOW, 1.0), (Behaviour.OVERTAKE, 0.2)])
def test_beside_what_is_passed_the_proposals_keep_nearer_to_the_line(behaviour: Behaviour, aside_m: float) -> None:
    corridor = Drive(actors=ASIDE).corridor(behaviour, ego(100.0, 0.0, 8.0))
    ends = [path.line.points[-1] for path in corridor.paths]
    assert max(np.hypot(*(end - ends[0])) for end in ends) == pytest.approx(aside_m, abs=0.01)


def test_the_way_out_to_the_next_lane_and_back_is_gentle_where_there_is_room() -> None:
    line = Polyline(np.array(((0.0, 0.0), (300.0, 0.0))))
    obstacle = BlockedLane("barrier", 95.0, 150.0, 155.0, (("left", 3.5),), against_traffic=True)
    passing = passing_line(line, Pose(50.0, 0.0, 0.0), obstacle, 10.0, PACIFICA.length_m)
    assert passing.poses_at(np.array((150.0,)))[0, 1] == pytest.approx(3.5, abs=0.01)
    x_m, y_m = passing.points.T
    curvature = np.gradient(np.gradient(y_m, x_m), x_m)
    assert 10.0**2 * np.abs(curvature).max() < 1.5  # m/s^2


def test_who_is_still_on_the_oncoming_lane_may_drive_on_it_back_to_the_own() -> None:
    drive = Drive(mission(junction(), ("1", "13", "7")))  # comes from the west, 1.75 m right of the middle of the road
    assert drive.corridor(Behaviour.FOLLOW, ego(-50.0, -1.75, 8.0)).ground is drive.watch.route.ground
    assert drive.corridor(Behaviour.FOLLOW, ego(-40.0, 1.75, 8.0)).ground is drive.watch.free_ground
