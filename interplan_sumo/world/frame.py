"""Where a file's own coordinates lie: in metres of a UTM zone, or of a stand-in where the file does not say."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

import numpy as np
import pyproj
from pyproj.exceptions import CRSError, ProjError

from interplan_sumo.errors import MapError
from interplan_sumo.world.geometry import Floats

UNPLACED_CRS = "EPSG:32631"
"""Stands in where a file does not say where on earth it lies."""
UNPLACED_ORIGIN_M = (500_000.0, 1_000_000.0)
"""Added to the coordinates of such a file, so that they lie within the system."""
_SAME_AS_WGS84 = ("WGS 84", "GRS 1980")
"""Ellipsoids whose UTM coordinates are taken for WGS 84's: they agree within two metres."""
_FALSE_NORTHING_M = 10_000_000.0
_ZONE_EASTING_M = (100_000.0, 900_000.0)
"""Generous: a zone is at most 668 km wide."""
_NOWHERE_DEG = 0.05
"""A map so close to 0, 0 has no georeference but a default one: the sea is there."""
_ROUND_TRIP_M = 0.01
_WGS84 = "EPSG:4326"


@dataclass(frozen=True, eq=False)
class Frame:
    """From the coordinates of one file to the projected system `crs`.

    A point is scaled, turned about the origin and shifted, which leads to the
    file's own system; from there it goes to `crs`, through latitude and
    longitude where the two differ.
    """

    crs: str
    shift_m: tuple[float, float] = (0.0, 0.0)
    turn_rad: float = 0.0
    scale: float = 1.0
    via: pyproj.Transformer | None = None

    def points(self, xy: Floats) -> Floats:
        """(N, 2) points of the file in metres of `crs`; MapError for points that the system cannot hold."""
        moved = self.moved(np.asarray(xy, dtype=np.float64).reshape(-1, 2))
        if not np.isfinite(moved).all() or np.abs(moved).max(initial=0.0) > 2.0 * _FALSE_NORTHING_M:
            raise MapError(f"a point lies outside the reach of {self.crs}; look at the georeference")
        return moved

    def vectors(self, xy: Floats, vectors: Floats) -> Floats:
        """(N, 2) vectors of the file that start at (N, 2) points, turned and stretched as the ground there is."""
        length = np.hypot(*vectors.T)[:, None]
        unit = np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0.0)
        return (self.points(xy + unit) - self.points(xy)) * length

    def stretch_at(self, xy: tuple[float, float]) -> float:
        """How many metres of `crs` a metre of the file is at a point."""
        return float(np.hypot(*self.vectors(np.array([xy]), np.array([(1.0, 0.0)]))[0]))

    def headings(self, xy: Floats, heading_rad: Floats) -> Floats:
        """(N,) headings of the file at (N, 2) points, as headings in `crs`."""
        ahead = self.vectors(xy, np.stack((np.cos(heading_rad), np.sin(heading_rad)), axis=1))
        return np.arctan2(ahead[:, 1], ahead[:, 0])

    def moved(self, xy: Floats) -> Floats:
        """`points` without the check."""
        cos, sin = self.scale * math.cos(self.turn_rad), self.scale * math.sin(self.turn_rad)
        x = cos * xy[:, 0] - sin * xy[:, 1] + self.shift_m[0]
        y = sin * xy[:, 0] + cos * xy[:, 1] + self.shift_m[1]
        if self.via is not None:
            x, y = self.via.transform(x, y)
        return np.stack((x, y), axis=1)


STAND_IN = Frame(UNPLACED_CRS, UNPLACED_ORIGIN_M)
"""The frame of a file that does not say where it lies."""


def utm_frame(
    reference: str,
    sample_xy: tuple[float, float],
    shift_m: tuple[float, float] = (0.0, 0.0),
    turn_rad: float = 0.0,
    scale: float = 1.0,
) -> Frame:
    """The UTM frame of a file whose coordinates, after the move, are those of `reference` (a PROJ string or a code).

    UTM references keep their metres; all others go through latitude and
    longitude to the zone of `sample_xy`, a point of the file, so that
    stretched metres (Mercator's) come out as metres of the ground. MapError
    says why a reference cannot be used.
    """
    own = _system(reference)
    zone = own.utm_zone
    x, y = Frame("", shift_m, turn_rad, scale).moved(np.array([sample_xy]))[0].tolist()
    if zone and own.ellipsoid and own.ellipsoid.name in _SAME_AS_WGS84:
        if not _ZONE_EASTING_M[0] < x < _ZONE_EASTING_M[1]:
            raise MapError(f"{reference[:60]!r} puts the map at an easting of {x:.0f} m, outside its zone")
        south = zone.endswith("S")
        if not south and y < 0.0:  # SUMO counts on below the equator
            south, shift_m = True, (shift_m[0], shift_m[1] + _FALSE_NORTHING_M)
        return Frame(f"EPSG:{(32700 if south else 32600) + int(zone[:-1])}", shift_m, turn_rad, scale)
    longitude, latitude = _transformer(own, _WGS84).transform(x, y)
    if not (abs(longitude) <= 180.0 and abs(latitude) <= 84.0):
        raise MapError(f"{reference[:60]!r} puts the map at {longitude:.3f}, {latitude:.3f}, where no UTM zone is")
    if max(abs(longitude), abs(latitude)) < _NOWHERE_DEG:
        raise MapError(f"{reference[:60]!r} puts the map into the sea at latitude 0, longitude 0")
    number = min(int((longitude + 180.0) // 6.0) + 1, 60)
    crs = f"EPSG:{(32600 if latitude >= 0.0 else 32700) + number}"
    to_utm = _transformer(own, crs)
    there_and_back = to_utm.transform(*to_utm.transform(x, y), direction="INVERSE")
    if not math.dist(there_and_back, (x, y)) < _ROUND_TRIP_M:
        raise MapError(f"{reference[:60]!r} cannot be converted to {crs} at {x:g}, {y:g}")
    return Frame(crs, shift_m, turn_rad, scale, to_utm)


def _transformer(own: pyproj.CRS, to: str) -> pyproj.Transformer:
    try:
        return pyproj.Transformer.from_crs(own, to, always_xy=True)
    except ProjError as error:
        raise MapError(f"{own.name[:60]!r} cannot be converted to {to}") from error


def _system(reference: str) -> pyproj.CRS:
    """The projected system in metres that a text names."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FutureWarning)  # "+init=epsg:..." of old files
            system = pyproj.CRS.from_user_input(reference)
    except (CRSError, ProjError, ValueError) as error:
        raise MapError(f"{reference[:60]!r} names no coordinate system") from error
    if not system.is_projected or any(axis.unit_conversion_factor != 1.0 for axis in system.axis_info):
        raise MapError(f"{reference[:60]!r} does not measure metres")
    return system
