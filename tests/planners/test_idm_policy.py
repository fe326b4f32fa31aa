from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from interplan_planners.common.idm_policy import IdmDriver, idm_acceleration_mps2, idm_step
from tests.golden_values import GOLDEN, SHIPPED
from tests.planners.golden_idm import Case, pairs, read_cases

CASES = read_cases()
DRIVER = IdmDriver(target_speed_mps=13.4)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case["name"])
def test_the_solve_agrees_with_nuplan(case: Case) -> None:
    # relative to the size: accelerations reach hundreds where the gap is gone
    far_off = {p.what: p.difference for p in pairs(case) if not p.difference <= 1e-9 * max(1.0, abs(p.expected[0]))}
    assert far_off == {}


@pytest.mark.skipif(GOLDEN != SHIPPED, reason="another folder of golden cases")
def test_all_golden_cases_are_there() -> None:
    assert len(CASES) == 15


@pytest.mark.parametrize(("gap_m", "same"), [(1.0, True), (0.2, True), (-3.0, True), (1.01, False)])
def test_gaps_below_the_minimum_count_as_the_minimum(gap_m: float, same: bool) -> None:
    at_minimum = idm_acceleration_mps2(DRIVER, 5.0, 1.0, 0.0)
    assert (idm_acceleration_mps2(DRIVER, 5.0, gap_m, 0.0) == at_minimum) is same


@given(speed=st.floats(0.0, 30.0), gap=st.floats(-5.0, 200.0), lead=st.floats(-20.0, 30.0), dt=st.floats(0.01, 1.0))
def test_a_step_never_backs_and_respects_both_limits(speed: float, gap: float, lead: float, dt: float) -> None:
    moved_m, after = idm_step(DRIVER, speed, gap, lead, dt)
    assert moved_m == speed * dt
    assert max(0.0, speed - 3.0 * dt) - 1e-12 <= after <= speed + 1.0 * dt + 1e-12


@given(speed=st.floats(0.0, 30.0), gap=st.floats(2.0, 200.0), more=st.floats(0.1, 50.0))
def test_a_larger_gap_to_a_standing_lead_never_brakes_harder(speed: float, gap: float, more: float) -> None:
    assert idm_acceleration_mps2(DRIVER, speed, gap + more, 0.0) >= idm_acceleration_mps2(DRIVER, speed, gap, 0.0)
