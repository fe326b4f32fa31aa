"""Generated folders: sound scenarios, their certificates, and reasons for everything that was left out."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import pytest

from interplan_sumo.cli import main
from interplan_sumo.errors import InputError, UnknownNameError
from interplan_sumo.families import names
from interplan_sumo.maps.store import load_roads
from interplan_sumo.scenario import certificates
from interplan_sumo.scenario.files import read_scenarios
from interplan_sumo.verification.generation import (
    CANDIDATES_PER_SCENARIO,
    LEAST_CANDIDATES,
    check_folder,
    families_of,
    generate,
)
from interplan_sumo.verification.light_windows import light_problems
from interplan_sumo.verification.start_checks import start_problems


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_generated_scenarios_pass_every_start_check_and_rejected_places_have_reasons() -> None:
    roads = load_roads("back_bay")
    made = generate(roads, "accident", 4, seed=11)
    assert len(made.scenarios) == 4
    assert all(not start_problems(scenario, roads) for scenario in made.scenarios)
    assert made.rejected
    assert all(each.reason for each in made.rejected)


def test_places_where_lights_keep_the_ego_from_its_goal_are_rejected() -> None:
    roads = load_roads("back_bay")
    made = generate(roads, "lane_change_ltd", 3, seed=0)
    assert len(made.scenarios) == 3
    assert all(not light_problems(scenario, roads) for scenario in made.scenarios)
    assert any("with its lights" in each.reason for each in made.rejected)


@pytest.mark.slow
@pytest.mark.parametrize(("count", "most"), [(1, LEAST_CANDIDATES), (6, 6 * CANDIDATES_PER_SCENARIO)])
def test_it_gives_up_after_many_unsound_candidates_and_after_more_where_many_are_asked_for(
    count: int, most: int
) -> None:
    bottomless = replace(load_roads("back_bay"), road_segments=())
    made = generate(bottomless, "lane_change_ltd", count, seed=0)
    assert made.scenarios == []
    assert sum("the ego's box is not wholly on the drivable area" in each.reason for each in made.rejected) == most


def test_a_group_is_all_its_families() -> None:
    assert families_of("all") == names(ordinary=False)
    assert len(families_of("ordinary")) == 14
    assert families_of("nudge") == ("nudge",)


def test_an_unknown_family_and_a_count_of_none_are_refused() -> None:
    roads = load_roads("back_bay")
    with pytest.raises(UnknownNameError, match="nudge"):
        generate(roads, "nuge", 1, seed=0)
    with pytest.raises(InputError, match="count is 0"):
        generate(roads, "nudge", 0, seed=0)


@pytest.mark.slow
def test_the_command_writes_a_folder_that_run_accepts_and_the_certificates_are_its_experts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, again = tmp_path / "more", tmp_path / "again"
    command = ["scenarios", "generate", "--map", "back_bay", "--family", "nudge", "--count", "1", "--seed", "5"]
    for folder in (out, again):
        assert main([*command, "--out", str(folder), "--workers", "0", "--json"]) == 0
        printed, told = capsys.readouterr()
        said = json.loads(printed)
        assert (said["scenarios"], said["certified"], said["short"]) == (1, 1, {})
        drawn, proof = told.splitlines()
        assert drawn == f"nudge: 1 sound scenario, {len(rows(folder / 'rejected.csv'))} places rejected"
        assert proof.startswith("[1/1] ")
    for name in ("scenarios.yaml", "report.csv", "rejected.csv", certificates.FILE):
        assert (out / name).read_bytes() == (again / name).read_bytes(), name
    assert [row["certified"] for row in rows(out / "report.csv")] == ["True"]
    assert all(row["reason"] for row in rows(out / "rejected.csv"))

    run = tmp_path / "run"
    file = str(out / "scenarios.yaml")
    assert (
        main(
            ["run", "--planner", "straight_ahead", "--scenarios", file, "--out", str(run), "--workers", "0", "--quiet"]
        )
        == 0
    )
    assert len(list((run / "experts").glob("*.parquet"))) == 1
    results = [json.loads(line) for line in (run / "results.jsonl").read_text(encoding="utf-8").splitlines()]
    assert {row["scenario_id"] for row in results} == {s.id for s in read_scenarios(file)}
    assert not any(row["official"] for row in results)


def test_a_folder_that_holds_scenarios_is_not_overwritten_unasked(tmp_path: Path) -> None:
    (tmp_path / "scenarios.yaml").write_text("format: 1\n", encoding="utf-8")
    with pytest.raises(InputError, match="--overwrite"):
        check_folder(tmp_path, overwrite=False)
    check_folder(tmp_path, overwrite=True)
