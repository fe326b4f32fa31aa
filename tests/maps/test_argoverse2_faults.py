"""Argoverse 2 map files that cannot be used: one clear line each, whatever is wrong with them."""

from __future__ import annotations

import copy
import json
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from interplan_sumo.maps.geopackage_writer import write_map
from interplan_sumo.maps.importers.argoverse2 import file as argoverse2_file
from interplan_sumo.maps.importers.argoverse2.reader import read_argoverse2
from interplan_sumo.maps.importers.build import build
from interplan_sumo.world.roads import Roads
from tests.maps.argoverse_files import lane, line, straight, street, tile, written
from tests.maps.damaged import assert_sound, refusal, survive
from tests.quick import few
from tests.realdata import real

Change = Callable[[dict[str, Any]], Any]


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    assert refusal(tmp_path / "map.json", read_argoverse2).startswith("no map file at FILE")


NO_JSON, NO_MAP = "FILE: not a JSON file (", "FILE: not an Argoverse 2 map (no "
FILES = [
    *((content, NO_JSON) for content in (b"", b"<osm/>", b"{", b'{"lane_segments": 1,}', b"\xff\xfe\xff\x00PK\x03")),
    *((content, NO_JSON) for content in (b"[" * 100_000, b"1" * 5000, b'{"a":' * 50_000)),
    *((json.dumps(content).encode(), NO_MAP) for content in ([], 3, None, "lanes", {})),
    (json.dumps(tile()).encode(), "FILE: lane_segments is empty; there is no road on this map"),
    (
        json.dumps(street()).replace('"2": {"id": 2', '"1": {"id": 1').encode(),
        "FILE: the key '1' appears twice in one object",
    ),
]


@pytest.mark.parametrize(("content", "message"), FILES, ids=[str(content[:20]) for content, _ in FILES])
def test_a_file_that_is_no_map(content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / "map.json").write_bytes(content)
    assert refusal(tmp_path / "map.json", read_argoverse2).startswith(message)


def test_a_file_that_is_too_large(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(street(), tmp_path)
    size = path.stat().st_size
    monkeypatch.setattr(argoverse2_file, "MAX_FILE_BYTES", size)
    assert len(read_argoverse2(path).lanes) == 4
    monkeypatch.setattr(argoverse2_file, "MAX_FILE_BYTES", size - 1)
    assert refusal(path, read_argoverse2).startswith("FILE: the file is larger than")


def segment(**fields: Any) -> Change:
    """Gives lane 2 other fields."""
    return lambda content: content["lane_segments"]["2"].update(fields)


def without(field: str) -> Change:
    return lambda content: content["lane_segments"]["2"].pop(field)


LANES: list[tuple[Change, str]] = [
    (lambda c: c["lane_segments"].update({"2": 5}), "Expected `object`, got `int`"),
    (segment(id=6), "its id is 6; both must be the same"),
    (without("id"), "Object missing required field `id`"),
    (segment(id="2"), "Expected `int`, got `str` - at `$.id`"),
    (without("lane_type"), "Object missing required field `lane_type`"),
    (segment(lane_type=3), "Expected `str`, got `int` - at `$.lane_type`"),
    (segment(lane_type="A\nB"), "Expected `str` matching regex"),
    (segment(is_intersection="no"), "Expected `bool`, got `str` - at `$.is_intersection`"),
    (without("left_lane_boundary"), "Object missing required field `left_lane_boundary`"),
    (segment(right_lane_boundary="x"), "Expected `array`, got `str` - at `$.right_lane_boundary`"),
    (segment(left_lane_boundary=line((0, 0))), "1 distinct points, a line needs 2 - at `$.left_lane_boundary`"),
    (segment(left_lane_boundary=[]), "0 distinct points, a line needs 2 - at `$.left_lane_boundary`"),
    (segment(left_lane_boundary=line((0, 0), (0, 0, 1))), "1 distinct points, a line needs 2"),
    (segment(left_lane_boundary=[{"x": 0, "y": 1}]), "Object missing required field `z` - at `$[0]`"),
    (segment(left_lane_boundary=[[0, 1, 2]]), "Expected `object`, got `array` - at `$[0]`"),
    (segment(left_lane_boundary=line((0, float("nan")), (1, 1))), "Expected `float` >= -100000.0 - at `$[0].y`"),
    (segment(left_lane_boundary=line((0, 1), (-float("inf"), 1))), "Expected `float` >= -100000.0 - at `$[1].x`"),
    (segment(left_lane_boundary=line((0, 1), (100_001, 1))), "Expected `float` <= 100000.0 - at `$[1].x`"),
    (segment(left_lane_boundary=line((0, 1), (10**400, 1))), "Number out of range - at `$[1].x`"),
    (segment(left_lane_boundary=[{"x": "1", "y": 1, "z": 0.0}]), "Expected `float`, got `str` - at `$[0].x`"),
    (
        segment(right_lane_boundary=line((0, 0), (5, 0)), left_lane_boundary=line((0, 0), (5, 0))),
        "left_lane_boundary and right_lane_boundary enclose no surface",
    ),
    (segment(successors=4), "Expected `array`, got `int` - at `$.successors`"),
    (segment(predecessors=["1"]), "Expected `int`, got `str` - at `$.predecessors[0]`"),
    (segment(successors=[True]), "Expected `int`, got `bool` - at `$.successors[0]`"),
    (segment(successors=[4, 2]), "names itself beside, before or behind it"),
    (segment(left_neighbor_id=2), "names itself beside, before or behind it"),
    (segment(right_neighbor_id=1.5), "Expected `int | null`, got `float` - at `$.right_neighbor_id`"),
    (without("right_neighbor_id"), "Object missing required field `right_neighbor_id`"),
]
NAMES = ("lane_segments", "pedestrian_crossings", "drivable_areas")
LAYERS: list[tuple[Change, str]] = [
    *((lambda c, name=name: c.pop(name), f"not an Argoverse 2 map (no {name})") for name in NAMES),
    *(
        (lambda c, name=name: c.update({name: [1, 2]}), f"{name} is no object, expected objects by id")
        for name in NAMES
    ),
    (
        lambda c: c["pedestrian_crossings"]["7"].update(edge2=line((1, 1))),
        "pedestrian_crossings '7': 1 distinct points, a line needs 2 - at `$.edge2`",
    ),
    (
        lambda c: c["drivable_areas"]["8"].update(area_boundary=line((1, 1), (2, 2))),
        "drivable_areas '8': area_boundary has 2 distinct points, needs 3",
    ),
]


@pytest.mark.parametrize(
    ("change", "message"), [*LAYERS, *((change, f"lane_segments '2': {said}") for change, said in LANES)]
)
def test_objects_that_cannot_be_are_named(change: Change, message: str, tmp_path: Path) -> None:
    content = street()
    change(content)
    assert refusal(written(content, tmp_path), read_argoverse2).startswith(f"FILE: {message}")


def test_the_largest_coordinate_is_still_read(tmp_path: Path) -> None:
    far = lane(1, [(99_990, 0), (100_000, 0)], [(99_990, -3), (100_000, -3)])
    assert len(read_argoverse2(written(tile(far), tmp_path)).lanes) == 1


GARBAGE: tuple[Any, ...] = (
    None, True, 0, -1, 1, 4, 1.5, 1e308, 10**30, float("nan"), float("-inf"), "", "VEHICLE", "BIKE", "x\ny", [], {},
    [[]], [None], [1], {"x": 0}, {"x": 0, "y": 0, "z": 0}, [{"x": 0, "y": 0, "z": 0}] * 2, {"1": {}},
)  # fmt: skip


def places(node: Any) -> list[tuple[Any, Any]]:
    """Every (container, key) of a tree."""
    found: list[tuple[Any, Any]] = []
    keys = list(node) if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else ()
    for key in keys:
        found.append((node, key))
        found.extend(places(node[key]))
    return found


def damage(path: Path, rng: np.random.Generator, whole: dict[str, Any]) -> None:
    """A map after one to three random changes to its tree or its bytes."""
    content = copy.deepcopy(whole)
    for _ in range(int(rng.integers(1, 4))):
        spots = places(content)
        if not spots:
            break
        node, key = spots[int(rng.integers(len(spots)))]
        other, other_key = spots[int(rng.integers(len(spots)))]
        way = rng.random()
        if way < 0.7 and type(node[key]) in (int, float):
            node[key] = float(rng.normal(node[key], 10.0 ** rng.integers(-3, 5)))
        elif way < 0.2:
            del node[key]
        elif way < 0.4:
            node[key] = copy.deepcopy(other[other_key])
        elif way < 0.7 and isinstance(node, list):
            node.reverse()
        else:
            node[key] = copy.deepcopy(GARBAGE[int(rng.integers(len(GARBAGE)))])
    text = bytearray(json.dumps(content).encode())
    if rng.random() < 0.1:
        at = rng.integers(len(text), size=3)
        for place in at.tolist():
            text[place] = int(rng.integers(256))
    path.write_bytes(text[: int(rng.integers(len(text)))] if rng.random() < 0.03 else text)


def imported(path: Path) -> Roads:
    """What breaks nuPlan's rules is not written."""
    roads = build(read_argoverse2(path)).roads
    write_map(roads, path.with_suffix(".gpkg"))
    return roads


@pytest.mark.parametrize(("where", "seeds"), few([("street", 50), ("street", 1000), ("city", 60)], 1))
def test_damaged_files_are_read_and_then_imported_or_refused_and_nothing_else(
    where: str, seeds: int, tmp_path: Path
) -> None:
    whole = street()
    if where == "city":
        (file,) = real("argoverse2", "austin_0a1e6f0a").glob("log_map_archive_*.json")
        whole = json.loads(file.read_text())
    path, damaged = tmp_path / "log_map_archive_x____PIT_city_1.json", partial(damage, whole=whole)
    read, refused = survive(seeds, path, damaged, [read_argoverse2], assert_sound)
    assert read > 0.2
    assert refused > 0.3
    assert survive(min(seeds, 150), path, damaged, [imported], assert_sound)[0] > 0.9 * read


@pytest.mark.skipif(os.name == "nt" or not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root reads everything")
def test_a_file_that_may_not_be_read(tmp_path: Path) -> None:
    path = written(tile(straight(1, 0.0, 40.0, 0.0)), tmp_path)
    path.chmod(0)
    assert refusal(path, read_argoverse2).startswith("FILE: cannot be read (")
