"""Lanelet2 files for tests: small ones written element by element, and where the real one lies."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal
from xml.sax.saxutils import quoteattr

import numpy as np
from pyproj import Transformer

from interplan_sumo.maps.importers.lanelet2.reader import read_lanelet2
from interplan_sumo.maps.importers.source import SourceLane, SourceMap
from interplan_sumo.world.geometry import Floats
from tests.realdata import real

ORIGIN_M = (458_000.0, 5_428_000.0)
"""Of the tests' metres in UTM zone 32 north."""
UTM, MERCATOR, DEGREES = "EPSG:32632", "EPSG:3857", "EPSG:4326"

Point = tuple[float, float]
Encoding = Literal["degrees", "local", "mercator", "both"]


def example() -> Path:
    """The example map of the library; skips the test where it is absent."""
    return real("lanelet2", "mapping_example.osm")


@dataclass
class Osm:
    """A file in the making; points of equal place are one node, lines through the same points one way."""

    nodes: dict[Point, int] = field(default_factory=dict[Point, int])
    ways: dict[tuple[int, ...], int] = field(default_factory=dict[tuple[int, ...], int])
    tags: dict[int, dict[str, str]] = field(default_factory=dict[int, dict[str, str]])
    members: dict[int, list[tuple[str, int, str]]] = field(default_factory=dict[int, list[tuple[str, int, str]]])
    """Of relations: kind, id and role."""
    next_id: int = 1

    def new_id(self) -> int:
        self.next_id += 1
        return self.next_id

    def way(self, *points: Point, **tags: str) -> int:
        nodes = tuple(self.nodes.setdefault(point, -len(self.nodes) - 1) for point in points)
        if nodes[::-1] in self.ways:
            nodes = nodes[::-1]
        id_ = self.ways.setdefault(nodes, len(self.ways) + 10_000)
        self.tags.setdefault(id_, {}).update(tags)
        return id_

    def relation(self, members: Sequence[tuple[str, int, str]], tags: Mapping[str, str], id_: int | None = None) -> int:
        id_ = self.new_id() if id_ is None else id_
        self.members[id_] = list(members)
        self.tags[id_] = dict(tags)
        return id_

    def lanelet(
        self,
        left: Sequence[Point],
        right: Sequence[Point],
        tags: Mapping[str, str] | None = None,
        rules: Sequence[int] = (),
    ) -> str:
        """A lanelet, a road by default; returns its id as a lane's."""
        members = [("way", self.way(*left), "left"), ("way", self.way(*right), "right")]
        members += [("relation", rule, "regulatory_element") for rule in rules]
        return str(self.relation(members, {"type": "lanelet", "subtype": "road", **(tags or {})}))

    def straight(
        self,
        start_m: float,
        end_m: float,
        left_m: float = 0.0,
        width_m: float = 3.0,
        tags: Mapping[str, str] | None = None,
        rules: Sequence[int] = (),
    ) -> str:
        """A lanelet along x, eastward if `end_m` is larger; `left_m` is y of its left boundary."""
        right_m = left_m - math.copysign(width_m, end_m - start_m)
        return self.lanelet(
            [(start_m, left_m), (end_m, left_m)], [(start_m, right_m), (end_m, right_m)], tags=tags, rules=rules
        )

    def rule(self, subtype: str, *members: tuple[str, int, str], **tags: str) -> int:
        return self.relation(members, {"type": "regulatory_element", "subtype": subtype, **tags})

    def text(self, encoding: Encoding = "degrees", root: str = "", head: str = "") -> str:
        lines = ["<?xml version='1.0' encoding='UTF-8'?>", f"<osm version='0.6' {root}>", head]
        places = np.array(list(self.nodes)).reshape(-1, 2) + ORIGIN_M
        degrees = _moved(UTM, DEGREES, places)
        metres = {"mercator": _moved(UTM, MERCATOR, places), "both": places}.get(encoding, places - ORIGIN_M)
        for row, id_ in enumerate(self.nodes.values()):
            lon, lat = degrees[row] if encoding in ("degrees", "both") else (0.0, 0.0)
            x, y = metres[row]
            local = {} if encoding == "degrees" else {"local_x": f"{x:.4f}", "local_y": f"{y:.4f}"}
            lines += [f"<node id='{id_}' lat='{lat:.11f}' lon='{lon:.11f}'>", *_tags(local), "</node>"]
        for nodes, id_ in self.ways.items():
            lines += [f"<way id='{id_}'>", *(f"<nd ref='{n}'/>" for n in nodes), *_tags(self.tags[id_]), "</way>"]
        for id_, members in self.members.items():
            lines += [f"<relation id='{id_}'>", *_tags(self.tags[id_])]
            lines += [f"<member type='{kind}' ref='{ref}' role='{role}'/>" for kind, ref, role in members]
            lines.append("</relation>")
        return "\n".join((*lines, "</osm>"))

    def write(self, path: Path, encoding: Encoding = "degrees", root: str = "", head: str = "") -> Path:
        path.write_text(self.text(encoding, root, head), encoding="utf-8")
        return path


def read(osm: Osm, file: Path, encoding: Encoding = "degrees", **parts: str) -> SourceMap:
    return read_lanelet2(osm.write(file, encoding, **parts))


def length_m(points: Floats) -> float:
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def middle_m(lane: SourceLane) -> float:
    """Length of the line halfway between points of equal share of the two boundaries."""
    sides: list[Floats] = []
    for line in (lane.left, lane.right):
        shares = np.concatenate(([0.0], np.hypot(*np.diff(line, axis=0).T).cumsum()))
        at = np.linspace(0.0, shares[-1], 101)
        sides.append(np.stack([np.interp(at, shares, line[:, axis]) for axis in (0, 1)], axis=1))
    return length_m((sides[0] + sides[1]) / 2.0)


def crossing() -> Osm:
    """A little of everything: lanes side by side, a light, a stop sign, a two-way road, a crosswalk, a car park."""
    osm = Osm()
    line = osm.way((40.0, 0.0), (40.0, -6.0), type="stop_line")
    light = osm.way((60.0, 2.0), (60.0, 3.0), type="traffic_light")
    rule = osm.rule("traffic_light", ("way", light, "refers"), ("way", line, "ref_line"))
    osm.straight(0.0, 40.0, 0.0, tags={"speed_limit": "30 mph"}, rules=[rule])
    osm.straight(0.0, 40.0, -3.0, rules=[rule])
    osm.straight(40.0, 60.0, 0.0, tags={"turn_direction": "straight"})
    osm.straight(60.0, 100.0, 0.0)
    osm.straight(100.0, 60.0, 0.0)
    osm.straight(100.0, 150.0, 0.0, tags={"subtype": "bicycle_lane"})
    back = osm.straight(0.0, 40.0, 20.0, 6.0, tags={"one_way": "no"})
    sign = osm.way((0.0, 30.0), (0.0, 31.0), type="traffic_sign", subtype="stop_sign")
    osm.rule("right_of_way", ("relation", int(back), "yield"), ("way", sign, "refers"))
    osm.lanelet([(40.0, -6.0), (42.0, -6.0)], [(40.0, -9.0), (42.0, -9.0)], tags={"subtype": "crosswalk"})
    outline = [osm.way((0.0, 40.0), (10.0, 40.0)), osm.way((0.0, 40.0), (0.0, 50.0), (10.0, 40.0))]
    osm.relation([("way", id_, "outer") for id_ in outline], {"type": "multipolygon", "subtype": "parking"})
    return osm


def _moved(start: str, end: str, points: np.ndarray) -> np.ndarray:
    return np.stack(Transformer.from_crs(start, end, always_xy=True).transform(*points.T), axis=1)


def _tags(tags: Mapping[str, str]) -> list[str]:
    return [f"<tag k='{key}' v={quoteattr(value)}/>" for key, value in tags.items()]
