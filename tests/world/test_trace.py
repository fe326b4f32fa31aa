"""Traces: written and read back unchanged, hashed over everything that matters, opened by pandas in one line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from worlds import cars, signals

from interplan_sumo.errors import InputError
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.trace import (
    ACTOR_COLUMNS,
    EGO_COLUMNS,
    SEEN_BEFORE,
    SEEN_COLUMNS,
    ActorTable,
    EgoTrack,
    Trace,
)
from interplan_sumo.world.trajectory import Trajectory


def trace(x_m: float = 664_400.123456, behaviour: str = "mixed") -> Trace:
    egos = [EgoState(0.1 * k, x_m + k, 3_997_700.0, 0.25, vx_mps=10.0, ax_mps2=0.1 * k) for k in range(4)]
    others: list[Actors] = [cars((10.0 + k, 0.0)) if k != 2 else Actors.none() for k in range(4)]
    plan = Trajectory(np.array([0.0, 4.0]), np.array([x_m, x_m + 40]), np.zeros(2), np.zeros(2))
    names = {i: behaviour for a in others for i in a.ids}
    lights = tuple(signals(red=("7",), green=("9",)) for _ in egos)
    return Trace(EgoTrack.of(egos), ActorTable.of(others, names), lights, (plan,) * 3, np.array([0.01, 0.02, 0.03]))


def test_a_trace_reads_back_equal(tmp_path: Path) -> None:
    before = trace()
    before.write(tmp_path)
    after = Trace.read(tmp_path)
    assert after.hash() == before.hash()
    assert after.actors.at(2).ids == ()
    assert after.actors.at(3).x_m == pytest.approx(before.actors.at(3).x_m)
    assert after.signals[0].connector_ids == ("7", "9")
    assert len(after.plans) == 3
    assert after.plan_wall_s == pytest.approx([0.01, 0.02, 0.03])
    assert after.ego.state(2) == before.ego.state(2)


def test_what_was_seen_is_a_table_of_its_own_from_before_the_start_on_and_counts_for_the_hash(tmp_path: Path) -> None:
    there = trace()
    crowd = [cars((float(k), 0.0)) if k else Actors.none() for k in range(SEEN_BEFORE + len(there))]
    seen = replace(there, seen=ActorTable.of(crowd))
    seen.write(tmp_path)
    table = pd.read_parquet(tmp_path / "seen.parquet")
    assert tuple(table.columns) == SEEN_COLUMNS
    assert (table["frame"].min(), table["frame"].max()) == (1 - SEEN_BEFORE, 3)
    after = Trace.read(tmp_path)
    assert after.seen_at(-SEEN_BEFORE).ids == ()
    assert [after.seen_at(frame).x_m[0] for frame in (-1, 0, 3)] == [19.0, 20.0, 23.0]
    assert after.hash() == seen.hash() != there.hash()
    with pytest.raises(ValueError, match="perception was full"):
        there.seen_at(0)


def test_pandas_opens_every_table_with_the_documented_columns(tmp_path: Path) -> None:
    trace().write(tmp_path)
    assert tuple(pd.read_parquet(tmp_path / "ego.parquet").columns) == EGO_COLUMNS
    assert tuple(pd.read_parquet(tmp_path / "actors.parquet").columns) == ACTOR_COLUMNS
    assert pd.read_parquet(tmp_path / "ego.parquet")["time_us"].tolist() == [0, 100_000, 200_000, 300_000]


def test_the_rear_axle_on_disk_lies_behind_the_centre(tmp_path: Path) -> None:
    trace().write(tmp_path)
    table = pd.read_parquet(tmp_path / "ego.parquet")
    away = np.hypot(table["center_x"] - table["x"], table["center_y"] - table["y"])
    assert np.asarray(away) == pytest.approx(PACIFICA.rear_axle_to_center_m)


def test_the_hash_sees_a_micrometre_and_a_behaviour_but_not_the_clock() -> None:
    one = trace()
    assert one.hash() == trace().hash()
    assert one.hash() != trace(x_m=664_400.123458).hash()
    assert one.hash() != trace(behaviour="assertive").hash()
    assert one.hash() == replace(one, plan_wall_s=np.array([1.0, 2.0, 3.0])).hash()


def test_a_missing_or_damaged_file_is_named(tmp_path: Path) -> None:
    trace().write(tmp_path)
    (tmp_path / "plans.parquet").write_bytes(b"PAR1")
    with pytest.raises(InputError, match=r"plans\.parquet"):
        Trace.read(tmp_path)
    with pytest.raises(InputError, match=r"ego\.parquet"):
        Trace.read(tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("name", "column", "values", "words"),
    [
        ("actors", "type", "SPACESHIP", "unknown value 'SPACESHIP'"),
        ("signals", "status", "PURPLE", "unknown value 'PURPLE'"),
        ("ego", "heading", "north", "could not convert"),
        ("plans", "x", None, "lacks the columns x"),
    ],
)
def test_a_file_that_holds_something_else_is_named(
    name: str, column: str, values: str | None, words: str, tmp_path: Path
) -> None:
    trace().write(tmp_path)
    file = tmp_path / f"{name}.parquet"
    table = pd.read_parquet(file)
    table = table.drop(columns=[column]) if values is None else table.assign(**{column: values})
    table.to_parquet(file)
    with pytest.raises(InputError, match=rf"{name}\.parquet: .*{words}"):
        Trace.read(tmp_path)


def test_a_track_with_a_short_column_is_refused() -> None:
    track = trace().ego
    with pytest.raises(ValueError, match=r"EgoTrack\.x_m has shape \(3,\), expected \(4,\)"):
        replace(track, x_m=track.x_m[:3])


def test_actors_must_be_sorted_and_of_one_length() -> None:
    good = cars((0.0, 0.0), (10.0, 0.0))
    with pytest.raises(ValueError, match="unique and sorted"):
        replace(good, ids=good.ids[::-1])
    with pytest.raises(ValueError, match=r"Actors\.x_m has shape \(1,\), expected \(2,\)"):
        replace(good, x_m=np.zeros(1))
    with pytest.raises(ValueError, match="read-only"):
        good.x_m[0] = 1.0


def test_actors_within_a_radius_include_the_edge() -> None:
    scene = cars((3.0, 4.0), (3.0, 4.1))
    assert len(scene.within(0.0, 0.0, 5.0)) == 1
    assert scene.within(0.0, 0.0, 50.0) is scene


@pytest.mark.parametrize(
    ("time_s", "message"),
    [((0.0,), "at least two poses"), ((0.0, 0.0), "must increase"), ((0.0, np.nan), "not finite")],
)
def test_a_trajectory_that_is_none_is_refused(time_s: tuple[float, ...], message: str) -> None:
    size = len(time_s)
    with pytest.raises(ValueError, match=message):
        Trajectory(np.array(time_s), np.zeros(size), np.zeros(size), np.zeros(size))


def test_a_trajectory_turns_the_short_way_between_samples() -> None:
    plan = Trajectory(np.array([0.0, 1.0]), np.zeros(2), np.zeros(2), np.array([3.0, -3.0]))
    assert abs(plan.at(0.5).heading_rad) == pytest.approx(np.pi)
    with pytest.raises(ValueError, match="outside the trajectory"):
        plan.at(1.1)
