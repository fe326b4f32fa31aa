"""The hash of a planner: whatever makes it another planner makes it another hash, and nothing else does."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from interplan_sumo.errors import UnknownNameError
from interplan_sumo.planner_source import LARGE_BYTES, PlannerSource, changed_files


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "acme").mkdir()
    (tmp_path / "acme" / "__init__.py").write_text("")
    (tmp_path / "acme" / "planner.py").write_text("import json\nfrom acme_tools import line\n")
    (tmp_path / "acme" / "net.onnx").write_bytes(b"weights")
    (tmp_path / "acme_tools.py").write_text("import numpy\n")
    (tmp_path / "elsewhere.py").write_text("")
    (tmp_path / "my.yaml").write_text("gain: 2\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.chdir(tmp_path)
    return tmp_path


SPEC = "acme.planner:Acme?config=my.yaml&gain=2"


@pytest.mark.parametrize("file", ["acme/planner.py", "acme/net.onnx", "acme/__init__.py", "acme_tools.py", "my.yaml"])
def test_an_edit_is_another_hash_and_is_named(file: str, place: Path) -> None:
    before = PlannerSource.of(SPEC)
    with (place / file).open("a") as edited:
        edited.write("# more\n")
    after = PlannerSource.of(SPEC)
    assert before.hash != after.hash
    assert changed_files(before.files, after.files) == [file]


@pytest.mark.parametrize("file", ["elsewhere.py", "acme/__pycache__/planner.pyc", "acme/.planner.py.swp"])
def test_what_is_none_of_it_changes_nothing(file: str, place: Path) -> None:
    before = PlannerSource.of(SPEC)
    (place / file).parent.mkdir(exist_ok=True)
    (place / file).write_text("# more\n")
    os.utime(place / "acme" / "net.onnx")
    assert PlannerSource.of(SPEC) == before


@pytest.mark.usefixtures("place")
def test_libraries_are_none_of_it() -> None:
    assert set(PlannerSource.of(SPEC).files) == {
        "acme/__init__.py", "acme/net.onnx", "acme/planner.py", "acme_tools.py", "my.yaml",
    }  # fmt: skip


def test_what_it_writes_is_none_of_it(place: Path) -> None:
    spec = "acme.planner:Acme?store=answers.jsonl"
    before = PlannerSource.of(spec)
    (place / "answers.jsonl").write_text("{}\n")
    assert PlannerSource.of(spec) == before


@pytest.mark.parametrize(
    "options",
    [
        "model=embedded:net.gguf", "model=embedded+lora:net.gguf@0.5", "model=embedded:other.gguf+lora:net.gguf",
        "model=embedded:%6eet.gguf", "nets=[small:net.gguf]",
    ],
)  # fmt: skip
def test_a_file_that_a_part_of_an_option_names_is_one_of_it(options: str, place: Path) -> None:
    spec = f"acme.planner:Acme?{options}"
    (place / "net.gguf").write_bytes(b"aaa")
    before = PlannerSource.of(spec)
    (place / "net.gguf").write_bytes(b"bbb")
    assert PlannerSource.of(spec).hash != before.hash


def test_signs_in_the_name_of_a_file_are_no_obstacle(place: Path) -> None:
    (place / "net@2+a.gguf").write_bytes(b"weights")
    spec = "acme.planner:Acme?model=embedded:net@2+a.gguf@0.5"
    assert set(PlannerSource.of(spec).files) - set(PlannerSource.of("acme.planner:Acme").files) == {"net@2+a.gguf"}


@pytest.mark.parametrize(
    "options",
    ["model=replay:answers.jsonl#toy", "model=embedded&store=answers.jsonl&mode=replay", "replay=answers.jsonl"],
)
def test_what_it_replays_is_one_of_it(options: str, place: Path) -> None:
    (place / "answers.jsonl").write_text("{}\n")
    assert "answers.jsonl" in PlannerSource.of(f"acme.planner:Acme?{options}").files


@pytest.mark.usefixtures("place")
def test_a_home_that_nobody_has_names_no_file() -> None:
    spec = "acme.planner:Acme"
    assert PlannerSource.of(f"{spec}?place=~nobody_at_all/net.onnx").files == PlannerSource.of(spec).files


@pytest.mark.usefixtures("place")
def test_other_options_are_another_hash() -> None:
    assert PlannerSource.of("acme.planner:Acme?gain=2").hash != PlannerSource.of("acme.planner:Acme?gain=3").hash


def test_a_registered_planner_is_what_it_imports_and_not_its_neighbours() -> None:
    idm, closed = PlannerSource.of("idm"), PlannerSource.of("pdm_closed")
    assert "interplan_planners/idm.py" in idm.files
    assert "interplan_planners/common/idm_policy.py" in idm.files.keys() & closed.files.keys()
    assert "interplan_planners/pdm_closed.py" not in idm.files
    assert idm.hash != PlannerSource.of("idm?x=1").hash
    assert not any(name.startswith("interplan_sumo") for name in idm.files)


PARTS = {
    "__init__.py": "",
    "planner.py": "from .inner import far\nfrom acme import near\n",
    "near.py": "import acme.inner.deep as deep\n",
    "other.py": "",
    "inner/__init__.py": "",
    "inner/far.py": "from ..farther import value\n",
    "inner/deep.py": "def late():\n    from acme.late import value\n    return value\n",
    "inner/other.py": "",
    "farther.py": "value = 1\n",
    "late.py": "value = 1\n",
}


def parts_of(place: Path, **changed: str) -> set[str]:
    """The Python files of a planner in several modules."""
    for name, text in (PARTS | changed).items():
        (place / "acme" / name).parent.mkdir(exist_ok=True)
        (place / "acme" / name).write_text(text)
    return {name.removeprefix("acme/") for name in PlannerSource.of("acme.planner:Acme").files if name.endswith(".py")}


def test_of_its_package_a_planner_is_what_it_imports_however_it_says_so(place: Path) -> None:
    assert parts_of(place) == PARTS.keys() - {"other.py", "inner/other.py"}


@pytest.mark.parametrize(
    "line",
    [
        "import importlib", "from importlib import import_module", "import importlib.util as found", "import runpy",
        "module = __import__(name)", "exec(text)", "from pkgutil import iter_modules",
        "from interplan_sumo.planner import load_planner", "def broken(:",
    ],
)  # fmt: skip
def test_where_a_file_loads_by_name_the_whole_package_is_the_planner(line: str, place: Path) -> None:
    assert parts_of(place, **{"farther.py": line + "\n"}) == PARTS.keys()


@pytest.mark.parametrize(
    ("file", "counts"),
    [
        ("net.onnx", True), ("tables/speeds.csv", True), ("inner/deep.onnx", True), ("inner/more/deep.onnx", True),
        ("weights/net.onnx", True), ("beside/net.onnx", False), ("beside/more/net.onnx", False),
    ],
)  # fmt: skip
def test_data_count_with_the_package_that_they_lie_in(file: str, counts: bool, place: Path) -> None:
    path = place / "acme" / file
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"weights")
    parts_of(place, **{"beside/__init__.py": "", "beside/planner.py": "", "weights/__init__.py": ""})
    assert (f"acme/{file}" in PlannerSource.of("acme.planner:Acme").files) == counts


def test_reading_data_of_a_package_is_no_loading_by_name(place: Path) -> None:
    text = "from importlib.resources import files\nimport importlib.resources\n"
    assert "other.py" not in parts_of(place, **{"farther.py": text})


def test_a_program_is_its_file_and_those_that_it_is_given(place: Path) -> None:
    program = place / "drive"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    (place / "drive.log").write_text("")
    spec = "exec:./drive --config=my.yaml --log drive.log"
    before = PlannerSource.of(spec)
    assert set(before.files) == {"./drive", "my.yaml"}
    program.write_text("#!/bin/sh\necho\n")
    assert changed_files(before.files, PlannerSource.of(spec).files) == ["./drive"]


def test_a_large_file_counts_by_its_size_and_pieces_of_it(place: Path) -> None:
    weights = place / "acme" / "net.onnx"
    with weights.open("wb") as file:
        file.truncate(LARGE_BYTES + 1)
    before = PlannerSource.of(SPEC).hash
    with weights.open("r+b") as file:
        file.seek(LARGE_BYTES)
        file.write(b"x")
    assert PlannerSource.of(SPEC).hash != before


def test_a_name_that_nobody_has_is_named() -> None:
    with pytest.raises(UnknownNameError):
        PlannerSource.of("idn")
