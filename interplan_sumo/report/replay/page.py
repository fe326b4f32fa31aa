"""Page: the replay as one self-contained HTML file that asks for nothing from anywhere."""

from __future__ import annotations

import gzip
import json
from base64 import b64encode
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

from markupsafe import Markup

from interplan_sumo.batch.stored_drive import StoredDrive
from interplan_sumo.maps import render
from interplan_sumo.report import scenario_drawing as drawing
from interplan_sumo.report.page.html import html
from interplan_sumo.report.replay.data import replay_data
from interplan_sumo.world.files import writing

SCRIPTS: Final = ("decode.js", "camera.js", "scene.js", "charts.js", "panels.js", "player.js")
"""In the order in which they are joined to one module."""
COLOURS: Final = {
    "ground": render.PAPER,
    "walkway": render.WALKWAY,
    "carpark": render.CARPARK,
    "extra": render.EXTRA,
    "road": render.ASPHALT,
    "junction": render.JUNCTION,
    "edge": drawing.EDGE,
    "marking": drawing.MARKING,
    "middle": drawing.MIDDLE,
    "planner-1": drawing.EGO,
    "route": drawing.ROUTE,
    "goal": drawing.GOAL,
    "person": drawing.PERSON,
    **{f"stop-{kind.name.lower().replace('_', '-')}": colour for kind, colour in render.STOP_COLOURS.items()},
}
"""Of the pictures of maps and scenarios, as properties of the page's style; replay.css has those of the dark."""


def write_replay(drives: Sequence[StoredDrive], path: Path) -> None:
    """Write `replay_page` to a file; InputError if it cannot be written."""
    text = replay_page(drives)
    with writing(path):
        path.write_text(text, encoding="utf-8")


def replay_page(drives: Sequence[StoredDrive]) -> str:
    """One drive, or two of one scenario side by side, as HTML; raises as `replay_data` does."""
    planners = " and ".join(str(drive.row.planner) for drive in drives)
    data = replay_data(drives)
    heading = data["scenario"]["id"]
    return html(
        "replay.html.j2", style=style(), script=_script(), heading=heading, title=f"{heading} with {planners}",
        data=packed(data),
    )  # fmt: skip


def packed(data: Mapping[str, Any]) -> Markup:
    """The data as JSON in a JSON text: compressed, in base64; about a quarter of what it would be in plain.

    So no part of it can be taken for markup.
    """
    plain = json.dumps(data, separators=(",", ":"), allow_nan=False).encode()
    return Markup(json.dumps({"gzip": b64encode(gzip.compress(plain, 9, mtime=0)).decode()}))


@cache
def part(name: str) -> str:
    """One of the files that the page is made from."""
    return files(__package__ or "").joinpath(name).read_text(encoding="utf-8")


@cache
def style() -> str:
    """The style, with the colours of the pictures."""
    colours = "".join(f"--{name}:{colour};" for name, colour in COLOURS.items())
    return f":root{{{colours}}}\n{part('replay.css')}"


@cache
def _script() -> str:
    return "\n".join(part(name) for name in SCRIPTS)
