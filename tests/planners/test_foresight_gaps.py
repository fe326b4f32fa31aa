"""How the foresight planner gets into another lane, and what it expects of those who are there."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from worlds import cars, ego, ego_on, mission, observation, signals, straight_road

from interplan_planners.common.neighbours import moved
from interplan_planners.foresight import ForesightPlanner
from interplan_planners.foresight.candidate_paths import HELD_M, RUN_IN_M, CandidatePath
from interplan_planners.foresight.costs import speed_costs
from interplan_planners.foresight.drivers import ACCELERATION_MPS2, HARD_MPS2, answers_mps2, minded, needed_gap_m
from interplan_planners.foresight.manoeuvres import Manoeuvres
from interplan_planners.foresight.prediction import STEP_S, Prediction
from interplan_planners.foresight.scene import PlanningScene
from interplan_planners.foresight.speeds import NO_CAP, Drafts
from interplan_planners.foresight.st_obstacles import Stage, occupied_base, staged
from interplan_sumo.planner import Mission, Past
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.roads import Roads
from tests.planners.staging_planners import foresee

WIDTH_M = 3.5
FRONT_M = PACIFICA.length_m / 2
END_M = 200.0


def forking(between_m: float | None = None) -> Roads:
    """Two lanes, of which the right one, "12", leads elsewhere behind `END_M`: the route goes on from "11".

    With `between_m` there is a junction behind `END_M` and two lanes of that length behind it, and there they part.
    """
    cuts, fork = [(END_M, END_M + 12.0)], 2
    if between_m is not None:
        cuts, fork = [*cuts, (END_M + 12.0 + between_m, END_M + 24.0 + between_m)], 4
    roads = straight_road(lanes=2, length_m=400.0, limit_mps=10.0, cuts_m=cuts)
    left, right, behind = f"{fork}1", f"{fork}2", f"{fork + 1}"
    blocks = dict(roads.roadblocks)
    away = replace(blocks[f"{fork}"], id="29", lane_ids=(right,), to_id="39")
    blocks |= {
        f"{fork}": replace(blocks[f"{fork}"], lane_ids=(left,)),
        behind: replace(blocks[behind], lane_ids=(f"{behind}1",)),
        "29": away,
        "39": replace(blocks[behind], id="39", lane_ids=(f"{behind}2",)),
    }
    connector = replace(roads.connectors[right], roadblock_id="29")
    lane = replace(roads.lanes[f"{behind}2"], roadblock_id="39", index=0)
    return replace(
        roads,
        roadblocks=blocks,
        connectors={**roads.connectors, right: connector},
        lanes={**roads.lanes, f"{behind}2": lane},
    )


FORK = forking()
TASK = mission(FORK, ("11", "21", "31"), goal_arc_m=150.0)


# --- who is behind ---------------------------------------------------------------------------------

speeds = st.floats(0.5, 20.0)


@given(gap_m=st.floats(0.5, 80.0), more_m=st.floats(0.1, 20.0), speed=speeds, ego_mps=speeds)
@example(gap_m=4.0, more_m=2.0, speed=9.0, ego_mps=10.0)  # who would accelerate may do so less: it keeps what it has
def test_nobody_brakes_harder_for_a_larger_gap_or_a_faster_ego(
    gap_m: float, more_m: float, speed: float, ego_mps: float
) -> None:
    def braking(gap_m: float, ego_mps: float) -> Floats:
        return np.maximum(answers_mps2(np.array(gap_m), np.array(speed), np.array(ego_mps)), 0.0)

    here = braking(gap_m, ego_mps)
    assert (braking(gap_m + more_m, ego_mps) <= here + 1e-9).all()
    assert (braking(gap_m, ego_mps + 1.0) <= here + 1e-9).all()


@given(speed=speeds, slower_mps=st.floats(0.0, 20.0))
@example(speed=19.0, slower_mps=2.25)
def test_at_the_gap_that_is_needed_a_fifth_has_to_brake_hard_at_most_and_at_a_third_of_it_most_do(
    speed: float, slower_mps: float
) -> None:
    ego_mps = np.array(max(speed - slower_mps, 0.5))
    needed = needed_gap_m(np.array(speed), ego_mps)
    assert np.mean(answers_mps2(needed, np.array(speed), ego_mps) > HARD_MPS2) <= 0.2 + 1e-9
    assert minded(answers_mps2(needed / 3.0, np.array(speed), ego_mps)) > 0.5


@pytest.mark.parametrize(("braking_mps2", "share"), [(3.0, 0.0), (4.0, 0.125), (5.0, 0.25), (5.01, 1.0)])
def test_hard_braking_is_minded_four_times_as_much_as_braking_that_is_just_not_hard(
    braking_mps2: float, share: float
) -> None:
    assert minded(np.full(7, braking_mps2)) == pytest.approx(share)


def test_who_comes_from_behind_is_expected_to_brake_for_a_corner_of_the_ego_in_its_lane() -> None:
    roads = straight_road(lanes=2, length_m=400.0, limit_mps=12.0)
    behind = cars((30.0, -WIDTH_M, 10.0))

    def speed_then_mps(left_m: float) -> float:
        traffic = Prediction(roads).traffic(observation(ego(60.0, left_m, 2.0), behind), PACIFICA, 4.0)
        return float(traffic.forecast.speed_mps[0, -1])

    assert speed_then_mps(-1.2) < 5.0 < speed_then_mps(0.0)


def test_who_backs_is_expected_to_go_on_backwards_and_not_along_its_lane() -> None:
    roads = straight_road(lanes=1, length_m=400.0, limit_mps=12.0)
    backs = cars((100.0, 0.0, -2.0))
    traffic = Prediction(roads).traffic(observation(ego(60.0, 0.0, 5.0), backs), PACIFICA, 4.0)
    assert traffic.forecast.x_m[0] == pytest.approx(100.0 - 2.0 * STEP_S * np.arange(21))
    assert set(traffic.forecast.speed_mps[0]) == {-2.0}


@pytest.mark.parametrize(("front_beyond_rear_m", "brakes"), [(-0.5, True), (0.5, False)])
def test_who_is_beside_the_ego_is_not_expected_to_brake_for_its_corner(
    front_beyond_rear_m: float, brakes: bool
) -> None:
    roads = straight_road(lanes=2, length_m=400.0, limit_mps=12.0)
    other = cars((60.0 - FRONT_M + front_beyond_rear_m - 2.4, -WIDTH_M, 2.0))
    traffic = Prediction(roads).traffic(observation(ego(60.0, -1.2, 1.0), other), PACIFICA, 4.0)
    assert (float(traffic.forecast.speed_mps[0, 10]) < 2.0) == brakes


@pytest.mark.parametrize(
    ("x_m", "was_mps", "gains_m"),
    [(50.0, 4.0, 0.0), (50.0, 3.75, 0.0), (50.0, 3.0, 1.7), (50.0, 1.0, 5.2), (50.0, 0.0, 5.2), (80.0, 1.0, 0.0)],
)
def test_who_accelerates_hard_goes_on_so_for_a_while_unless_it_is_ahead(
    x_m: float, was_mps: float, gains_m: float
) -> None:
    """A gap behind those ahead must not be counted on to grow."""
    roads, here = straight_road(lanes=2, length_m=400.0, limit_mps=12.0), ego(60.0, 0.0, 6.0)
    now, then = (cars((x_m, -WIDTH_M, mps)) for mps in (4.0, was_mps))
    seen = observation(here, now, past=Past((here,) * 20, (then,) * 20))
    forecast = Prediction(roads).traffic(seen, PACIFICA, 4.0).forecast
    usual = Prediction(roads).traffic(observation(here, now), PACIFICA, 4.0).forecast
    assert float(forecast.x_m[0, 10] - usual.x_m[0, 10]) == pytest.approx(gains_m, abs=0.5)


# --- the end of a lane -----------------------------------------------------------------------------


@pytest.mark.slow
def test_it_waits_for_a_gap_before_its_lane_leaves_the_route() -> None:
    row = cars(*((x, 0.0, 8.0) for x in np.arange(-60.0, 260.0, 9.0).tolist()))
    states = foresee(TASK, ego_on(FORK, "12", 120.0, 9.0), row, seconds=14.0)
    assert states[-1].vx_mps < 0.3
    assert END_M - 14.0 < states[-1].x_m + FRONT_M < END_M
    assert max(abs(state.y_m + WIDTH_M) for state in states) < 0.7


@pytest.mark.parametrize(("between_m", "waits_m"), [(11.5, END_M), (12.5, END_M + 12.0 + 12.5)])
def test_it_waits_before_the_junction_if_the_lane_behind_is_too_short_to_change_from(
    between_m: float, waits_m: float
) -> None:
    roads = forking(between_m)
    task = mission(roads, ("11", "21", "31", "41", "51"), goal_arc_m=100.0)
    base = Manoeuvres(task, ego_on(roads, "12", 120.0, 9.0), 13.0, 3.6).base(0, "12")
    assert base.room_m == pytest.approx(RUN_IN_M + waits_m)
    assert base.held_m == pytest.approx(RUN_IN_M + waits_m - HELD_M)
    assert base.ends_m == pytest.approx(RUN_IN_M + END_M + 12.0 + between_m)
    onward = Manoeuvres(task, ego_on(roads, "11", 120.0, 9.0), 13.0, 3.6).base(0, "11")
    assert (onward.held_m, onward.room_m) == (inf, onward.ends_m)


def test_it_changes_before_its_lane_leaves_the_route_if_there_is_room() -> None:
    states = foresee(TASK, ego_on(FORK, "12", 120.0, 9.0), seconds=12.0)
    assert states[-1].y_m == pytest.approx(0.0, abs=0.4)
    assert states[-1].x_m > END_M


@pytest.mark.slow
@pytest.mark.parametrize("red", [True, False])
def test_who_missed_its_lane_stops_at_the_red_light_of_the_one_that_it_is_on(red: bool) -> None:
    row = cars(*((x, 0.0, 8.0) for x in np.arange(-120.0, 300.0, 9.0).tolist()))
    lights = signals(red=("22",)) if red else signals(green=("22",))
    states = foresee(TASK, ego_on(FORK, "12", END_M - FRONT_M - 0.8, 0.0), row, lights, seconds=10.0)
    assert (states[-1].x_m + FRONT_M < END_M + 0.1) == red


# --- getting going ---------------------------------------------------------------------------------

# --- a lane change under way -----------------------------------------------------------------------


def options_of(task: Mission, start: EgoState, actors: Actors | None = None) -> str:
    """What the planner looks at closely in its first round, in words."""
    planner = ForesightPlanner()
    planner.start(task)
    planner.plan(observation(start, actors, past=Past((start,) * 20, (actors or Actors.none(),) * 20)))
    assert planner.decision is not None
    return "; ".join(name for name, _ in planner.decision.options)


def test_who_is_between_two_lanes_may_go_on_to_the_one_that_it_needs() -> None:
    between = ego(120.0, -WIDTH_M + 1.2, 9.0)
    assert "change, to 11" in options_of(TASK, between)


@pytest.mark.parametrize(("arc_m", "may"), [(0.9, True), (-0.1, False)])
def test_who_stands_with_its_rear_in_the_junction_may_change_lanes_once_its_middle_is_in_the_lane(
    arc_m: float, may: bool
) -> None:
    roads = straight_road(lanes=2, length_m=END_M + 42.0, limit_mps=10.0, cuts_m=((END_M, END_M + 12.0),))
    start, now = ego_on(roads, "12", 150.0, 5.0), ego(END_M + 12.0 + arc_m, -WIDTH_M)
    manoeuvres = Manoeuvres(mission(roads, ("11", "21", "31"), goal_arc_m=29.0), start, 13.0, 3.6)
    seen, nobody = observation(now), np.zeros(0, np.bool_)
    scene = PlanningScene(seen, PACIFICA, Prediction(roads).traffic(seen, PACIFICA, 8.0), nobody, nobody, nobody)
    options, _ = manoeuvres.options(scene, manoeuvres.here(start))
    assert ("change" in [option.candidate.kind for option in options]) == may


@pytest.mark.slow
def test_who_stood_in_the_lane_that_it_changed_to_changes_on_when_there_is_a_gap() -> None:
    """From the third lane to the second before the end, where it waits: the first is full for twelve seconds."""
    roads = straight_road(lanes=3, length_m=400.0, limit_mps=10.0, cuts_m=((END_M, END_M + 12.0),))
    blocks, lanes, connectors = dict(roads.roadblocks), dict(roads.lanes), dict(roads.connectors)
    blocks |= {"2": replace(blocks["2"], lane_ids=("21",)), "3": replace(blocks["3"], lane_ids=("31",))}
    for n in ("2", "3"):
        blocks[f"2{n}"] = replace(roads.roadblocks["2"], id=f"2{n}", lane_ids=(f"2{n}",), to_id=f"3{n}")
        blocks[f"3{n}"] = replace(roads.roadblocks["3"], id=f"3{n}", lane_ids=(f"3{n}",))
        connectors[f"2{n}"] = replace(connectors[f"2{n}"], roadblock_id=f"2{n}")
        lanes[f"3{n}"] = replace(lanes[f"3{n}"], roadblock_id=f"3{n}", index=0)
    roads = replace(roads, roadblocks=blocks, lanes=lanes, connectors=connectors)

    def full(time_s: float) -> Actors:
        if time_s > 12.0:
            return Actors.none()
        return cars(*((x + 8.0 * time_s, 0.0, 8.0) for x in np.arange(-120.0, 260.0, 9.0).tolist()))

    states = foresee(
        mission(roads, ("11", "21", "31"), goal_arc_m=150.0), ego_on(roads, "13", END_M - 62.0, 8.0), full, seconds=26.0
    )
    waited = min(states, key=lambda state: abs(state.time_s - 12.0))
    assert waited.speed_mps < 1.0
    assert waited.y_m == pytest.approx(-WIDTH_M, abs=1.0)
    assert states[-1].y_m == pytest.approx(0.0, abs=0.5)
    assert states[-1].x_m > END_M


def cost_of(center_m: float, mps: float, comes_s: float = 0.0) -> float:
    """Of driving on at 6 m/s from an arc length of 100 m, with somebody who comes into the strip at some time."""
    steps = 41
    time_s: Floats = STEP_S * np.arange(steps, dtype=np.float64)
    start = ego_on(FORK, "11", 60.0, 6.0)
    candidate = Manoeuvres(TASK, start, 13.0, 3.6).here(start)
    s, v = (100.0 + 6.0 * time_s)[None], np.full((1, steps), 6.0)
    drafts = Drafts(np.zeros(1, np.int64), ((),), (NO_CAP,), np.zeros(1, np.bool_), s, v, np.zeros((1, steps - 1)))
    there = time_s[None] > comes_s - 1e-9
    center: Floats = np.where(there, (center_m + mps * time_s)[None], np.nan)
    near, far = np.where(there, center - 2.4, np.inf), np.where(there, center + 2.4, -np.inf)
    yes, no, nobody = np.ones(1, np.bool_), np.zeros(1, np.bool_), np.zeros((0, steps))
    stage = Stage(
        candidate, 100.0, np.full(400, 10.0), (), near, far, center, np.full((1, steps), mps),
        there, no, yes, no, no, no, no, (inf, inf), None, None, nobody, nobody, np.zeros(0, np.bool_),
    )  # fmt: skip
    return float(speed_costs([stage], drafts, PACIFICA, 10.0, 0.0)[0])


def test_who_is_forecast_through_the_ego_from_behind_is_not_hit_but_who_is_ahead_is() -> None:
    alone = cost_of(-400.0, 6.0)
    assert cost_of(60.0, 6.0) == cost_of(60.0, 13.0) == alone
    assert cost_of(115.0, 1.0) > alone + 30.0


@pytest.mark.parametrize(("center_m", "hit"), [(96.0, False), (97.5, True), (100.0, True)])
def test_who_comes_into_the_lane_beside_the_ego_is_hit_and_who_comes_into_it_behind_is_not(
    center_m: float, hit: bool
) -> None:
    """The ego's rear is at 98.9 m, its middle at 101.5 m; the other drives as fast, and has its front 2.4 m ahead."""
    assert cost_of(center_m, 6.0) == pytest.approx(cost_of(-400.0, 6.0), abs=3.0)  # there from the beginning
    assert (cost_of(center_m, 6.0, comes_s=2.0) > cost_of(-400.0, 6.0) + 30.0) == hit


@given(gap_m=st.floats(3.0, 60.0), speed=speeds, ego_mps=speeds, gained_mps=st.floats(0.0, 4.0))
def test_the_more_a_driver_has_gained_the_harder_brake_those_who_like_to_accelerate(
    gap_m: float, speed: float, ego_mps: float, gained_mps: float
) -> None:
    plain = answers_mps2(np.array(gap_m), np.array(speed), np.array(ego_mps))
    gained = answers_mps2(
        np.array(gap_m), np.array(speed), np.array(ego_mps), np.array(gained_mps), np.array(gained_mps)
    )
    sprightly = ACCELERATION_MPS2 > 1.0
    assert (gained[sprightly] >= plain[sprightly] - 1e-9).all()
    assert (gained[~sprightly] <= plain[~sprightly] + 1e-9).all()


@pytest.mark.parametrize(("limit_mps", "goes"), [(8.0, True), (16.0, False)])
def test_it_does_not_go_over_in_front_of_who_is_as_slow_as_it_is_but_may_speed_up(limit_mps: float, goes: bool) -> None:
    roads = straight_road(lanes=2, length_m=500.0, limit_mps=limit_mps)
    start, beside = ego_on(roads, "12", 100.0, 8.0), cars((100.0 - 2.4 - FRONT_M - 8.5, 0.0, 8.0))
    planner = ForesightPlanner()
    planner.start(mission(roads, ("11",), goal_arc_m=250.0))
    planner.plan(observation(start, beside, past=Past((start,) * 20, (beside,) * 20)))
    assert planner.decision is not None
    cost_of = {kind: min(c for n, c in planner.decision.options if n.startswith(kind)) for kind in ("change", "keep")}
    assert (cost_of["change"] < cost_of["keep"] + 2.0) == goes, planner.decision


def passes(task: Mission, start: EgoState, *places: tuple[float, ...]) -> list[CandidatePath]:
    """Ways past cars that stand, or drive, and are taken to stay."""
    roads, others = task.roads, cars(*places)
    manoeuvres = Manoeuvres(task, start, 13.0, 3.6)
    seen, no, yes = observation(start, others), np.zeros(len(places), np.bool_), np.ones(len(places), np.bool_)
    scene = PlanningScene(seen, PACIFICA, Prediction(roads).traffic(seen, PACIFICA, 8.0), yes, no, no)
    options, _ = manoeuvres.options(scene, manoeuvres.here(start))
    return [option.candidate for option in options if option.candidate.kind == "pass"]


@pytest.mark.parametrize(("stands_m", "may"), [(END_M - 75.0, True), (END_M - 15.0, False)])
def test_nothing_is_passed_on_a_lane_that_leads_elsewhere_before_the_way_back_is_over(
    stands_m: float, may: bool
) -> None:
    start = ego_on(FORK, "11", stands_m - 40.0, 8.0)
    beside = [way for way in passes(TASK, start, (stands_m, 0.0)) if way.new is not None]
    assert bool(beside) == may


@pytest.mark.parametrize(("mps", "follows"), [(2.0, True), (0.0, False)])
def test_who_drives_on_beside_the_ego_that_passes_it_is_met_in_the_lane_that_it_comes_back_to(
    mps: float, follows: bool
) -> None:
    task = mission(FORK, ("11", "21", "31"), goal_arc_m=150.0)
    way, *_ = passes(task, ego_on(FORK, "11", 60.0, 8.0), (100.0, 0.0))
    at = way.path.line.pose_at(sum(way.beside_m) / 2)
    now = ego(at.x_m + PACIFICA.rear_axle_to_center_m, at.y_m, 1.0)
    seen, no = observation(now, cars((now.x_m - 3.0, 0.0, mps))), np.zeros(1, np.bool_)
    traffic = Prediction(FORK).traffic(seen, PACIFICA, 8.0)
    scene = PlanningScene(seen, PACIFICA, traffic, no, no, no)
    back = way.returning()
    arc_m, _ = way.path.line.project_point(scene.axle.x_m, scene.axle.y_m)
    new_m, _ = way.base.line.project_point(scene.axle.x_m, scene.axle.y_m)
    own = moved(occupied_base(way.base, traffic, PACIFICA, (new_m - 60.0, new_m + 90.0)), arc_m - new_m)
    stage = staged(back, arc_m, back.limit_mps, (), scene, no, 90.0, own)
    assert bool(stage.follower.any()) == follows
    assert arc_m + 1.0 < stage.enters_m[1] < back.settles_m
