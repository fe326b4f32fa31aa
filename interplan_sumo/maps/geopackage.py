"""nuPlan's GeoPackage maps as `Roads`."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
import shapely

from interplan_sumo.errors import MapError
from interplan_sumo.maps import schema
from interplan_sumo.maps.driving_side import shown_side
from interplan_sumo.maps.tables import GeoPackage, LayerTable
from interplan_sumo.world.geometry import Floats, Polyline
from interplan_sumo.world.roads import (
    Area,
    Connector,
    DrivingSide,
    Intersection,
    IntersectionKind,
    Lane,
    Roadblock,
    Roads,
    StopLine,
    StopLineKind,
    Turn,
)

_Code = TypeVar("_Code", Turn, StopLineKind, IntersectionKind)
_Vertices = Mapping[str, Floats]


def read_map(path: Path, name: str | None = None) -> Roads:
    """The map in one GeoPackage file, in the projected system that its `meta` table names.

    `name` defaults to the location folder of `<location>/<version>/map.gpkg`,
    else to the file's own name. As strict as nuPlan's classes where they would
    fail (MapError with one line that names the layer and the id), as tolerant
    where they are: missing speed limits, unknown codes, NULL stop lines,
    numbers stored as reals or texts.

    Boundaries are turned to run with the traffic, whatever their direction in
    the file. The driving side is the `meta` key drivingSide where there is one,
    else left for Singapore's locations ("sg-..."), else what opposing
    roadblocks beside one another show, else right.
    """
    path = Path(path)
    location = path.resolve().parent.parent.name if path.stem == "map" else ""
    with GeoPackage(path) as file:
        return _roads(file, name or location or path.stem)


@dataclass(frozen=True, slots=True)
class MapSize:
    """How large a map is."""

    lanes: int
    lane_km: float
    """Of all lanes together, without connectors; to the metre."""
    driving_side: DrivingSide

    @classmethod
    def of(cls, roads: Roads) -> MapSize:
        """The size of a map at hand."""
        metres = sum(lane.centerline.length_m for lane in roads.lanes.values())
        return cls(len(roads.lanes), round(metres / 1000.0, 3), roads.driving_side)


def read_size(path: Path, name: str | None = None) -> MapSize:
    """`MapSize.of(read_map(path, name))`, from two layers of the file where it names its driving side."""
    with GeoPackage(path) as file:
        side = file.meta.get(schema.DRIVING_SIDE_KEY, "").strip().lower()
        if side == "left" or side == "right":
            lanes = frozenset(file.read(schema.LANES, geometry=False).ids)
            baselines = file.read(schema.BASELINES)
            owned = [lane in lanes for lane in baselines.references("lane_fid")]
            metres = float(shapely.length(baselines.geometries[owned]).sum())
            return MapSize(len(lanes), round(metres / 1000.0, 3), side)
    return MapSize.of(read_map(path, name))


def _roads(file: GeoPackage, name: str) -> Roads:
    lane_rows = file.read(schema.LANES)
    connector_rows = file.read(schema.CONNECTORS, geometry=False)
    shape_rows = file.read(schema.CONNECTOR_POLYGONS)
    baseline_rows = file.read(schema.BASELINES)
    boundary_rows = file.read(schema.BOUNDARIES)
    block_rows = file.read(schema.ROADBLOCKS)
    block_connector_rows = file.read(schema.ROADBLOCK_CONNECTORS)
    intersection_rows = file.read(schema.INTERSECTIONS)
    stop_rows = file.read(schema.STOP_LINES)
    _check_apart(lane_rows, connector_rows)
    _check_apart(block_rows, block_connector_rows)

    boundaries = _vertices(boundary_rows)
    stop_lines = {
        id_: StopLine(id_, polygon, _code(StopLineKind, kind, StopLineKind.UNKNOWN))
        for id_, polygon, kind in zip(
            stop_rows.ids, stop_rows.geometries, stop_rows.codes("stop_polygon_type_fid", 5).tolist(), strict=True
        )
    }
    lanes = _lanes(lane_rows, baseline_rows, boundaries, frozenset(block_rows.ids))
    connectors = _connectors(
        connector_rows, shape_rows, baseline_rows, boundaries, lanes, frozenset(block_connector_rows.ids), stop_lines
    )
    roadblocks = _roadblocks(block_rows, block_connector_rows, frozenset(intersection_rows.ids), lanes, connectors)
    side = file.meta.get(schema.DRIVING_SIDE_KEY, "").strip().lower()
    if side not in ("", "left", "right"):
        raise MapError(
            f"{file.path}: {schema.META}: {schema.DRIVING_SIDE_KEY} is {side[:20]!r}, expected left or right"
        )
    return Roads(
        name=name,
        crs=file.crs,
        driving_side="left" if side == "left" else "right" if side == "right" else _inferred_side(name, lanes),
        lanes=lanes,
        connectors=connectors,
        roadblocks=roadblocks,
        intersections=tuple(
            Intersection(id_, polygon, _code(IntersectionKind, kind, IntersectionKind.DEFAULT))
            for id_, polygon, kind in zip(
                intersection_rows.ids,
                intersection_rows.geometries,
                intersection_rows.codes("intersection_type_fid", 0).tolist(),
                strict=True,
            )
        ),
        stop_lines=stop_lines,
        crosswalks=_areas(file, schema.CROSSWALKS),
        walkways=_areas(file, schema.WALKWAYS),
        carparks=_areas(file, schema.CARPARKS),
        road_segments=_areas(file, schema.ROAD_SEGMENTS),
        generic_drivable_areas=_areas(file, schema.GENERIC_DRIVABLE_AREAS),
    )


def _vertices(table: LayerTable) -> dict[str, Floats]:
    """The vertices of a layer of lines, by id, cut from one array."""
    ends = np.cumsum(shapely.get_num_coordinates(table.geometries))
    return dict(zip(table.ids, np.split(shapely.get_coordinates(table.geometries), ends[:-1]), strict=False))


def _baseline(baselines: LayerTable, rows: Sequence[int], what: str, id_: str) -> Polyline:
    """The one baseline of a lane or connector; nuPlan's classes refuse none or several."""
    if len(rows) != 1:
        known = f"{len(rows)} baselines ({', '.join(baselines.ids[r] for r in rows[:3])})" if rows else "no baseline"
        raise MapError(f"{baselines.path}: {what} {id_}: has {known} in {baselines.layer}, needs exactly one")
    try:
        return Polyline(shapely.get_coordinates(baselines.geometries[rows[0]]))
    except ValueError as error:
        baselines.fault(rows[0], f"a line without length ({error})")


def _by_reference(table: LayerTable, column: str) -> dict[str, list[int]]:
    rows: dict[str, list[int]] = defaultdict(list)
    for row, value in enumerate(table.references(column)):
        if value is not None:
            rows[value].append(row)
    return rows


def _speed_limits(table: LayerTable) -> list[float | None]:
    """Limits in m/s; empty ones are unknown, and 0 stays 0: nuPlan takes both for "no limit to check"."""
    limits = table.numbers("speed_limit_mps")
    bad = ~np.isnan(limits) & ~((limits >= 0.0) & np.isfinite(limits))
    if bad.any():
        row = int(np.argmax(bad))
        table.fault(row, f"speed_limit_mps is {limits[row]:g}")
    return [None if np.isnan(limit) else limit for limit in limits.tolist()]


def _boundary(boundaries: _Vertices, table: LayerTable, row: int, id_: str, line: Polyline) -> Polyline:
    """The boundary `id_`, turned to run the way `line` does."""
    if id_ not in boundaries:
        table.fault(row, f"names boundary {id_}, which does not exist")
    try:
        own = Polyline(boundaries[id_])
    except ValueError as error:
        raise MapError(f"{table.path}: {schema.BOUNDARIES} {id_}: a line without length ({error})") from error
    return own if own.runs_with(line) else Polyline(own.points[::-1])


def _lanes(table: LayerTable, baselines: LayerTable, boundaries: _Vertices, blocks: frozenset[str]) -> dict[str, Lane]:
    owners = _by_reference(baselines, "lane_fid")
    block_ids = table.ids_in("lane_group_fid")
    left, right = table.ids_in("left_boundary_fid"), table.ids_in("right_boundary_fid")
    index = table.ids_in("lane_index")
    limits = _speed_limits(table)
    lanes: dict[str, Lane] = {}
    for row, (id_, lane_fid) in enumerate(zip(table.ids, table.ids_in("lane_fid"), strict=True)):
        if lane_fid != id_:
            table.fault(row, f"its lane_fid is {lane_fid}; both must be the same")
        if block_ids[row] not in blocks:
            table.fault(row, f"belongs to lane group {block_ids[row]}, which is not in {schema.ROADBLOCKS}")
        line = _baseline(baselines, owners.get(id_, ()), table.layer, id_)
        lanes[id_] = Lane(
            id=id_,
            roadblock_id=block_ids[row],
            index=int(index[row]),
            centerline=line,
            polygon=table.geometries[row],
            left_boundary=_boundary(boundaries, table, row, left[row], line),
            right_boundary=_boundary(boundaries, table, row, right[row], line),
            speed_limit_mps=limits[row],
        )
    return lanes


def _connectors(
    table: LayerTable,
    shapes: LayerTable,
    baselines: LayerTable,
    boundaries: _Vertices,
    lanes: Mapping[str, Lane],
    blocks: frozenset[str],
    stop_lines: Mapping[str, StopLine],
) -> dict[str, Connector]:
    owners = _by_reference(baselines, "lane_connector_fid")
    shape_of = _by_reference(shapes, "lane_connector_fid")
    left, right = shapes.references("left_boundary_fid"), shapes.references("right_boundary_fid")
    ends = table.ids_in("exit_lane_fid"), table.ids_in("entry_lane_fid")
    block_ids = table.ids_in("lane_group_connector_fid")
    stops = table.texts("traffic_light_stop_line_fids")
    limits = _speed_limits(table)
    turns = table.codes("turn_type_fid", Turn.UNKNOWN).tolist()
    connectors: dict[str, Connector] = {}
    for row, id_ in enumerate(table.ids):
        for column, lane in zip(("exit_lane_fid", "entry_lane_fid"), (ends[0][row], ends[1][row]), strict=True):
            if lane not in lanes:
                table.fault(row, f"{column} is lane {lane}, which does not exist")
        if block_ids[row] not in blocks:
            table.fault(row, f"belongs to {schema.ROADBLOCK_CONNECTORS} {block_ids[row]}, which does not exist")
        rows = shape_of.get(id_, ())
        if len(rows) != 1:
            table.fault(row, f"has {len(rows) or 'no'} polygons in {shapes.layer}, needs exactly one")
        shape = rows[0]
        left_id, right_id = left[shape], right[shape]
        if left_id is None or right_id is None:
            shapes.fault(shape, "left_boundary_fid or right_boundary_fid is empty")
        line = _baseline(baselines, owners.get(id_, ()), table.layer, id_)
        connectors[id_] = Connector(
            id=id_,
            roadblock_id=block_ids[row],
            from_lane_id=ends[0][row],
            to_lane_id=ends[1][row],
            centerline=line,
            polygon=shapes.geometries[shape],
            left_boundary=_boundary(boundaries, shapes, shape, left_id, line),
            right_boundary=_boundary(boundaries, shapes, shape, right_id, line),
            speed_limit_mps=limits[row],
            turn=_code(Turn, turns[row], Turn.UNKNOWN),
            stop_line_ids=_stop_line_ids(table, row, stops[row], stop_lines),
        )
    return connectors


def _stop_line_ids(table: LayerTable, row: int, text: str, known: Mapping[str, StopLine]) -> tuple[str, ...]:
    """The ids in a list such as "12, 14"; MapError for one that does not exist."""
    ids = tuple(part.strip() for part in text.split(",") if part.strip())
    for id_ in ids:
        if id_ not in known:
            table.fault(row, f"names stop line {id_[:20]!r}, which is not in {schema.STOP_LINES}")
    return ids


def _roadblocks(
    blocks: LayerTable,
    connectors: LayerTable,
    intersections: frozenset[str],
    lanes: Mapping[str, Lane],
    lane_connectors: Mapping[str, Connector],
) -> dict[str, Roadblock]:
    members: dict[str, list[str]] = defaultdict(list)
    for lane in sorted(lanes.values(), key=lambda lane: lane.index):
        members[lane.roadblock_id].append(lane.id)
    for connector in lane_connectors.values():
        members[connector.roadblock_id].append(connector.id)
    found = {
        id_: Roadblock(id_, polygon, tuple(members[id_]))
        for id_, polygon in zip(blocks.ids, blocks.geometries, strict=True)
    }
    starts, ends = connectors.ids_in("from_lane_group_fid"), connectors.ids_in("to_lane_group_fid")
    inside = connectors.references("intersection_fid")
    for row, id_ in enumerate(connectors.ids):
        for column, block in (("from_lane_group_fid", starts[row]), ("to_lane_group_fid", ends[row])):
            if block not in found or found[block].is_connector:
                connectors.fault(row, f"{column} is lane group {block}, which does not exist")
        found[id_] = Roadblock(
            id=id_,
            polygon=connectors.geometries[row],
            lane_ids=tuple(members[id_]),
            is_connector=True,
            from_id=starts[row],
            to_id=ends[row],
            intersection_id=inside[row] if inside[row] in intersections else None,
        )
    return found


def _areas(file: GeoPackage, layer: str) -> tuple[Area, ...]:
    table = file.read(layer)
    return tuple(Area(id_, polygon) for id_, polygon in zip(table.ids, table.geometries, strict=True))


def _code(kind: type[_Code], value: int, default: _Code) -> _Code:
    """The member of an enumeration with this value; codes that nobody knows become the default."""
    try:
        return kind(value)
    except ValueError:
        return default


def _check_apart(table: LayerTable, other: LayerTable) -> None:
    """MapError for an id that both tables use: planners keep them in one dictionary."""
    both = frozenset(table.ids) & frozenset(other.ids)
    if both:
        id_ = min(both, key=int)
        other.fault(other.ids.index(id_), f"the id is taken by {table.layer} {id_}")


def _inferred_side(name: str, lanes: Mapping[str, Lane]) -> DrivingSide:
    """The driving side of a map that does not say: Singapore's is left, else what the roads show, else right."""
    if name.startswith("sg-"):
        return "left"
    left = (lane.left_boundary.linestring for lane in lanes.values())
    right = (lane.right_boundary.linestring for lane in lanes.values())
    return shown_side(left, right) or "right"
