"""Films: what the file is, how long it plays, and one line for what cannot be."""

from __future__ import annotations

import builtins
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from interplan_sumo.errors import InputError
from interplan_sumo.report.film import STRIP, WIDTH, write_film
from tests.report.tiny_drives import TinyDrive, crossing_at, parked_at, tiny_drive
from tests.worlds import cars

pytest.importorskip("matplotlib", reason="matplotlib is not installed")
imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed")
pillow = pytest.importorskip("PIL.Image")


def driven(frames: int = 21, **changes: Any) -> TinyDrive:
    """Two seconds behind a car, towards a parked one."""
    ahead = [cars((30.0 + frame, 0.0, 0.0, 10.0)) for frame in range(frames)]
    return tiny_drive([10.0] * frames, actors=ahead, obstacles=(parked_at(60.0),), **changes)


def picture(path: Path) -> Any:
    with pillow.open(path) as image:
        return np.asarray(image.convert("RGB"))


def test_a_still_shows_the_frame_that_is_asked_for(tmp_path: Path) -> None:
    for name, at_s in (("early", 0.0), ("late", 2.0)):
        write_film([driven()], tmp_path / f"{name}.png", from_s=at_s)
    early, late = picture(tmp_path / "early.png"), picture(tmp_path / "late.png")
    assert early.shape == late.shape
    assert early.shape[1] == WIDTH
    assert (early[:STRIP] != late[:STRIP]).any()
    assert (early[STRIP:] != late[STRIP:]).any()


def test_equal_calls_write_equal_stills(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_film([driven(jaywalkers=(crossing_at(80.0),))], tmp_path / f"{name}.png", from_s=1.0)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_two_drives_stand_one_above_the_other(tmp_path: Path) -> None:
    write_film([driven(name="idm")], tmp_path / "one.png", from_s=0.0)
    write_film([driven(name="idm"), driven(11, name="other")], tmp_path / "two.png", from_s=2.0)
    one, two = picture(tmp_path / "one.png"), picture(tmp_path / "two.png")
    assert two.shape[1] == one.shape[1]
    assert two.shape[0] > one.shape[0]


@pytest.mark.parametrize(("speed", "frames", "duration_ms"), [(1.0, 21, 100), (0.5, 21, 200), (5.0, 11, 40)])
def test_a_gif_plays_at_the_speed_of_the_drive_or_another(
    tmp_path: Path, speed: float, frames: int, duration_ms: int
) -> None:
    write_film([driven()], tmp_path / "film.gif", speed=speed)
    with pillow.open(tmp_path / "film.gif") as film:
        assert (film.n_frames, film.info["duration"], film.info["loop"]) == (frames, duration_ms, 0)


def test_a_part_of_a_drive_can_be_shown(tmp_path: Path) -> None:
    write_film([driven()], tmp_path / "film.gif", from_s=0.5, to_s=1.0)
    with pillow.open(tmp_path / "film.gif") as film:
        assert film.n_frames == 6


def test_an_mp4_plays_everywhere(tmp_path: Path) -> None:
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


@pytest.mark.parametrize("name", ["film.avi", "film", "film.html"])
def test_another_suffix_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"films end in \.gif, \.mp4, \.png"):
        write_film([driven()], tmp_path / name)
    assert not (tmp_path / name).exists()


@pytest.mark.parametrize("name", ["film.gif", "film.mp4", "film.png"])
def test_a_folder_that_is_not_there_is_said_before_anything_is_drawn(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"cannot write .*nowhere"):
        write_film([driven()], tmp_path / "nowhere" / name)


@pytest.mark.parametrize(("from_s", "to_s"), [(-0.1, None), (2.1, None), (1.0, 0.5)])
def test_times_outside_the_drive_are_refused(tmp_path: Path, from_s: float, to_s: float | None) -> None:
    with pytest.raises(InputError, match=r"the drive has 0 to 2\.0 s"):
        write_film([driven()], tmp_path / "film.gif", from_s=from_s, to_s=to_s)


@pytest.mark.parametrize("speed", [0.0, 0.049, 20.1, float("nan")])
def test_a_speed_that_nobody_can_watch_is_refused(tmp_path: Path, speed: float) -> None:
    with pytest.raises(InputError, match=r"give 0\.05 to 20"):
        write_film([driven()], tmp_path / "film.gif", speed=speed)


def test_three_drives_are_too_many(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="one drive or two, not 3"):
        write_film([driven()] * 3, tmp_path / "film.gif")


def test_without_the_extra_it_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def lacking(name: str, *rest: Any) -> Any:
        if name.partition(".")[0] == "imageio_ffmpeg":
            raise ImportError(name=name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", lacking)
    with pytest.raises(InputError, match=r"films need imageio_ffmpeg; run: pip install 'interplan-sumo\[plots\]'"):
        write_film([driven()], tmp_path / "film.mp4")
