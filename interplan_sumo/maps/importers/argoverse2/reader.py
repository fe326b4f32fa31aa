"""Argoverse 2 maps: `read_argoverse2` makes a `SourceMap` of a `log_map_archive_*.json`."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
import shapely
from msgspec.structs import replace
from numpy.typing import NDArray

from interplan_sumo.errors import UnknownNameError
from interplan_sumo.maps.importers.argoverse2.file import (
    ArgoverseLane,
    PedestrianCrossing,
    map_file,
    read_archive,
    valid_parts,
)
from interplan_sumo.maps.importers.source import LeftOut, SourceLane, SourceMap
from interplan_sumo.world.argoverse_frame import argoverse_name, city_frame, find_city, scenario_city
from interplan_sumo.world.frame import UNPLACED_CRS, UNPLACED_ORIGIN_M
from interplan_sumo.world.geometry import Floats, Ints, frozen, hausdorff_m

REASONS = {"BIKE": "bicycle lane", "BUS": "bus lane"}
"""Why lanes of these types are left out; any other type but VEHICLE is named as it is."""
MAX_NEIGHBOUR_GAP_M = 0.5
"""Neighbours share a boundary: further apart than this, anywhere, they do not adjoin."""
BRIDGE_M = 3.0
"""Lanes that cross with more than this between their heights do not meet."""
_TOUCHING_M2 = 1.0
"""Lanes that overlap by less lie side by side or one behind the other."""

NO_RULES_NOTE = "The format has no speed limits, traffic lights or signs."


def read_argoverse2(path: Path, city: str | None = None) -> SourceMap:
    """The map in a `log_map_archive_*.json`, or in a folder that holds exactly one.

    Coordinates become UTM metres of the city, which is `city` (a code such as
    "PIT" or a name), else the one in the file's name, else the one that the
    recording beside the file names. Without any of these the map is unplaced,
    with a note. Lanes for bicycles and buses are left out, with their surfaces.

    Raises MapError for a file that cannot be used and UnknownNameError for a
    `city` that Argoverse 2 does not cover.
    """
    file = map_file(path)
    archive = read_archive(file)
    notes = [NO_RULES_NOTE]
    lanes = _straightened(archive.lane_segments, notes)
    name, crs, origin_m = _placed(file, city, notes)
    cars = {lane.id: lane for lane in lanes if lane.type == "VEHICLE"}
    others = [lane for lane in lanes if lane.type != "VEHICLE"]
    _note_bridges(list(cars.values()), notes)
    crossings = _surfaces(map(_crossing, archive.pedestrian_crossings), "pedestrian crossings", notes)
    areas = (shapely.Polygon(area.area_boundary[:, :2]) for area in archive.drivable_areas)
    drivable = _surfaces(areas, "drivable areas", notes)
    return SourceMap(
        name=name,
        format="argoverse2",
        crs=crs,
        driving_side="right",
        lanes=_source_lanes(cars, {lane.id for lane in others}, origin_m, notes),
        crosswalks=tuple(_moved(polygon, origin_m) for polygon in crossings),
        drivable=tuple(_moved(polygon, origin_m) for polygon in drivable),
        left_out=tuple(_left_out(lane, origin_m) for lane in others),
        notes=tuple(notes),
    )


# --- where the map lies ----------------------------------------------------------------------------


def _placed(file: Path, city: str | None, notes: list[str]) -> tuple[str, str, tuple[float, float]]:
    """Name, projected system and origin of the map."""
    stem = file.stem.removeprefix("log_map_archive_")
    named = re.search(r"____([A-Z]{3})_city_(\d+)$", stem)
    where = find_city(city).name if city is not None else _named_city(named) or _recorded_city(file)
    name = argoverse_name(where, named.group(2) if named else stem)
    if where is None:
        notes.append("Neither the file's name nor a recording beside it tells the city; the map is not on the globe.")
        return name, UNPLACED_CRS, UNPLACED_ORIGIN_M
    return name, *city_frame(where)


def _named_city(named: re.Match[str] | None) -> str | None:
    try:
        return find_city(named.group(1)).name if named else None
    except UnknownNameError:
        return None


def _recorded_city(file: Path) -> str | None:
    """The city of the recording of the same log, or of the only recording beside the file."""
    own = file.with_name(f"{file.stem.replace('log_map_archive_', 'scenario_')}.parquet")
    found = [own] if own.is_file() else list(file.parent.glob("scenario_*.parquet"))
    return scenario_city(found[0]) if len(found) == 1 else None


def _moved(polygon: shapely.Polygon, origin_m: tuple[float, float]) -> shapely.Polygon:
    return shapely.transform(polygon, lambda xy: xy + origin_m)


# --- lanes -----------------------------------------------------------------------------------------


def _straightened(lanes: Sequence[ArgoverseLane], notes: list[str]) -> list[ArgoverseLane]:
    """The lanes with both boundaries in one direction and the left one on the left.

    A boundary that runs against its twin is turned: of the two ways to do so
    one puts left on the left. Where both run alike, their direction stands.
    """
    turned = swapped = 0
    found: list[ArgoverseLane] = []
    for lane in lanes:
        left, right = lane.left, lane.right
        if _along(left) @ _along(right) < 0.0:
            right = right[::-1]
            if _area_to_the_right_m2(left, right) < 0.0:
                left, right = left[::-1], right[::-1]
            turned += 1
        elif _area_to_the_right_m2(left, right) < 0.0:
            left, right = right, left
            swapped += 1
        found.append(replace(lane, left=left, right=right))
    if turned:
        notes.append(f"Lanes of which one boundary ran against the other, so that it was turned: {turned}.")
    if swapped:
        notes.append(f"Lanes with left and right boundary exchanged, put right in their direction: {swapped}.")
    return found


def _along(line: Floats) -> Floats:
    """(2,) from the first point of a line to its last."""
    return line[-1, :2] - line[0, :2]


def _area_to_the_right_m2(left: Floats, right: Floats) -> float:
    """Area between two boundaries, negative where the right one lies left of the left one."""
    ring = np.concatenate((left, right[::-1]))[:, :2] - left[0, :2]
    ahead = np.roll(ring, -1, axis=0)
    return float(ring[:, 1] @ ahead[:, 0] - ring[:, 0] @ ahead[:, 1]) / 2.0


def _source_lanes(
    cars: Mapping[int, ArgoverseLane], others: set[int], origin_m: tuple[float, float], notes: list[str]
) -> dict[str, SourceLane]:
    successors, predecessors = _links(cars, others, notes)
    on_left, on_right = _neighbours(cars, notes)
    return {
        str(lane.id): SourceLane(
            id=str(lane.id),
            left=frozen(lane.left[:, :2] + origin_m),
            right=frozen(lane.right[:, :2] + origin_m),
            successors=successors[lane.id],
            predecessors=predecessors[lane.id],
            left_neighbour=on_left.get(lane.id),
            right_neighbour=on_right.get(lane.id),
            in_intersection=lane.in_intersection,
        )
        for lane in cars.values()
    }


def _links(
    cars: Mapping[int, ArgoverseLane], others: set[int], notes: list[str]
) -> tuple[dict[int, tuple[str, ...]], dict[int, tuple[str, ...]]]:
    """Successors and predecessors of every lane for cars, each link between two of them named by both."""
    ahead = {id_: dict.fromkeys(lane.successors) for id_, lane in cars.items()}
    behind = {id_: dict.fromkeys(lane.predecessors) for id_, lane in cars.items()}
    dropped = sum(link in others for links in (*ahead.values(), *behind.values()) for link in links)
    completed = 0
    for named, twin in ((ahead, behind), (behind, ahead)):
        for id_, links in named.items():
            for other in links:
                if other in cars and id_ not in twin[other]:
                    twin[other][id_] = None
                    completed += 1
    if dropped:
        notes.append(f"Links of lanes for cars to lanes that are left out, not kept: {dropped}.")
    if completed:
        notes.append(f"Links that only one of the two lanes names, made known to the other: {completed}.")

    def kept(links: Mapping[int, Iterable[int]]) -> dict[int, tuple[str, ...]]:
        return {id_: tuple(str(link) for link in found if link not in others) for id_, found in links.items()}

    return kept(ahead), kept(behind)


def _neighbours(cars: Mapping[int, ArgoverseLane], notes: list[str]) -> tuple[dict[int, str], dict[int, str]]:
    """The left and the right neighbour of the lanes that have one.

    Argoverse names lanes of the opposite direction too. Kept are those that
    run the same way and share the boundary from end to end.
    """
    named = dict.fromkeys(
        [(lane.left_neighbour, lane.id) for lane in cars.values() if lane.left_neighbour in cars]
        + [(lane.id, lane.right_neighbour) for lane in cars.values() if lane.right_neighbour in cars]
    )
    on_left: dict[int, int] = {}
    on_right: dict[int, int] = {}
    for left, right in named:
        if left is None or right is None or left in on_right or right in on_left:
            continue
        if _adjoin(cars[left].right, cars[right].left):
            on_left[right], on_right[left] = left, right
    lost = {frozenset(pair) for pair in named} - {frozenset(pair) for pair in on_left.items()}
    if lost:
        notes.append(f"Pairs of neighbours that are oncoming or do not adjoin from end to end, not kept: {len(lost)}.")
    of_left, of_right = ({lane: str(other) for lane, other in found.items()} for found in (on_left, on_right))
    return of_left, of_right


def _adjoin(one: Floats, other: Floats) -> bool:
    """Whether two boundaries run the same way and lie on each other."""
    ends_m = np.hypot(*(one[[0, -1], :2] - other[[0, -1], :2]).T)
    if ends_m.max() > MAX_NEIGHBOUR_GAP_M or _along(one) @ _along(other) < 0.0:
        return False
    return hausdorff_m(one[:, :2], other[:, :2]) <= MAX_NEIGHBOUR_GAP_M


def _left_out(lane: ArgoverseLane, origin_m: tuple[float, float]) -> LeftOut:
    reason = REASONS.get(lane.type, f"lane of type {lane.type}")
    return LeftOut(str(lane.id), reason, _moved(max(valid_parts(lane.ring), key=shapely.area), origin_m))


def _note_bridges(cars: Sequence[ArgoverseLane], notes: list[str]) -> None:
    """Say how many pairs of lanes pass above each other."""
    if not cars:
        return
    rings = shapely.make_valid(np.array([lane.ring for lane in cars], dtype=object))
    one, other = shapely.STRtree(rings).query(rings, predicate="intersects")
    one, other = one[one < other], other[one < other]
    shared = shapely.intersection(rings[one], rings[other])
    meeting = shapely.area(shared) > _TOUCHING_M2
    at = shapely.centroid(shared[meeting])
    apart_m = np.abs(_heights_m(cars, one[meeting], at) - _heights_m(cars, other[meeting], at))
    bridges = int((apart_m > BRIDGE_M).sum())
    if bridges:
        notes.append(f"Pairs of lanes that cross at different heights, as on a bridge: {bridges}.")


def _heights_m(cars: Sequence[ArgoverseLane], rows: Ints, at: NDArray[np.object_]) -> Floats:
    """(N,) height of lanes, given by their rows, at the points of their boundaries nearest to places."""
    heights = np.zeros(len(rows))
    for side in ("left", "right"):
        lines = np.array([shapely.LineString(getattr(cars[row], side)) for row in rows.tolist()], dtype=object)
        nearest = shapely.line_interpolate_point(lines, shapely.line_locate_point(lines, at))
        heights += shapely.get_z(nearest) / 2.0
    return heights


# --- surfaces --------------------------------------------------------------------------------------


def _surfaces(outlines: Iterable[shapely.Geometry], what: str, notes: list[str]) -> list[shapely.Polygon]:
    """Valid polygons, with a note where the file's are none."""
    found: list[shapely.Polygon] = []
    bad = 0
    for drawn in outlines:
        parts = valid_parts(drawn)
        found.extend(parts)
        bad += not (parts and shapely.is_valid(drawn))
    if bad:
        notes.append(f"Outlines of {what} that cross themselves (mended) or are empty (dropped): {bad}.")
    return found


def _crossing(crossing: PedestrianCrossing) -> shapely.Geometry:
    """The ring around the two edges of a crossing, whichever way each was drawn; their hull if they cross."""
    one, other = crossing.edge1[:, :2], crossing.edge2[:, :2]
    rings = [shapely.Polygon(np.concatenate((one, twin))) for twin in (other[::-1], other)]
    return next((ring for ring in rings if ring.is_valid), rings[0].convex_hull)
