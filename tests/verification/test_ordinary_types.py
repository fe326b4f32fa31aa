"""What the types of ordinary driving are named after is seen in drives."""

from __future__ import annotations

from dataclasses import replace

import pytest

from interplan_sumo.scenario.suite import expert, find_scenario
from interplan_sumo.verification.ordinary_types import shows_its_type
from interplan_sumo.verification.replay import replay
from tests.quick import few


@pytest.mark.slow
@pytest.mark.parametrize(
    ("id", "others"),
    few(
        [
            ("following_lane_with_lead/1", ("behind_long_vehicle", "starting_right_turn", "stationary_in_traffic")),
            ("starting_left_turn/1", ("starting_right_turn", "stationary_in_traffic", "low_magnitude_speed")),
            ("stationary_in_traffic/1", ("starting_left_turn", "high_magnitude_speed", "stopping_with_lead")),
        ],
        0,
    ),
)
def test_a_drive_shows_its_own_type_and_not_others(id: str, others: tuple[str, ...]) -> None:
    scenario = find_scenario(id)
    trace = replay(scenario, expert(scenario))
    assert shows_its_type(scenario, trace)
    for other in others:
        assert not shows_its_type(replace(scenario, family=other), trace)


def test_a_family_that_is_no_type_asks_for_nothing() -> None:
    scenario = find_scenario("nudge/1")
    assert shows_its_type(scenario, replay(scenario, expert(scenario)))
