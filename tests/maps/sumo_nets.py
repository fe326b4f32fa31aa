"""SUMO networks for tests: made by netconvert from plain XML, or written by hand."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Sequence
from pathlib import Path

from interplan_sumo.maps.to_sumo import program_path, sumo_home

UNPLACED = (
    '<location netOffset="0.00,0.00" convBoundary="0.00,0.00,0.00,0.00" '
    'origBoundary="0.00,0.00,0.00,0.00" projParameter="!"/>'
)


def node(id_: str, x: float, y: float, type_: str = "priority") -> str:
    return f'<node id="{id_}" x="{x}" y="{y}" type="{type_}"/>'


def edge(id_: str, start: str, end: str, lanes: int = 1, priority: int = 1, inner: str = "", **more: str) -> str:
    extra = "".join(f' {name}="{value}"' for name, value in more.items())
    head = f'id="{id_}" from="{start}" to="{end}" numLanes="{lanes}" priority="{priority}" speed="13.9"'
    return f"<edge {head}{extra}>{inner}</edge>"


def made(folder: Path, nodes: Sequence[str], edges: Sequence[str], *options: str, name: str = "made.net.xml") -> Path:
    """The network that netconvert makes, without changing coordinates."""
    (folder / "made.nod.xml").write_text(f"<nodes>{''.join(nodes)}</nodes>")
    (folder / "made.edg.xml").write_text(f"<edges>{''.join(edges)}</edges>")
    command = [str(program_path("netconvert")), "-n", "made.nod.xml", "-e", "made.edg.xml", "-o", name]
    fixed = ("--precision=4", "--precision.geo=9", "--xml-validation=never", "--no-warnings", "--aggregate-warnings=0")
    environment = {**os.environ, "SUMO_HOME": str(sumo_home())}
    done = subprocess.run([*command, *fixed, *options], cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder / name


def crossroads(
    folder: Path, type_: str = "priority", *options: str, lanes: int = 2, name: str = "made.net.xml"
) -> Path:
    """A road from west to east with `lanes` each way, crossed by a lesser one with one lane each way; 100 m arms."""
    arms = {"w": (-100.0, 0.0), "e": (100.0, 0.0), "s": (0.0, -100.0), "n": (0.0, 100.0)}
    nodes = [node("c", 0.0, 0.0, type_), *(node(id_, *at) for id_, at in arms.items())]
    edges = [
        text
        for id_ in arms
        for text in (
            edge(f"{id_}c", id_, "c", lanes if id_ in "we" else 1, 2 if id_ in "we" else 1),
            edge(f"c{id_}", "c", id_, lanes if id_ in "we" else 1, 2 if id_ in "we" else 1),
        )
    ]
    return made(folder, nodes, edges, "--offset.disable-normalization", "--no-turnarounds", *options, name=name)


def lane(id_: str, shape: str, index: int = 0, permission: str = "", **more: str) -> str:
    """A lane; `permission` is a whole attribute, such as allow="bus"."""
    extra = " ".join((permission, *(f'{name}="{value}"' for name, value in more.items())))
    return f'<lane id="{id_}" index="{index}" speed="10" length="1" shape="{shape}" {extra}/>'


def by_hand(*parts: str, location: str = UNPLACED) -> str:
    """The text of a network of some elements."""
    return f'<?xml version="1.0" encoding="UTF-8"?>\n<net version="1.20">{location}{"".join(parts)}</net>\n'


def written(folder: Path, text: str, name: str = "hand.net.xml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path
