"""What must not change a score: where the map lies, who is far away, the order of actors."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from interplan_sumo.metrics.score import ScoreSheet, score
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.geometry import Floats, Pose
from interplan_sumo.world.trace import ActorTable, Trace
from tests.golden_values import SHIPPED
from tests.metrics.golden_metrics import Case, read_case
from tests.metrics.staging import moved_roads, moved_trace, moved_track, rotation, scenario_on
from tests.worlds import cars, drive, straight_road

STORED = SHIPPED / "nuplan_metrics"
DRIVES = ("run_cross_simple_replay", "run_curve_pdm_reactive", "coll_many_in_one_run", "assoc_cut_the_corner")

cached_case = cache(read_case)


def golden(name: str) -> Case:
    return cached_case(STORED / "cases" / name)


def scores(sheet: ScoreSheet) -> dict[str, float | None]:
    return {"score": sheet.score, **{name: result.score for name, result in sheet.metrics.items()}}


@pytest.mark.parametrize("name", DRIVES)
@settings(max_examples=3)
@given(angle=st.floats(-np.pi, np.pi), shift=st.tuples(st.floats(-1e5, 1e5), st.floats(-1e5, 1e5)))
def test_turning_and_shifting_the_world_changes_no_score(name: str, angle: float, shift: tuple[float, float]):
    case = golden(name)
    facts, origin, turn = case.facts, case.facts.centre[0], rotation(angle, (0.0, 0.0))

    def move(xy: Floats) -> Floats:
        return turn(xy - origin) + origin + shift

    trace, roads = moved_trace(facts.trace, move), moved_roads(facts.roads, move)
    moved = score(trace, roads, moved_track(facts.expert, move), profile="nuplan")
    assert scores(moved) == pytest.approx(scores(case.sheet), abs=1e-6)


def with_another(trace: Trace, other: Actors) -> Trace:
    """The trace with one more actor at the end of every frame, whose actors are not sorted."""
    actors, extra = trace.actors, ActorTable.of([other])
    names = [name for name in ActorTable.__dataclass_fields__ if name not in ("frame", "starts", "ax_without_ego")]
    columns = {name: np.insert(getattr(actors, name), actors.starts[1:], getattr(extra, name)) for name in names}
    frame = np.repeat(np.arange(len(trace)), np.diff(actors.starts) + 1)
    starts = actors.starts + np.arange(len(trace) + 1)
    return replace(trace, actors=replace(actors, frame=frame, starts=starts, **columns))


@settings(max_examples=6)
@given(
    bearing=st.floats(-np.pi, np.pi),
    distance_m=st.floats(400.0, 1e4),
    speed_mps=st.floats(0.0, 30.0),
    heading=st.floats(-np.pi, np.pi),
    kind=st.sampled_from(ActorKind),
)
def test_an_actor_out_of_reach_changes_nothing(
    bearing: float, distance_m: float, speed_mps: float, heading: float, kind: ActorKind
):
    case = golden("run_curve_pdm_reactive")
    x, y = case.facts.centre[0] + distance_m * np.array([np.cos(bearing), np.sin(bearing)])
    far = cars((float(x), float(y), speed_mps, heading), kind=kind, prefix="far")
    crowded = with_another(case.facts.trace, far)
    assert scores(score(crowded, case.facts.roads, case.facts.expert, profile="nuplan")) == scores(case.sheet)


@pytest.mark.parametrize("name", ["run_cross_simple_replay", "coll_many_in_one_run"])
def test_the_order_of_actors_within_a_frame_changes_no_score(name: str):
    case = golden(name)
    actors = case.facts.trace.actors
    rng = np.random.default_rng(1)
    order = np.concatenate(
        [rng.permutation(np.arange(actors.starts[k], actors.starts[k + 1])) for k in range(len(case.facts.trace))]
    )
    unmoved = ("starts", "ax_without_ego")
    columns = {c: getattr(actors, c)[order] for c in ActorTable.__dataclass_fields__ if c not in unmoved}
    shuffled = replace(case.facts.trace, actors=replace(actors, **columns))
    assert scores(score(shuffled, case.facts.roads, case.facts.expert, profile="nuplan")) == scores(case.sheet)


@settings(max_examples=5)
@given(
    angle=st.floats(-np.pi, np.pi), shift=st.tuples(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4)), lane=st.integers(0, 2)
)
def test_interplans_terms_do_not_depend_on_where_the_world_lies(angle: float, shift: tuple[float, float], lane: int):
    road = straight_road(lanes=3, length_m=300.0, cuts_m=((150.0, 170.0),))
    scenario = scenario_on(road, ("12", 20.0), (f"3{lane + 1}", 100.0))
    trace = drive(*[9.0] * 150, start=Pose(20.0, -3.5, 0.0), actors=cars((190.0, 0.0, 2.0)))
    move = rotation(angle, shift)
    here = score(trace, road, trace.ego, scenario)
    there = score(moved_trace(trace, move), moved_roads(road, move), moved_track(trace.ego, move), scenario)
    assert scores(here) == pytest.approx(scores(there), abs=1e-6)
