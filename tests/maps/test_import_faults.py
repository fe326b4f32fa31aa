"""Damaged maps through the whole import: a map that keeps nuPlan's rules, or one clear line."""

from __future__ import annotations

import json
import random
from pathlib import Path
from typing import Any

import pytest

from interplan_sumo.errors import MapError
from interplan_sumo.maps.importers.argoverse2.reader import read_argoverse2
from interplan_sumo.maps.importers.build import build
from interplan_sumo.maps.rules import schema_problems
from tests.maps.argoverse_files import street, written
from tests.realdata import real


def damage(tile: dict[str, Any], rng: random.Random) -> None:
    """Change one lane as careless tools do: boundaries swapped, reversed or shaken, links and kinds wrong."""
    lanes = list(tile["lane_segments"].values())
    lane, other = rng.choice(lanes), rng.choice(lanes)
    left, right = lane["left_lane_boundary"], lane["right_lane_boundary"]
    match rng.randrange(9):
        case 0:
            lane["left_lane_boundary"], lane["right_lane_boundary"] = right, left
        case 1:
            lane["left_lane_boundary"] = left[::-1]
        case 2:
            spread_m = rng.choice((0.1, 2.0, 30.0))
            for point in left:
                point["x"] += rng.gauss(0.0, spread_m)
        case 3:
            lane["successors"] = [rng.choice(lanes)["id"] for _ in range(rng.randrange(4))]
        case 4:
            lane["left_neighbor_id"] = other["id"]
        case 5:
            lane["is_intersection"] = not lane["is_intersection"]
        case 6:
            lane["lane_type"] = rng.choice(("VEHICLE", "BUS", "BIKE"))
        case 7:
            lane["right_lane_boundary"] = right[:2]
        case _:
            for point in left[1:]:
                point["x"], point["y"] = left[0]["x"] + 0.01 * rng.random(), left[0]["y"]


def outcome(tile: dict[str, Any], seed: int, folder: Path) -> list[object] | None:
    """Rules that the damaged map breaks; None if it is refused."""
    rng = random.Random(seed)
    tile = json.loads(json.dumps(tile))
    for _ in range(rng.choice((1, 3, 10))):
        damage(tile, rng)
    try:
        return list(schema_problems(build(read_argoverse2(written(tile, folder))).roads))
    except MapError as error:
        return None if len(str(error).splitlines()) == 1 else [f"not one line: {error}"]


def test_a_damaged_street_keeps_the_rules_or_is_refused(tmp_path: Path) -> None:
    found = [outcome(street(), seed, tmp_path) for seed in range(40)]
    assert [seed for seed, problems in enumerate(found) if problems] == []
    assert sum(problems is not None for problems in found) > 20


@pytest.mark.slow
def test_a_damaged_real_map_keeps_the_rules_or_is_refused(tmp_path: Path) -> None:
    (file,) = real("argoverse2", "austin_0a1e6f0a").glob("log_map_archive_*.json")
    tile = json.loads(file.read_text())
    assert [seed for seed in range(60) if outcome(tile, seed, tmp_path)] == []
