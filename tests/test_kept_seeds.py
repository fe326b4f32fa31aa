"""Scores over seeds: kept by planner, told with how far apart other traffic puts them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest

from interplan_sumo.batch.run_folder import read_run
from interplan_sumo.world.csv_tables import read_table
from tools import kept_seeds
from tools.kept_drives import folder_of, traffic_of
from tools.kept_seeds import keep_seeds, seeds
from tools.kept_sweeps import SUITE

TODAY = traffic_of(SUITE)
"""The version of the traffic that is kept."""


def run(folder: Path, scores: dict[str, list[float]], *, suite: str = SUITE, older: int = 0) -> Path:
    """A run of the kept planners' scenes in which each seed has one score, the same in every scene."""
    held = read_run(folder_of(suite))
    about = msgspec.json.decode((held.path / "manifest.json").read_bytes())
    names = [*scores]
    count = len(scores[names[0]])
    about["planners"] = dict.fromkeys(names, about["planners"]["idm"])
    about["requests"] = [about["requests"][0] | {"planners": names, "seeds": count}]
    about["traffic_version"] -= older
    rows = [row for row in held.rows.values() if row.planner == "idm"]
    folder.mkdir()
    (folder / "manifest.json").write_bytes(msgspec.json.encode(about))
    fresh: list[Any] = [
        msgspec.structs.replace(row, planner=name, seed=seed, score=score)
        for row in rows
        for name, of in scores.items()
        for seed, score in enumerate(of)
    ]
    (folder / "results.jsonl").write_bytes(b"".join(msgspec.json.encode(row) + b"\n" for row in fresh))
    return folder


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept_seeds, "KEPT", tmp_path / "seeds.csv")


def test_each_seed_has_its_score_and_all_have_the_interval_over_scenes(tmp_path: Path) -> None:
    keep_seeds(run(tmp_path / "a", {"idm": [0.2, 0.3, 0.4], "mine": [0.8, 0.8, 0.8]}))
    keep_seeds(run(tmp_path / "b", {"idm": [0.1, 0.2, 0.3]}))
    assert seeds() == [
        "planner | seed 0 | seed 1 | seed 2 | all | spread of a scene | two seeds apart",
        "---|---|---|---|---|---|---",
        "`mine` | 80 | 80 | 80 | 80 [75, 81] | 0 | 0",
        "`idm` | 10 | 20 | 30 | 20 [19, 25] | 10 | 3",
    ]


def test_scenes_spread_the_interval_and_not_the_seeds(tmp_path: Path) -> None:
    folder = run(tmp_path / "a", {"idm": [0.0, 0.0]})
    lines = [msgspec.json.decode(line) for line in (folder / "results.jsonl").read_bytes().splitlines()]
    rows = (row | {"score": float(row["scenario_id"].endswith("0"))} for row in lines)
    (folder / "results.jsonl").write_bytes(b"".join(msgspec.json.encode(row) + b"\n" for row in rows))
    keep_seeds(folder)
    *_, total, spread, apart = seeds()[2].split(" | ")
    assert (total.split()[0], spread, apart) == ("10", "0", "0")
    low, high = total.removeprefix("10 [").removesuffix("]").split(", ")
    assert 2 <= int(low) < 10 < int(high) <= 24


def test_what_is_kept_says_of_which_traffic_and_planner_it_is(tmp_path: Path) -> None:
    keep_seeds(run(tmp_path / "a", {"idm": [0.2, 0.3]}))
    held = read_run(folder_of(SUITE)).manifest
    for line in read_table(tmp_path / "seeds.csv", ("planner",)):
        assert (line["traffic_version"], line["planner_hash"]) == (str(held.traffic_version), held.planners["idm"].hash)


@pytest.mark.parametrize(
    ("scores", "how", "says"),
    [
        ([0.2], {}, "has one seed; run with --seeds 3"),
        ([0.2, 0.2], {"suite": "common==1"}, "is of common==1, expected interplan==1"),
        ([0.2, 0.2], {"older": 1}, f"is of traffic version {TODAY - 1}, the kept drives are of {TODAY}"),
    ],
)
def test_other_runs_are_refused(scores: list[float], how: dict[str, Any], says: str, tmp_path: Path) -> None:
    folder = run(tmp_path / "a", {"idm": scores}, **how)
    with pytest.raises(SystemExit, match=says):
        keep_seeds(folder)
    assert not kept_seeds.KEPT.exists()
