"""Cropping extracts of OpenStreetMap: what a recipe keeps, cuts, joins and changes."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import shapely

from tests.maps.osm_files import METRES_PER_DEGREE, node, osm, roundabout, way, written
from tools.make_maps.real import RECIPES, Recipe, crop, extract_of, read_recipe

HERE = (0.0, 0.0)  # where a degree is as long both ways
HALF = 100.0 / METRES_PER_DEGREE
OUTLINE = shapely.box(-HALF, -HALF, HALF, HALF)
STREETS = (
    *(node(id_, x, y, at=HERE) for id_, x, y in ((1, -150, 0), (2, 0, 0), (3, 150, 0), (4, 0, 50), (5, 60, 60))),
    way(10, (1, 2, 3), highway="residential", sidewalk="separate"),
    way(11, (2, 4), highway="tertiary", maxspeed="30", source="survey"),
    way(12, (4, 5), highway="service"),
)


def cropped(folder: Path, *parts: str, **changes: Any) -> dict[int, tuple[list[tuple[float, float]], dict[str, str]]]:
    """By way: its places in metres, and its tags."""
    recipe = Recipe("town", "A town", "Drawn", OUTLINE, **changes)
    root = ElementTree.fromstring(crop(written(folder, osm(*parts)), recipe))
    places = {n.attrib["id"]: (float(n.attrib["lon"]), float(n.attrib["lat"])) for n in root.iter("node")}
    return {
        int(w.attrib["id"]): (
            [(round(x * METRES_PER_DEGREE), round(y * METRES_PER_DEGREE)) for x, y in
             (places[n.attrib["ref"]] for n in w.iter("nd"))],
            {t.attrib["k"]: t.attrib["v"] for t in w.iter("tag")},
        )
        for w in root.iter("way")
    }  # fmt: skip


def test_streets_are_cut_at_the_outline_and_only_what_matters_to_streets_is_kept(tmp_path: Path) -> None:
    assert cropped(tmp_path, *STREETS) == {
        10: ([(-100, 0), (0, 0), (100, 0)], {"highway": "residential", "sidewalk": "both"}),
        11: ([(0, 0), (0, 50)], {"highway": "tertiary", "maxspeed": "30"}),
    }


def test_a_street_that_leaves_and_comes_back_is_two(tmp_path: Path) -> None:
    bow = (node(6, 50, 150, at=HERE), way(13, (2, 6, 5), highway="residential"), way(14, (4, 5), highway="residential"))
    found = cropped(tmp_path, *STREETS, *bow)
    assert found[13][0] == [(0, 0), (33, 100)]
    assert found[15] == ([(56, 100), (60, 60)], {"highway": "residential"})


def test_streets_that_hang_together_with_the_rest_only_outside_are_left_out(tmp_path: Path) -> None:
    island = (node(8, 80, 90, at=HERE), way(15, (5, 8), highway="residential"))
    assert set(cropped(tmp_path, *STREETS, *island)) == {10, 11}


def test_ways_are_dropped_tagged_and_limited(tmp_path: Path) -> None:
    assert set(cropped(tmp_path, *STREETS, dropped={11: "why"})) == {10}
    changed = cropped(tmp_path, *STREETS, tagged={11: {"maxspeed": "", "lanes": "2"}}, limits_kmh={"tertiary": 50.0})
    assert changed[11][1] == {"highway": "tertiary", "lanes": "2", "maxspeed": "50"}
    assert "maxspeed" not in changed[10][1]


def test_a_ring_becomes_one_crossing_in_its_middle(tmp_path: Path) -> None:
    ring = (roundabout(30, 30, clockwise=False, at=HERE), way(16, (2, 34), highway="residential"))
    found = cropped(tmp_path, *STREETS, *ring, joined={130: "why"})
    assert 130 not in found
    assert found[16][0] == [(0, 0), (30, 0)]


@pytest.mark.parametrize("name", RECIPES)
def test_a_shipped_extract_cropped_again_is_the_same(name: str) -> None:
    recipe = read_recipe(RECIPES[name])
    extract = extract_of(recipe)
    kept = Recipe(recipe.name, recipe.place, recipe.source, shapely.buffer(recipe.outline, 1e-6))
    assert crop(extract, kept) == extract.read_text(encoding="utf-8")
