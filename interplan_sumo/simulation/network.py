"""The SUMO network as arrays: every lane's shape, length, limit and ways on, read once per process.

Reading the file here first also means that SUMO never sees a damaged one: a
network that ends inside a tag would crash the whole process.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_sumo.errors import MapError
from interplan_sumo.maps.network import NetworkIds, SumoPiece
from interplan_sumo.maps.network_file import FileLane, NetworkFile, read_network_file
from interplan_sumo.simulation.lane_polygons import ClipArea, ConvexPart, RectangleIndex, Ring, convex_parts_between
from interplan_sumo.simulation.light_cycles import NO_LIGHTS, LightCycles
from interplan_sumo.simulation.plain_polyline import PlainPolyline
from interplan_sumo.world.geometry import Floats, Polyline

SHAPE_TOLERANCE_M = 0.005
"""Lane shapes are thinned out to this deviation: overlaps are judged to a hundredth of a car's width."""
PIECE_M = 25.0
"""Length of the pieces that lanes are searched in."""
HALF_FOOTPRINT_M = 1.15
"""A car on the centre line keeps clear of what stays this far from it: half its width and a hand's breadth more."""
NOWHERE_M = 50.0
MOST_ROUTES = 256
"""So many routes' lanes are kept."""


@dataclass(frozen=True, slots=True)
class NetworkLink:
    """A way from the end of one normal lane to the start of another."""

    from_lane: str
    to_lane: str
    via: tuple[str, ...]
    """Internal lanes in between, upstream to downstream."""
    direction: str
    """s straight, l left, r right, t turn, L and R partial."""
    major: bool
    """Has right of way where there is no light."""
    light: tuple[str, int] | None
    """Traffic light id and link index."""


@dataclass(frozen=True, eq=False)
class NetworkLane:
    """One SUMO lane. Shapes are in SUMO's frame: map coordinates less the origin."""

    id: str
    edge: str
    index: int
    """Counted from the kerb."""
    line: Polyline
    length_m: float
    """SUMO's length, in which lane positions are given; may differ from the line's."""
    width_m: float
    limit_mps: float
    internal: bool

    def position_of(self, line_arc_m: float) -> float:
        """SUMO's lane position of an arc length on the line."""
        return line_arc_m * self.length_m / self.plain_line.length_m

    def arc_of(self, position_m: float) -> float:
        """Arc length on the line of SUMO's lane position."""
        return position_m * self.plain_line.length_m / self.length_m

    @cached_property
    def plain_line(self) -> PlainPolyline:
        """The line in plain floats."""
        return PlainPolyline(self.line)

    @cached_property
    def pieces(self) -> tuple[LanePiece, ...]:
        """The lane in short pieces, upstream to downstream."""
        line = self.line.resampled(PIECE_M)
        delta = np.diff(line.points, axis=0) / np.diff(line.arc_m)[:, None]
        unit = np.concatenate((delta[:1], delta[:-1] + delta[1:], delta[-1:]))
        unit /= np.hypot(unit[:, 0], unit[:, 1])[:, None]
        # A mitre, so that neighbouring pieces share an edge and the sides stay half a width away from the line.
        reach = self.width_m / 2.0 / np.maximum(0.5, (unit[1:] * delta).sum(axis=1))
        across = np.stack((-unit[:, 1], unit[:, 0]), axis=1) * np.append(reach[:1], reach)[:, None]
        left, right = line.points + across, line.points - across
        pieces: list[LanePiece] = []
        first = 0
        for last in range(1, len(line.points)):
            if last == len(line.points) - 1 or line.arc_m[last + 1] - line.arc_m[first] > PIECE_M + 1e-9:
                rows = slice(first, last + 1)
                polygon = shapely.Polygon(np.concatenate((left[rows], right[rows][::-1])))
                valid = polygon if polygon.is_valid else shapely.convex_hull(polygon)
                pieces.append(
                    LanePiece(
                        self, float(line.arc_m[first]), Polyline(line.points[rows]), valid, left[rows], right[rows]
                    )
                )
                first = last
        return tuple(pieces)


@dataclass(frozen=True, eq=False)
class LanePiece:
    """A short piece of a lane: what is found and cut fast."""

    lane: NetworkLane
    start_m: float
    """Arc length on the lane's line where the piece begins."""
    line: Polyline
    polygon: shapely.Geometry
    left: Floats
    """(N, 2) left ends of the cuts across the lane at the line's vertices."""
    right: Floats
    """(N, 2) right ends."""

    @cached_property
    def plain_line(self) -> PlainPolyline:
        """The line in plain floats."""
        return PlainPolyline(self.line)

    @cached_property
    def convex_parts(self) -> tuple[ConvexPart, ...]:
        """The polygon in convex pieces."""
        return convex_parts_between(self.left, self.right, self.polygon)

    def holds(self, x_m: float, y_m: float) -> bool:
        """Whether a point lies in the polygon or on its edge."""
        return any(part.holds(x_m, y_m) for part in self.convex_parts)

    def reaches(self, x_m: float, y_m: float, reach_m: float) -> bool:
        """Whether a point lies within reach of the polygon."""
        around = (x_m - reach_m, y_m - reach_m, x_m + reach_m, y_m + reach_m)
        return any(not part.apart(*around) and part.distance_m(x_m, y_m) <= reach_m for part in self.convex_parts)


@dataclass(frozen=True, eq=False)
class SumoNetwork:
    """All lanes of one network and how they join."""

    path: Path
    lanes: Mapping[str, NetworkLane]
    edges: Mapping[str, tuple[str, ...]]
    """Normal edges: lanes by index."""
    links: Mapping[str, tuple[NetworkLink, ...]]
    """Ways on from each normal lane."""
    lights: LightCycles = NO_LIGHTS
    """From time 0 on."""

    @cached_property
    def pieces(self) -> tuple[tuple[LanePiece, ...], shapely.STRtree]:
        """All lanes in short pieces and a spatial index over them."""
        pieces = tuple(piece for lane in self.lanes.values() for piece in lane.pieces)
        return pieces, shapely.STRtree([piece.polygon for piece in pieces])

    @cached_property
    def footprints(self) -> NDArray[Any]:
        """Per piece the area that a car on the centre line sweeps, `HALF_FOOTPRINT_M` to both sides."""
        lines = [piece.line.linestring for piece in self.pieces[0]]
        return np.asarray(shapely.buffer(lines, HALF_FOOTPRINT_M, cap_style="flat"))

    @cached_property
    def nowhere(self) -> tuple[float, float]:
        """A point far from all lanes, yet within the 100 m in which SUMO insists on finding a road."""
        points = np.concatenate([lane.line.points for lane in self.lanes.values()])
        easternmost = points[points[:, 0].argmax()]
        return float(easternmost[0]) + NOWHERE_M, float(easternmost[1])

    @cached_property
    def _grid(self) -> RectangleIndex:
        return RectangleIndex(shapely.bounds([piece.polygon for piece in self.pieces[0]]))

    def pieces_near(self, area: ClipArea) -> list[LanePiece]:
        """The pieces whose upright rectangles meet an area's, in the order of `pieces`."""
        pieces = self.pieces[0]
        return [pieces[i] for i in self._grid.within(area.low_x, area.low_y, area.high_x, area.high_y)]

    def pieces_around(self, x_m: float, y_m: float, reach_m: float) -> list[tuple[LanePiece, float]]:
        """Strips that may lie within reach of a point, nearest first; none is nearer than the distance beside it."""
        pieces = self.pieces[0]
        found = self._grid.around(x_m, y_m, reach_m)
        return [(pieces[i], away_m) for away_m, i in found]

    def touches_lane(self, box: Ring) -> bool:
        """Whether a box in SUMO's frame reaches into any lane."""
        area = ClipArea.of(box)
        return any(True for piece in self.pieces_near(area) for _ in area.on(piece.convex_parts))

    @cached_property
    def incoming(self) -> Mapping[str, tuple[NetworkLink, ...]]:
        """Ways into each normal lane."""
        found: dict[str, list[NetworkLink]] = {}
        for links in self.links.values():
            for link in links:
                found.setdefault(link.to_lane, []).append(link)
        return {lane: tuple(links) for lane, links in found.items()}

    @cached_property
    def before(self) -> Mapping[str, tuple[str, ...]]:
        """The lanes, normal or internal, that end where each lane begins."""
        found: dict[str, list[str]] = {}
        for links in self.links.values():
            for link in links:
                for here, there in pairwise((link.from_lane, *link.via, link.to_lane)):
                    found.setdefault(there, []).append(here)
        return {lane: tuple(dict.fromkeys(lanes)) for lane, lanes in found.items()}

    @cached_property
    def after(self) -> Mapping[str, tuple[str, ...]]:
        """The lanes, normal or internal, that begin where each lane ends."""
        found: dict[str, list[str]] = {}
        for lane, befores in self.before.items():
            for before in befores:
                found.setdefault(before, []).append(lane)
        return {lane: tuple(lanes) for lane, lanes in found.items()}

    @cached_property
    def _around(self) -> dict[str, frozenset[str]]:
        around: dict[str, set[str]] = {lane: {lane} for lane in self.lanes}
        for links in self.links.values():
            for link in links:
                chain = (link.from_lane, *link.via, link.to_lane)
                for here, there in pairwise(chain):
                    around[here].add(there)
                    around[there].add(here)
                around[link.from_lane].update(chain)
                around[link.to_lane].update(chain)
        return {lane: frozenset(found) for lane, found in around.items()}

    def continuations(self, lane: str) -> frozenset[str]:
        """The lane, what follows it and what precedes it, up to the next normal lanes."""
        return self._around[lane]

    @cached_property
    def _ways_of_internal(self) -> dict[str, tuple[NetworkLink, ...]]:
        found: dict[str, list[NetworkLink]] = {}
        for links in self.links.values():
            for link in links:
                for lane in link.via:
                    found.setdefault(lane, []).append(link)
        return {lane: tuple(ways) for lane, ways in found.items()}

    def ways_through(self, internal_lane: str) -> tuple[NetworkLink, ...]:
        """The links that an internal lane is part of; one, but for odd junctions."""
        return self._ways_of_internal.get(internal_lane, ())

    def on_route(self, lane: str, route: tuple[str, ...]) -> bool:
        """Whether a lane belongs to an edge of the route or to a way between two of its successive edges."""
        return lane in self.lanes_on(route)

    def lanes_on(self, route: tuple[str, ...]) -> frozenset[str]:
        """All lanes of a route's edges and of the ways between successive ones."""
        found = self._lanes_on.get(route)
        if found is None:
            lanes = {lane for edge in route for lane in self.edges[edge]}
            pairs = set(pairwise(route))
            for lane in tuple(lanes):
                for way in self.links[lane]:
                    if (self.lanes[lane].edge, self.lanes[way.to_lane].edge) in pairs:
                        lanes.update(way.via)
            if len(self._lanes_on) >= MOST_ROUTES:
                self._lanes_on.clear()
            found = self._lanes_on[route] = frozenset(lanes)
        return found

    @cached_property
    def _lanes_on(self) -> dict[tuple[str, ...], frozenset[str]]:
        return {}


def opens_freely(lights: LightCycles, link: NetworkLink) -> bool:
    """Whether a car may drive through without yielding as these lights begin."""
    return link.major if link.light is None else lights.stay_green(*link.light)


def plain_ids(network: SumoNetwork) -> NetworkIds:
    """Ids under which every SUMO lane is its own source lane."""
    pieces = {lane.id: (SumoPiece(lane.id, 0.0, lane.line.length_m),) for lane in network.lanes.values()}
    return NetworkIds((0.0, 0.0), "right", pieces, {})


def read_network(path: Path) -> SumoNetwork:
    """Read a network file; MapError if it is missing or damaged. Cached until the file changes."""
    try:
        stat = path.stat()
    except OSError:
        raise MapError(f"no SUMO network at {path}; build it: interplan-sumo maps convert {path.parent}") from None
    return _read(path, stat.st_mtime_ns, stat.st_size)


@lru_cache(maxsize=16)
def _read(path: Path, _mtime_ns: int, _size: int) -> SumoNetwork:
    try:
        return _network(read_network_file(path))
    except (MapError, ValueError) as error:
        said = str(error) if isinstance(error, MapError) else f"{path} is not a complete SUMO network ({error})"
        raise MapError(f"{said}; build it anew: interplan-sumo maps convert {path.parent}") from None


def _network(file: NetworkFile) -> SumoNetwork:
    if not file.edges:
        raise ValueError("it has no edges")
    lanes = {lane.id: _lane(lane, line) for lane, line in zip(file.in_order, _thinned_out(file.in_order), strict=True)}
    links: dict[str, list[NetworkLink]] = {lane: [] for members in file.edges.values() for lane in members}
    for connection in file.connections:
        link = NetworkLink(
            from_lane=connection.from_lane,
            to_lane=connection.to_lane,
            via=file.via(connection),
            direction=connection.direction or "s",
            major=(connection.state or "M") == "M",
            light=connection.link,
        )
        for end in (link.from_lane, link.to_lane, *link.via):
            if end not in lanes:
                raise ValueError(f"a connection names lane {end}, which does not exist")
        links[link.from_lane].append(link)
    return SumoNetwork(
        path=file.path,
        lanes=lanes,
        edges={edge: tuple(members) for edge, members in file.edges.items()},
        links={lane: tuple(found) for lane, found in links.items()},
        lights=LightCycles.of(file.programs),
    )


def _lane(lane: FileLane, line: Floats) -> NetworkLane:
    if lane.length_m is None or lane.speed_mps is None:
        raise ValueError(f"lane {lane.id} lacks its length or speed")
    return NetworkLane(
        id=lane.id,
        edge=lane.edge,
        index=lane.index,
        line=Polyline(line),
        length_m=lane.length_m,
        width_m=lane.width_m,
        limit_mps=lane.speed_mps,
        internal=lane.internal,
    )


def _thinned_out(lanes: Sequence[FileLane]) -> list[Floats]:
    """(N, 2) the shape of each lane with the vertices that matter."""
    shapes: list[Floats] = []
    for lane in lanes:
        points = lane.shape
        if len(points) < 2:
            raise ValueError(f"lane {lane.id} has no shape")
        if lane.internal and np.ptp(points, axis=0).max() < 1e-3:  # the internal lane of a cut has no extent of its own
            points = np.stack((points[0], points[0] + (1e-3, 0.0)))
        shapes.append(points)
    counts = [len(points) for points in shapes]
    lines = shapely.linestrings(np.concatenate(shapes), indices=np.repeat(np.arange(len(shapes)), counts))
    thin, rows = shapely.get_coordinates(shapely.simplify(lines, SHAPE_TOLERANCE_M), return_index=True)
    return np.split(thin, np.flatnonzero(np.diff(rows)) + 1)
