"""Tracks of a sensor with errors: who stands is known to stand and where; a sensor without errors is believed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from worlds import cars, ego, ego_on, mission, observation, straight_road, together

from interplan_planners.common.neighbours import stands_for_good
from interplan_planners.common.steadied import steadied
from interplan_planners.foresight import ForesightPlanner
from interplan_sumo.planner import Observation, Past
from interplan_sumo.simulation.track_noise import TrackNoise
from interplan_sumo.world.actors import ActorKind, Actors
from tests.planners.staging_planners import driven, moved

EYE = (0.0, 0.0)
ROW = cars(*((5.0 * k, 30.0) for k in range(-10, 11)))
"""Twenty-one that stand 30 to 60 m away."""


class Noisy:
    """What a sensor with errors tells of actors, frame by frame."""

    def __init__(self, seed: int = 0) -> None:
        self._noise = TrackNoise(f"steadied#{seed}", 0.1)

    def seen(self, frame: int, actors: Actors) -> Actors:
        return self._noise.seen(frame, actors.ids, actors, np.arange(len(actors)), EYE)


def told(frames: list[Actors], seed: int = 0) -> Observation:
    """The observation at the last of true frames, seen with errors."""
    sensor = Noisy(seed)
    seen = [sensor.seen(k, each) for k, each in enumerate(frames)]
    return observation(ego(), seen[-1], past=Past((ego(),) * (len(seen) - 1), tuple(seen[:-1])))


def rolling(actors: Actors) -> list[Actors]:
    """The last 2 s and now, everybody at its velocity."""
    return [moved(actors, 0.1 * (k - 20)) for k in range(21)]


def standing(seen: Observation) -> dict[str, bool]:
    return dict(zip(seen.actors.ids, stands_for_good(seen).tolist(), strict=True))


def test_a_sensor_without_errors_is_taken_at_its_word() -> None:
    here = together(ROW, cars((10.0, 0.0, 7.0), prefix="moves"))
    seen = observation(ego(), here, past=Past((ego(),) * 20, tuple(rolling(here)[:-1])))
    assert steadied(seen) is seen


def test_with_nothing_in_sight_there_is_nothing_to_steady() -> None:
    seen = observation(ego(), Actors.none(), past=Past((ego(),) * 20, (Actors.none(),) * 20))
    assert steadied(seen) is seen


def test_who_stands_is_known_to_stand() -> None:
    """Not every one, for limits are three and a half standard deviations; of single frames hardly any does."""

    def known(every: list[Observation]) -> float:
        return float(np.mean([sum(standing(each).values()) / len(ROW) for each in every]))

    raws = [told(rolling(ROW), seed) for seed in range(60)]
    assert known(raws) < 0.02 < 0.99 < known([steadied(raw) for raw in raws])


@given(seed=st.integers(0, 10_000))
def test_nobody_gets_lost_and_who_stands_is_at_rest(seed: int) -> None:
    now = steadied(told(rolling(ROW), seed))
    assert set(now.actors.ids) == set(ROW.ids)
    assert (now.actors.speed_mps[[standing(now)[name] for name in now.actors.ids]] == 0.0).all()


def test_standing_boxes_are_seen_nearer_to_where_they_are_than_one_frame_tells() -> None:
    def off_m(seen: Observation) -> float:
        rows = [ROW.ids.index(name) for name in seen.actors.ids]
        return float(np.hypot(seen.actors.x_m - ROW.x_m[rows], seen.actors.y_m - ROW.y_m[rows]).mean())

    raws = [told(rolling(ROW), seed) for seed in range(60)]
    now_m, raw_m = (np.mean([off_m(each) for each in seen]) for seen in ([steadied(raw) for raw in raws], raws))
    assert now_m < 0.15
    assert now_m < 0.7 * raw_m


@pytest.mark.parametrize("speed_mps", [1.0, 3.0, 12.0])
def test_who_moves_at_a_walk_or_faster_does_not_stand(speed_mps: float) -> None:
    for seed in range(20):
        movers = cars(*((10.0 * k, -30.0, speed_mps) for k in range(-3, 4)), prefix="moves")
        found = standing(steadied(told(rolling(together(ROW, movers)), seed)))
        assert not any(found.get(name, False) for name in movers.ids)


@pytest.mark.slow
def test_who_sets_off_is_found_out_within_a_second() -> None:
    def setting_off(after_s: float) -> list[Actors]:
        """Stood until `after_s` ago, and has accelerated with 2 m/s2 since."""
        frames: list[Actors] = []
        for k in range(21):
            since_s = max(after_s - 0.1 * (20 - k), 0.0)
            frames.append(together(ROW, cars((since_s * since_s, -20.0, 2.0 * since_s), prefix="goes")))
        return frames

    late = [standing(steadied(told(setting_off(1.0), seed))).get("goes00", False) for seed in range(40)]
    early = [standing(steadied(told(setting_off(0.0), seed))).get("goes00", True) for seed in range(40)]
    assert np.mean(late) < 0.1 < 0.9 < np.mean(early)


def test_cones_lie_where_they_were_seen_on_average_and_keep_their_kind() -> None:
    cones = cars((12.0, 3.0), (14.0, 3.2), kind=ActorKind.TRAFFIC_CONE, prefix="cone")
    now = steadied(told(rolling(together(ROW, cones)), 3)).actors
    rows = [now.ids.index(name) for name in cones.ids]
    assert (now.kind[rows] == ActorKind.TRAFFIC_CONE).all()
    assert np.abs(now.x_m[rows] - cones.x_m).max() < 0.25


@pytest.mark.parametrize(("missing", "there"), [(1, True), (3, True), (4, False)])
def test_who_is_lost_for_three_frames_is_still_there_and_then_no_more(missing: int, there: bool) -> None:
    seen = told(rolling(together(ROW, cars((20.0, 0.0, 10.0), prefix="lost"))), 5)
    every = (*seen.past.actors, seen.actors)
    frames = [each if k < 21 - missing else without(each, "lost00") for k, each in enumerate(every)]
    now = steadied(replace(seen, actors=frames[-1], past=replace(seen.past, actors=tuple(frames[:-1])))).actors
    assert ("lost00" in now.ids) == there
    if there:
        assert now.x_m[now.ids.index("lost00")] == pytest.approx(20.0, abs=1.0)


def without(actors: Actors, name: str) -> Actors:
    return actors.only(np.array([each != name for each in actors.ids]))


@pytest.mark.slow
def test_a_car_that_stands_in_the_way_is_passed_although_its_track_creeps_to_and_fro() -> None:
    roads = straight_road(lanes=2, length_m=400.0, limit_mps=10.0)
    truth = together(cars((70.0, -3.5)), cars(*((8.0 * k, 12.0) for k in range(12)), prefix="row"))
    planner, sensor, frame = ForesightPlanner(), Noisy(1), iter(range(1000))
    planner.start(mission(roads, ("12",), goal_arc_m=350.0))
    start = ego_on(roads, "12", 30.0, 8.0)
    states = driven(planner, start, 140, lambda _: sensor.seen(next(frame), truth), may_touch=True)
    assert states[-1].x_m > 85.0
