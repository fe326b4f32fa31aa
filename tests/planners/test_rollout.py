from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from worlds import cars, straight_road

from interplan_planners.common.forecast import constant_velocity
from interplan_planners.common.idm_policy import IdmDriver, IdmLaw, idm_step
from interplan_planners.common.occupancy import StripOccupancy, occupancy
from interplan_planners.common.paths import DrivingPath
from interplan_planners.common.rollout import ProposalPath, RolloutClock, RolloutStart, roll_out
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.geometry import Floats

LANE = DrivingPath(straight_road(length_m=300.0)["11"].centerline)
DRIVER = IdmDriver(12.0, 1.0, 1.5, 1.5, 3.0, 10.0)
FRONT_M, REAR_M = 4.0, 1.0
STEPS = 40
INSTANTS = np.arange(STEPS + 1) // 2


def on_lane(*places: tuple[float, ...]) -> StripOccupancy:
    actors = cars(*places) if places else Actors.none()
    return occupancy(LANE, 1.1, constant_velocity(actors, 8.0), (0.0, 300.0))


def rolled(
    track: ProposalPath, speed_mps: float, targets: list[float] | Floats, **options: Floats
) -> tuple[Floats, Floats]:
    count = len(targets)
    start = RolloutStart(np.zeros(count, dtype=np.int64), np.full(count, 20.0), speed_mps)
    found = roll_out([track], start, np.array(targets), DRIVER, (FRONT_M, REAR_M), RolloutClock(INSTANTS), **options)
    return found.progress_m, found.speed_mps


@given(speed=st.floats(0.0, 30.0), target=st.floats(0.5, 30.0), gap=st.floats(-5.0, 200.0), lead=st.floats(-20.0, 30.0))
def test_accelerations_of_many_are_those_of_one(speed: float, target: float, gap: float, lead: float) -> None:
    driver = IdmDriver(target, 1.0, 1.5, 1.5, 3.0, 10.0)
    given = (speed, target, gap, lead)
    many = IdmLaw.many(DRIVER, 2).acceleration_mps2(*(np.full(2, number) for number in given))
    assert many.tolist() == [IdmLaw.one(DRIVER).acceleration_mps2(*given)] * 2  # to the last bit
    _, after = idm_step(driver, speed, gap, lead, 0.1)
    assert max(0.0, speed + 0.1 * float(many[0])) == pytest.approx(after, abs=1e-9)


@given(seed=st.integers(0, 2**31))
@settings(max_examples=20)
def test_one_proposal_alone_drives_as_it_does_among_others(seed: int) -> None:
    """A single one is rolled out without numpy; equal to the last bit."""
    rng = np.random.default_rng(seed)
    others = [
        (float(s), 0.0, float(v)) for s, v in zip(rng.uniform(0.0, 120.0, 4), rng.uniform(0.0, 9.0, 4), strict=True)
    ]
    limit = rng.uniform(2.0, 15.0, 200)
    track = ProposalPath(300.0, on_lane(*others), ((float(rng.uniform(30.0, 250.0)), 290.0),), limit)
    targets = rng.uniform(3.0, 15.0, (2, STEPS))
    most = np.where(np.arange(STEPS) < 9, rng.normal(), np.inf)
    speed_mps = float(rng.uniform(-0.5, 14.0))
    both, alone = (rolled(track, speed_mps, each, most_mps2=most) for each in (targets, targets[:1]))
    assert (both[0][0] == alone[0][0]).all()
    assert (both[1][0] == alone[1][0]).all()


def test_without_a_lead_each_reaches_its_target_speed() -> None:
    _, speed = rolled(ProposalPath(1e4, on_lane()), 8.0, [4.0, 8.0, 10.0])
    assert speed[:, -1] == pytest.approx([4.0, 8.0, 10.0], abs=0.6)
    assert (np.diff(speed[0]) <= 1e-9).all()


def test_a_proposal_is_one_idm_step_after_the_other() -> None:
    """Against the plain model, with a lead that drives on."""
    progress, speed = rolled(ProposalPath(300.0, on_lane((60.0, 0.0, 5.0))), 10.0, [12.0])
    s, v, rear_m = 20.0, 10.0, 0.0
    for k in range(1, STEPS + 1):
        if (k - 1) % 2 == 0:
            rear_m = 60.0 - 2.4 + 5.0 * 0.2 * (k // 2)
        moved, v = idm_step(DRIVER, v, rear_m - s - FRONT_M, 5.0, 0.1)
        s += moved
        assert (progress[0, k], speed[0, k]) == pytest.approx((s, v), abs=1e-9), k


def test_whoever_is_behind_is_no_lead() -> None:
    with_one = rolled(ProposalPath(300.0, on_lane((19.0, 0.0, 3.0))), 8.0, [12.0])
    assert (with_one[0] == rolled(ProposalPath(300.0, on_lane()), 8.0, [12.0])[0]).all()


def test_it_stops_before_what_stands() -> None:
    progress, speed = rolled(ProposalPath(300.0, on_lane(), standing_m=((50.0, 60.0),)), 8.0, [12.0])
    assert speed[0, -1] < 2.5
    assert 40.0 < progress[0, -1] + FRONT_M < 50.0


def test_it_stops_before_the_end_of_the_path() -> None:
    progress, _ = rolled(ProposalPath(45.0, on_lane()), 8.0, [12.0])
    assert progress[0, -1] + (FRONT_M + REAR_M) / 2 < 45.0


def test_limits_along_the_path_are_kept() -> None:
    limit = np.where(np.arange(300) < 40, 12.0, 6.0)
    _, speed = rolled(ProposalPath(300.0, on_lane(), limit_mps=limit), 10.0, [12.0])
    assert speed[0, -1] == pytest.approx(6.0, abs=0.5)
    _, slow = rolled(ProposalPath(300.0, on_lane(), limit_mps=limit), 10.0, [3.0])
    assert slow[0, -1] == pytest.approx(3.0, abs=0.5)


def test_accelerations_can_be_capped() -> None:
    most = np.concatenate((np.full(10, -2.0), np.full(STEPS - 10, np.inf)))
    _, speed = rolled(ProposalPath(300.0, on_lane()), 8.0, [12.0], most_mps2=most)
    assert speed[0, 10] == pytest.approx(6.0)
    assert speed[0, -1] > 6.0


def test_target_speeds_may_change_over_time() -> None:
    targets = np.where(np.arange(STEPS) < 20, 12.0, 2.0)[None, :]
    _, speed = rolled(ProposalPath(300.0, on_lane()), 8.0, targets)
    assert speed[0, 20] > 8.0 > speed[0, -1]


def test_each_proposal_minds_its_own_track() -> None:
    tracks = [ProposalPath(300.0, on_lane()), ProposalPath(300.0, on_lane((40.0, 0.0)))]
    start = RolloutStart(np.array([1, 0]), np.array([20.0, 20.0]), 8.0)
    found = roll_out(tracks, start, np.array([12.0, 12.0]), DRIVER, (FRONT_M, REAR_M), RolloutClock(INSTANTS))
    assert found.speed_mps[0, -1] < 1.0
    assert found.speed_mps[1, -1] > 9.0


def test_a_backing_start_counts_as_standing() -> None:
    progress, speed = rolled(ProposalPath(300.0, on_lane()), -0.3, [12.0])
    assert speed[0, 0] == 0.0
    assert (np.diff(progress[0]) >= 0.0).all()
