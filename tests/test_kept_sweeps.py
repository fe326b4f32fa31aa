"""Sweeps that are kept: whoever is swept again takes its own place, and nothing else is let in."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest

from interplan_sumo.world.csv_tables import read_table
from tools import kept_sweeps
from tools.kept_drives import folder_of, traffic_of
from tools.kept_sweeps import SUITE, behaviours, keep_sweep, tracks

TODAY = traffic_of(SUITE)
"""The version of the traffic that is kept."""

HEAD = (
    "{},planner,scenarios,seeds,drives,missing,score,score_low,score_high,"
    "goal_lane,at_fault_collisions,change,change_low,change_high,faults"
)


def sweep(
    folder: Path,
    parameter: str,
    lines: list[tuple[str, str, float]],
    *,
    suite: str = SUITE,
    missing: int = 0,
    older: int = 0,
) -> Path:
    """A folder as `sweep` leaves it, of values, planners and scores, driven in traffic of an older version."""
    rows = [
        f"{value},{planner},80,1,{80 - missing},{missing},{score},{score - 5},{score + 5},50.4,2.6,,,,"
        for value, planner, score in lines
    ]
    about = msgspec.json.decode((folder_of(suite) / "manifest.json").read_bytes())
    about["planners"] = {planner: {"hash": f"hash of {planner}", "files": {}} for _, planner, _ in lines}
    about |= {"requests": [], "traffic_version": about["traffic_version"] - older}
    for value, *_ in lines:
        run = folder / f"{parameter}={value}"
        run.mkdir(parents=True, exist_ok=True)
        (run / "manifest.json").write_bytes(msgspec.json.encode(about))
    (folder / "sweep.csv").write_text("\n".join((HEAD.format(parameter), *rows, "")))
    return folder


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept_sweeps, "RESULTS", tmp_path)


def test_who_is_swept_again_takes_its_own_place(tmp_path: Path) -> None:
    keep_sweep(
        sweep(tmp_path / "a", "track", [("noisy", "idm", 20.0), ("noisy", "mine", 70.0), ("late", "mine", 61.6)])
    )
    keep_sweep(sweep(tmp_path / "b", "track", [("noisy", "idm", 30.0)]))
    assert tracks({"mine": "80 [70, 90]", "idm": "31 [20, 40]"}) == [
        "planner | plain | noisy | late | at fault in noisy, late %",
        "---|---|---|---|---",
        "`mine` | 80 [70, 90] | 70 [65, 75] | 62 [57, 67] | 3, 3",
        "`idm` | 31 [20, 40] | 30 [25, 35] | - | 3, -",
    ]


def test_what_is_kept_says_of_which_traffic_and_planner_it_is(tmp_path: Path) -> None:
    keep_sweep(sweep(tmp_path / "a", "track", [("noisy", "idm", 20.0)]))
    (line,) = read_table(tmp_path / "sweep-track.csv", ("planner",))
    assert (line["traffic_version"], line["planner_hash"]) == (str(TODAY), "hash of idm")


def test_drivers_are_told_in_the_order_of_the_sweep(tmp_path: Path) -> None:
    keep_sweep(sweep(tmp_path / "a", "behaviour", [("conservative", "idm", 20.0), ("assertive", "idm", 10.0)]))
    assert behaviours()[2:] == [
        "`idm` | conservative | 80 | 3 | 50 | 20 [15, 25]",
        "`idm` | assertive | 80 | 3 | 50 | 10 [5, 15]",
    ]


@pytest.mark.parametrize(
    ("parameter", "how", "says"),
    [
        ("density", {}, "swept density, expected track or behaviour"),
        ("track", {"suite": "common==1"}, "is of common==1, expected interplan==1"),
        ("track", {"missing": 1}, "lacks drives of idm"),
        ("track", {"older": 1}, f"is of traffic version {TODAY - 1}, the kept drives are of {TODAY}"),
    ],
)
def test_other_sweeps_are_refused(parameter: str, how: dict[str, Any], says: str, tmp_path: Path) -> None:
    folder = sweep(tmp_path / "a", parameter, [("noisy", "idm", 20.0)], **how)
    with pytest.raises(SystemExit, match=says):
        keep_sweep(folder)
    assert not (tmp_path / f"sweep-{parameter}.csv").exists()


def test_a_sweep_without_the_runs_it_tells_of_is_refused(tmp_path: Path) -> None:
    folder = sweep(tmp_path / "a", "track", [("noisy", "idm", 20.0), ("late", "idm", 20.0)])
    (folder / "track=late" / "manifest.json").unlink()
    (folder / "track=late").rmdir()
    with pytest.raises(SystemExit, match="lacks drives of idm"):
        keep_sweep(folder)
