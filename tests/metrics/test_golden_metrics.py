"""Profile nuplan gives what nuPlan's own metrics gave: every score, statistic, series and association."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from tests.golden_values import TOLERANCE
from tests.metrics.golden_metrics import GOLDEN, OURS, Case, case_folders, pairs, read_case

FOLDERS = case_folders()
cached_case = cache(read_case)


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_every_stored_value_is_reproduced(folder: Path):
    case = cached_case(folder)
    found = list(pairs(case))
    assert len(found) > 60
    wrong = [(p.what, p.difference) for p in found if not p.difference <= TOLERANCE]
    assert not wrong


@pytest.fixture(scope="module")
def by_name() -> dict[str, Case]:
    return {folder.name: cached_case(folder) for folder in FOLDERS}


@pytest.mark.skipif(not (GOLDEN / "aggregate.json").exists(), reason="a folder without aggregate.json")
def test_the_aggregate_table_is_reproduced(by_name: dict[str, Case]):
    table = json.loads((GOLDEN / "aggregate.json").read_text())
    scored = {name: case.sheet for name, case in by_name.items()}
    kind = {name: case.about["scenario_type"] for name, case in by_name.items()}
    for row in table["rows"]:
        label = row["scenario"]
        if label == "final_score":
            members = list(scored)
        else:
            members = [label] if label in scored else [name for name in scored if kind[name] == label]
        assert row["num_scenarios"] in (None, len(members))
        assert np.mean([scored[name].score for name in members]) == pytest.approx(row["score"], abs=TOLERANCE)
        for theirs, ours in OURS.items():
            total = sum(scored[name].metrics[ours].score or 0.0 for name in members)
            if label == "final_score":
                total /= len(members)
            assert total == pytest.approx(row[theirs], abs=TOLERANCE * len(members))


def test_every_lost_point_has_a_reason(by_name: dict[str, Case]):
    for case in by_name.values():
        for name, result in case.sheet.metrics.items():
            assert (result.reason is not None) == (result.score is not None and result.score < 1.0), name
