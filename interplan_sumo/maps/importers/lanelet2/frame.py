"""Where the points of a file lie, in metres: from latitudes and longitudes where it has them, else from local ones."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS, Transformer
from pyproj.exceptions import ProjError

from interplan_sumo.maps.importers.lanelet2.osm import OsmFile
from interplan_sumo.world.frame import UNPLACED_CRS, UNPLACED_ORIGIN_M
from interplan_sumo.world.geometry import Floats

_WGS84 = "EPSG:4326"
_SPREAD_DEG = 1e-6  # some 0.1 m: latitudes that vary less were filled in for form's sake
_SAME_SCALE = 0.01
_FAR_DEG = 3.0  # half a zone of UTM: what lies further from the rest is an error of the file
_FAR_M = 300e3
_UTM_DEG = (-80.0, 84.0)


@dataclass(frozen=True, eq=False)
class LaneletFrame:
    """The points of a file in one projected system."""

    crs: str
    points: dict[str, tuple[float, float]]
    """Metres by node id; nodes without a usable place are absent."""
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class _Places:
    """(N, 2) each, NaN where a node has none."""

    ids: list[str]
    lonlat_deg: Floats
    local_m: Floats


def frame_of(file: OsmFile) -> LaneletFrame:
    """UTM metres from latitudes and longitudes where these vary; else, and where they contradict local_x and local_y,
    the local metres.

    Local metres that a geoReference explains are taken through it to UTM, so
    that a stretched projection such as Web Mercator does no harm. MapError
    where no node has a place, or the map lies beyond UTM.
    """
    places = _places(file)
    with_degrees, with_metres = _known(places.lonlat_deg), _known(places.local_m)
    if _spread(places.lonlat_deg[with_degrees]).max(initial=0.0) > _SPREAD_DEG:
        utm = _in_utm(file, places, places.lonlat_deg)
        return _checked_by_local(utm, places) if not file.references else utm
    if not with_metres.any():
        file.fault("its nodes have neither latitudes and longitudes that vary nor local_x and local_y; add one of them")
    return _from_local(file, places)


def _places(file: OsmFile) -> _Places:
    rows = np.array([(n.lon_deg, n.lat_deg, n.x_m, n.y_m) for n in file.nodes.values()], dtype=np.float64)
    rows = rows.reshape(-1, 4)
    degrees = rows[:, :2]
    degrees[(np.abs(degrees) > (180.0, 90.0)).any(axis=1)] = math.nan
    return _Places(list(file.nodes), degrees, rows[:, 2:])


def _known(rows: Floats) -> NDArray[np.bool_]:
    return np.logical_and(*np.isfinite(rows).T)


def _spread(rows: Floats) -> Floats:
    return np.ptp(rows, axis=0) if len(rows) else np.zeros(2)


def _near(rows: Floats, reach: float) -> Floats:
    """The rows, NaN where they are unknown or further than `reach` from the middle one."""
    known = _known(rows)
    middle = np.median(rows[known], axis=0)
    return np.where((known & (np.abs(rows - middle) <= reach).all(axis=1))[:, None], rows, math.nan)


def _in_utm(file: OsmFile, places: _Places, lonlat_deg: Floats, notes: tuple[str, ...] = ()) -> LaneletFrame:
    lonlat_deg = _near(lonlat_deg, _FAR_DEG)
    known = _known(lonlat_deg)
    if not known.any():
        file.fault("its nodes lie all over the globe; give the map in one place")
    lon_deg, lat_deg = np.mean(lonlat_deg[known], axis=0).tolist()
    if not _UTM_DEG[0] <= lat_deg <= _UTM_DEG[1]:
        file.fault(f"lies at latitude {lat_deg:.1f}, beyond UTM; correct its latitudes")
    zone = min(int((lon_deg + 180.0) // 6.0) + 1, 60)
    crs = f"EPSG:{326 if lat_deg >= 0.0 else 327}{zone:02d}"
    to_utm = Transformer.from_crs(_WGS84, crs, always_xy=True)
    return LaneletFrame(crs, _named(places.ids, _transformed(to_utm, lonlat_deg)), notes)


def _transformed(transformer: Transformer, rows: Floats) -> Floats:
    moved = np.stack(transformer.transform(rows[:, 0], rows[:, 1]), axis=1)
    return np.where(np.isfinite(moved), moved, math.nan)


def _named(ids: list[str], metres: Floats) -> dict[str, tuple[float, float]]:
    return {ids[row]: (float(metres[row, 0]), float(metres[row, 1])) for row in np.flatnonzero(_known(metres))}


def _checked_by_local(utm: LaneletFrame, places: _Places) -> LaneletFrame:
    """`utm`, unless every node has local metres of another size: then the latitudes were filled in for form's sake."""
    if not _known(places.local_m).all():
        return utm
    both = [row for row, id_ in enumerate(places.ids) if id_ in utm.points]
    if len(both) < 2:
        return utm
    metres = np.array([utm.points[places.ids[row]] for row in both])
    scale = _size(places.local_m[both]) / max(_size(metres), 1e-9)
    if abs(scale - 1.0) <= _SAME_SCALE:
        return utm
    lat_deg = float(np.median(places.lonlat_deg[both, 1]))
    if abs(scale * math.cos(math.radians(lat_deg)) - 1.0) <= _SAME_SCALE:
        note = "local_x and local_y are stretched as in Web Mercator; latitudes and longitudes are used."
        return LaneletFrame(utm.crs, utm.points, (note,))
    why = f"latitudes and longitudes give a map {1.0 / scale:.3g} times the size of local_x and local_y"
    return _unplaced(places, f"{why}, which are used as they stand.")


def _size(rows: Floats) -> float:
    """The usual step from one node of the file to the next: wild ones and seams of a local grid change nothing."""
    return float(np.median(np.hypot(*np.diff(rows, axis=0).T)))


def _from_local(file: OsmFile, places: _Places) -> LaneletFrame:
    why = "the file gives no latitudes and longitudes"
    for text in file.references:
        to_degrees = _to_degrees(text)
        if to_degrees is None:
            why = f"the file's geoReference {text[:40]!r} is not a projected system that can be used"
            continue
        lonlat_deg = _transformed(to_degrees, places.local_m)
        if _known(lonlat_deg).any():
            return _in_utm(file, places, lonlat_deg, ("local_x and local_y are placed by the file's geoReference.",))
    return _unplaced(places, f"{why}; local_x and local_y are used as they stand.")


def _to_degrees(text: str) -> Transformer | None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # pyproj's advice on old spellings such as +init=epsg:25832
        try:
            crs = CRS.from_user_input(text)
            return Transformer.from_crs(crs, _WGS84, always_xy=True) if crs.is_projected else None
        except ProjError:
            return None


def _unplaced(places: _Places, note: str) -> LaneletFrame:
    """Local metres, moved into the range of the system that stands in; coordinates of a grid lose whole kilometres."""
    local_m = _near(places.local_m, _FAR_M)
    middle = np.median(local_m[_known(local_m)], axis=0)
    moved = np.where(np.abs(middle) > _FAR_M, np.floor(middle / 1000.0) * 1000.0, 0.0)
    return LaneletFrame(
        UNPLACED_CRS,
        _named(places.ids, local_m - moved + UNPLACED_ORIGIN_M),
        (note[0].upper() + note[1:], "The map is not placed on the globe."),
    )
