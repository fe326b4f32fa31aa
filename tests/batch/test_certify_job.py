"""Certifying in worker processes: the same as in this one, whatever the order."""

from __future__ import annotations

from dataclasses import replace

import pytest

from interplan_sumo.batch.certify_job import proofs
from interplan_sumo.scenario.certificates import Certificate
from interplan_sumo.scenario.suite import certificate_of, find_scenario, find_suite

SCENARIOS = [find_scenario("nudge/2"), find_scenario("nudge/7")]


@pytest.mark.nightly
def test_a_worker_finds_and_checks_what_this_process_finds() -> None:
    here = {p.scenario.id: p.certificate for p in proofs(SCENARIOS, workers=0) if p.certificate is not None}
    assert set(here) == {s.id for s in SCENARIOS}
    (there,) = proofs(SCENARIOS[1:], workers=1)
    assert there.certificate is not None
    assert there.certificate.record() == here["nudge/7"].record()
    worse = {**here, "nudge/2": Certificate(replace(here["nudge/2"].summary, score=0.5), here["nudge/2"].track)}
    checked = {p.scenario.id: p for p in proofs(SCENARIOS, workers=0, stored=worse)}
    assert checked["nudge/7"].problems == ()
    assert checked["nudge/2"].certificate is None
    assert "score" in checked["nudge/2"].problems[0]


@pytest.mark.nightly
def test_a_certificate_names_who_of_the_panel_solves_the_scenario_and_an_open_one_nobody() -> None:
    stored = ((each, certificate_of(each.id, each.hash())) for each in find_suite("interplan==1").scenarios)
    solved = next(each for each, proof in stored if proof is not None and "pdm_closed" in (proof.solved_by or ()))
    (asked,) = proofs([solved], workers=0, panel=["straight_ahead", "pdm_closed"])
    assert asked.certificate is not None
    found = asked.certificate.summary
    summaries = (found, replace(found, solved_by=()), replace(found, solved_by=None))
    assert found.solved_by == ("pdm_closed",)
    assert [summary.solved_words for summary in summaries] == ["pdm_closed", "open", ""]


def test_a_scenario_without_a_stored_certificate_does_not_pass_the_check() -> None:
    (proof,) = proofs(SCENARIOS[:1], workers=0, stored={})
    assert proof.certificate is None
    assert proof.problems == ("no certificate is stored",)
