"""A dataset of a few drives on tiny roads, made in a second: bends to both sides, fast and slow, a car ahead."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from interplan_learned.card import Card
from interplan_sumo import tiny_worlds
from interplan_sumo.dataset import folder as layout
from interplan_sumo.dataset import records
from interplan_sumo.dataset.columns import Columns, count_of, joined, write_arrays
from interplan_sumo.dataset.drives import map_hash
from interplan_sumo.dataset.samples import drive_samples, sample_frames
from interplan_sumo.features import schema
from interplan_sumo.features.lane_graph import lane_graph
from interplan_sumo.features.schema import BY_NAME
from interplan_sumo.features.view import Arrays
from interplan_sumo.maps.geopackage_writer import write_map
from interplan_sumo.maps.store import find_map
from interplan_sumo.scenario.scenario import LanePosition, Scenario
from interplan_sumo.world.files import file_hash
from interplan_sumo.world.geometry import Polyline
from interplan_sumo.world.roads import Roads
from tools.train.recipe import Batch, Recipe

FRAMES = 91
HASH = "tiny"
_BENDS = {"left": (60.0, 1.2), "right": (60.0, -1.2), "gentle": (200.0, 0.5)}


def roads_of(name: str) -> Roads:
    """A road with a bend: `left`, `right` or `gentle`."""
    radius_m, angle_rad = _BENDS[name]
    return tiny_worlds.curved_road(radius_m, angle_rad, run_in_m=80.0, limit_mps=12.0)


def samples_of(name: str, speed_mps: float, push_mps2: float = 0.0, drive: int = 0) -> Columns:
    """A drive of 9 s along the road's centre line from 10 m on, sampled every half second."""
    roads = roads_of(name)
    (lane,) = roads.lanes.values()
    line = Polyline(np.array(lane.centerline.points))
    speeds = np.maximum(speed_mps + push_mps2 * 0.1 * np.arange(FRAMES), 0.0)
    trace = tiny_worlds.drive_along(line, *speeds, start_m=10.0, actors=tiny_worlds.cars((70.0, 0.5)))
    scenario = Scenario(
        "test/0", "test", name, LanePosition(lane.id, 10.0), speed_mps, LanePosition(lane.id, line.length_m - 5.0),
        (lane.roadblock_id,), duration_s=9.0,
    )  # fmt: skip
    return drive_samples(scenario, roads, trace, drive=drive, frames=sample_frames(trace, 5))


def empty_sample(*names: str) -> Arrays:
    """One sample without anything in it."""
    shapes = {name: tuple(size or 0 for size in BY_NAME[name].shape) for name in names}
    return {name: np.zeros((1, *shape), dtype=BY_NAME[name].dtype) for name, shape in shapes.items()}


def write_tiny_dataset(folder: Path) -> Path:
    """A dataset of eighteen drives in `train` and three in `val`, each on one of three maps."""
    (folder / layout.SHARDS).mkdir(parents=True)
    (folder / layout.MAPS).mkdir()
    plan = [
        (name, speed, push)
        for name in _BENDS
        for speed, push in ((4.0, 0.0), (6.0, 0.5), (8.0, 0.0), (9.0, -0.5), (10.0, 0.0), (11.0, -1.0), (7.0, 0.2))
    ]
    held = [k for k, (_, speed, _) in enumerate(plan) if speed == 7.0]
    made = [samples_of(*each, drive=k) for k, each in enumerate(plan)]
    shards = [
        _write_shard(folder, "train", [made[k] for k in range(len(plan)) if k not in held]),
        _write_shard(folder, "val", [made[k] for k in held]),
    ]
    splits: list[records.Split] = ["val" if k in held else "train" for k in range(len(plan))]
    lines = [
        records.text_of(
            records.DriveRecord(
                origin="run", source="tiny", scenario_id="test/0", family="test", map=name, seed=k, planner="idm",
                car=None, score=1.0, route=("1",), goal_lane="11", split=split, samples=count_of(made[k]),
                scenario_hash="", trace_hash="", generator="",
            )
        )
        for k, ((name, _, _), split) in enumerate(zip(plan, splits, strict=True))
    ]  # fmt: skip
    drives = folder / layout.DRIVES
    drives.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")
    samples = {each.split: each.samples for each in shards}
    manifest = records.DatasetManifest(
        kind=layout.KIND, format=layout.FORMAT, hash=HASH, versions={}, sources=[], left_out={},
        features=records.FeaturesRecord(schema.FORMAT, "", "", schema.STEP_S, []),
        options=records.OptionsRecord(0.5, 0.5, 0.0, [], [], []),
        counts=records.CountsRecord(len(plan), sum(samples.values()), {**samples}, {}, {}, {}, {}),
        maps={name: _write_map(folder, name) for name in _BENDS},
        drives=records.FileRecord(layout.DRIVES, file_hash(drives)),
        shards=shards,
    )  # fmt: skip
    (folder / layout.MANIFEST).write_text(records.text_of(manifest), encoding="utf-8")
    return folder


def _write_shard(folder: Path, split: records.Split, parts: Sequence[Columns]) -> records.ShardRecord:
    columns = joined(parts)
    path = folder / layout.SHARDS / f"{split}-00000.npz"
    write_arrays(path, columns, level=1)
    return records.ShardRecord(
        f"{layout.SHARDS}/{path.name}", split, count_of(columns), path.stat().st_size, file_hash(path)
    )


def _write_map(folder: Path, name: str) -> records.MapRecord:
    """The lane graph, and beside it the map itself, which is no shipped one."""
    roads = roads_of(name)
    path = folder / layout.MAPS / f"{name}.npz"
    write_arrays(path, lane_graph(roads).tables())
    write_map(roads, path.with_suffix("") / "1.0" / "map.gpkg")
    return records.MapRecord(roads.crs, roads.driving_side, map_hash(find_map(name, path.parent)), file_hash(path))


def write_untrained(recipe: Recipe, model: Any, batch: Batch, folder: Path) -> Path:
    """The card of a network, written beside its graphs, which holds ONNX against torch; skips without the extras."""
    pytest.importorskip("onnx", reason="needs onnx: pip install 'interplan-sumo[train]'")
    pytest.importorskip("onnxruntime", reason="needs onnxruntime: pip install 'interplan-sumo[learned]'")
    from tools.train.onnx_export import export_graphs

    card = Card(
        planner=recipe.planner, what=recipe.what, size=recipe.size, parameters=1, options=recipe.options,
        features_format=schema.FORMAT, graphs=export_graphs(recipe.graphs(model, batch), folder, recipe.planner),
        data={}, training={}, errors={}, versions={},
    )  # fmt: skip
    card.write(folder / f"{recipe.planner}.json")
    return folder / f"{recipe.planner}.json"
