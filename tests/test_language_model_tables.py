"""Tables of language models: what stands beside them comes from what was kept, and each in its place."""

from __future__ import annotations

from pathlib import Path

import pytest

from interplan_sumo.scenario.suite import find_suite
from tools import language_models as kept
from tools.language_models import choosers, keep_oracle
from tools.tables import SMALL, stored


@pytest.mark.slow
@pytest.mark.parametrize(("score", "place"), [(1.0, 0), (0.0, -1)])
def test_the_oracle_stands_where_its_score_puts_it_and_a_fault_is_unsafe_and_not_done(
    score: float, place: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kept, "ORACLE", tmp_path / "oracle.csv")
    rows = [
        {"scenario_id": scene.id, "family": scene.family, "score": score, "done": True, "unsafe": False, "drives": 4}
        for scene in find_suite(SMALL).scenarios
    ]
    fault = {"class": "planner", "message": "gave up"}
    keep_oracle([row | ({"fault": fault, "done": None} if k == 0 else {"fault": None}) for k, row in enumerate(rows)])
    lines = [line.split(" | ") for line in choosers(stored()[SMALL].run)[2:]]
    assert lines[place][0] == "the oracle, which tries choices out: 4 drives a scene"
    assert lines[place][1].startswith(f"{100.0 * score:.0f} [")
    assert lines[place][2:5] == ["99", "1", f"{100.0 * score:.0f}"]
    assert {len(line) for line in lines} == {14}
