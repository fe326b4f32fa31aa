"""A package of a stranger's adds a family, a metric, a profile, a map format, a recording format and a planner.

Its code is that of the documentation's pages. It is installed beside the program and used from the command line; the
table, the report and the replay show what it adds, and nothing official changes for it.
"""

from __future__ import annotations

import gzip
import json
import re
import subprocess
import sys
from base64 import b64decode
from pathlib import Path
from typing import Any

import pytest
from docs_pages import blocks_of

from tests.environments import environment

ROOT = Path(__file__).parents[1]
PAGES = [
    ROOT / "docs" / f"{page}.md" for page in ("add_a_family", "add_a_metric", "add_a_map_format", "write_a_planner")
]
PROJECT = """\
[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"

[project]
name = "stranger"
version = "1.0"

[project.entry-points."interplan_sumo.families"]
fallen_load = "spilled.fallen_load:FAMILY"

[project.entry-points."interplan_sumo.metrics"]
room_for_people = "courtesy.room_for_people:room_for_people"

[project.entry-points."interplan_sumo.profiles"]
courteous = "courtesy"

[project.entry-points."interplan_sumo.map_formats"]
sketch = "sketched.roads:FORMAT"

[project.entry-points."interplan_sumo.recording_formats"]
sketch = "sketched.tracks:FORMAT"

[project.entry-points."interplan_sumo.planners"]
route_follower = "my_route:FollowRoute"

[tool.hatch.build.targets.wheel]
only-include = ["courtesy", "sketched", "spilled", "my_route.py"]
"""

HASHES = """\
import json
from interplan_sumo.scenario.suite import suites
print(json.dumps({key: {each.id: each.hash() for each in suite.scenarios} for key, suite in suites().items()}))
"""

pytestmark = pytest.mark.slow


class Stranger:
    """A folder to work in, and the command line of a machine on which the package is installed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        blocks = [block for page in PAGES for block in blocks_of(page) if block.file and block.file != "pyproject.toml"]
        for block in blocks:
            assert block.file is not None
            path = folder / "package" / block.file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(block.text, encoding="utf-8")
        (folder / "package" / "pyproject.toml").write_text(PROJECT, encoding="utf-8")
        installed = folder / "installed"
        self.python("-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation", "--target", str(installed),
                    str(folder / "package"))  # fmt: skip
        self.told = environment(installed, OPENBLAS_NUM_THREADS="1")
        for page in PAGES:
            for block in blocks_of(page):
                if block.language == "python" and block.slow and block.file is None:
                    self.python("-c", block.text)

    told = environment(OPENBLAS_NUM_THREADS="1")

    def python(self, *arguments: str) -> str:
        done = subprocess.run(
            [sys.executable, *arguments], cwd=self.folder, env=self.told, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, f"{arguments}\n{done.stdout}\n{done.stderr}"
        return done.stdout

    def __call__(self, command: str) -> str:
        return self.python("-m", "interplan_sumo", *command.split())

    def json(self, command: str) -> Any:
        return json.loads(self(f"{command} --json"))


def shown_by(replay: Path) -> str:
    """The data that a replay unpacks in the browser."""
    packed = re.findall(r'"gzip": ?"([A-Za-z0-9+/=]+)"', replay.read_text())
    return "".join(gzip.decompress(b64decode(each)).decode() for each in packed)


@pytest.fixture(scope="module")
def stranger(tmp_path_factory: pytest.TempPathFactory) -> Stranger:
    return Stranger(tmp_path_factory.mktemp("stranger"))


@pytest.fixture(scope="module")
def run_of_its_own(stranger: Stranger) -> str:
    """A run of the stranger's planner on scenes of its family, scored by its profile."""
    stranger("scenarios generate --map strip --family fallen_load --count 1 --seed 3 --no-certify --out load")
    stranger(
        "run --planner route_follower --planner idm --scenarios load/scenarios.yaml --profile courteous --quiet "
        "--out runs/load"
    )
    return "runs/load"


def test_nothing_official_changes(stranger: Stranger) -> None:
    held = list((ROOT / "interplan_sumo" / "scenario" / "suites").glob("*/lock.json"))
    assert len(held) >= 4
    found = json.loads(stranger.python("-c", HASHES))
    assert len(found) == len(held)
    for path in held:
        lock = json.loads(path.read_text())
        assert found[lock["suite"]] == {id: each["scenario"] for id, each in lock["scenarios"].items()}


def test_the_family_is_generated_checked_driven_and_has_its_column(stranger: Stranger, run_of_its_own: str) -> None:
    stranger("scenarios validate load/scenarios.yaml")
    document = stranger.json(f"report {run_of_its_own}")
    assert [row["planner"] for row in document["rows"]] == ["route_follower", "idm"]
    assert all(isinstance(row["fallen_load"], float) for row in document["rows"])
    assert all(row["construction"] is None for row in document["rows"])
    assert "Load" in stranger(f"report {run_of_its_own} --markdown").splitlines()[0]


def test_the_metric_is_in_the_rows_of_its_profile(stranger: Stranger, run_of_its_own: str) -> None:
    rows = [json.loads(line) for line in (stranger.folder / run_of_its_own / "results.jsonl").read_text().splitlines()]
    assert all(row["metrics"]["room_for_people"]["score"] == 1.0 for row in rows if row["fault"] is None)
    assert {row["weights"]["room_for_people"] for row in rows} == {5.0}
    assert stranger.json(f"report {run_of_its_own}")["profile"] == "courteous"


def test_what_the_metric_takes_away_stands_in_the_reasons_the_page_and_the_replay(stranger: Stranger) -> None:
    stranger(
        "run --planner idm_mobil --suite smoke==1 --scenarios construction/* --profile courteous --quiet "
        "--out runs/people"
    )
    assert "passed somebody fast" in stranger("report runs/people --why --details")
    stranger("report runs/people --html people.html --replays all")
    assert "passed somebody fast" in (stranger.folder / "people.html").read_text()
    (replay,) = (stranger.folder / "people-replays").rglob("*.html")
    assert "room for people" in shown_by(replay)


def test_page_and_replay_name_the_family(stranger: Stranger, run_of_its_own: str) -> None:
    stranger(f"report {run_of_its_own} --html load.html --replays all")
    assert "Load" in (stranger.folder / "load.html").read_text()
    replays = list((stranger.folder / "load-replays").rglob("*.html"))
    assert replays
    assert all("fallen_load" in shown_by(replay) for replay in replays)


def test_the_map_format_is_imported_and_checked(stranger: Stranger) -> None:
    stranger("maps import highway.sketch.json --format sketch --out maps/highway")
    found = stranger.json("maps check maps/highway --source highway.sketch.json")
    assert found["ok"]
    assert found["lanes"] == 4


@pytest.mark.nightly
def test_the_recording_is_told_by_its_content_and_becomes_scenes(stranger: Stranger) -> None:
    stranger("maps import highway.sketch.json --format sketch --out maps/recorded")
    stranger("scenarios import cars.csv --map maps/recorded --out scenes")
    stranger("run --planner idm --scenarios scenes/scenarios.yaml --limit 1 --out runs/scenes --quiet")
    assert all(row["faults"] == {} for row in stranger.json("report runs/scenes")["rows"])


def test_the_planner_is_listed_with_its_options(stranger: Stranger) -> None:
    listed = {each["name"]: each for each in stranger.json("planners list")}
    assert listed["route_follower"]["source"] == "stranger"
    assert "speed_mps" in listed["route_follower"]["parameters"]
