"""Films: a drive, or two one above the other, as GIF, MP4 or a still, in the look of the pictures of scenarios."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from math import ceil
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.batch.stored_drive import StoredDrive
from interplan_sumo.errors import InputError
from interplan_sumo.extras import need, need_matplotlib
from interplan_sumo.maps.render import INK, PAPER
from interplan_sumo.report import scenario_drawing as drawing
from interplan_sumo.report.film_shot import Shot
from interplan_sumo.report.key_events import deciding_moment
from interplan_sumo.report.scenario_drawing import View
from interplan_sumo.world.files import writing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Image = NDArray[np.uint8]
"""(H, W, 3) red, green, blue."""
DPI: Final = 100
SCALE: Final = 9.0
"""Pixels per metre."""
WIDTH, HEIGHT, STRIP = 960, 400, 48
"""Pixels of the view of one drive, and of the two lines of words above it."""
HEIGHT_OF_TWO: Final = 296
PLANNER_CHARS: Final = 48
"""Of a planner with its options, so that the legend has room beside it."""
LOST_CHARS: Final = 110
"""Of a line of what was lost: it spans most of a film."""
GIF_SHARE: Final = 0.75
"""GIFs are smaller: they compress worse."""
MOST_PIXELS: Final = 48e6
"""Of the map that a film's views are cut out of; a longer drive is shown smaller."""
FASTEST_FPS: Final = 25.0


def write_film(
    drives: Sequence[StoredDrive],
    path: Path,
    *,
    from_s: float | None = None,
    to_s: float | None = None,
    speed: float = 1.0,
) -> None:
    """Draw one drive, or two of one scenario one above the other, into a .gif, .mp4 or .png.

    Seconds count from the first frame. A .png is one frame, at `from_s`, else
    at the moment that decided the first drive's score. A drive that ends before
    the other stays where it ended. Needs the `plots` extra; InputError says so
    where it is missing, or names the file, time or speed that cannot be.
    """
    if len(drives) not in (1, 2):
        raise InputError(f"a film shows one drive or two, not {len(drives)}; choose them with --planner")
    if not 0.05 <= speed <= 20.0:
        raise InputError(f"--speed {speed:g}: give 0.05 to 20")
    writer = WRITERS.get(path.suffix.lower())
    if writer is None:
        raise InputError(f"{path}: films end in {', '.join(WRITERS)}")
    _require_extra()
    share = GIF_SHARE if path.suffix.lower() == ".gif" else 1.0
    if path.suffix.lower() == ".png":
        start_s = deciding_moment(drives[0]).time_s if from_s is None else from_s
        frames = _frames(drives, start_s, start_s)[:1]
    else:
        frames = _frames(drives, from_s, to_s)
    stride = max(1, ceil(speed / (drives[0].trace.dt_s * FASTEST_FPS)))
    _check_writable(path)
    film = _Film(drives, frames, share)
    with writing(path):
        writer(path, film.images(frames[::stride]), speed / (stride * drives[0].trace.dt_s))


def _require_extra() -> None:
    need("imageio_ffmpeg", "a film", "plots")
    need_matplotlib("a film")


def _check_writable(path: Path) -> None:
    """Before the drawing is done in vain."""
    new = not path.exists()
    with writing(path):
        path.open("ab").close()
    if new:
        path.unlink()


def _frames(drives: Sequence[StoredDrive], from_s: float | None, to_s: float | None) -> list[int]:
    """The frames between two times; those after the end of a drive are the other's."""
    dt_s, last = drives[0].trace.dt_s, max(len(drive.trace) for drive in drives) - 1
    first_s, last_s = 0.0 if from_s is None else from_s, last * dt_s if to_s is None else to_s
    if not 0.0 <= first_s <= last_s or first_s > last * dt_s + 1e-6:
        raise InputError(f"there is nothing from {first_s:g} to {last_s:g} s: the drive has 0 to {last * dt_s:.1f} s")
    return list(range(round(first_s / dt_s), min(last, round(last_s / dt_s)) + 1))


# --- the film ------------------------------------------------------------------------------------


class _Film:
    """Images of frames: the map is drawn once, views are cut out of it, and who moves is drawn on top."""

    def __init__(self, drives: Sequence[StoredDrive], frames: Sequence[int], share: float) -> None:
        height = HEIGHT if len(drives) == 1 else HEIGHT_OF_TWO
        self._size = WIDTH, height
        self._share = share
        shots = [Shot(drive, frames, (WIDTH / SCALE, height / SCALE)) for drive in drives]
        wider = max(1.0, *((shot.whole.width_m * shot.whole.height_m / self._most_m2) ** 0.5 for shot in shots))
        self._shots = [replace(shot, size_m=(wider * WIDTH / SCALE, wider * height / SCALE)) for shot in shots]
        self._scale = WIDTH * share / self._shots[0].size_m[0]
        self._maps = [self._map(shot) for shot in self._shots]

    @property
    def _most_m2(self) -> float:
        """So much of the map can be drawn before memory runs out."""
        return MOST_PIXELS / (SCALE * self._share) ** 2

    def _map(self, shot: Shot) -> Image:
        view = replace(shot.whole, scale=WIDTH * self._share / shot.size_m[0])
        width, height = ceil(view.width_m * view.scale), ceil(view.height_m * view.scale)
        figure = _figure(width, height, self._share)
        figure.set_facecolor(PAPER)
        shot.draw_road(_axes(figure, (0.0, 0.0, 1.0, 1.0), view), view)
        return _pixels(figure)

    def images(self, frames: Sequence[int]) -> Iterator[Image]:
        """The frames, all of one even size."""
        width, height = (_even(self._share * side) for side in self._size)
        strip = _even(self._share * STRIP)
        total = (height + strip) * len(self._shots)
        figure = _figure(width, total, self._share)
        stages = [
            _Stage(figure, shot, (0, total - (height + strip) * (place + 1), width, height), strip, total)
            for place, shot in enumerate(self._shots)
        ]
        paper = np.full((total, width, 4), 255, dtype=np.uint8)
        for frame in frames:
            for stage, shot, road in zip(stages, self._shots, self._maps, strict=True):
                stage.show(frame, shot.view(frame, self._scale), road, paper)
            yield _pixels(figure, paper)


class _Stage:
    """The part of a film's picture that shows one drive."""

    def __init__(self, figure: Figure, shot: Shot, box: tuple[int, int, int, int], strip: int, total: int) -> None:
        _, bottom, width, height = box
        self._shot, self._box = shot, box
        self._axes = _axes(figure, (0.0, bottom / total, 1.0, height / total), shot.view(0, 1.0))
        self._top = total - bottom - height
        row = shot.drive.row
        score = "no score" if row.score is None else f"{100.0 * row.score:.0f}"
        upper, lower = ((bottom + height + share * strip) / total for share in (0.7, 0.27))
        edge = 12.0 / width
        said: dict[str, Any] = {"va": "center", "color": INK}
        figure.text(edge, upper, row.scenario_id, fontsize=13, weight="bold", **said)
        self._time = figure.text(1.0 - edge, upper, "", fontsize=12, ha="right", family="monospace", **said)
        planner = row.planner
        if len(planner) > PLANNER_CHARS:
            planner = f"{planner[: PLANNER_CHARS - 1]}\N{HORIZONTAL ELLIPSIS}"
        who = figure.text(edge, lower, f"{planner}, score {score}", fontsize=12, **said)
        self._legend(figure, who.get_window_extent().x1 / width + 2.0 * edge, lower)
        self._lost = figure.text(
            0.5, (bottom + 8.0) / total, "", fontsize=11, ha="center", va="bottom", color="white", zorder=30,
            bbox={"facecolor": drawing.LOST, "edgecolor": "none", "boxstyle": "round,pad=0.5"},
        )  # fmt: skip
        self._lost.set_visible(False)

    def _legend(self, figure: Figure, left: float, middle: float) -> None:
        """What the colours of the drivers say."""
        width = figure.bbox.width
        there = Counter({str(name) for name in self._shot.drive.trace.actors.behaviour if name})
        for label, colour, _ in drawing.drivers_in_legend(there):
            box = figure.text(left, middle, "\N{BLACK SQUARE}", fontsize=12, va="center", color=colour)
            left = box.get_window_extent().x1 / width + 4.0 / width
            word = figure.text(left, middle, label, fontsize=10, va="center", color=INK)
            left = word.get_window_extent().x1 / width + 14.0 / width

    def show(self, frame: int, view: View, road: Image, paper: Image) -> None:
        """Draw a frame in place of the one before; what lies under it goes onto the paper."""
        axes, (_, _, width, height) = self._axes, self._box
        for artist in (*axes.lines, *axes.patches, *axes.collections):
            artist.remove()
        whole = self._shot.whole
        x_m, y_m = whole.points((view.x_m, view.y_m)).tolist()
        left = round((x_m + (whole.width_m - view.width_m) / 2.0) * view.scale)
        top = round(((whole.height_m - view.height_m) / 2.0 - y_m) * view.scale)
        left, top = min(max(0, left), road.shape[1] - width), min(max(0, top), road.shape[0] - height)
        paper[self._top : self._top + height, :, :3] = road[top : top + height, left : left + width]
        self._shot.draw_frame(axes, frame, view)
        said, lost = self._shot.words(frame)
        self._time.set_text(said)
        self._lost.set_text(fill(lost, LOST_CHARS))
        self._lost.set_visible(bool(lost))


def _even(pixels: float) -> int:
    """H.264 wants even sides."""
    return 2 * round(pixels / 2.0)


def _figure(width: int, height: int, share: float) -> Figure:
    """An empty picture of this size in pixels, whose lines and letters shrink with `share`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    dpi = DPI * share
    figure = Figure(figsize=(width / dpi, height / dpi), dpi=dpi, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def _axes(figure: Figure, place: tuple[float, float, float, float], view: View) -> Axes:
    axes = figure.add_axes(place, facecolor="none")
    axes.set_axis_off()
    axes.set_xlim(-view.width_m / 2.0, view.width_m / 2.0)
    axes.set_ylim(-view.height_m / 2.0, view.height_m / 2.0)
    axes.set_autoscale_on(False)
    return axes


def _pixels(figure: Figure, under: NDArray[np.uint8] | None = None) -> Image:
    """The picture, drawn on top of pixels (H, W, 4) of its size if there are any."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = figure.canvas
    assert isinstance(canvas, FigureCanvasAgg)
    if under is None:
        canvas.draw()
    else:
        renderer = canvas.get_renderer()
        np.asarray(renderer.buffer_rgba())[...] = under  # in place of a background that would be drawn anew
        figure.patch.set_visible(False)
        figure.draw(renderer)
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


# --- files -------------------------------------------------------------------------------------------


def _write_gif(path: Path, images: Iterator[Image], per_s: float) -> None:
    """With the same colours in all frames, which keeps what does not change unchanged."""
    from PIL import Image as Pillow

    opening = next(images)
    palette = Pillow.fromarray(np.concatenate((opening, _swatches(opening.shape[1])))).quantize(128)
    first = Pillow.fromarray(opening).quantize(palette=palette, dither=Pillow.Dither.NONE)
    rest = [Pillow.fromarray(image).quantize(palette=palette, dither=Pillow.Dither.NONE) for image in images]
    duration_ms = max(20, round(1000.0 / per_s))
    first.save(path, "GIF", save_all=True, append_images=rest, duration=duration_ms, loop=0, optimize=False)


def _swatches(width: int) -> Image:
    """Bands of the colours that may not be in a film's first frame."""
    colours = [
        drawing.EGO,
        drawing.GOAL,
        drawing.PERSON,
        drawing.LOST,
        *drawing.BEHAVIOURS.values(),
        *drawing.OBSTACLE_COLOURS.values(),
        *drawing.LIGHTS.values(),
    ]
    rows = [[int(colour[i : i + 2], 16) for i in (1, 3, 5)] for colour in colours]
    return np.repeat(np.array(rows, dtype=np.uint8)[:, None], width, axis=1).repeat(8, axis=0)


def _write_mp4(path: Path, images: Iterator[Image], per_s: float) -> None:
    from imageio_ffmpeg import write_frames as untyped_write_frames

    write_frames: Any = untyped_write_frames

    first = next(images)
    height, width, _ = first.shape
    flags = ["-crf", "20", "-preset", "veryfast", "-movflags", "+faststart"]
    encoder = write_frames(
        str(path), (width, height), fps=per_s, codec="libx264", pix_fmt_out="yuv420p", macro_block_size=2,
        quality=None, output_params=flags, ffmpeg_log_level="error",
    )  # fmt: skip
    encoder.send(None)
    encoder.send(np.ascontiguousarray(first))
    for image in images:
        encoder.send(np.ascontiguousarray(image))
    encoder.close()


def _write_png(path: Path, images: Iterator[Image], _per_s: float) -> None:
    from PIL import Image as Pillow

    Pillow.fromarray(next(images)).save(path, "PNG", optimize=True)


WRITERS: Final[Mapping[str, Callable[[Path, Iterator[Image], float], None]]] = {
    ".gif": _write_gif,
    ".mp4": _write_mp4,
    ".png": _write_png,
}
"""By suffix: they take the file, its images, all of one even size, and how many there are in a second."""
