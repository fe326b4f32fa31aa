"""Pictures of maps."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from interplan_sumo.errors import MapError
from interplan_sumo.maps.render import render_map
from interplan_sumo.maps.store import load_roads
from interplan_sumo.world.roads import Roads

pytestmark = pytest.mark.skipif(find_spec("matplotlib") is None, reason="matplotlib is not installed")


def pixels(path: Path) -> np.ndarray:
    from matplotlib import image

    return np.round(image.imread(path)[..., :3] * 255).astype(int)


def test_the_whole_map_fills_the_picture(tmp_path: Path) -> None:
    render_map(load_roads("strip"), tmp_path / "map.png")
    picture = pixels(tmp_path / "map.png")
    assert max(picture.shape[:2]) == 1500
    paper = picture[0, 0]
    drawn = (picture != paper).any(axis=2)
    assert drawn.any(axis=0).mean() > 0.9
    assert drawn.any(axis=1).mean() > 0.9


def test_a_part_of_a_map_has_the_asked_scale_and_shows_the_road(tmp_path: Path) -> None:
    roads = load_roads("strip")
    middle = next(area.polygon.centroid for area in roads.intersections if area.id == "3")
    render_map(
        roads,
        tmp_path / "part.png",
        centre_m=(middle.x, middle.y),
        radius_m=40.0,
        pixels_per_m=5.0,
        lane_ids=True,
        places={"the junction": (middle.x, middle.y)},
    )
    picture = pixels(tmp_path / "part.png")
    assert picture.shape[:2] == (400, 400)
    red, green, blue = picture[198:202, 198:202].reshape(-1, 3).mean(axis=0)
    assert red > 150 > green
    assert red > 150 > blue


def test_equal_calls_write_equal_files_and_connectors_can_be_left_out(tmp_path: Path) -> None:
    roads = load_roads("strip")
    middle = next(area.polygon.centroid for area in roads.intersections if area.id == "3")
    for name in ("one", "two", "without"):
        render_map(
            roads,
            tmp_path / f"{name}.png",
            centre_m=(middle.x, middle.y),
            radius_m=12.0,
            pixels_per_m=8.0,
            connectors=name != "without",
        )
    one, two, without = ((tmp_path / f"{name}.png").read_bytes() for name in ("one", "two", "without"))
    assert one == two
    assert without != one


def test_a_map_without_lanes_cannot_be_drawn(tmp_path: Path) -> None:
    empty = Roads("empty", "EPSG:32611", "right", {}, {}, {})
    with pytest.raises(MapError, match="no lanes"):
        render_map(empty, tmp_path / "map.png")


def test_a_part_needs_both_centre_and_radius(tmp_path: Path) -> None:
    with pytest.raises(MapError, match="centre and a radius"):
        render_map(load_roads("strip"), tmp_path / "map.png", radius_m=30.0)


def test_a_file_that_is_no_picture_or_cannot_be_written_is_refused_in_one_line(tmp_path: Path) -> None:
    roads = load_roads("strip")
    centre = tuple(roads.lanes["101010"].centerline.points[0])
    with pytest.raises(MapError, match=r"\.png"):
        render_map(roads, tmp_path / "map.docx", centre_m=centre, radius_m=20.0)
    with pytest.raises(MapError, match="cannot write"):
        render_map(roads, tmp_path / "missing" / "map.png", centre_m=centre, radius_m=20.0)
