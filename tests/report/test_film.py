"""Films: what the file is, how long it plays, what the lights show, and one line for what cannot be."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import replace
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from interplan_sumo.errors import InputError
from interplan_sumo.maps.render import STOP_COLOURS
from interplan_sumo.report import scenario_drawing as drawing
from interplan_sumo.report.film import HEIGHT, PLANNER_CHARS, SCALE, STRIP, WIDTH, write_film
from interplan_sumo.report.film_shot import AHEAD_M, Shot
from interplan_sumo.scenario.scenario import LanePosition, Obstacle
from interplan_sumo.world.roads import StopLineKind
from interplan_sumo.world.signals import Signals, SignalStatus
from tests.report.tiny_drives import TinyDrive, crossing_at, drive_at_lights, parked_at, tiny_drive
from tests.worlds import cars, signals

pytestmark = pytest.mark.skipif(
    not all(map(find_spec, ("matplotlib", "imageio_ffmpeg"))),
    reason="needs the extra: pip install 'interplan-sumo[plots]'",
)


def driven(frames: int = 21, **changes: Any) -> TinyDrive:
    """Two seconds behind a car, towards a parked one."""
    ahead = [cars((30.0 + frame, 0.0, 0.0, 10.0)) for frame in range(frames)]
    return tiny_drive([10.0] * frames, actors=ahead, obstacles=(parked_at(60.0),), **changes)


def opened(path: Path) -> Any:
    from PIL import Image

    return Image.open(path)


def picture(path: Path) -> Any:
    with opened(path) as image:
        return np.asarray(image.convert("RGB"))


def test_a_still_shows_the_frame_that_is_asked_for_and_is_the_same_every_time(tmp_path: Path) -> None:
    for name, at_s in (("early", 0.0), ("late", 2.0), ("again", 2.0)):
        write_film([driven(jaywalkers=(crossing_at(80.0),))], tmp_path / f"{name}.png", from_s=at_s)
    early, late = picture(tmp_path / "early.png"), picture(tmp_path / "late.png")
    assert early.shape == late.shape
    assert early.shape[1] == WIDTH
    assert (early[:STRIP] != late[:STRIP]).any()
    assert (early[STRIP:] != late[STRIP:]).any()
    assert (tmp_path / "late.png").read_bytes() == (tmp_path / "again.png").read_bytes()


@pytest.mark.slow
def test_two_drives_stand_one_above_the_other(tmp_path: Path) -> None:
    write_film([driven(name="idm")], tmp_path / "one.png", from_s=0.0)
    write_film([driven(name="idm"), driven(11, name="other")], tmp_path / "two.png", from_s=2.0)
    one, two = picture(tmp_path / "one.png"), picture(tmp_path / "two.png")
    assert two.shape[1] == one.shape[1]
    assert two.shape[0] > one.shape[0]


def head(tmp_path: Path, **names: Any) -> Any:
    """The words above a still."""
    write_film([driven(**names)], tmp_path / "head.png", from_s=0.0)
    return picture(tmp_path / "head.png")[:STRIP]


@pytest.mark.slow
def test_a_planner_with_many_options_is_cut_so_that_the_rest_has_room(tmp_path: Path) -> None:
    whole, cut, longer = (head(tmp_path, name="p" * (PLANNER_CHARS + more)) for more in (0, 1, 40))
    assert (cut == longer).all()
    assert not (whole == cut).all()


def test_a_long_name_leaves_the_time_alone(tmp_path: Path) -> None:
    names = "nudge/0", "starting_straight_traffic_light_intersection_traversal/0"
    short, long = (head(tmp_path, scenario_id=name)[:, WIDTH * 2 // 3 :] for name in names)
    assert (short == long).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "frames", "duration_ms"),
    [({"speed": 0.5}, 21, 200), ({"speed": 5.0}, 11, 40), ({"from_s": 0.5, "to_s": 1.0}, 6, 100)],
)
def test_a_gif_shows_a_part_of_the_drive_at_its_speed_or_another(
    tmp_path: Path, options: dict[str, float], frames: int, duration_ms: int
) -> None:
    write_film([driven()], tmp_path / "film.gif", **options)
    with opened(tmp_path / "film.gif") as film:
        assert (film.n_frames, film.info["duration"], film.info["loop"]) == (frames, duration_ms, 0)


def test_an_mp4_plays_everywhere(tmp_path: Path) -> None:
    import imageio_ffmpeg

    write_film([driven()], tmp_path / "film.mp4")
    probe = subprocess.run(
        [imageio_ffmpeg.get_ffmpeg_exe(), "-i", tmp_path / "film.mp4"], capture_output=True, text=True, check=False
    )
    (stream,) = (line for line in probe.stderr.splitlines() if "Video:" in line)
    assert "h264" in stream
    assert "yuv420p" in stream
    assert "10 fps" in stream
    width, height = next(
        map(int, part.strip().split()[0].split("x")) for part in stream.split(",") if f"{WIDTH}x" in part
    )
    assert (width % 2, height % 2) == (0, 0)


@pytest.mark.parametrize(
    ("name", "drives", "options", "said"),
    [
        ("film.avi", 1, {}, r"films end in \.gif, \.mp4, \.png"),
        ("film", 1, {}, r"films end in \.gif, \.mp4, \.png"),
        ("nowhere/film.mp4", 1, {}, "cannot write .*nowhere"),
        ("film.gif", 1, {"from_s": -0.1}, r"the drive has 0 to 2\.0 s"),
        ("film.gif", 1, {"from_s": 2.1}, r"the drive has 0 to 2\.0 s"),
        ("film.gif", 1, {"from_s": 1.0, "to_s": 0.5}, r"the drive has 0 to 2\.0 s"),
        ("film.gif", 1, {"speed": 0.049}, r"give 0\.05 to 20"),
        ("film.gif", 1, {"speed": 20.1}, r"give 0\.05 to 20"),
        ("film.gif", 1, {"speed": float("nan")}, r"give 0\.05 to 20"),
        ("film.gif", 3, {}, "one drive or two, not 3"),
    ],
)
def test_a_film_that_cannot_be_is_refused_in_one_line(
    tmp_path: Path, name: str, drives: int, options: dict[str, float], said: str
) -> None:
    with pytest.raises(InputError, match=said):
        write_film([driven()] * drives, tmp_path / name, **options)
    assert not [*tmp_path.iterdir()]


def test_without_the_extra_it_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(
        InputError, match=r"a film needs imageio_ffmpeg, .*; run: pip install 'interplan-sumo\[plots\]'"
    ):
        write_film([driven()], tmp_path / "film.mp4")


# --- lights --------------------------------------------------------------------------------------

LANE_END = (-12.0, -1.75)
"""Where the bar lies across lane 1, on which the ego comes."""
EVERY_TURN = ("12", "13", "14")


def still(tmp_path: Path, drive: TinyDrive) -> Any:
    write_film([drive], tmp_path / "still.png", from_s=0.0)
    return picture(tmp_path / "still.png")


def pixel_at(x_m: float, y_m: float, ego_x_m: float = -30.0) -> tuple[int, int]:
    """Row and column in a still of `drive_at_lights`."""
    column = WIDTH / 2 + (x_m - ego_x_m - AHEAD_M) * SCALE
    return round(STRIP + HEIGHT / 2 - (y_m + 1.75) * SCALE), round(column)


def has_colour(image: Any, colour: str, tolerance: int = 0) -> Any:
    """(H, W) bool."""
    rgb = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
    return (np.abs(image.astype(int) - rgb) <= tolerance).all(axis=-1)


def test_a_bar_lies_across_the_lane_s_end_and_only_there(tmp_path: Path) -> None:
    image = still(tmp_path, drive_at_lights(signals(red=EVERY_TURN)))
    (top, left), (bottom, right) = pixel_at(-12.45, 0.0), pixel_at(-11.55, -3.5)
    red = has_colour(image, drawing.LIGHTS[SignalStatus.RED])
    assert red[top:bottom, left:right].mean() > 0.7  # its outermost pixels are softened
    red[top : bottom + 1, left : right + 1] = False
    assert not red.any()
    # the stop line is paint, so that only the light says what it shows
    assert not has_colour(image, STOP_COLOURS[StopLineKind.TRAFFIC_LIGHT], tolerance=30).any()


def test_connectors_of_one_lane_show_each_its_own(tmp_path: Path) -> None:
    image = still(tmp_path, drive_at_lights(signals(red=["14"], yellow=["13"], green=["12"])))
    for y_m, status in zip(
        (-0.6, -1.75, -2.9), (SignalStatus.RED, SignalStatus.YELLOW, SignalStatus.GREEN), strict=True
    ):
        assert has_colour(image[pixel_at(-12.2, y_m)], drawing.LIGHTS[status]), status


def test_a_bar_changes_with_its_light_and_keeps_its_colour_after_the_end(tmp_path: Path) -> None:
    red, green = signals(red=EVERY_TURN), signals(green=EVERY_TURN)
    changing = drive_at_lights(red, red, green)
    write_film([changing], tmp_path / "film.gif")
    place = tuple(round(0.75 * each) for each in pixel_at(-12.0, -0.6))
    with opened(tmp_path / "film.gif") as film:
        colours = []
        for frame in range(film.n_frames):
            film.seek(frame)
            colours.append(np.asarray(film.convert("RGB"))[place])
    for colour, status in zip(colours, (SignalStatus.RED, SignalStatus.RED, SignalStatus.GREEN), strict=True):
        assert has_colour(colour, drawing.LIGHTS[status], tolerance=12)
    shot = Shot(changing, (0, 9), (100.0, 40.0))
    assert {status for _, status in shot.shown(9, shot.view(9, SCALE))} == {SignalStatus.GREEN}


@pytest.mark.slow
def test_nothing_is_drawn_where_no_light_is_or_none_was_seen(tmp_path: Path) -> None:
    unlit = replace(driven(), trace=replace(driven().trace, signals=(signals(red=["11"]),) * 21))
    for dark in (drive_at_lights(Signals.none()), unlit):
        image = still(tmp_path, dark)
        assert not any(has_colour(image, drawing.LIGHTS[status]).any() for status in list(SignalStatus)[:3])


def test_the_ego_and_what_stands_on_a_bar_hide_it(tmp_path: Path) -> None:
    red = signals(red=EVERY_TURN)
    over = still(tmp_path, drive_at_lights(red, from_x_m=LANE_END[0]))
    assert has_colour(over[pixel_at(*LANE_END, LANE_END[0])], drawing.EGO)
    parked = still(tmp_path, drive_at_lights(red, obstacles=(Obstacle(LanePosition("1", 60.0)),)))
    middle, beside = pixel_at(-12.2, -1.75), pixel_at(-12.2, -0.4)
    assert not has_colour(parked[middle], drawing.LIGHTS[SignalStatus.RED], tolerance=40)
    assert has_colour(parked[beside], drawing.LIGHTS[SignalStatus.RED])


def test_lights_out_of_view_cost_nothing() -> None:
    lit, dark = (
        Shot(drive_at_lights(*[shown] * 51, speed_mps=10.0, from_x_m=-66.0), range(51), (40.0, 20.0))
        for shown in (signals(red=EVERY_TURN), Signals.none())
    )
    assert (len(lit.lights), len(dark.lights)) == (3, 0)
    assert [len(lit.shown(frame, lit.view(frame, SCALE))) for frame in (0, 50)] == [0, 3]


def test_lights_have_the_colours_that_they_have_on_the_page_of_a_replay() -> None:
    style = files("interplan_sumo.report.replay").joinpath("replay.css").read_text()
    told = dict(re.findall(r"--light-(\w+): (#\w+);", style))
    assert told == {status.name.lower(): colour for status, colour in drawing.LIGHTS.items()}
