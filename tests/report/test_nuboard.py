"""nuBoard: the files that nuPlan's viewer reads, and nothing in them that could be run."""

from __future__ import annotations

import math
import pickle
import pickletools
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from interplan_sumo.batch.records import MetricRecord
from interplan_sumo.errors import InputError
from interplan_sumo.report.nuboard import AGGREGATED, EXPORTED, FINAL, METRICS, pickled_texts, write_nuboard
from tests import records
from tests.report.rows import drive, stored

ROWS = (
    drive("nudge/0", 0.8, progress=0.5),
    drive("nudge/1", 0.4),
    drive("overtake/0", 0.0, no_collision=0.0),
    drive("nudge/0", 1.0, planner="pdm_closed"),
    drive("nudge/1", 0.0, planner="pdm_closed", fault=("planner", "raised")),
    drive("overtake/0", 0.5, planner="pdm_closed"),
)


def metric(folder: Path, name: str) -> pd.DataFrame:
    return pd.read_parquet(folder / METRICS / f"{name}.parquet")


def aggregated(folder: Path) -> pd.DataFrame:
    return pd.read_parquet(folder / AGGREGATED / "interplan-paper_weighted_average_metrics.parquet")


def test_the_file_names_folders_beside_it_and_no_other_place(tmp_path: Path) -> None:
    file = write_nuboard([stored(*ROWS)], tmp_path / "out")
    assert file == tmp_path / "out" / "interplan-sumo.nuboard"
    assert pickle.loads(file.read_bytes()) == {
        "simulation_main_path": ".",
        "metric_main_path": ".",
        "metric_folder": "metrics",
        "aggregator_metric_folder": "aggregator_metric",
    }


@given(texts=st.dictionaries(st.text(st.characters(exclude_categories=["Cs"])), st.text("aü\n€𝄞'\\."), max_size=5))
def test_any_texts_are_pickled_as_python_would_read_them_and_nothing_but_texts(texts: dict[str, str]) -> None:
    data = pickled_texts(texts)
    assert pickle.loads(data) == texts
    allowed = {"PROTO", "EMPTY_DICT", "MARK", "BINUNICODE", "SETITEMS", "STOP"}
    assert {opcode.name for opcode, _, _ in pickletools.genops(data)} <= allowed


def test_a_metric_of_a_plug_in_keeps_its_own_name(tmp_path: Path) -> None:
    judged = drive("nudge/0", 0.8)
    judged = structs.replace(judged, metrics={**judged.metrics, "keeps_moving": MetricRecord(0.25, {}, None)})
    write_nuboard([stored(judged, drive("nudge/1", 0.4))], tmp_path)
    found = metric(tmp_path, "keeps_moving")
    assert found["metric_score"].tolist() == found["keeps_moving_stat_value"].tolist() == [0.25]
    assert aggregated(tmp_path)["keeps_moving"].iloc[-1] == 0.25


def test_metrics_have_nuplans_names_and_columns(tmp_path: Path) -> None:
    write_nuboard([stored(*ROWS)], tmp_path)
    found = metric(tmp_path, "no_ego_at_fault_collisions")
    assert list(found.columns) == [
        "log_name", "scenario_name", "scenario_type", "planner_name", "metric_computator", "metric_statistics_name",
        "metric_score", "metric_score_unit", "metric_category",
        "no_ego_at_fault_collisions_stat_type", "no_ego_at_fault_collisions_stat_unit",
        "no_ego_at_fault_collisions_stat_value",
        "time_series_unit", "time_series_timestamps", "time_series_values", "time_series_selected_frames",
    ]  # fmt: skip
    assert found["scenario_name"].tolist() == ["nudge_0", "nudge_1", "overtake_0", "nudge_0", "overtake_0"]
    assert found["metric_score"].tolist() == [1.0, 1.0, 0.0, 1.0, 1.0]
    assert found["no_ego_at_fault_collisions_stat_value"].tolist() == [True, True, False, True, True]
    assert set(found["metric_statistics_name"]) == {"no_ego_at_fault_collisions"}


def test_figures_of_the_detail_become_statistics(tmp_path: Path) -> None:
    rows = [drive("nudge/0", 0.8), drive("nudge/1", 0.8)]
    details: list[dict[str, Any]] = [{"least_s": 1.5}, {"least_s": None}]
    for row, detail in zip(rows, details, strict=True):
        row.metrics["time_to_collision"] = records.metric(1.0, detail)
    jerk = {"max": 1.0, "min": -1.0, "mean": 0.0, "p90": 0.5, "within": True}
    rows[0].metrics["comfort"] = records.metric(1.0, {"jerk_mps3": jerk})
    write_nuboard([stored(*rows)], tmp_path)
    found = metric(tmp_path, "time_to_collision_within_bound")
    assert found["min_time_to_collision_stat_value"].tolist() == [1.5, math.inf]
    jerk = metric(tmp_path, "ego_jerk")
    assert (jerk["p90_ego_jerk_stat_value"][0], bool(jerk["abs_ego_jerk_within_bounds_stat_value"][0])) == (0.5, True)
    assert jerk["metric_score"].isna().all()
    assert not (tmp_path / METRICS / "ego_yaw_rate.parquet").exists()


def test_a_figure_that_one_drive_lacks_is_left_out_for_all(tmp_path: Path) -> None:
    details: list[dict[str, Any]] = [{"ratio": 0.5, "ego_m": 10.0}, {"ratio": 0.5}]
    rows = [drive(f"nudge/{n}", 0.8, progress_detail=detail) for n, detail in enumerate(details)]
    write_nuboard([stored(*rows)], tmp_path)
    columns = metric(tmp_path, "ego_progress_along_expert_route").columns
    assert "ego_expert_progress_along_route_ratio_stat_value" in columns
    assert "ego_total_progress_along_route_stat_value" not in columns


def test_scores_are_aggregated_per_scenario_type_and_planner(tmp_path: Path) -> None:
    write_nuboard([stored(*ROWS)], tmp_path)
    found = aggregated(tmp_path)
    idm = found[found["planner_name"] == "idm"].set_index("scenario")
    assert list(idm.index) == ["nudge_0", "nudge_1", "overtake_0", "nudge", "overtake", FINAL]
    assert idm["num_scenarios"].fillna(-1).tolist() == [-1, -1, -1, 2, 1, 3]
    assert idm["score"].tolist() == pytest.approx([0.8, 0.4, 0.0, 0.6, 0.0, 0.4])
    assert idm.loc["nudge", "ego_progress_along_expert_route"] == pytest.approx(0.75)
    pdm = found[found["planner_name"] == "pdm_closed"].set_index("scenario")
    assert pdm.loc[FINAL, "score"] == pytest.approx(0.5)  # a fault of the planner counts 0
    columns = list(found.columns)
    assert columns[:6] == [
        "scenario", "log_name", "scenario_type", "num_scenarios", "planner_name", "aggregator_type"
    ]  # fmt: skip
    assert columns[6:-1] == sorted(each.name for each in EXPORTED if each.has_score)
    assert columns[-1] == "score"
    assert found.iloc[-1]["scenario"] == FINAL


def test_seeds_are_scenarios_of_their_own_and_runs_of_one_planner_two_planners(tmp_path: Path) -> None:
    one = stored(drive("nudge/0", 0.8), drive("nudge/0", 0.6, seed=1))
    other = stored(drive("nudge/0", 0.2), path="runs/b")
    write_nuboard([one, other], tmp_path)
    found = metric(tmp_path, "drivable_area_compliance")
    assert found["scenario_name"].tolist() == ["nudge_0", "nudge_0-seed1", "nudge_0"]
    assert found["planner_name"].tolist() == ["idm (a)", "idm (a)", "idm (b)"]


def test_drives_without_a_score_are_left_out_and_a_run_without_any_is_one_line(tmp_path: Path) -> None:
    broken = drive("nudge/1", None, fault=("traffic", "SUMO"))
    write_nuboard([stored(drive("nudge/0", 0.8), broken)], tmp_path / "a")
    assert aggregated(tmp_path / "a")["num_scenarios"].dropna().tolist() == [1, 1]
    with pytest.raises(InputError, match="no drive has a score yet"):
        write_nuboard([stored(broken)], tmp_path / "b")


def test_a_folder_in_use_and_one_that_cannot_be_written_are_one_line(tmp_path: Path) -> None:
    run = stored(drive("nudge/0", 0.8))
    write_nuboard([run], tmp_path / "a")
    with pytest.raises(InputError, match="is not empty; name another folder as --nuboard"):
        write_nuboard([run], tmp_path / "a")
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot write"):
        write_nuboard([run], tmp_path / "file" / "in")


def test_equal_runs_give_equal_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_nuboard([stored(*ROWS)], tmp_path / name)
    files = sorted(file.relative_to(tmp_path / "a") for file in (tmp_path / "a").rglob("*") if file.is_file())
    assert len(files) > 5
    assert all((tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes() for file in files)
