"""The golden table: what it prints and when it fails, on a folder of someone's own."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.golden_values import SHIPPED, Pair, floats

ROOT = Path(__file__).parents[1]
LAST_LINE = re.compile(r"(\d+) cases, (\d+) values, largest difference (\S+), (\d+) failed")


def table(folder: Path) -> tuple[int, list[str], str]:
    ours = {"INTERPLAN_GOLDEN": str(folder), "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'planners'}"}
    command = [sys.executable, "-m", "tests.golden_table"]
    done = subprocess.run(command, cwd=ROOT, env=os.environ | ours, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout.splitlines(), done.stderr


def idm_file(folder: Path, **changes: float | str) -> None:
    cases = json.loads((SHIPPED / "nuplan_idm" / "idm_cases.json").read_text())
    cases["cases"][0]["expected"] |= changes
    (folder / "nuplan_idm").mkdir(parents=True)
    (folder / "nuplan_idm" / "idm_cases.json").write_text(json.dumps(cases))


def test_a_folder_with_one_of_the_three_is_enough(tmp_path: Path) -> None:
    idm_file(tmp_path, remark="extra keys are welcome")
    code, lines, _ = table(tmp_path)
    assert code == 0
    last = LAST_LINE.fullmatch(lines[-1])
    assert last is not None
    assert last.group(1, 2, 4) == ("15", "45", "0")
    assert float(last[3]) < 1e-6


@pytest.mark.slow
def test_one_wrong_value_and_one_broken_file_fail_their_cases_only(tmp_path: Path) -> None:
    idm_file(tmp_path, velocity=9.0)
    (tmp_path / "nuplan_controller").mkdir()
    shutil.copy(SHIPPED / "nuplan_controller" / "two_states.json", tmp_path / "nuplan_controller")
    (tmp_path / "nuplan_controller" / "broken.json").write_text("{}")
    case = Path("nuplan_metrics") / "cases" / "vehicle_bus_left_turn"
    shutil.copytree(SHIPPED / case, tmp_path / case)
    (tmp_path / case / "traffic_lights.csv.gz").unlink()
    shutil.copytree(SHIPPED / "nuplan_metrics" / "maps", tmp_path / "nuplan_metrics" / "maps")
    code, lines, _ = table(tmp_path)
    assert code == 1
    last = LAST_LINE.fullmatch(lines[-1])
    assert last is not None
    assert last.group(1, 3, 4) == ("18", "inf", "2")
    wrong = {line.split()[0]: line.partition("FAILED: ")[2] for line in lines if "FAILED" in line}
    assert wrong == {"nuplan_controller/broken": "KeyError: 'initial_ego'", "nuplan_idm/00_free_road": "velocity"}


def test_a_folder_without_cases_is_an_error(tmp_path: Path) -> None:
    code, _, err = table(tmp_path)
    assert code == 2
    assert err.startswith("error: no golden case in ")


@pytest.mark.parametrize(
    ("expected", "got", "difference"),
    [
        (floats([1.0, "inf", None]), floats([1.25, np_inf := float("inf"), None]), 0.25),
        (floats([1.0]), floats([1.0, 1.0]), float("inf")),
        (floats([1.0]), floats(["nan"]), float("inf")),
        (floats([1.0]), None, float("inf")),
        ([("a", 1)], [("a", 1)], 0.0),
        ([("a", 1)], [("a", 2)], np_inf),
    ],
)
def test_a_difference_is_that_of_the_worst_value(expected: object, got: object, difference: float) -> None:
    assert Pair("", expected, got).difference == difference
