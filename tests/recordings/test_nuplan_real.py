"""Real scenes of nuPlan, put into a database of nuPlan's schema, through the reader of logs."""

from __future__ import annotations

import csv
import gzip
import math
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from interplan_sumo.recordings.nuplan_db import KINDS, NuplanLog
from interplan_sumo.world.recording import Recording
from interplan_sumo.world.signals import SignalStatus
from tests.realdata import real
from tests.recordings.nuplan_dbs import CATEGORIES, LIDAR, LOG, SCENE, insert, new_log, sweep, token

SCENES = ("262a4b7a1f2c5ab6", "d9ee9cf40a84520f")
LAS_VEGAS = 32611


def rows(name: str, part: str) -> list[dict[str, str]]:
    with gzip.open(real("nuplan_logs", f"{name}.{part}.csv.gz"), "rt") as file:
        return list(csv.DictReader(file))


def number_of(row: dict[str, str], key: str) -> float | None:
    """A number; things have no velocity."""
    return float(row[key]) if row[key] else None


def as_database(name: str, path: Path) -> Path:
    """The scene as a log: the same numbers in nuPlan's tables."""
    with new_log(path, "us-nv-las-vegas-strip") as tables:
        poses = rows(name, "ego")
        for frame, row in enumerate(poses):
            x, y, heading, vx, vy = (float(row[key]) for key in ("x", "y", "heading", "vx", "vy"))
            turned = (math.cos(heading / 2), 0.0, 0.0, math.sin(heading / 2))
            pose = (token("ep", frame), int(row["t_us"]), x, y, 0.0, *turned, vx, vy, *[0.0] * 7, LAS_VEGAS, LOG)
            insert(tables, "ego_pose", [pose])
            point = (token("pc", frame), None, None, token("ep", frame), LIDAR, SCENE, "", int(row["t_us"]))
            insert(tables, "lidar_pc", [point])
        tracks = rows(name, "tracks")
        kinds = {row["track_token"]: token("ca", CATEGORIES.index(row["type"])) for row in tracks}
        insert(tables, "track", [(bytes.fromhex(id_), kind, 1.0, 1.0, 1.0) for id_, kind in kinds.items()])
        boxes = [
            (
                token("lb", number), token("pc", int(row["it"])), bytes.fromhex(row["track_token"]), None, None,
                *(number_of(row, key) for key in ("x", "y")), 0.0,
                *(number_of(row, key) for key in ("width", "length", "height", "vx", "vy")), 0.0,
                number_of(row, "heading"), 1.0,
            )
            for number, row in enumerate(tracks)
        ]  # fmt: skip
        insert(tables, "lidar_box", boxes)
        lights = [
            (token("tl", number), token("pc", int(row["it"])), int(row["lane_connector_id"]), row["status"].lower())
            for number, row in enumerate(rows(name, "tl"))
        ]
        insert(tables, "traffic_light_status", lights)
    return path


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Recording]:
    folder = tmp_path_factory.mktemp("scenes")
    found: dict[str, Recording] = {}
    for name in SCENES:
        with NuplanLog(as_database(name, folder / f"{name}.db")) as log:
            found[name] = log.recording(log.moment(sweep(0)))
    return found


@pytest.mark.parametrize("name", SCENES)
def test_a_real_scene_comes_through_with_everyone_in_it_and_its_lights(name: str, scenes: dict[str, Recording]) -> None:
    found = scenes[name]
    recorded = rows(name, "tracks")
    assert (found.crs, found.ego_id) == ("EPSG:32611", sweep(0))
    others = [track for track in found.tracks if track.id != found.ego_id]
    assert {track.id.split("~")[0] for track in others} == {row["track_token"] for row in recorded}
    seen = Counter(KINDS[row["type"]] for row in recorded)
    kept = Counter(dict.fromkeys(seen, 0))
    for track in others:
        kept[track.kind] += len(track.poses)
    assert all(0.99 * seen[kind] <= kept[kind] for kind in seen)  # two sweeps of one scene have one time
    assert kept.total() <= 1.05 * seen.total()  # short gaps are filled
    assert 148 <= found.steps <= 151
    listed = rows(name, "tl")
    assert set(found.lights) == {row["lane_connector_id"] for row in listed}
    known = sum(int((status != SignalStatus.UNKNOWN).sum()) for status in found.lights.values())
    told = sum(row["status"] in ("RED", "GREEN") for row in listed if int(row["it"]) < found.steps)
    assert known == pytest.approx(told, abs=30)


def test_real_positions_and_velocities_tell_the_same_story(scenes: dict[str, Recording]) -> None:
    found = scenes[SCENES[1]]
    (ego,) = (track for track in found.tracks if track.id == found.ego_id)
    moved_mps, told_mps = np.diff(ego.poses[:, :2], axis=0) / found.step_s, ego.velocity_mps[1:]
    apart = np.hypot(*(moved_mps - told_mps).T) / np.hypot(*told_mps.T)
    assert float(np.median(apart)) < 0.06  # of the speed; a velocity that is not turned would be off by all of it
