"""Atlas page: a map of two parameters, what tells failures apart, and near misses side by side, as one HTML file."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Final
from urllib.parse import quote

import numpy as np

from interplan_sumo.report.atlas import Atlas, AtlasAxis, AtlasScene, nearness, value_text
from interplan_sumo.report.page.drives import band, replays_folder, shown
from interplan_sumo.report.page.drives import replay_name as drive_replay
from interplan_sumo.report.page.html import html, style_of
from interplan_sumo.verification.hard_folder import TRIED
from interplan_sumo.world.files import writing
from interplan_sumo.world.geometry import Floats

WIDE, HIGH = 640.0, 420.0
"""Of the map, in its own units."""
CELLS: Final = 16
"""Of the shading, along each side."""
TICKS: Final = 4
MOST_TOLD: Final = 8
"""Parameters in the table."""
SPREAD: Final = 0.7
"""Of the share of a word that its scenes are spread over."""
GOLDEN: Final = 0.618034
"""Multiples of it lie evenly between whole numbers, however many there are."""
LEAST_NEAR: Final = 0.3
"""Scenes that must lie near a cell for it to be shaded."""
RED, GREEN = 0.38, 0.25
"""How dark a cell is where all fails, and where all is solved."""
LETTER: Final = 7.6
"""Width of a letter beside the map."""


@dataclass(frozen=True, slots=True)
class AtlasMark:
    """A scene on the map."""

    x: float
    y: float
    solved: bool
    text: str


@dataclass(frozen=True, slots=True)
class AtlasMap:
    """What is drawn; x to the right and y upwards, 0 to 1 in `places`, in units of the drawing in the rest."""

    marks: tuple[AtlasMark, ...]
    places: Floats
    """(N, 2)"""
    shades: tuple[tuple[float, float, float], ...]
    """Lower left corner of a cell, and the share of failures that its neighbours suggest."""
    cell: tuple[float, float]
    along: tuple[tuple[float, str], ...]
    upwards: tuple[tuple[float, str], ...]


@dataclass(frozen=True, slots=True)
class SceneLink:
    """A scene as the page tells it: how to watch its drive, or how to make that."""

    id: str
    score: str
    band: str
    link: str
    make: str


def write_atlas_page(atlas: Atlas, path: Path, command: str) -> None:
    """The page; InputError if it cannot be written. Names are text whatever they hold."""
    text = atlas_page(atlas, command, path)
    with writing(path, "give another file as --html"):
        path.write_text(text, encoding="utf-8")


def atlas_page(atlas: Atlas, command: str = "", path: Path | None = None) -> str:
    """The atlas as HTML; replays that lie beside `path`, where the page will be, are linked."""
    drawn = atlas_map(atlas)
    links = {scene.id: scene_link(atlas, scene, path) for scene in atlas.scenes}
    return html(
        "atlas.html.j2",
        style=style_of("page.css", "atlas.css"),
        script="",
        atlas=atlas,
        map=drawn,
        left=round(40.0 + LETTER * max(len(text) for _, text in drawn.upwards)),
        summary=summary(atlas),
        told=told_table(atlas),
        pairs=[(pair, links[pair.failed.id], links[pair.solved.id]) for pair in atlas.near],
        scenes=[
            (links[scene.id], [value_text(scene.draws[axis.name].value) if axis.name in scene.draws else "-"
                               for axis in atlas.shown])
            for scene in sorted(atlas.scenes, key=lambda scene: (scene.score, scene.id))
        ],
        command=command,
        red=RED,
        green=GREEN,
        wide=WIDE,
        high=HIGH,
    )  # fmt: skip


def summary(atlas: Atlas) -> list[str]:
    """How much it solves, and how far to trust the two parameters."""
    many = len(atlas.scenes)
    mean = 100.0 * sum(scene.score for scene in atlas.scenes) / many
    names = " and ".join(axis.name for axis in atlas.shown)
    lines = [f"{atlas.planner} solves {atlas.solved} of {many} scenes of {atlas.family}, mean score {mean:.0f}."]
    if atlas.told is None:
        return [*lines, f"All or none are solved, or there are too few: nothing tells them apart. Shown: {names}."]
    chance = "" if atlas.by_chance is None else f"; in {100.0 * atlas.by_chance:.0f} % of shuffles chance tells as much"
    weak = " That may be chance: drive more scenes." if (atlas.by_chance or 0.0) > 0.05 else ""
    share = f"{max(100.0 * atlas.told.share, 0.0):.0f} %"
    return [*lines, f"{names} tell {share} of what is uncertain about whether a scene is solved{chance}.{weak}"]


def told_table(atlas: Atlas) -> dict[str, object]:
    """Each parameter alone, with what it usually is where the planner fails and where it does not."""
    failed = [scene for scene in atlas.scenes if not scene.solved]
    solved = [scene for scene in atlas.scenes if scene.solved]
    rows = [
        (
            told.names[0],
            f"{100.0 * told.share:+.0f} %",
            _usual(failed, atlas.axes[told.names[0]]),
            _usual(solved, atlas.axes[told.names[0]]),
        )
        for told in atlas.alone[:MOST_TOLD]
    ]
    columns = ("parameter", "tells alone", "usual where it fails", "usual where it solves")
    return {"columns": columns, "rows": rows}


def _usual(scenes: Sequence[AtlasScene], axis: AtlasAxis) -> str:
    """Median of a number, the most frequent of words with its share."""
    values = [scene.draws[axis.name].value for scene in scenes if axis.name in scene.draws]
    if not values:
        return "-"
    if not axis.options:
        return value_text(str(median(map(float, values))))
    word, count = Counter(values).most_common(1)[0]
    return f"{word} ({100.0 * count / len(values):.0f} %)"


def atlas_map(atlas: Atlas) -> AtlasMap:
    """Marks, shading and ticks."""
    across, up = atlas.shown
    both = [scene for scene in atlas.scenes if across.name in scene.draws and up.name in scene.draws]
    places = np.array([[_spread(number, scene, axis) for axis in atlas.shown] for number, scene in enumerate(both)])
    marks = [
        AtlasMark(
            round(WIDE * x, 1),
            round(HIGH * (1.0 - y), 1),
            scene.solved,
            f"{scene.id}: {100.0 * scene.score:.0f}; "
            + ", ".join(f"{axis.name} {value_text(scene.draws[axis.name].value)}" for axis in atlas.shown),
        )
        for scene, (x, y) in zip(both, places.tolist(), strict=True)
    ]
    columns, rows = (_nearness(axis, both) for axis in atlas.shown)
    failed = np.array([not scene.solved for scene in both], dtype=np.float64)
    width, height = WIDE / len(columns), HIGH / len(rows)
    shades = [
        (round(column * width, 1), round(HIGH - (row + 1) * height, 1), round(float(weight @ failed) / total, 3))
        for column, along in enumerate(columns)
        for row, upwards in enumerate(rows)
        if (total := float((weight := along * upwards).sum())) > LEAST_NEAR
    ]
    return AtlasMap(
        tuple(marks),
        places,
        tuple(shades),
        (width, height),
        tuple((round(WIDE * at, 1), text) for at, text in axis_ticks(across)),
        tuple((round(HIGH * (1.0 - at), 1), text) for at, text in axis_ticks(up)),
    )


def _spread(number: int, scene: AtlasScene, axis: AtlasAxis) -> float:
    """Where a scene lies along an axis: anywhere in the share of a word, so that none hides another."""
    value = scene.draws[axis.name].value
    if not axis.options:
        return axis.place(value)
    aside = number * GOLDEN % 1.0 - 0.5
    return axis.place(value) + SPREAD * aside / len(axis.options)


def _nearness(axis: AtlasAxis, scenes: Sequence[AtlasScene]) -> list[Floats]:
    """Of each cell along an axis, (N,) how near each scene is: by kernel for numbers, the same or not for words."""
    values = [scene.draws[axis.name].value for scene in scenes]
    if axis.options:
        return [np.array([value == option for value in values], dtype=np.float64) for option in axis.options]
    places = np.array([axis.place(value) for value in values])
    return [nearness(places, (number + 0.5) / CELLS) for number in range(CELLS)]


def axis_ticks(axis: AtlasAxis) -> list[tuple[float, str]]:
    """Places and what stands at them."""
    if axis.options:
        return [(axis.place(word), word) for word in axis.options]
    values = [axis.low + (axis.high - axis.low) * number / TICKS for number in range(TICKS + 1)]
    return [(number / TICKS, f"{value:.3g}") for number, value in enumerate(values)]


def replay_name(atlas: Atlas, scene: AtlasScene) -> str:
    """File name of the replay of a drive, as reports call it."""
    return drive_replay(scene.id, atlas.planner, scene.seed, scene.trace_hash)


def scene_link(atlas: Atlas, scene: AtlasScene, page: Path | None) -> SceneLink:
    """How to watch a drive: its replay beside the page, or the command that makes one."""
    folder = None if page is None else replays_folder(page)
    name, score = replay_name(atlas, scene), round(100.0 * scene.score, 1)
    link = f"{quote(folder.name)}/{quote(name)}#decides" if folder is not None and (folder / name).is_file() else ""
    return SceneLink(scene.id, shown(score), band(score), link, "" if link else _make(atlas, scene, name))


def _make(atlas: Atlas, scene: AtlasScene, name: str) -> str:
    """The command that makes a replay; a drive that was not kept is driven first."""
    run = atlas.run or Path("runs/atlas")
    seed = ["--seed", str(scene.seed)] if scene.seed else []
    watch = ["interplan-sumo", "replay", str(run), scene.id, "--planner", atlas.planner, *seed, "--html", name]
    if atlas.run is not None:
        return shlex.join(watch)
    file = atlas.source / TRIED / "scenarios.yaml"
    given = ["--planner", atlas.planner, "--scenarios", str(file), "--scenarios", scene.id, "--out", str(run)]
    return f"{shlex.join(['interplan-sumo', 'run', *given])} && {shlex.join(watch)}"
