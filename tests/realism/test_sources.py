"""Sources of traffic: a run folder, a trace, fcd output and recordings are read as the same."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from interplan_sumo.errors import InputError
from interplan_sumo.realism.sources import TrafficSource, named_sources, read_trace
from tests.realism.test_fcd import car, written


def trace(folder: Path, *rows: tuple[int, str, str, float], **changed: object) -> Path:
    """A folder with the actors of a trace: frame, id, type and x, at 5 m/s."""
    frame, ids, types, x = zip(*rows, strict=True)
    table = {
        "frame": frame, "track_token": ids, "type": types, "x": x, "y": 1.0, "heading": 0.5, "length": 4.5,
        "width": 1.9, "vx": 3.0, "vy": 4.0, "behaviour": "",
    }  # fmt: skip
    folder.mkdir(exist_ok=True, parents=True)
    pd.DataFrame(table | changed).to_parquet(folder / "actors.parquet")
    return folder


def test_a_trace_has_a_track_for_each_road_user_and_none_for_cones(tmp_path: Path) -> None:
    rows = [(k, "car", "VEHICLE", 0.5 * k) for k in range(3)]
    folder = trace(tmp_path, *rows, (1, "cone", "TRAFFIC_CONE", 9.0), (2, "walker", "PEDESTRIAN", 3.0))
    (part,) = TrafficSource("mine", folder).parts()
    one, walker = part.tracks
    assert (one.id, one.kind, one.length_m, one.width_m) == ("car", "vehicle", 4.5, 1.9)
    assert one.time_s == pytest.approx([0.0, 0.1, 0.2])
    assert one.x_m == pytest.approx([0.0, 0.5, 1.0])
    assert one.speed_mps == pytest.approx(5.0)
    assert (walker.kind, walker.time_s.tolist()) == ("pedestrian", [0.2])


def test_who_leaves_and_comes_again_is_two_tracks(tmp_path: Path) -> None:
    folder = trace(tmp_path, *((k, "a", "VEHICLE", 0.0) for k in (0, 1, 5, 6, 7)))
    assert [len(each.time_s) for each in read_trace(folder, "t").tracks] == [2, 3]


def test_an_empty_street_has_no_tracks(tmp_path: Path) -> None:
    assert read_trace(trace(tmp_path, (0, "cone", "TRAFFIC_CONE", 1.0)), "t").tracks == ()


@pytest.mark.parametrize(
    "changed", [{"x": float("nan")}, {"x": 1e200}, {"x": "east"}, {"length": None}, {"length": 0.0}]
)
def test_a_damaged_trace_is_named(tmp_path: Path, changed: dict[str, object]) -> None:
    folder = trace(tmp_path, (0, "a", "VEHICLE", 0.0), (1, "a", "VEHICLE", 0.0), **changed)
    with pytest.raises(InputError, match=r"actors\.parquet"):
        read_trace(folder, "t")
    (folder / "actors.parquet").write_text("nothing")
    with pytest.raises(InputError, match=r"actors\.parquet"):
        read_trace(folder, "t")


def test_fcd_output_is_a_source_too_and_what_is_nothing_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, car(1.0), car(2.0))
    (part,) = TrafficSource("fcd", path).parts()
    assert [each.id for each in part.tracks] == ["a"]
    (tmp_path / "notes.txt").write_text("nothing")
    with pytest.raises(InputError, match="is no recording: neither"):
        list(TrafficSource("x", tmp_path / "notes.txt").parts())


def test_sources_of_one_name_are_told_apart_by_their_paths() -> None:
    names = [each.name for each in named_sources([Path("a/run"), Path("b/run"), Path("b/other")])]
    assert names == ["a/run", "b/run", "other"]
