"""OpenDRIVE files for tests, written from a few words."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path


def geometry(
    shape: str = "<line/>", length: float = 100.0, s: float = 0.0, place: tuple[float, ...] = (0, 0, 0)
) -> str:
    x, y, heading = place
    return f'<geometry s="{s}" x="{x}" y="{y}" hdg="{heading}" length="{length}">{shape}</geometry>'


def lane(
    id_: int,
    kind: str = "driving",
    width: float | Sequence[tuple[float, ...]] = 3.5,
    inner: str = "",
    *,
    before: Sequence[int] = (),
    after: Sequence[int] = (),
) -> str:
    """A lane of one width, or of cubic polynomials (sOffset, a, b, c, d)."""
    rows = [(0.0, width)] if isinstance(width, float | int) else width
    links = "".join(f'<predecessor id="{one}"/>' for one in before) + "".join(f'<successor id="{o}"/>' for o in after)
    widths = "".join(cubic("width", "sOffset", row) for row in rows)
    return f'<lane id="{id_}" type="{kind}"><link>{links}</link>{widths}{inner}</lane>'


def cubic(tag: str, station: str, row: Sequence[float]) -> str:
    padded = [*row, *[0.0] * (5 - len(row))]
    return (
        f"<{tag} " + " ".join(f'{key}="{value}"' for key, value in zip((station, *"abcd"), padded, strict=True)) + "/>"
    )


def section(*lanes: str, s: float = 0.0, one_side: bool = False) -> str:
    left = "".join(text for text in lanes if not text.startswith('<lane id="-'))
    right = "".join(text for text in lanes if text.startswith('<lane id="-'))
    sides = (f"<left>{left}</left>" if left else "") + (f"<right>{right}</right>" if right else "")
    alone = ' singleSide="true"' if one_side else ""
    return f'<laneSection s="{s}"{alone}>{sides}</laneSection>'


def to_road(id_: str, contact: str = "start", more: str = "") -> str:
    return f'elementType="road" elementId="{id_}" contactPoint="{contact}" {more}'


def to_junction(id_: str) -> str:
    return f'elementType="junction" elementId="{id_}"'


def road(
    id_: str,
    *sections: str,
    plan: str | None = None,
    links: tuple[str, str] = ("", ""),
    head: str = 'junction="-1"',
    inner: str = "",
    offsets: str = "",
) -> str:
    """A road; 100 m to the east from 0, 0 if no plan says otherwise."""
    before, after = links
    link = (f"<predecessor {before}/>" if before else "") + (f"<successor {after}/>" if after else "")
    view = geometry() if plan is None else plan
    lanes = f"<lanes>{offsets}{''.join(sections) or section(lane(-1))}</lanes>"
    length = sum(map(float, re.findall(r'length="([^"]*)"', view)))
    return (
        f'<road id="{id_}" length="{length}" {head}><link>{link}</link><planView>{view}</planView>{inner}{lanes}</road>'
    )


def signal(
    id_: str, s: float, kind: str = "1000001", more: str = 'dynamic="yes" orientation="+"', inner: str = ""
) -> str:
    return f'<signal id="{id_}" s="{s}" t="-4" type="{kind}" country="OpenDRIVE" {more}>{inner}</signal>'


def connection(incoming: str, other: str, *lanes: tuple[int, int], key: str = "connectingRoad") -> str:
    links = "".join(f'<laneLink from="{a}" to="{b}"/>' for a, b in lanes)
    head = f'id="{incoming}-{other}" incomingRoad="{incoming}" {key}="{other}" contactPoint="start"'
    return f"<connection {head}>{links}</connection>"


def xodr(*parts: str, header: str = '<header revMajor="1" revMinor="6"/>', root: str = "OpenDRIVE") -> str:
    return f'<?xml version="1.0"?>\n<{root}>{header}{"".join(parts)}</{root.split()[0]}>\n'


def written(folder: Path, text: str) -> Path:
    path = folder / "town.xodr"
    path.write_text(text, encoding="utf-8")
    return path


def crossing(**more: str) -> str:
    """Four roads of two lanes that meet in junction 9, with a connecting road from 1 to 3 and one from 1 to 4.

    1 comes from the west and ends 10 m before the middle, at 100, 0; 3 goes on east from 120, 0, 4 north from 110, 10.
    """
    both = section(lane(1), lane(-1))
    east = geometry("<line/>", 100.0, place=(120, 0, 0))
    north = geometry("<line/>", 50.0, place=(110, 10, 1.5707963267948966))
    ahead = geometry("<line/>", 20.0, place=(100, 0, 0))
    left = geometry('<arc curvature="0.1"/>', 15.707963267948966, place=(100, 0, 0))
    way = section(lane(-1, before=(-1,), after=(-1,)))
    inside = 'junction="9"'
    from_1 = to_road("1", "end")
    return "".join(
        (
            road("1", both, links=("", to_junction("9")), inner=more.get("west", "")),
            road("3", both, plan=east, links=(to_junction("9"), "")),
            road("4", both, plan=north, links=(to_junction("9"), "")),
            road("13", way, plan=ahead, head=inside, links=(from_1, to_road("3")), inner=more.get("ahead", "")),
            road("14", way, plan=left, head=inside, links=(from_1, to_road("4"))),
            f'<junction id="9">{connection("1", "13", (-1, -1))}{connection("1", "14", (-1, -1))}</junction>',
        )
    )
