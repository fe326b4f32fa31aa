"""Page: what a person at the wheel looks at; it draws with the files of the replay."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from typing import Final

from interplan_sumo.report.page.html import html
from interplan_sumo.report.replay.page import part, style

DRAWN_WITH: Final = ("decode.js", "camera.js", "scene.js")
"""Files of the replay, in the order in which they are joined with those of the wheel."""
OWN: Final = ("hands.js", "live.js", "wheel.js")


@cache
def wheel_page() -> str:
    """The page; all that it shows comes as events."""
    here = files(__package__ or "")
    own = {name: here.joinpath(name).read_text(encoding="utf-8") for name in (*OWN, "wheel.css")}
    script = "\n".join((*map(part, DRAWN_WITH), *(own[name] for name in OWN)))
    return html("wheel.html.j2", style=f"{style()}\n{own['wheel.css']}", script=script, connects=True)
