"""What a planner sees: 100 m around, and how much worse that is when perception is occluded, noisy or late."""

from __future__ import annotations

from dataclasses import replace
from math import cos, exp, radians, sin, sqrt

import numpy as np
import pytest
import shapely
import test_episode
from hypothesis import example, given, settings
from hypothesis import strategies as st
from test_episode import ROADS, Planning, straight
from worlds import replayed, rolling

from interplan_sumo.errors import ScenarioError
from interplan_sumo.maps.store import load_roads
from interplan_sumo.scenario.recorded_parts import PAST_STEPS, ReplayedTrack
from interplan_sumo.scenario.scenario import LanePosition, Obstacle, Scenario
from interplan_sumo.scenario.suite import find_scenario
from interplan_sumo.simulation.episode import DT_S, Episode, EpisodeOptions, run_loop
from interplan_sumo.simulation.occlusion import Boxes, behind, named_occluder
from interplan_sumo.simulation.perception import Perception
from interplan_sumo.simulation.setup import open_traffic
from interplan_sumo.simulation.track_noise import TrackNoise
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import Floats, Polyline, box_polygons
from interplan_sumo.world.trace import SEEN_BEFORE

EGO = EgoState(0.0, 20.0, 0.0, 0.0)
CAR_M, TRUCK_M, PERSON_M = (4.6, 1.85), (8.0, 2.5), (0.9, 0.79)


def one(x_m: float, y_m: float, size_m: tuple[float, float] = CAR_M, kind: ActorKind = ActorKind.VEHICLE) -> Actors:
    """Somebody who stands there, heading along x."""
    columns = (np.array([value]) for value in (x_m, y_m, 0.0, *size_m, 0.0, 0.0))
    return Actors(("a",), np.array([kind], dtype=np.int8), *columns)


def together(*parts: Actors) -> Actors:
    """Several under the ids a, b, ..."""
    names = ("kind", "x_m", "y_m", "heading_rad", "length_m", "width_m", "vx_mps", "vy_mps")
    columns = (np.concatenate([getattr(part, name) for part in parts]) for name in names)
    return Actors(tuple(chr(ord("a") + i) for i in range(len(parts))), *columns)


def staged(perception: str, occluder: int | None = None) -> Scenario:
    obstacles = (Obstacle(LanePosition("11", 70.0)), Obstacle(LanePosition("11", 60.0, -3.5), "bus"))
    where = test_episode.scenario(duration_s=5.0)
    return replace(where, obstacles=obstacles, occluder=occluder, perception=perception)


def seen(perception: str, *parts: Actors, heights_m: dict[str, float] | None = None) -> str:
    """The ids of those that are in sight from `EGO`."""
    looking = Perception(staged(perception), ROADS, heights_m or {}, 0, DT_S)
    return "".join(looking.first(EGO, together(*parts))[1].ids)


# --- the range ---


@pytest.mark.parametrize("perception", ["full", "occluded", "late"])
@pytest.mark.parametrize(("x_m", "ids"), [(119.9, "a"), (120.1, "")])
def test_everything_within_100_m_is_seen(perception: str, x_m: float, ids: str) -> None:
    assert seen(perception, one(x_m, 0.0)) == ids


# --- the named occluder ---

BUS = Boxes(50.0, 4.0, 0.0, 12.0, 2.5)


# The line from the eye at (20, 0) that grazes the bus's corner at (56, 2.75) comes to y = 3.056 at x = 60.
@pytest.mark.parametrize(("x_m", "y_m", "hides"), [(60, 3.05, False), (60, 3.06, True), (60, 6, True), (43, 3, False)])
def test_a_point_behind_a_box_is_hidden(x_m: float, y_m: float, hides: bool) -> None:
    assert bool(behind(BUS, (20.0, 0.0), np.array([x_m]), np.array([y_m]))[0]) == hides


COORDINATE = st.floats(-30.0, 30.0)


@settings(max_examples=200)
@example(x=7.0, y=0.0, to_x=7.0, to_y=-1.0, heading=0.0)
@given(x=COORDINATE, y=COORDINATE, to_x=COORDINATE, to_y=COORDINATE, heading=st.floats(-4.0, 4.0))
def test_a_line_is_cut_where_shapely_says_so(x: float, y: float, to_x: float, to_y: float, heading: float) -> None:
    bus = Boxes(1.0, -2.0, heading, 12.0, 2.5)
    (box,) = box_polygons([1.0], [-2.0], [heading], [12.0], [2.5])
    line = shapely.LineString([(x, y), (to_x, to_y)])
    if line.length < 1e-3:
        return
    cut = bool(behind(bus, (x, y), np.array([to_x]), np.array([to_y]))[0])
    if shapely.intersection(line, box.buffer(-1e-6)).length > 1e-6:
        assert cut
    elif not box.buffer(1e-6).intersects(line):
        assert not cut


@pytest.mark.parametrize("heading", [0.0, 0.3])
@pytest.mark.parametrize(("y_m", "cut"), [(1.26, False), (1.24, True)])
def test_a_line_along_a_side_of_the_box_does_not_cut_it(y_m: float, cut: bool, heading: float) -> None:
    box = Boxes(0.0, 0.0, heading, 12.0, 2.5)
    start, end = (
        (along * cos(heading) - y_m * sin(heading), along * sin(heading) + y_m * cos(heading))
        for along in (-20.0, 20.0)
    )
    assert bool(behind(box, start, np.array([end[0]]), np.array([end[1]]))[0]) == cut


def walking(occluder: int | None = 1) -> tuple[Episode, Planning]:
    """Somebody walks behind the bus of the scenario, on the way of an ego that drives by."""
    lane_y = LanePosition("11", 20.0).pose(ROADS).y_m
    line = Polyline(np.array([[70.0, lane_y - 6.0], [70.0, lane_y + 100.0]]))
    planner = Planning(straight)
    walker = rolling("p", line, kind="pedestrian", size_m=PERSON_M)
    return driven(planner, staged("full", occluder), walker), planner


def driven(planner: Planning, where: Scenario, *tracks: ReplayedTrack, seed: int = 0) -> Episode:
    options = EpisodeOptions()
    episode = run_loop(where, ROADS, planner, replayed(*tracks), options=options, on_phase=lambda _: None, seed=seed)
    assert episode.fault is None, episode.fault
    return episode


def test_the_box_is_that_of_the_named_obstacle() -> None:
    box = named_occluder(staged("full", 1), ROADS)
    assert box is not None
    pose = LanePosition("11", 60.0, -3.5).pose(ROADS)
    assert (box.x_m, box.y_m, box.length_m, box.width_m) == (pose.x_m, pose.y_m, 12.0, 2.55)
    assert named_occluder(staged("full", None), ROADS) is None


def test_a_hidden_pedestrian_is_neither_in_the_scene_nor_in_the_past_yet_in_the_trace_and_is_seen_when_passed() -> None:
    episode, planner = walking()
    trace = episode.trace
    assert trace is not None
    assert trace.seen is None
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
    _, unhidden = walking(occluder=None)
    assert all(len(each.actors) == 1 for each in unhidden.seen)
    assert all(len(actors) == 1 for actors in unhidden.seen[0].past.actors)


# --- occluded ---

TALL, LOW = {"a": 1.41}, {"a": 1.39}
TRUCK = one(40.0, 3.0, TRUCK_M)


@pytest.mark.parametrize(("heights_m", "ids"), [(TALL, "a"), (LOW, "ab"), ({}, "ab")])
@pytest.mark.parametrize("kind", [ActorKind.VEHICLE, ActorKind.PEDESTRIAN, ActorKind.TRAFFIC_CONE])
def test_whoever_is_behind_a_tall_box_is_hidden(heights_m: dict[str, float], ids: str, kind: ActorKind) -> None:
    assert seen("occluded", TRUCK, one(60.0, 6.0, PERSON_M, kind), heights_m=heights_m) == ids
    assert seen("full", TRUCK, one(60.0, 6.0, PERSON_M, kind), heights_m=heights_m) == "ab"


def test_people_hide_nobody_and_who_overlaps_the_ego_neither() -> None:
    for hiding in (one(40.0, 3.0, TRUCK_M, ActorKind.PEDESTRIAN), one(20.5, 0.2, TRUCK_M)):
        assert seen("occluded", hiding, one(60.0, 6.0), heights_m=TALL) == "ab"


# The shadow is between the lines through the truck's corners at (44, 1.75) and (36, 4.25). The car's front right
# corner at x = 62.3 leaves it below y = 3.084, its rear left corner at x = 57.7 above y = 10.014.
@pytest.mark.parametrize(("y_m", "ids"), [(4.00, "ab"), (4.02, "a"), (7.0, "a"), (9.08, "a"), (9.10, "ab")])
def test_a_car_is_seen_if_a_corner_is(y_m: float, ids: str) -> None:
    assert seen("occluded", TRUCK, one(60.0, y_m), heights_m=TALL) == ids


def test_two_boxes_can_hide_what_neither_hides_alone() -> None:
    left, right, car = one(40.0, 1.5, (4.0, 2.9)), one(40.0, -1.5, (4.0, 2.9)), one(60.0, 0.0, (1.0, 3.0))
    # Between the two is a gap of 0.1 m that only the centre could be seen through: it is closed by a third.
    third = one(30.0, 0.0, (1.0, 0.4))
    heights_m = {"b": 2.0, "c": 2.0, "d": 2.0}
    assert "a" not in seen("occluded", car, left, right, third, heights_m=heights_m)
    for kept in ((left, third), (right, third), (left, right)):
        assert "a" in seen("occluded", car, *kept, heights_m=heights_m)


def test_obstacles_say_how_tall_they_are_and_the_named_occluder_always_hides() -> None:
    def heights(*obstacles: Obstacle, occluder: int | None = None) -> list[float]:
        scenario = replace(LTD, obstacles=obstacles, occluder=occluder)
        with open_traffic(scenario, load_roads(scenario.map)) as traffic:
            standing = traffic.observe().actors
            behaviours = traffic.behaviours
            return sorted(traffic.heights_m[name] for name in standing.ids if name not in behaviours)

    place = LTD.start
    kinds = [Obstacle(place, "cone"), Obstacle(place, "barrier", height_m=1.45), Obstacle(place, "bus")]
    assert heights(*kinds) == [0.75, 1.45, 3.0]
    assert heights(kinds[0], occluder=0)[0] > 1.4


def test_sumo_s_vehicles_are_as_tall_as_their_types() -> None:
    with open_traffic(LTD, load_roads(LTD.map)) as traffic:
        assert {traffic.heights_m[name] for name in traffic.behaviours} == {1.5}


LTD = find_scenario("lane_change_ltd/0")


# --- noisy ---


def measured(frames: int = 600, tracks: int = 400, away_m: float = 50.0) -> tuple[Floats, float]:
    """Errors (frames, tracks, 4) in x, y, speed and heading, nan where dropped; the sum of the cones' speeds."""
    noise = TrackNoise("test/0#0", DT_S)
    ids = tuple(f"{i:03}" for i in range(tracks))
    rows, x_m = np.arange(tracks), np.full(tracks, away_m)
    none, eight = np.zeros(tracks), np.full(tracks, 8.0)
    kinds = np.where(rows < tracks // 2, ActorKind.VEHICLE, ActorKind.TRAFFIC_CONE).astype(np.int8)
    truth = Actors(ids, kinds, x_m, none, none, none + 4.0, none + 2.0, np.where(kinds == 0, eight, 0.0), none)
    errors, cones = np.full((frames, tracks, 4), np.nan), 0.0
    for frame in range(frames):
        told = noise.seen(frame, ids, truth, rows, (0.0, 0.0))
        at = np.array([int(name) for name in told.ids])
        of_speed = told.speed_mps - truth.speed_mps[at]
        errors[frame, at] = np.stack((told.x_m - x_m[at], told.y_m, of_speed, told.heading_rad), axis=1)
        cones += float(told.speed_mps[told.kind != ActorKind.VEHICLE].sum())
    return errors, cones


def test_errors_have_their_size_and_last_their_time_and_one_frame_in_a_hundred_is_missing() -> None:
    errors, cones = measured()
    assert cones == 0.0
    cars = errors[:, :200]
    for column, sigma in enumerate((0.2, 0.2, 0.2, radians(1.0))):  # 0.1 m + 0.2 % of 50 m
        of_one = cars[..., column]
        assert np.nanstd(of_one) == pytest.approx(sigma, rel=0.05)
        assert abs(np.nanmean(of_one)) < 0.1 * sigma
        for steps in (1, 5):
            product = np.nanmean(of_one[steps:] * of_one[:-steps]) / sigma**2
            assert product == pytest.approx(exp(-steps * DT_S / 0.5), abs=0.05)
    assert abs(np.nanmean(cars[..., 0] * cars[..., 1])) < 0.1 * 0.2**2
    assert abs(np.nanmean(cars[:, 0, 0] * cars[:, 1, 0])) < 0.4 * 0.2**2
    missing = np.isnan(errors[..., 0])
    assert missing.mean() == pytest.approx(0.01, abs=0.002)
    assert (missing[1:] & missing[:-1]).mean() < 5e-4


@pytest.mark.parametrize(("away_m", "sigma_m"), [(0.0, 0.1), (100.0, 0.3)])
def test_errors_of_position_grow_with_the_distance(away_m: float, sigma_m: float) -> None:
    errors, _ = measured(frames=200, away_m=away_m)
    assert sqrt(np.nanmean(errors[..., :2] ** 2)) == pytest.approx(sigma_m, rel=0.05)


def test_what_a_track_suffers_depends_on_nobody_else_and_goes_on_while_it_is_hidden() -> None:
    def told(frames: int, *ids: str, seen_from: int = 0, seed: int = 0) -> Actors:
        noise, last = TrackNoise(f"test/0#{seed}", DT_S), Actors.none()
        for frame in range(frames):
            near = together(*(one(20.0, 3.0 * i) for i in range(len(ids))))
            near = Actors.trusted(ids, *(getattr(near, name) for name in COLUMNS))
            rows = np.arange(len(ids) if frame >= seen_from else 0)
            last = noise.seen(frame, ids, near.only(rows), rows, (0.0, 0.0))
        return last.only([name == "m" for name in last.ids])

    alone = told(30, "m")
    assert told(30, "m", "z").x_m.tolist() == alone.x_m.tolist()
    assert told(30, "m", seen_from=29).x_m.tolist() == alone.x_m.tolist()
    assert told(30, "m", seed=1).x_m.tolist() != alone.x_m.tolist()


COLUMNS = ("kind", "x_m", "y_m", "heading_rad", "length_m", "width_m", "vx_mps", "vy_mps")


@pytest.mark.parametrize(("x_m", "in_sight"), [(119.9, True), (120.1, False)])
def test_errors_move_nobody_into_or_out_of_the_range(x_m: float, in_sight: bool) -> None:
    actors = together(one(x_m, 0.0))
    looking = Perception(staged("noisy"), ROADS, {}, 0, DT_S)
    looking.first(EGO, actors)
    counts = [len(looking.look(EGO, actors)) for _ in range(100)]
    assert sum(counts) > 90 if in_sight else not sum(counts)


# --- late, and together ---

LINE = Polyline(np.array([[0.0, 0.0], [400.0, 0.0]]))


def test_late_shows_the_scene_of_two_frames_ago_to_an_ego_of_now() -> None:
    planner, prompt = Planning(straight), Planning(straight)
    driven(planner, staged("late"), rolling("c", LINE, 60.0, 5.0))
    driven(prompt, staged("full"), rolling("c", LINE, 60.0, 5.0))
    for late, now in zip(planner.seen, prompt.seen, strict=True):
        assert late.ego == now.ego
        assert late.actors.x_m[0] == pytest.approx(now.actors.x_m[0] - 2 * 0.5)
        assert late.past.actors[-1].x_m[0] == pytest.approx(now.actors.x_m[0] - 3 * 0.5)
        assert len(late.past.actors) == PAST_STEPS


def places(actors: Actors) -> dict[str, float]:
    return {"t": 0.0} | dict(zip(actors.ids, actors.x_m.tolist(), strict=True))


def test_modes_together_follow_one_another() -> None:
    tracks = (rolling("c", LINE, 60.0, 5.0), rolling("t", LINE, 45.0, 5.0, size_m=(12.0, 2.5)))
    noisy, both = Planning(straight), Planning(straight)
    driven(noisy, staged("noisy"), *tracks)
    episode = driven(both, staged("late+noisy+occluded"), *tracks)
    hidden = [set(now.actors.ids) - set(late.actors.ids) for now, late in zip(noisy.seen, both.seen[2:], strict=False)]
    assert all(ids <= {"c"} for ids in hidden)
    assert sum(map(len, hidden)) > 30
    for now, late in zip(noisy.seen, both.seen[2:], strict=False):
        assert places(now.actors)["t"] == places(late.actors)["t"]
    assert episode.trace is not None
    assert episode.trace.seen is not None


def test_the_same_scenario_and_seed_are_the_same_trace_and_another_seed_is_not() -> None:
    def hash_of(perception: str, seed: int = 0) -> str:
        trace = driven(Planning(straight), staged(perception), rolling("c", LINE, 60.0, 5.0), seed=seed).trace
        assert trace is not None
        return trace.hash()

    assert hash_of("occluded+noisy") == hash_of("noisy+occluded")
    assert hash_of("noisy") != hash_of("noisy", seed=1)
    assert len({hash_of(each) for each in ("full", "occluded", "noisy", "late")}) == 4


def test_the_trace_keeps_what_was_seen_beside_what_was_there() -> None:
    planner = Planning(straight)
    trace = driven(planner, staged("noisy+late"), rolling("c", LINE, 60.0, 5.0)).trace
    assert trace is not None
    for frame, each in enumerate(planner.seen):
        kept = [trace.seen_at(frame - SEEN_BEFORE + k) for k in range(SEEN_BEFORE + 1)]
        for ours, told in zip(kept, (*each.past.actors, each.actors), strict=True):
            assert (ours.ids, ours.x_m.tolist()) == (told.ids, told.x_m.tolist())
    assert trace.actors.at(0).x_m.tolist() == [60.0]


@pytest.mark.parametrize("perception", ["foggy", "", "noisy+", "full+noisy", "Noisy"])
def test_a_perception_that_there_is_not_is_one_line_with_those_that_there_are(perception: str) -> None:
    with pytest.raises(ScenarioError, match=r"test/0: no perception named .* full, or some of occluded, noisy, late"):
        staged(perception)


def test_perception_is_part_of_what_a_scenario_is_where_it_is_not_full() -> None:
    full, noisy = staged("full"), staged("late+noisy")
    assert noisy.perception == "noisy+late"
    assert "perception" not in full.canonical()
    assert noisy.canonical()["perception"] == "noisy+late"
    assert noisy.hash() != full.hash()
