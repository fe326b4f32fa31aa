"""Recorded once, repeated without the model: the same decisions and the same trace, to the last bit."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pytest

from interplan_llm.models.fetch import default_model
from interplan_sumo.errors import InputError
from interplan_sumo.planner import load_planner
from interplan_sumo.scenario.suite import find_scenario
from interplan_sumo.simulation.episode import drive

STRAIGHT = json.dumps({"thoughts": "on", "waypoints": [[4 * k, 0] for k in range(1, 17)]})


def driven(spec: str, scenario: str, seconds: float) -> tuple[str, list[dict[str, Any]]]:
    """Hash of the trace and all that was asked, in the first seconds of a scene."""
    planner: Any = load_planner(spec)
    episode = drive(replace(find_scenario(scenario), duration_s=seconds), planner)
    assert episode.fault is None
    assert episode.trace is not None
    asked = [exchange.as_json() for exchange in planner.exchanges]
    assert asked
    return episode.trace.hash(), asked


@pytest.mark.slow
@pytest.mark.parametrize(
    ("planner", "answers"),
    [
        ("llm_hybrid", ["merge_left", "fly", "follow"]),
        ("llm_waypoints", [STRAIGHT, "straight on"]),
    ],
)
def test_a_drive_is_repeated_from_what_was_recorded(planner: str, answers: list[str], tmp_path: Path) -> None:
    model, store = f"scripted:{','.join(map(quote, answers))}", tmp_path / "answers.jsonl"
    recorded = driven(f"{planner}?model={model}&store={store}", "construction/0", 5.0)
    replayed = driven(f"{planner}?model=replay:{store}", "construction/0", 5.0)
    assert replayed == recorded
    assert {each["failure"] and each["failure"]["cause"] for each in recorded[1]} >= {None, "parse"}


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("planner", "scenario", "seconds"),
    [
        ("llm_hybrid?model=embedded", "construction/0", 5.0),
        ("llm_hybrid?model=embedded&real_time=true", "construction/0", 5.0),
        ("llm_waypoints?model=embedded", "nudge/0", 2.5),
    ],
)
def test_so_is_one_with_the_embedded_model(planner: str, scenario: str, seconds: float, tmp_path: Path) -> None:
    pytest.importorskip("xllamacpp", reason="needs the extra: pip install 'interplan-sumo[llm]'")
    try:
        default_model()
    except InputError as error:
        pytest.skip(f"needs the embedded model: {error}")
    store = tmp_path / "answers.jsonl"
    recorded = driven(f"{planner}&store={store}", scenario, seconds)
    assert driven(planner.replace("embedded", f"replay:{store}"), scenario, seconds) == recorded
    if "real_time" not in planner:  # an answer takes longer or shorter each time
        again = driven(planner, scenario, seconds)
        assert again[0] == recorded[0]
        assert [each["taken"] for each in again[1]] == [each["taken"] for each in recorded[1]]
