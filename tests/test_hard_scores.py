"""Scores in hard scenes: of both halves what a planner gets today, the panel's where it has not driven since."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from interplan_sumo.batch.run_folder import read_run
from interplan_sumo.scenario.suite import find_suite
from tools import hard_scores
from tools.hard_scores import HARD, both_halves, keep_hidden, panel_scores
from tools.kept_drives import folder_of


def test_both_halves_are_of_today_where_somebody_has_driven_since(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hard_scores, "HIDDEN", tmp_path / "hidden.csv")
    run, panel = read_run(folder_of(HARD)), panel_scores()
    keep_hidden(run, find_suite(HARD).folder)  # as if the shipped scenes were those that are kept back
    shown, hidden = both_halves(run)
    assert shown.keys() == hidden.keys() == {*run.planners, *panel}
    for name, families in shown.items():
        for family, scores in families.items():
            assert sorted(hidden[name][family]) == pytest.approx(sorted(scores), abs=1e-4)
    again = {name for name in panel if name in run.planners}
    assert again == {"foresight", "gameformer"}
    assert all(np.mean([*panel[name].values()]) < np.mean(np.concatenate([*shown[name].values()])) for name in again)
