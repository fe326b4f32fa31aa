"""Cars: background cars in the place of the ego give the samples that an ego with their motion would."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from worlds import cars, drive, pedestrians, straight_road, together

from interplan_sumo.batch.stored_drive import StoredDrive
from interplan_sumo.dataset.cars import BEYOND_M, EGO, CarDrive, Cars, way_of
from interplan_sumo.dataset.motion import body
from interplan_sumo.dataset.observation_replay import ObservationReplay
from interplan_sumo.dataset.samples import drive_samples
from interplan_sumo.features.schema import BY_NAME, SEEN
from interplan_sumo.features.view import EgoView
from interplan_sumo.maps.store import load_roads
from interplan_sumo.planner import load_planner
from interplan_sumo.scenario.route import route_centerline
from interplan_sumo.scenario.scenario import LanePosition, Scenario
from interplan_sumo.simulation import episode
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import wrap_angle
from interplan_sumo.world.trace import ActorTable, EgoTrack, Trace
from tests.scenes import scene

LEAST = 101
"""2 s, the present and 8 s."""


def scenario(length_m: float = 400.0) -> Scenario:
    return Scenario(
        "test/0", "test", "tiny", LanePosition("11", 10.0), 10.0, LanePosition("11", length_m - 10.0), ("1",)
    )


def traffic(frames: int, *, speed_mps: float = 10.0, y_m: float = 0.0, first: int = 0, length_m: float = 4.6) -> Trace:
    """An ego that stands far off, and a car that comes in a frame and goes on at one speed."""
    car = [
        cars((30.0 + 0.1 * speed_mps * k, y_m, speed_mps), length_m=length_m) if k >= first else Actors.none()
        for k in range(frames)
    ]
    return drive(*(0.0,) * frames, actors=car)


@pytest.mark.parametrize(("frames", "found"), [(LEAST, 1), (LEAST - 1, 0)])
def test_a_car_must_live_for_its_past_and_its_future(frames: int, found: int) -> None:
    trace = Cars(traffic(frames + 7, first=7))
    assert len(trace.tokens) == found
    if found:
        made = trace.drive(trace.tokens[0])
        assert made.first_frame == 7
        assert made.samples.tolist() == [20]


@pytest.mark.parametrize(("length_m", "is_car"), [(2.2, False), (4.6, True), (6.99, True), (7.0, False)])
def test_only_vehicles_of_a_cars_size_stand_in_for_the_ego(length_m: float, is_car: bool) -> None:
    assert bool(Cars(traffic(LEAST, length_m=length_m)).tokens) == is_car
    assert Cars(drive(*(5.0,) * 120, actors=pedestrians((30.0, 4.0)))).tokens == ()


def test_samples_have_nothing_but_good_frames_from_2_s_before_to_8_s_after() -> None:
    made = Cars(traffic(300)).drive("car00")
    good = np.ones(300, dtype=np.bool_)
    good[150] = False
    marked = CarDrive(made.token, made.first_frame, made.trace, good, 0.0)
    expected = [*range(20, 70), *range(171, 220)]
    assert marked.samples.tolist() == expected
    assert made.samples.tolist() == list(range(20, 220))


def test_where_boxes_overlap_there_is_no_sample() -> None:
    ahead = cars((140.0, 0.0), prefix="other")
    frames = [together(cars((30.0 + k, 0.0, 10.0)), ahead) for k in range(300)]
    made = Cars(drive(*(0.0,) * 300, start=drive(0.0).ego.state(0).pose, actors=frames)).drive("car00")
    assert made.good[:100].all()
    assert not made.good[110]


def test_a_car_that_hops_to_the_next_lane_is_not_used_there() -> None:
    frames = [cars((30.0 + k, 0.0 if k < 150 else 3.5, 10.0)) for k in range(300)]
    made = Cars(drive(*(0.0,) * 300, start=drive(0.0).ego.state(0).pose, actors=frames)).drive("car00")
    assert not made.good[150]
    assert not set(made.samples.tolist()) & set(range(150 - 80, 150 + 20))
    assert set(made.samples.tolist()) >= set(range(20, 60))


def test_the_former_ego_is_one_of_the_others() -> None:
    trace = Cars(traffic(LEAST, y_m=3.5)).drive("car00").trace
    others = trace.actors.at(0)
    assert others.ids == (EGO,)
    assert others.kind[0] == ActorKind.VEHICLE
    assert (others.length_m[0], others.width_m[0]) == (PACIFICA.length_m, PACIFICA.width_m)
    assert trace.shape == body(4.6, 2.0)


def in_the_ranks(trace: Trace, token: str) -> Trace:
    """The same drive with the ego among the actors as `me`, and one of the actors as the ego."""
    frames = len(trace)
    rows = np.flatnonzero(trace.actors.ids == token)
    assert len(rows) == frames
    table = trace.actors
    speed = np.hypot(table.vx_mps[rows], table.vy_mps[rows])
    zero = np.zeros(frames)
    x_m, y_m, heading = table.x_m[rows], table.y_m[rows], table.heading_rad[rows]
    track = EgoTrack(trace.ego.time_us, x_m, y_m, heading, speed, zero, zero, zero, zero, zero, zero, zero)
    ego = trace.ego
    crowd: list[Actors] = []
    for k in range(frames):
        rest = table.at(k).only(np.array([i != token for i in table.at(k).ids]))
        me = cars(
            (ego.x_m[k], ego.y_m[k], ego.vx_mps[k], ego.heading_rad[k]),
            length_m=PACIFICA.length_m, width_m=PACIFICA.width_m, prefix="me",
        )  # fmt: skip
        crowd.append(together(rest, me))
    shape = body(float(table.length_m[rows[0]]), float(table.width_m[rows[0]]))
    return Trace(track, ActorTable.of(crowd), trace.signals, (), np.zeros(0), shape)


ALMOST = {"ego_history": 0.2, "ego_future": 0.03, "agents": 0.06, "origin": 0.02}
"""Smoothing moves places by centimetres; everything else turns with the heading: millimetres a metre."""


@pytest.mark.slow
def test_a_car_that_moves_as_an_ego_did_gives_the_samples_of_that_ego() -> None:
    known, roads = scene("lane_change_mtd/5"), load_roads(scene("lane_change_mtd/5").map)
    trace = episode.drive(known, load_planner("idm")).trace
    assert trace is not None
    token = next(t for t in Cars(trace).tokens if (trace.actors.ids == t).sum() == len(trace))
    own = Cars(in_the_ranks(trace, token)).drive("me00").trace
    frames = range(25, len(trace) - 30, 15)
    assert len(frames) >= 3
    (one, other) = (drive_samples(known, roads, each, drive=0, frames=frames) for each in (trace, own))
    for name in (*(field.name for field in SEEN), "ego_future", "agent_futures", "expert_nodes", "situation"):
        off = one[name].astype(np.float64) - other[name].astype(np.float64)
        for k in (k for k, channel in enumerate(BY_NAME[name].channels) if channel.name == "yaw"):
            off[..., k] = wrap_angle(off[..., k])  # an oncoming lane may be turned by half a turn to either side
        assert np.abs(off).max(initial=0.0) <= ALMOST.get(name, 0.25), name
    motion = ("x", "y", "yaw", "vx", "vy")
    np.testing.assert_allclose(
        one["ego_history"][..., : len(motion)], other["ego_history"][..., : len(motion)], atol=0.03
    )


def test_the_way_of_a_car_follows_its_lanes_and_goes_on_beyond_its_last_place() -> None:
    roads = straight_road(lanes=2, length_m=600.0)
    made = Cars(traffic(200, y_m=-3.5)).drive("car00")
    host = replace(scenario(600.0), map=roads.name)
    found = way_of(made, host, roads)
    assert found.start.lane == "12"
    assert found.start.arc_m == pytest.approx(30.0, abs=0.1)
    assert found.start_speed_mps == pytest.approx(10.0)
    assert found.goal.lane == "12"
    assert found.goal.arc_m == pytest.approx(30.0 + 19.9 * 10.0 + BEYOND_M, abs=3.0)
    assert found.id == host.id


@pytest.mark.nightly
def test_every_car_of_a_drive_stays_on_its_way(stored: StoredDrive) -> None:
    every = Cars(stored.trace)
    assert len(every.tokens) >= 3
    for token in every.tokens[:3]:
        made = every.drive(token)
        found = way_of(made, stored.scenario, stored.roads)
        line = route_centerline(stored.roads, found)
        ego = made.trace.ego
        _, left_m = line.project(np.stack((ego.x_m, ego.y_m), axis=1))
        assert np.abs(left_m).max() < 4.5  # a lane change at most
        seen = ObservationReplay(found, stored.roads, made.trace).at(20)
        arrays = EgoView(ObservationReplay(found, stored.roads, made.trace).mission).arrays(seen)
        assert arrays["route_centerline_valid"][:40].all()
        assert abs(arrays["route_centerline"][0, 1]) < 2.0
