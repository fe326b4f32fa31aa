"""CommonRoad files for tests, written from a few words."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

Points = Sequence[tuple[float, float]]


def points(line: Points) -> str:
    return "".join(f"<point><x>{x}</x><y>{y}</y></point>" for x, y in line)


def lanelet(
    id_: int,
    x: tuple[float, float] = (0.0, 50.0),
    y: float = 0.0,
    inner: str = "",
    *,
    width: float = 3.5,
    before: Sequence[int] = (),
    after: Sequence[int] = (),
) -> str:
    """A straight lanelet from x[0] to x[1] (backwards if x[1] is less) whose left bound lies at y on its left."""
    side = 1.0 if x[1] >= x[0] else -1.0
    left = points([(x[0], y), (x[1], y)])
    right = points([(x[0], y - side * width), (x[1], y - side * width)])
    links = "".join(f'<predecessor ref="{one}"/>' for one in before) + "".join(f'<successor ref="{o}"/>' for o in after)
    bounds = f"<leftBound>{left}</leftBound><rightBound>{right}</rightBound>"
    return f'<lanelet id="{id_}">{bounds}{links}{inner}</lanelet>'


def location(reference: str, shift: tuple[float, float] = (0.0, 0.0), turn: float = 0.0, scale: float = 1.0) -> str:
    move = f"<xTranslation>{shift[0]}</xTranslation><yTranslation>{shift[1]}</yTranslation>"
    move += f"<zRotation>{turn}</zRotation><scaling>{scale}</scaling>"
    place = f"<geoReference>{reference}</geoReference><additionalTransformation>{move}</additionalTransformation>"
    return f"<location><geoTransformation>{place}</geoTransformation></location>"


def sign(id_: int, number: str, value: str | None = None) -> str:
    extra = f"<additionalValue>{value}</additionalValue>" if value is not None else ""
    element = f"<trafficSignElement><trafficSignID>{number}</trafficSignID>{extra}</trafficSignElement>"
    return f'<trafficSign id="{id_}">{element}</trafficSign>'


def scenario(*parts: str, version: str = "2020a", name: str = "DEU_Test-1_1_T-1", step_s: str = "0.1") -> str:
    head = f'benchmarkID="{name}" commonRoadVersion="{version}" timeStepSize="{step_s}"'
    return f'<?xml version="1.0" encoding="utf-8"?>\n<commonRoad {head}>{"".join(parts)}</commonRoad>\n'


def written(folder: Path, text: str) -> Path:
    path = folder / "scenario.xml"
    path.write_text(text, encoding="utf-8")
    return path


def state(
    step: int, x: float, y: float, heading: float | None = 0.0, speed: float | None = 10.0, tag: str = "state"
) -> str:
    inner = f"<position>{points([(x, y)])}</position><time><exact>{step}</exact></time>"
    inner += f"<orientation><exact>{heading}</exact></orientation>" if heading is not None else ""
    inner += f"<velocity><exact>{speed}</exact></velocity>" if speed is not None else ""
    return f"<{tag}>{inner}</{tag}>"


def rectangle(length: float = 4.5, width: float = 1.8, inner: str = "") -> str:
    return f"<shape><rectangle><length>{length}</length><width>{width}</width>{inner}</rectangle></shape>"
