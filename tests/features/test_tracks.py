"""Tracks: every number of the ego's history, the agents and the static objects on worlds made by hand."""

from __future__ import annotations

from dataclasses import replace
from math import hypot, pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from worlds import cars, ego, observation, pedestrians, together

from interplan_sumo.features.frame import EgoFrame
from interplan_sumo.features.tracks import agents, ego_history, nearest_agents, static_objects
from interplan_sumo.planner import Past
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import Floats

REAR_M = 1.461  # PACIFICA's rear axle behind its centre
NOW = 20
DT_S = 0.1
HERE = ego(0.0, 0.0, 8.0)
FRAME = EgoFrame.of(HERE)


def table(now: Actors, *before: Actors) -> Floats:
    return agents(observation(HERE, now, past=Past((HERE,) * len(before), before)), FRAME, DT_S)


def test_the_present_of_the_ego_is_its_own_state_at_the_origin() -> None:
    state = replace(
        HERE, vy_mps=0.5, ax_mps2=1.0, ay_mps2=-0.25, tire_angle_rad=0.1, tire_rate_radps=-0.2, yaw_rate_radps=0.3
    )
    history, valid = ego_history(observation(state), FRAME, PACIFICA)
    np.testing.assert_allclose(history[NOW], (0.0, 0.0, 0.0, 8.0, 0.5, 1.0, -0.25, 0.3, 0.1, -0.2), atol=1e-12)
    assert valid.tolist() == [False] * 20 + [True]
    assert (history[:NOW] == 0.0).all()


def test_the_past_is_turned_into_the_frame_of_the_present() -> None:
    before = replace(ego(-5.0, 2.0, 3.0, pi / 2), ax_mps2=1.5)  # northwards, to the left of the ego's x axis
    history, valid = ego_history(observation(HERE, past=Past((before,), (Actors.none(),))), FRAME, PACIFICA)
    # rear axle at (-5, 2 - 1.461), the origin at (-1.461, 0); velocity and acceleration point to the left now
    np.testing.assert_allclose(
        history[NOW - 1, :7], (-5.0 + REAR_M, 2.0 - REAR_M, pi / 2, 0.0, 3.0, 0.0, 1.5), atol=1e-12
    )
    assert valid.tolist() == [False] * 19 + [True, True]


def test_of_a_longer_past_the_last_two_seconds_count() -> None:
    egos = tuple(ego(float(k), 0.0) for k in range(25))
    history, _ = ego_history(observation(HERE, past=Past(egos, (Actors.none(),) * 25)), FRAME, PACIFICA)
    assert history[0, 0] == pytest.approx(5.0)


def test_a_car_ahead_on_the_left_that_drives_away_to_the_left() -> None:
    row = table(cars((10.0, 3.0, 6.0, pi / 2)))[0, NOW]
    np.testing.assert_allclose(
        row, (10.0 + REAR_M, 3.0, pi / 2, 0.0, 6.0, 0.0, 4.8, 2.0, 1.0, 0.0, 0.0, 0.0, 1.0), atol=1e-12
    )


@pytest.mark.parametrize(
    ("actor", "bits"),
    [
        (cars((9.0, 0.0), length_m=6.99), (1, 0, 0, 0)),
        (cars((9.0, 0.0), length_m=7.0), (0, 1, 0, 0)),
        (pedestrians((9.0, 0.0)), (0, 0, 1, 0)),
        (cars((9.0, 0.0), kind=ActorKind.BICYCLE, length_m=1.8), (0, 0, 0, 1)),
    ],
    ids=["car", "bus", "pedestrian", "bicycle"],
)
def test_every_agent_is_of_one_class(actor: Actors, bits: tuple[int, ...]) -> None:
    assert tuple(table(actor)[0, NOW, 8:12]) == bits


def test_frames_in_which_an_agent_was_not_seen_are_empty() -> None:
    rows = table(cars((10.0, 0.0)), cars((9.0, 0.0)), Actors.none())[0]
    assert rows[:, 12].tolist() == [0.0] * 18 + [1.0, 0.0, 1.0]
    assert (rows[19] == 0.0).all()
    assert rows[18, 0] == pytest.approx(9.0 + REAR_M)


def test_who_is_gone_now_has_no_row() -> None:
    assert (table(Actors.none(), cars((9.0, 0.0))) == 0.0).all()


def test_turning_left_is_a_positive_yaw_rate_also_across_the_seam_of_angles() -> None:
    rows = table(cars((10.0, 0.0, 1.0, -pi + 0.03)), cars((10.0, 0.0, 1.0, pi - 0.02)))[0]
    assert rows[NOW, 5] == pytest.approx(0.5)
    assert rows[NOW - 1, 5] == pytest.approx(0.5)  # seen for the first time: taken from the step after


def test_seen_once_is_no_yaw_rate() -> None:
    now, long_ago = cars((10.0, 0.0, 1.0, 0.4)), cars((10.0, 0.0, 1.0, 0.1))
    assert (table(now, long_ago, Actors.none())[0, :, 5] == 0.0).all()


def test_the_nearest_come_first_and_the_thirty_first_is_left_out() -> None:
    crowd = cars(*((40.0 - k, 0.0) for k in range(31)))
    rows = table(crowd)
    np.testing.assert_allclose(rows[:, NOW, 0], np.arange(10.0, 40.0) + REAR_M)
    assert nearest_agents(crowd, FRAME) == tuple(f"car{k:02d}" for k in range(30, 0, -1))


def test_equally_near_agents_go_by_id() -> None:
    beside_m = hypot(5.0, 2.0)
    crowd = cars((5.0 - REAR_M, 2.0), (5.0 - REAR_M, -2.0), (beside_m - REAR_M, 0.0))
    assert nearest_agents(crowd, FRAME) == ("car00", "car01", "car02")


@settings(max_examples=8)
@given(st.permutations(range(6)))
def test_what_actors_are_called_does_not_matter(order: list[int]) -> None:
    places = [(6.0 + 3.0 * k, float(k), 1.0 * k, 0.1 * k) for k in range(6)]
    plain = table(cars(*places), cars(*places))
    renamed = cars(*(places[k] for k in order))
    np.testing.assert_array_equal(table(renamed, renamed), plain)


def test_cones_and_barriers_are_no_agents_and_carry_nuplans_codes() -> None:
    cone = cars((6.0, 1.0, 0.0, 0.2), kind=ActorKind.TRAFFIC_CONE, length_m=0.5, width_m=0.4, prefix="cone")
    barrier = cars((4.0, -1.0), kind=ActorKind.BARRIER, length_m=2.0, width_m=0.6, prefix="barrier")
    scene = together(cone, barrier, cars((20.0, 0.0)))
    found = static_objects(scene, FRAME)
    np.testing.assert_allclose(found[0], (4.0 + REAR_M, -1.0, 0.0, 2.0, 0.6, 4.0), atol=1e-12)
    np.testing.assert_allclose(found[1], (6.0 + REAR_M, 1.0, 0.2, 0.5, 0.4, 3.0), atol=1e-12)
    assert (found[2:] == 0.0).all()
    assert table(scene)[:, NOW, 12].sum() == 1.0


def test_of_many_cones_the_nearest_twenty_are_kept() -> None:
    found = static_objects(cars(*((30.0 - k, 0.0) for k in range(21)), kind=ActorKind.TRAFFIC_CONE), FRAME)
    np.testing.assert_allclose(found[:, 0], np.arange(10.0, 30.0) + REAR_M)
