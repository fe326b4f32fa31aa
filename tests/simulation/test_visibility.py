"""What a planner sees: 100 m around, but no pedestrian behind the scenario's occluder."""

from __future__ import annotations

from dataclasses import replace
from math import cos, pi, sin

import numpy as np
import pytest
import shapely
import test_episode
from hypothesis import example, given, settings
from hypothesis import strategies as st
from test_episode import ROADS, Planning, straight
from worlds import replayed, rolling

from interplan_sumo.scenario.scenario import LanePosition, Obstacle, Scenario
from interplan_sumo.simulation.episode import EpisodeOptions, run_loop
from interplan_sumo.simulation.visibility import OccludingBox, occluding_box, visible
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import Polyline, box_polygons

BUS = OccludingBox(50.0, 4.0, 0.0, 12.0, 2.5)
EGO = EgoState(0.0, 20.0, 0.0, 0.0)


def things(*rows: tuple[str, ActorKind, float, float]) -> Actors:
    """(id, class, x, y), sorted by id; all of one size, standing."""
    x, y = np.array([row[2:] for row in rows]).T
    ones, zeros = np.ones(len(rows)), np.zeros(len(rows))
    kinds = np.array([row[1] for row in rows], dtype=np.int8)
    return Actors(tuple(row[0] for row in rows), kinds, x, y, zeros, ones, ones, zeros, zeros)


def seen(*rows: tuple[str, ActorKind, float, float], occluder: OccludingBox | None = BUS) -> tuple[str, ...]:
    return visible(things(*rows), EGO, occluder).ids


@pytest.mark.parametrize(("x_m", "in_sight"), [(119.9, True), (120.1, False)])
def test_everything_within_100_m_is_seen(x_m: float, in_sight: bool) -> None:
    assert (seen(("a", ActorKind.VEHICLE, x_m, 0.0), occluder=None) == ("a",)) == in_sight


# The line from the ego at (20, 0) that grazes the bus's corner at (56, 2.75) comes to y = 3.056 at x = 60.
@pytest.mark.parametrize(("y_m", "hidden"), [(3.05, False), (3.06, True), (6.0, True)])
def test_a_pedestrian_behind_the_occluder_is_hidden(y_m: float, hidden: bool) -> None:
    assert (seen(("p", ActorKind.PEDESTRIAN, 60.0, y_m)) == ()) == hidden


def test_a_pedestrian_before_or_beside_the_occluder_is_seen() -> None:
    assert seen(("p", ActorKind.PEDESTRIAN, 43.0, 3.0), ("q", ActorKind.PEDESTRIAN, 60.0, 0.0)) == ("p", "q")


def test_only_pedestrians_are_hidden() -> None:
    rows = [(kind.name.lower(), kind, 60.0, 5.0) for kind in ActorKind]
    assert set(seen(*sorted(rows))) == {kind.name.lower() for kind in ActorKind} - {"pedestrian"}


def test_without_an_occluder_nobody_is_hidden() -> None:
    assert seen(("p", ActorKind.PEDESTRIAN, 60.0, 5.0), occluder=None) == ("p",)


COORDINATE = st.floats(-30.0, 30.0)


@settings(max_examples=500)
@example(x=7.0, y=0.0, to_x=7.0, to_y=-1.0, heading=0.0)
@given(x=COORDINATE, y=COORDINATE, to_x=COORDINATE, to_y=COORDINATE, heading=st.floats(-4.0, 4.0))
def test_a_line_is_cut_where_shapely_says_so(x: float, y: float, to_x: float, to_y: float, heading: float) -> None:
    bus = OccludingBox(1.0, -2.0, heading, 12.0, 2.5)
    (box,) = box_polygons([1.0], [-2.0], [heading], [12.0], [2.5])
    inner = box.buffer(-1e-6)  # a line along a side does not cut
    inside_m = shapely.intersection(shapely.LineString([(x, y), (to_x, to_y)]), inner).length
    cut = bool(bus.cuts(x, y, np.array([to_x]), np.array([to_y]))[0])
    if inside_m > 1e-6:
        assert cut
    elif not box.buffer(1e-6).intersects(shapely.LineString([(x, y), (to_x, to_y)])):
        assert not cut


@pytest.mark.parametrize(("y_m", "cut"), [(1.26, False), (1.24, True)])
def test_a_line_along_a_side_of_the_box_does_not_cut_it(y_m: float, cut: bool) -> None:
    bus = OccludingBox(0.0, 0.0, pi, 12.0, 2.5)
    assert bool(bus.cuts(-20.0, y_m, np.array([20.0]), np.array([y_m]))[0]) == cut
    turned = OccludingBox(0.0, 0.0, 0.3, 12.0, 2.5)
    start, end = ((c * 20.0 * cos(0.3) - y_m * sin(0.3), c * 20.0 * sin(0.3) + y_m * cos(0.3)) for c in (-1.0, 1.0))
    assert bool(turned.cuts(*start, np.array([end[0]]), np.array([end[1]]))[0]) == cut


def scenario(occluder: int | None) -> Scenario:
    obstacles = (Obstacle(LanePosition("11", 70.0)), Obstacle(LanePosition("11", 60.0, -3.5), "bus"))
    return replace(test_episode.scenario(duration_s=5.0), obstacles=obstacles, occluder=occluder)


def test_the_box_is_that_of_the_named_obstacle() -> None:
    box = occluding_box(scenario(1), ROADS)
    assert box is not None
    pose = LanePosition("11", 60.0, -3.5).pose(ROADS)
    assert (box.x_m, box.y_m, box.length_m, box.width_m) == (pose.x_m, pose.y_m, 12.0, 2.55)
    assert occluding_box(scenario(None), ROADS) is None


def test_a_hidden_pedestrian_is_neither_in_the_scene_nor_in_the_past_yet_in_the_trace_and_is_seen_when_passed() -> None:
    lane_y = LanePosition("11", 20.0).pose(ROADS).y_m
    line = Polyline(np.array([[70.0, lane_y - 6.0], [70.0, lane_y + 100.0]]))
    walker = rolling("p", line, kind="pedestrian", size_m=(0.9, 0.79))
    planner = Planning(straight)
    episode = run_loop(scenario(1), ROADS, planner, replayed(walker), options=EpisodeOptions(), on_phase=lambda _: None)
    trace = episode.trace
    assert trace is not None
    assert all(trace.actors.at(k).ids == ("p",) for k in range(len(trace)))
    present = [len(each.actors) for each in planner.seen]
    assert present[0] == 0
    assert present[-1] == 1
    appears = present.index(1)
    assert present == [0] * appears + [1] * (len(present) - appears)
    for step, each in enumerate(planner.seen):
        past = [len(actors) for actors in each.past.actors]
        known = [present[k] if k >= 0 else 0 for k in range(step - len(past), step)]
        assert past == known
    unhidden = Planning(straight)
    run_loop(scenario(None), ROADS, unhidden, replayed(walker), options=EpisodeOptions(), on_phase=lambda _: None)
    assert all(len(each.actors) == 1 for each in unhidden.seen)
    assert all(len(actors) == 1 for actors in unhidden.seen[0].past.actors)
