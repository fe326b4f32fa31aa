"""PDM with proposals on the lanes beside: it changes where a change is wanted and safe, and is PDM otherwise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from worlds import cars, ego, ego_on, mission, observation, straight_road

from interplan_planners.pdm_proposals import PdmProposalsPlanner, PdmProposalsSettings
from interplan_sumo.planner import Mission, Past
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import PACIFICA, EgoState
from tests.planners.staging_planners import LOOP, LOOP_LANES, driven
from tests.quick import few

WIDTH_M = 3.5
TWO = straight_road(lanes=2, length_m=400.0, limit_mps=10.0)
TO_THE_RIGHT = mission(TWO, ("12",), goal_arc_m=380.0)


def started(task: Mission, settings: PdmProposalsSettings | None = None) -> PdmProposalsPlanner:
    planner = PdmProposalsPlanner(settings)
    planner.start(task)
    return planner


def drive(task: Mission, start: EgoState, actors: Actors | None = None, seconds: float = 10.0) -> list[EgoState]:
    return driven(started(task), start, round(10 * seconds), actors)


def proposed(planner: PdmProposalsPlanner, start: EgoState, actors: Actors | None = None) -> int:
    """How many proposals it makes in its first two steps, at most."""
    past = Past((start,) * 20, (actors or Actors.none(),) * 20)
    counts: list[int] = []
    for _ in range(2):
        planner.plan(observation(start, actors, past=past))
        assert planner.decision is not None
        counts.append(len(planner.decision.drives))
    return max(counts)


@pytest.mark.slow
def test_it_changes_to_the_goal_lane_and_stays_there() -> None:
    states = drive(TO_THE_RIGHT, ego(20.0, 0.0, 9.0), seconds=12.0)
    assert states[-1].y_m == pytest.approx(-WIDTH_M, abs=0.3)
    assert abs(states[-1].heading_rad) < 0.03


@pytest.mark.slow
@pytest.mark.parametrize(("behind_m", "mps", "goes"), [(12.0, 10.0, False), (40.0, 9.0, True)])
def test_it_does_not_change_before_somebody_who_would_have_to_brake_hard(
    behind_m: float, mps: float, goes: bool
) -> None:
    start = ego(60.0, 0.0, 5.0)
    states = drive(TO_THE_RIGHT, start, cars((60.0 - behind_m, -WIDTH_M, mps)), seconds=2.5)
    assert (abs(states[-1].y_m) > 0.3) == goes


@pytest.mark.slow
def test_around_what_stands_on_its_lane_it_goes_by_the_lane_beside_and_back() -> None:
    states = drive(mission(TWO, ("11",), goal_arc_m=300.0), ego(20.0, 0.0, 9.0), cars((90.0, 0.0)), seconds=25.0)
    assert min(state.y_m for state in states) < -2.0
    assert states[-1].x_m > 110.0
    assert states[-1].y_m == pytest.approx(0.0, abs=0.4)


@pytest.mark.slow
def test_within_its_lane_it_keeps_away_from_what_reaches_into_it() -> None:
    parked = cars((80.0, -WIDTH_M - 1.8), width_m=1.6)
    states = drive(mission(TWO, ("12",), goal_arc_m=200.0), ego(20.0, -WIDTH_M, 8.0), parked, seconds=12.0)
    assert 0.4 < max(state.y_m for state in states) + WIDTH_M < 2.0
    assert states[-1].x_m > 90.0


def test_there_are_at_most_sixty_proposals_and_on_a_single_lane_thirty() -> None:
    three = straight_road(lanes=3, length_m=400.0, limit_mps=10.0)
    blocked = cars((70.0, -WIDTH_M))
    assert proposed(started(mission(three, ("12",))), ego(30.0, -WIDTH_M, 8.0), blocked) == 60
    assert proposed(started(mission(straight_road(lanes=1), ("11",))), ego(30.0, 0.0, 8.0)) == 30


@pytest.mark.slow
@given(x_m=st.floats(20.0, 200.0), left_m=st.floats(-4.5, 1.0), mps=st.floats(0.0, 10.0), heading=st.floats(-0.2, 0.2))
def test_wherever_it_begins_it_plans_from_where_it_is(x_m: float, left_m: float, mps: float, heading: float) -> None:
    start = ego(x_m, left_m, mps, heading)
    plan = started(TO_THE_RIGHT).plan(observation(start, cars((x_m - 20.0, -WIDTH_M, 8.0), (x_m + 15.0, 0.0, 3.0))))
    assert np.isfinite(plan.x_m).all()
    assert np.hypot(plan.x_m[0] - start.x_m, plan.y_m[0] - start.y_m) < 2.5


@pytest.mark.parametrize(
    ("change", "says"),
    few(
        [
            ({"lateral_offsets_m": ()}, "lateral_offsets_m must hold a number"),
            ({"change_times_s": ()}, "change_times_s must hold a number"),
            ({"change_times_s": (2.0, 0.0)}, r"change_times_s\[1\]"),
            ({"change_worth": -0.1}, "change_worth"),
            ({"safe_deceleration_mps2": 0.0}, "safe_deceleration_mps2"),
        ],
        5,
    ),
)
def test_options_that_cannot_be_are_refused(change: dict[str, object], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        PdmProposalsSettings(**change)  # type: ignore[arg-type]


@pytest.mark.slow
def test_it_changes_on_a_free_road_only_because_a_change_left_to_the_goal_costs() -> None:
    def farthest_m(settings: PdmProposalsSettings) -> float:
        return max(
            abs(state.y_m) for state in driven(started(TO_THE_RIGHT, settings), ego_on(TWO, "11", 20.0, 9.0), 80)
        )

    assert farthest_m(PdmProposalsSettings(change_worth=0.0, urgent_worth=0.0)) < 1.0
    assert farthest_m(PdmProposalsSettings()) > 2.0


@pytest.mark.slow
@pytest.mark.parametrize("off_m", [-0.3, 0.3])
def test_where_its_way_crosses_itself_it_goes_on_along_the_lane_that_it_is_on(off_m: float) -> None:
    at = ego(95.0 + PACIFICA.rear_axle_to_center_m, off_m)
    states = drive(mission(LOOP, LOOP_LANES, goal_arc_m=40.0), at, seconds=4.0)
    assert states[-1].x_m > at.x_m + 5.0
    assert abs(states[-1].y_m) < 3.0
