"""Files of films: images, one after the other, as GIF, MP4 or PNG."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.report import scenario_drawing as drawing

Image = NDArray[np.uint8]
"""(H, W, 3) red, green, blue."""


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
