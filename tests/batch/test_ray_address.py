"""Ray without a cluster: what is missing is named at once, and who works is read from one option."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from interplan_sumo.batch.processes import Workers, available_cores
from interplan_sumo.batch.ray_backend import run_on_ray
from interplan_sumo.batch.tasks import Limits, Task
from interplan_sumo.cli import main
from interplan_sumo.errors import InputError
from tests.batch.toys import ToysAway


def test_without_ray_one_line_says_how_to_get_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(InputError, match=r"pip install 'interplan-sumo\[ray\]'"):
        next(run_on_ray([Task(0, "works", 0)], ToysAway(tmp_path), address="local", limits=Limits()))


@pytest.mark.parametrize("address", ["127.0.0.1:1", "ray://127.0.0.1:1"])
def test_a_cluster_that_is_not_there_is_named_at_once(
    address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "ray", SimpleNamespace(is_initialized=lambda: False))
    with pytest.raises(InputError) as caught:
        next(run_on_ray([Task(0, "works", 0)], ToysAway(tmp_path), address=address, limits=Limits()))
    assert str(caught.value).startswith(f"cannot reach a Ray cluster at '{address}': ")
    assert "start one with `ray start --head`" in str(caught.value)


def test_nothing_to_do_needs_no_cluster(tmp_path: Path) -> None:
    assert list(run_on_ray([], ToysAway(tmp_path), address="nowhere:1", limits=Limits())) == []


@pytest.mark.parametrize(
    ("text", "workers"),
    [
        (None, Workers(available_cores())),
        ("0", Workers(0)),
        ("12", Workers(12)),
        ("ray", Workers(0, "local")),
        ("ray:auto", Workers(0, "auto")),
        ("ray:10.0.0.7:6379", Workers(0, "10.0.0.7:6379")),
        ("ray:ray://head:10001", Workers(0, "ray://head:10001")),
        ("ray://head:10001", Workers(0, "ray://head:10001")),
    ],
)
def test_who_works_is_read_from_one_option(text: str | None, workers: Workers) -> None:
    assert Workers.parse(text) == workers


@pytest.mark.parametrize("text", ["many", "", "1.5", "rays"])
def test_what_is_no_number_of_workers_is_named(text: str) -> None:
    with pytest.raises(InputError, match=f"--workers '{text}' is no number of processes"):
        Workers.parse(text)


def test_a_command_for_a_cluster_that_is_not_there_says_so_before_anything_else(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "ray", SimpleNamespace(is_initialized=lambda: False))
    asked = ["--planner", "straight_ahead", "--param", "tau=1,3", "--scenarios", "nudge/0", "--quiet"]
    assert main(["sweep", *asked, "--workers", "ray:127.0.0.1:1", "--out", str(tmp_path / "swept")]) == 2
    assert capsys.readouterr().err.count("cannot reach a Ray cluster at '127.0.0.1:1'") == 1
