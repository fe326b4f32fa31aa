"""Who knows the shipped certificates by heart shines where they lead, and is blind on scenes that nobody has seen."""

from __future__ import annotations

import pytest

from interplan_sumo.maps.store import load_roads
from interplan_sumo.planner_process.process import PlannerProcess
from interplan_sumo.planner_seat import PlannerSeat
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.suite import find_suite
from interplan_sumo.simulation.episode import drive
from interplan_sumo.verification.generation import generate
from interplan_sumo.verification.suite_slots import Seed

CHEAT = "tests.planner_process.certificate_replay:CertificateReplay"


def driven(scenario: Scenario, seat: PlannerSeat) -> tuple[str, bool]:
    """The hash of the drive, and whether it came to the goal."""
    episode = drive(scenario, seat)
    assert episode.fault is None
    assert episode.trace is not None
    return episode.trace.hash(), episode.reached_goal


@pytest.mark.slow
def test_a_replayed_certificate_solves_its_own_scene_and_gets_nothing_on_a_hidden_one() -> None:
    public = find_suite("smoke==1").scenarios[0]
    seed = Seed.secret(b"nobody has ever seen this")
    (hidden,) = generate(load_roads("hazelwood"), "nudge", 1, seed.value).scenarios
    with PlannerProcess.of(CHEAT) as cheat, PlannerProcess.of("straight_ahead") as blind:
        assert driven(public, cheat)[1]
        assert driven(hidden, cheat) == driven(hidden, blind)
