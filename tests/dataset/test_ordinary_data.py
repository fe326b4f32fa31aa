"""Ordinary driving as data: one request, one dataset; what cannot be asked for, and that nothing depends on workers."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec import UNSET, structs
from typer.testing import CliRunner

from interplan_sumo.batch.records import MetricRecord
from interplan_sumo.batch.run_folder import read_run
from interplan_sumo.cli.dataset import dataset_app
from interplan_sumo.dataset.folder import DRIVEN
from interplan_sumo.dataset.ordinary import VAL_SEEDS, OrdinaryRequest, conduct, make_ordinary
from interplan_sumo.dataset.reading import read_dataset
from interplan_sumo.errors import InputError, InterplanError
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.scenario.suite import suites
from interplan_sumo.world.trajectory import Trajectory
from tools.kept_drives import folder_of

MAP = "back_bay"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"samples": 0}, "samples is 0, expected 1 or more"),
        ({"seed": 99_999}, "seed is 99999, expected 100000 or more: smaller ones may have made official scenes"),
        ({"min_score": 90.0}, "min-score is 90, expected 0 to 1"),
        ({"maps": ("back_by",)}, "Did you mean 'back_bay'"),
        ({"holdout_maps": ("strip",)}, "no map among those to drive on named 'strip'"),
        ({"holdout_maps": (MAP,)}, "every map is held out, none is left to train on"),
    ],
)
def test_what_cannot_be_is_named_before_anything_is_driven(
    tmp_path: Path, options: dict[str, Any], message: str
) -> None:
    asked: dict[str, Any] = {"folder": tmp_path / "a", "samples": 10, "maps": (MAP,), **options}
    with pytest.raises(InputError, match=message):
        make_ordinary(OrdinaryRequest(**asked))
    assert not (tmp_path / "a").exists()


def test_a_strangers_folder_is_refused_before_anything_is_driven(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("years of work")
    with pytest.raises(InputError, match=r"holds 'thesis.txt' and is no dataset"):
        make_ordinary(OrdinaryRequest(tmp_path, 10, maps=(MAP,)))
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


def test_the_command_hands_its_options_on(tmp_path: Path) -> None:
    asked = ["ordinary", "--out", str(tmp_path / "a"), "--samples", "10", "--seed", "3", "--workers", "0"]
    found = CliRunner().invoke(dataset_app, asked, obj=asked)
    assert isinstance(found.exception, InterplanError)
    assert "seed is 3" in str(found.exception)


@pytest.mark.parametrize(
    ("lacks", "counts"),
    [
        ({}, 1.0), ({"task_done": 0.25, "progress": 0.3}, 1.0), ({"task_done": 0.25, "lane_changes": 0.0}, 0.0),
        ({"task_done": 0.25, "making_progress": 0.0}, 0.0), ({"no_collision": 0.0}, 0.0), ({"comfort": 0.0}, 0.85),
    ],
)  # fmt: skip
def test_who_drives_well_may_come_late_but_not_astray(lacks: dict[str, float], counts: float) -> None:
    gates = ("no_collision", "making_progress", "task_done")
    weights = {"progress": 5.0, "time_to_collision": 11.0, "comfort": 2.0}
    metrics = {name: MetricRecord(lacks.get(name, 1.0), {}, None) for name in (*gates, *weights, "lane_changes")}
    (row, *_) = read_run(folder_of("common==1")).rows.values()
    assert conduct(structs.replace(row, metrics=metrics, gates=gates, weights=weights)) == pytest.approx(
        counts, abs=0.01
    )


def asked(folder: Path, workers: int) -> OrdinaryRequest:
    """A few samples by drivers that take no time to think."""
    return OrdinaryRequest(
        folder, 24, maps=(MAP,), min_score=0.0, experts=("idm", "straight_ahead"), workers=workers, shard_samples=8
    )


def files_of(folder: Path) -> dict[str, bytes]:
    every = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in every if DRIVEN not in path.parts}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("ordinary") / "a"
    make_ordinary(asked(folder, 0))
    return folder


@pytest.mark.nightly
def test_a_dataset_of_ordinary_driving_says_what_it_holds(made: Path) -> None:
    dataset = read_dataset(made)
    counts = dataset.manifest.counts
    assert counts.by_split == {"train": 22, "val": 2}
    assert counts.by_planner["sumo"] == 20
    for split in ("train", "val"):
        shown = np.concatenate([batch["situation"] for batch in dataset.split(split).batches(100)])
        assert np.bincount(shown, minlength=8).tolist() == list(counts.by_situation[split].values())
    official = {scenario.id for suite in suites().values() for scenario in suite.scenarios}
    assert not official & {drive.scenario_id for drive in dataset.drives}
    seeds = {(drive.split, drive.seed >= 100_000 + VAL_SEEDS) for drive in dataset.drives}
    assert seeds == {("train", False), ("val", True)}
    about = dataset.manifest.ordinary
    assert about is not UNSET
    assert (about.first_seed, about.samples_wanted, about.maps) == (100_000, 24, [MAP])


@pytest.mark.nightly
def test_what_is_driven_is_not_driven_again_and_gives_equal_files_whatever_the_workers(
    made: Path, tmp_path: Path
) -> None:
    shutil.copytree(made, tmp_path / "a")
    lines: list[str] = []
    make_ordinary(asked(tmp_path / "a", 1), lines.append)
    assert not [line for line in lines if line.startswith("[")]
    assert files_of(tmp_path / "a") == files_of(made)


@pytest.mark.nightly
def test_background_cars_teach_where_the_expert_drove_badly_and_the_expert_does_not(made: Path, tmp_path: Path) -> None:
    shutil.copytree(made, tmp_path / "a")
    make_ordinary(replace(asked(tmp_path / "a", 0), min_score=0.9))
    dataset = read_dataset(tmp_path / "a")
    rows = [row for run in (tmp_path / "a" / DRIVEN).glob("*/") for row in read_run(run).rows.values()]
    clean = {row.trace_hash: conduct(row) >= 0.9 for row in rows}
    hosts = [(drive.planner == "sumo", clean[drive.trace_hash]) for drive in dataset.drives]
    assert {is_clean for is_car, is_clean in hosts if not is_car} == {True}
    assert {is_clean for is_car, is_clean in hosts if is_car} == {True, False}


class StandStill:
    """Brakes where it is, and never goes on: nobody to learn from."""

    def start(self, mission: Mission) -> None: ...

    def plan(self, observation: Observation) -> Trajectory:
        ego = observation.ego
        ahead = np.linspace(0.0, 8.0, 81)
        return Trajectory(observation.time_s + ahead, *(np.full(81, at) for at in (ego.x_m, ego.y_m, ego.heading_rad)))


@pytest.mark.nightly
def test_experts_of_whom_nothing_can_be_learned_end_it_although_there_are_cars_enough(tmp_path: Path) -> None:
    nobody = f"{__name__}:StandStill"
    with pytest.raises(InputError, match="gave no clean drive"):
        make_ordinary(replace(asked(tmp_path / "a", 0), min_score=0.9, experts=(nobody, nobody)))
