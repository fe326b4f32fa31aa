"""Pictures of maps."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from worlds import junction

from interplan_sumo.errors import MapError
from interplan_sumo.maps.render import render_map
from interplan_sumo.maps.store import load_roads
from interplan_sumo.world.roads import Roads

pytestmark = pytest.mark.skipif(find_spec("matplotlib") is None, reason="matplotlib is not installed")


def pixels(path: Path) -> np.ndarray:
    from matplotlib import image

    return np.round(image.imread(path)[..., :3] * 255).astype(int)


@pytest.mark.slow
def test_the_whole_map_fills_the_picture(tmp_path: Path) -> None:
    render_map(load_roads("strip"), tmp_path / "map.png")
    picture = pixels(tmp_path / "map.png")
    assert max(picture.shape[:2]) == 1500
    paper = picture[0, 0]
    drawn = (picture != paper).any(axis=2)
    assert drawn.any(axis=0).mean() > 0.9
    assert drawn.any(axis=1).mean() > 0.9


def test_equal_calls_write_equal_files_and_lane_ids_are_shown_where_they_are_asked_for(tmp_path: Path) -> None:
    roads = junction()
    for name in ("one", "two", "named"):
        render_map(roads, tmp_path / f"{name}.png", lane_ids=name == "named")
    one, two, named = ((tmp_path / f"{name}.png").read_bytes() for name in ("one", "two", "named"))
    assert one == two
    assert named != one


def test_a_roadblock_without_lanes_is_passed_over(tmp_path: Path) -> None:
    roads = junction()
    links = [block for block in roads.roadblocks.values() if block.is_connector]
    nowhere = [replace(links[0], id="way", from_id="empty"), replace(links[0], id="empty", is_connector=False)]
    blocks = {**roads.roadblocks, **{block.id: replace(block, lane_ids=()) for block in nowhere}}
    render_map(replace(roads, roadblocks=blocks), tmp_path / "map.png")
    render_map(roads, tmp_path / "plain.png")
    assert (tmp_path / "map.png").read_bytes() == (tmp_path / "plain.png").read_bytes()


def test_a_map_without_lanes_cannot_be_drawn(tmp_path: Path) -> None:
    empty = Roads("empty", "EPSG:32611", "right", {}, {}, {})
    with pytest.raises(MapError, match="no lanes"):
        render_map(empty, tmp_path / "map.png")


def test_a_file_that_is_no_picture_or_cannot_be_written_is_refused_in_one_line(tmp_path: Path) -> None:
    roads = junction()
    with pytest.raises(MapError, match=r"\.png"):
        render_map(roads, tmp_path / "map.docx")
    with pytest.raises(MapError, match="cannot write"):
        render_map(roads, tmp_path / "missing" / "map.png")
