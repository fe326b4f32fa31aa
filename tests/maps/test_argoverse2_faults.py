"""Argoverse 2 map files that cannot be used: one clear line each, whatever is wrong with them."""

from __future__ import annotations

import copy
import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from interplan_sumo.errors import MapError
from interplan_sumo.maps.importers.argoverse2 import file as argoverse2_file
from interplan_sumo.maps.importers.argoverse2.reader import read_argoverse2
from interplan_sumo.maps.importers.source import SourceMap
from tests.maps.argoverse_files import lane, line, straight, street, tile, written

Change = Callable[[dict[str, Any]], Any]


def refusal(path: Path) -> str:
    """The one line that reading ends in, without the path."""
    with pytest.raises(MapError) as caught:
        read_argoverse2(path)
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < len(str(path)) + 200
    assert str(path) in message
    return message.replace(str(path), "FILE")


# --- files -----------------------------------------------------------------------------------------


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    assert refusal(tmp_path / "map.json").startswith("no map file at FILE")


@pytest.mark.parametrize(
    "content", ["", "<osm/>", "{", '{"lane_segments": 1,}', "[" * 100_000, "1" * 5000, '{"a":' * 50_000]
)
def test_a_file_that_is_not_json(content: str, tmp_path: Path) -> None:
    assert refusal(written(content, tmp_path)).startswith("FILE: not a JSON file (")


def test_a_file_that_is_no_text(tmp_path: Path) -> None:
    path = tmp_path / "map.json"
    path.write_bytes(b"\xff\xfe\xff\x00PK\x03\x04")
    assert refusal(path).startswith("FILE: not a JSON file (")


@pytest.mark.parametrize("content", [[], 3, None, "lanes", {}])
def test_json_of_another_kind(content: Any, tmp_path: Path) -> None:
    assert refusal(written(json.dumps(content), tmp_path)).startswith("FILE: not an Argoverse 2 map (no ")


@pytest.mark.parametrize("layer", argoverse2_file.LAYERS)
def test_a_missing_layer(layer: str, tmp_path: Path) -> None:
    content = street()
    del content[layer]
    assert refusal(written(content, tmp_path)) == f"FILE: not an Argoverse 2 map (no {layer})"


@pytest.mark.parametrize("layer", argoverse2_file.LAYERS)
def test_a_layer_of_another_form(layer: str, tmp_path: Path) -> None:
    content = street()
    content[layer] = [1, 2]
    assert refusal(written(content, tmp_path)) == f"FILE: {layer} is a list of 2, expected objects by id"


def test_a_map_without_lanes(tmp_path: Path) -> None:
    assert refusal(written(tile(), tmp_path)) == "FILE: lane_segments is empty; there is no road on this map"


def test_a_file_that_is_too_large(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(street(), tmp_path)
    size = path.stat().st_size
    monkeypatch.setattr(argoverse2_file, "MAX_FILE_BYTES", size)
    assert len(read_argoverse2(path).lanes) == 4
    monkeypatch.setattr(argoverse2_file, "MAX_FILE_BYTES", size - 1)
    assert refusal(path).startswith("FILE: the file is larger than")


def test_a_key_that_appears_twice(tmp_path: Path) -> None:
    content = json.dumps(street()).replace('"2": {"id": 2', '"1": {"id": 1')
    assert refusal(written(content, tmp_path)) == "FILE: the key '1' appears twice in one object"


# --- objects ---------------------------------------------------------------------------------------


def segment(**fields: Any) -> Change:
    """Gives lane 2 other fields."""
    return lambda content: content["lane_segments"]["2"].update(fields)


def without(field: str) -> Change:
    return lambda content: content["lane_segments"]["2"].pop(field)


FAULTS: dict[str, tuple[Change, str]] = {
    "no object": (lambda c: c["lane_segments"].update({"2": 5}), "'2': is 5, expected an object"),
    "id of another": (segment(id=1), "'2': its id is 1; both must be the same"),
    "no id": (without("id"), "'2': its id is None; both must be the same"),
    "id that is a word": (segment(id="2"), "'2': its id is '2'; both must be the same"),
    "no type": (without("lane_type"), "2: has no lane_type"),
    "type that is a number": (segment(lane_type=3), "2: lane_type is 3, expected a word"),
    "type of two lines": (segment(lane_type="A\nB"), r"2: lane_type is 'A\nB', expected a word"),
    "flag that is a word": (segment(is_intersection="no"), "2: is_intersection is 'no', expected true or false"),
    "no boundary": (without("left_lane_boundary"), "2: has no left_lane_boundary"),
    "boundary that is a word": (
        segment(right_lane_boundary="x"),
        "2: right_lane_boundary is 'x', expected a list of points",
    ),
    "boundary of one point": (
        segment(left_lane_boundary=line((0, 0))),
        "2: left_lane_boundary has 1 distinct points, needs 2",
    ),
    "boundary of no point": (
        segment(left_lane_boundary=[]),
        "2: left_lane_boundary has 0 distinct points, needs 2",
    ),
    "boundary of one point twice": (
        segment(left_lane_boundary=line((0, 0), (0, 0, 1))),
        "2: left_lane_boundary has 1 distinct points, needs 2",
    ),
    "point without height": (
        segment(left_lane_boundary=[{"x": 0, "y": 1}]),
        "2: left_lane_boundary holds a point without x, y and z",
    ),
    "point that is a list": (
        segment(left_lane_boundary=[[0, 1, 2]]),
        "2: left_lane_boundary holds a point without x, y and z",
    ),
    "not a number": (
        segment(left_lane_boundary=line((0, float("nan")), (1, 1))),
        "2: left_lane_boundary has the coordinate nan, expected metres, at most 100000",
    ),
    "infinite": (
        segment(left_lane_boundary=line((0, 1), (-float("inf"), 1))),
        "2: left_lane_boundary has the coordinate -inf, expected metres, at most 100000",
    ),
    "beyond the city": (
        segment(left_lane_boundary=line((0, 1), (100_001, 1))),
        "2: left_lane_boundary has the coordinate 100001, expected metres, at most 100000",
    ),
    "a number beyond all floats": (
        segment(left_lane_boundary=line((0, 1), (10**400, 1))),
        f"2: left_lane_boundary has the coordinate 1{'0' * 39}, expected metres, at most 100000",
    ),
    "a coordinate that is a word": (
        segment(left_lane_boundary=line(("1", 1), (2, 1))),  # pyright: ignore[reportArgumentType]
        "2: left_lane_boundary has the coordinate '1', expected metres, at most 100000",
    ),
    "a coordinate that is a list": (
        segment(left_lane_boundary=[{"x": [1, 2], "y": [3, 4], "z": [5, 6]}]),
        "2: left_lane_boundary has the coordinate a list of 2, expected metres, at most 100000",
    ),
    "boundaries that are one": (
        segment(right_lane_boundary=line((0, 0), (5, 0)), left_lane_boundary=line((0, 0), (5, 0))),
        "2: left_lane_boundary and right_lane_boundary enclose no surface",
    ),
    "links that are a number": (segment(successors=4), "2: successors is 4, expected a list of ids"),
    "a link that is a word": (segment(predecessors=["1"]), "2: predecessors holds '1', expected a whole number"),
    "a link that is true": (segment(successors=[True]), "2: successors holds True, expected a whole number"),
    "a link to itself": (segment(successors=[4, 2]), "2: successors names the object itself"),
    "its own neighbour": (segment(left_neighbor_id=2), "2: left_neighbor_id names the object itself"),
    "half a neighbour": (segment(right_neighbor_id=1.5), "2: right_neighbor_id holds 1.5, expected a whole number"),
    "no neighbours": (without("right_neighbor_id"), "2: has no right_neighbor_id"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_lanes_that_cannot_be_are_named(name: str, tmp_path: Path) -> None:
    change, message = FAULTS[name]
    content = street()
    change(content)
    assert refusal(written(content, tmp_path)) == f"FILE: lane_segments {message}"


def test_crossings_and_areas_that_cannot_be_are_named(tmp_path: Path) -> None:
    content = street()
    content["pedestrian_crossings"]["7"]["edge2"] = line((1, 1))
    assert refusal(written(content, tmp_path)) == "FILE: pedestrian_crossings 7: edge2 has 1 distinct points, needs 2"
    content = street()
    content["drivable_areas"]["8"]["area_boundary"] = line((1, 1), (2, 2))
    message = "FILE: drivable_areas 8: area_boundary has 2 distinct points, needs 3"
    assert refusal(written(content, tmp_path)) == message


def test_the_largest_coordinate_is_still_read(tmp_path: Path) -> None:
    far = lane(1, [(99_990, 0), (100_000, 0)], [(99_990, -3), (100_000, -3)])
    assert len(read_argoverse2(written(tile(far), tmp_path)).lanes) == 1


# --- anything at all -------------------------------------------------------------------------------

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


def mutated(content: dict[str, Any], rng: np.random.Generator) -> bytes:
    """The file after one to three random changes to its tree or its bytes."""
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
    return bytes(text[: int(rng.integers(len(text)))] if rng.random() < 0.03 else text)


def survive(seeds: range, folder: Path) -> tuple[int, int]:
    """How many damaged files were read and how many refused; anything else raises."""
    path = folder / "log_map_archive_x____PIT_city_1.json"
    read = refused = 0
    for seed in seeds:
        path.write_bytes(mutated(street(), np.random.default_rng(seed)))
        start = time.monotonic()
        try:
            found: SourceMap | MapError = read_argoverse2(path)
        except MapError as error:
            found = error
        except Exception as error:
            raise AssertionError(f"seed {seed}: {error!r}") from error
        assert time.monotonic() - start < 5.0, seed
        if isinstance(found, SourceMap):
            read += 1
            check_sound(found)
        else:
            refused += 1
            assert "\n" not in str(found), seed
    return read, refused


def check_sound(source: SourceMap) -> None:
    """What every reader promises, however odd the file."""
    for one in source.lanes.values():
        assert np.isfinite(one.left).all()
        assert np.isfinite(one.right).all()
        assert min(len(one.left), len(one.right)) >= 2
        assert all(one.id in source.lanes[b].predecessors for b in one.successors if b in source.lanes)
        assert all(one.id in source.lanes[b].successors for b in one.predecessors if b in source.lanes)
        assert one.left_neighbour is None or source.lanes[one.left_neighbour].right_neighbour == one.id
        assert one.right_neighbour is None or source.lanes[one.right_neighbour].left_neighbour == one.id
        assert one.id not in (*one.successors, *one.predecessors)
    surfaces = (*source.crosswalks, *source.drivable, *(item.polygon for item in source.left_out))
    assert all(isinstance(surface, shapely.Polygon) and surface.is_valid for surface in surfaces)


def test_damaged_files_are_read_or_refused_and_nothing_else(tmp_path: Path) -> None:
    read, refused = survive(range(300), tmp_path)
    assert read > 60
    assert refused > 100


@pytest.mark.slow
def test_two_thousand_damaged_files(tmp_path: Path) -> None:
    read, refused = survive(range(1000, 3000), tmp_path)
    assert read > 400
    assert refused > 800


@pytest.mark.skipif(os.name == "nt" or not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root reads everything")
def test_a_file_that_may_not_be_read(tmp_path: Path) -> None:
    path = written(tile(straight(1, 0.0, 40.0, 0.0)), tmp_path)
    path.chmod(0)
    assert refusal(path).startswith("FILE: cannot be read (")
