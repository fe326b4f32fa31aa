"""The wheel as a stranger meets it: built from the sdist, installed afresh, run outside the checkout."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Iterable
from importlib.metadata import Distribution, PathDistribution, distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
SHIPPED = ("nets/", "routes/")

pytestmark = pytest.mark.slow


def run(command: list[str | Path], cwd: Path, **environment: str) -> str:
    """Standard output of a command that must succeed; our import path and caches stay out of it."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "PYTEST", "INTERPLAN", "COV_"))}
    result = subprocess.run(
        [str(c) for c in command],
        cwd=cwd,
        env={**kept, **environment},
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert result.returncode == 0, f"{command}\n{result.stdout}\n{result.stderr}"
    return result.stdout


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the sdist and the wheel made from it; built from a copy, so that the checkout stays clean."""
    source = tmp_path_factory.mktemp("source") / "interplan-sumo"
    names = run(["git", "ls-files", "--cached", "--others", "--exclude-standard"], ROOT).splitlines()
    for name in names:
        if (ROOT / name).is_file():
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, source / name)
    out = tmp_path_factory.mktemp("dist")
    run([sys.executable, "-m", "build", "--no-isolation", "--outdir", out, source], ROOT)
    return out


def test_git_leaves_hashed_files_as_they_are_where_it_would_change_line_ends(tmp_path: Path) -> None:
    names = ("routes/mixed.xml", "interplan_sumo/scenario/suites/smoke-1/selection.yaml", "interplan_sumo/planner.py")
    for name in (".gitattributes", *names):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / name, tmp_path / name)
    git = ("git", "-c", "core.autocrlf=true", "-c", "core.safecrlf=false")  # as git for Windows is installed
    run([*git, "init", "--quiet"], tmp_path)
    run([*git, "add", "."], tmp_path)
    for name in names:
        (tmp_path / name).unlink()
    run([*git, "checkout", "--", "."], tmp_path)
    assert all((tmp_path / name).read_bytes() == (ROOT / name).read_bytes() for name in names)


def in_git(*folders: str) -> set[str]:
    """Files that the repository holds below these folders, but for Python beside the data."""
    names = run(["git", "ls-files", "--cached", "--others", "--exclude-standard", "--", *folders], ROOT).split()
    return {name for name in names if not (name.startswith(SHIPPED) and name.endswith(".py"))}


def test_the_wheel_holds_the_code_both_type_markers_and_all_data_and_nothing_else(built: Path) -> None:
    (wheel,) = built.glob("*.whl")
    held = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    packages = {str(init.parent.relative_to(ROOT)) for init in ROOT.glob("planners/*/__init__.py")}
    wanted = {name.removeprefix("planners/") for name in in_git("interplan_sumo", *packages)}
    wanted |= {f"interplan_sumo/_data/{name}" for name in in_git("nets", "routes")}
    assert held == wanted
    assert {"interplan_sumo/py.typed", "interplan_planners/py.typed"} <= held


def test_the_sdist_holds_the_tests_with_the_pages_that_they_read_and_no_leftovers(built: Path) -> None:
    (sdist,) = built.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        names = {name.split("/", 1)[1] for name in archive.getnames() if "/" in name}
    assert "tests/test_packaging.py" in names
    top = {name.split("/")[0] for name in names}
    documents = {"README.md", "CHANGELOG.md", "CITATION.cff", "LICENSE", "PKG-INFO"}
    settings = {"pyproject.toml", "mkdocs.yml", ".gitignore"}
    assert top <= documents | settings | {"docs", "interplan_sumo", "planners", "nets", "routes", "tests", "tools"}


def asked_for(requirements: Iterable[str]) -> list[Distribution]:
    """The libraries here that are named without any extra, those that these name, and so on."""
    found: dict[str, Distribution] = {}
    wanted = [*requirements]
    while wanted:
        requirement = Requirement(wanted.pop())
        name = canonicalize_name(requirement.name)  # others may spell it otherwise
        if name not in found and (requirement.marker is None or requirement.marker.evaluate({"extra": ""})):
            found[name] = distribution(name)
            wanted += found[name].requires or ()
    return list(found.values())


def test_with_nothing_but_what_it_asks_for_the_wheel_runs_and_scores_a_scenario(built: Path, tmp_path: Path) -> None:
    """Libraries are lent from the environment of the tests: nothing is fetched, and what is not named is not there."""
    (wheel,) = built.glob("*.whl")
    run([sys.executable, "-m", "venv", "--without-pip", tmp_path / "venv"], tmp_path)
    scripts = tmp_path / "venv" / ("Scripts" if os.name == "nt" else "bin")
    pip = [sys.executable, "-m", "pip", "--python", scripts / "python"]
    run([*pip, "install", "--quiet", "--no-deps", wheel], tmp_path)
    (site,) = (tmp_path / "venv").rglob("site-packages")
    (own,) = site.glob("*.dist-info")
    for library in asked_for(PathDistribution(own).requires or ()):
        for name in {file.parts[0] for file in library.files or ()} - {"..", "__pycache__"}:
            (site / name).symlink_to(str(library.locate_file(name)))
    command = scripts / "interplan-sumo"

    listed = json.loads(run([command, "scenarios", "list", "--suite", "smoke==1", "--json"], tmp_path))
    assert {"lane_change_ltd/0", "nudge/0"} <= {row["id"] for row in listed}
    names = {row["name"] for row in json.loads(run([command, "planners", "list", "--json"], tmp_path))}
    assert {"idm", "straight_ahead"} <= names

    run([command, "run", "--planner", "idm", "--scenarios", "lane_change_ltd/0", "--suite", "smoke==1", "--out", "out",
         "--workers", "1", "--quiet"], tmp_path)  # fmt: skip
    (row,) = map(json.loads, (tmp_path / "out" / "results.jsonl").read_text().splitlines())
    assert row["fault"] is None
    assert row["score"] > 0.0
    report = json.loads(run([command, "report", "out", "--json"], tmp_path))
    assert report["rows"][0]["planner"] == "idm"

    version = "import interplan_sumo, interplan_planners; print(interplan_sumo.__file__)"
    assert str(tmp_path) in run([scripts / "python", "-c", version], tmp_path)
