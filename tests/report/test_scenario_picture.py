"""Pictures of scenarios: everything staged is in them, and the route runs from left to right."""

from __future__ import annotations

import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from interplan_sumo.errors import InputError
from interplan_sumo.maps.store import load_roads
from interplan_sumo.report import scenario_drawing as drawing
from interplan_sumo.report import scenario_picture as picture
from interplan_sumo.report.scenario_drawing import View, behaviour_colours, drivers_in_legend
from interplan_sumo.report.scenario_picture import contact_sheet, render_scenario
from interplan_sumo.scenario.kinds import OBSTACLES
from interplan_sumo.scenario.scenario import Jaywalker, LanePosition, Obstacle, TrafficDemand
from interplan_sumo.world.roads import Roads
from tests.batch.busy import PLAIN

pytestmark = pytest.mark.skipif(find_spec("matplotlib") is None, reason="matplotlib is not installed")

LANE = "402032"
BUSY = replace(PLAIN, goal=LanePosition("402030", 200.0), traffic=TrafficDemand("medium"))
CROSSED = replace(
    PLAIN,
    id="mine/1",
    goal=LanePosition(LANE, 200.0),
    obstacles=(
        Obstacle(LanePosition(LANE, 104.0, -3.6), "bus"),
        Obstacle(LanePosition(LANE, 130.0), "cone"),
        Obstacle(LanePosition(LANE, 132.0), "worker"),
        Obstacle(LanePosition(LANE, 134.0), "barrier"),
    ),
    jaywalkers=(Jaywalker(LanePosition(LANE, 112.0, -5.0), LanePosition(LANE, 112.0, 8.0), 1.5),),
    occluder=0,
)


@pytest.fixture(scope="module")
def roads() -> Roads:
    return load_roads("strip")


def pixels(path: Path) -> np.ndarray:
    from matplotlib import image

    return np.round(image.imread(path)[..., :3] * 255).astype(int)


def shows(shot: np.ndarray, colour: str) -> int:
    """Pixels of exactly this colour."""
    wanted = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
    return int((shot == wanted).all(axis=2).sum())


def test_a_picture_of_traffic_shows_ego_goal_and_drivers(roads: Roads, tmp_path: Path) -> None:
    render_scenario(BUSY, roads, tmp_path / "busy.png")
    shot = pixels(tmp_path / "busy.png")
    assert shot.shape[1] == picture.WIDTH
    for colour in (drawing.EGO, drawing.GOAL, *drawing.BEHAVIOURS.values()):
        assert shows(shot, colour) > 50
    assert shows(shot, drawing.PERSON) == 0
    ego = np.argwhere((shot[:-60] == [0x1D, 0x4E, 0xD8]).all(axis=2))[:, 1]
    goal = np.argwhere((shot[:-60] == [0x15, 0x80, 0x3D]).all(axis=2))[:, 1]
    assert ego.mean() < 0.25 * picture.WIDTH < 0.75 * picture.WIDTH < goal.mean()


def test_a_picture_of_a_crossing_shows_all_that_stands_and_walks_twice(roads: Roads, tmp_path: Path) -> None:
    render_scenario(CROSSED, roads, tmp_path / "crossed.png")
    shot = pixels(tmp_path / "crossed.png")
    for colour in (drawing.PERSON, drawing.CONE, drawing.WORKER, drawing.BARRIER):
        assert shows(shot, colour) > 50
    assert shot.shape[0] > 700  # the close-up lies below
    render_scenario(CROSSED, roads, tmp_path / "again.png")
    assert (tmp_path / "again.png").read_bytes() == (tmp_path / "crossed.png").read_bytes()
    render_scenario(replace(CROSSED, obstacles=(), occluder=None, jaywalkers=()), roads, tmp_path / "bare.png")
    assert pixels(tmp_path / "bare.png").shape[0] < 450


@pytest.mark.parametrize("kind", sorted(OBSTACLES))
def test_everything_that_can_stand_somewhere_has_a_colour(kind: str) -> None:
    assert OBSTACLES[kind][0] in drawing.OBSTACLE_COLOURS


def test_a_sheet_has_a_row_per_family_and_as_many_columns_as_its_largest(tmp_path: Path) -> None:
    other = replace(CROSSED, id="other/0", family="other")
    contact_sheet([BUSY, CROSSED, other], tmp_path / "sheet.png")
    height, width, _ = pixels(tmp_path / "sheet.png").shape
    assert width == 2 * (picture.CELL[0] + picture.GAP) + picture.GAP
    rows = 2 * (picture.CELL[1] + picture.CELL_TITLE + picture.GAP) + picture.GAP
    assert height > rows + picture.FOOT  # words that do not fit side by side stand below each other
    bare = replace(CROSSED, obstacles=(), occluder=None, jaywalkers=())
    contact_sheet([replace(bare, id=f"mine/{i}") for i in range(picture.OF_ONE_FAMILY + 1)], tmp_path / "many.png")
    height, width, _ = pixels(tmp_path / "many.png").shape  # of one family: wrapped, no row of all
    assert width == picture.OF_ONE_FAMILY * (picture.CELL[0] + picture.GAP) + picture.GAP
    assert rows + picture.FOOT <= height < rows + 2 * picture.FOOT


def test_above_a_scenario_there_are_as_many_words_as_have_room_beside_its_id() -> None:
    busy = replace(BUSY, traffic=replace(BUSY.traffic, oncoming="low"))
    short = picture._about(replace(busy, id="a/0"))
    assert short == f"{busy.map}, {busy.traffic.density}, oncoming low"
    room = picture.TITLE_LETTERS - len(short)
    assert picture._about(replace(busy, id="a" * room)) == short
    assert picture._about(replace(busy, id="a" * (room + 1))) == f"{busy.map}, {busy.traffic.density}"
    assert picture._about(replace(busy, id="a" * picture.TITLE_LETTERS)) == ""


def test_the_words_below_a_small_sheet_are_not_cut_off(tmp_path: Path) -> None:
    contact_sheet([BUSY], tmp_path / "sheet.png")
    below = pixels(tmp_path / "sheet.png")[-picture.FOOT :]
    assert (below < 128).any()
    assert (below[:, [0, -1]] == 255).all()


def test_nothing_to_draw_and_files_that_cannot_be_written_are_refused_in_one_line(
    roads: Roads, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match="no scenarios to draw"):
        contact_sheet([], tmp_path / "sheet.png")
    with pytest.raises(InputError, match=r"pictures end in \.png"):
        render_scenario(CROSSED, roads, tmp_path / "crossed.docx")
    with pytest.raises(InputError, match=r"cannot write .*no/crossed\.png: No such file"):
        render_scenario(CROSSED, roads, tmp_path / "no" / "crossed.png")
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(InputError, match=r"needs matplotlib, .*; run: pip install 'interplan-sumo\[plots\]'"):
        render_scenario(BUSY, roads, tmp_path / "busy.png")


def test_types_of_drivers_keep_their_colours_and_others_get_one() -> None:
    assert behaviour_colours(["mixed", "assertive"])["assertive"] == drawing.BEHAVIOURS["assertive"]
    assert behaviour_colours(["truck", "bus"]) == behaviour_colours(["bus", "truck", "bus"])
    assert len(set(behaviour_colours(["bus", "truck", "assertive", "conservative"]).values())) == 4


def test_more_types_of_drivers_than_colours_share_one_and_stand_in_the_legend_once() -> None:
    few = {f"driver_{i}": 2 for i in range(len(drawing.OTHERS))} | {"assertive": 1}
    assert [number for _, _, number in drivers_in_legend(few)] == [1] + [2] * len(drawing.OTHERS)
    assert len({colour for _, colour, _ in drivers_in_legend(few)}) == len(few)
    many = few | {"driver_more": 2}
    assert [(label, number) for label, _, number in drivers_in_legend(many)] == [
        ("assertive", 1), ("drivers, each its own type", 2 * len(drawing.OTHERS) + 2),
    ]  # fmt: skip
    assert behaviour_colours(many)["driver_more"] == behaviour_colours(many)["driver_0"]


@given(
    x_m=st.floats(-1e4, 1e4), y_m=st.floats(-1e4, 1e4), turned_rad=st.floats(-7.0, 7.0), ahead_m=st.floats(0.1, 100.0)
)
def test_a_view_turns_its_heading_to_the_right_and_keeps_distances(
    x_m: float, y_m: float, turned_rad: float, ahead_m: float
) -> None:
    view = View(x_m, y_m, turned_rad, 60.0, 20.0, 10.0)
    ahead = (x_m + ahead_m * np.cos(turned_rad), y_m + ahead_m * np.sin(turned_rad))
    assert view.points(ahead) == pytest.approx((ahead_m, 0.0), abs=1e-6)
    corners = view.points(view.outline.exterior.coords)
    assert corners[:4] == pytest.approx(np.array(((30, 10), (-30, 10), (-30, -10), (30, -10))), abs=1e-6)
