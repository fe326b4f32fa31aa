"""The command `rates`: folders of several planners together, weighed anew, or refused in a line."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
import numpy as np
import pytest

from benchmarks.rate_coverage import NATURAL, ToyWorld, driven
from interplan_sumo.batch.records import encode
from interplan_sumo.cli import main
from interplan_sumo.endurance.gathered import read_kilometres
from interplan_sumo.endurance.kilometres import ABOUT, SEGMENTS, AboutEndure
from interplan_sumo.errors import InputError, RunFolderError


def folder(
    place: Path,
    planner: str,
    seed: int,
    *,
    map_hash: str = "m",
    planner_hash: str = "p",
    code: str = "c",
    sumo: str = "1.28.0",
) -> Path:
    """A folder of toy kilometres, as `endure` leaves one."""
    place.mkdir()
    about = AboutEndure(
        2, {"sumo": sumo}, code, 1, {"toy": map_hash}, {"mixed": "d"}, {planner: planner_hash}, {**NATURAL}, 0.5, 1500.0
    )
    (place / ABOUT).write_bytes(encode(about))
    records = driven(ToyWorld(200, 0.5, 4), np.random.default_rng(seed))
    lines = [encode(msgspec.structs.replace(each, planner=planner)) for each in records]
    (place / SEGMENTS).write_bytes(b"".join(line + b"\n" for line in lines))
    return place


def test_folders_of_several_planners_are_told_together(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folders = [str(folder(tmp_path / name, name, seed)) for seed, name in enumerate(("idm", "mine"))]
    assert main(["rates", *folders, "--html", str(tmp_path / "a.html"), "--rare", "cut_in=0.004"]) == 0
    said = capsys.readouterr().out
    assert "idm: what makes its at-fault collisions" in said
    assert "0.004" in said
    assert "interplan-sumo rates" in (tmp_path / "a.html").read_text()
    assert main(["rates", *folders, "--of", "near_miss", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert [each["planner"] for each in document["planners"]] == ["idm", "mine"]
    assert document["measure"] == "near_miss"


def test_a_folder_that_is_given_twice_counts_once(tmp_path: Path) -> None:
    one = folder(tmp_path / "one", "idm", 1)
    assert len(read_kilometres([one, one])) == len(read_kilometres([one])) == 200


def test_folders_that_cannot_stand_beside_one_another_are_refused(tmp_path: Path) -> None:
    one = folder(tmp_path / "one", "idm", 1)
    with pytest.raises(InputError, match="different map toy; give only one"):
        read_kilometres([one, folder(tmp_path / "two", "mine", 2, map_hash="n")])
    with pytest.raises(InputError, match="both hold segment"):
        read_kilometres([one, folder(tmp_path / "three", "idm", 2)])
    with pytest.raises(InputError, match="different planner idm"):
        read_kilometres([one, folder(tmp_path / "four", "idm", 1, planner_hash="q")])
    with pytest.raises(InputError, match="different code; give only one"):
        read_kilometres([one, folder(tmp_path / "five", "idm", 1, code="d")])
    with pytest.raises(InputError, match="different version of sumo; give only one"):
        read_kilometres([one, folder(tmp_path / "six", "idm", 1, sumo="1.29.0")])
    (one / ABOUT).write_text("{}")
    with pytest.raises(RunFolderError, match="is damaged"):
        read_kilometres([one])
    (one / ABOUT).unlink()
    with pytest.raises(RunFolderError, match="cannot read"):
        read_kilometres([one])
