"""Geometries as a GeoPackage keeps them: a header and well-known binary."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

SRS_ID = 4326
"""GeoPackage's own number of longitudes and latitudes."""
_HEADER = b"GP\x00\x01" + struct.pack("<i", SRS_ID)
"""Magic, version, little-endian without an envelope, and the system of the coordinates."""
_ENVELOPE_BYTES = {0: 0, 1: 32, 2: 48, 3: 48, 4: 64}


class BlobError(ValueError):
    """What stands in place of a geometry."""


def blobs_of(shapes: NDArray[np.object_]) -> list[bytes]:
    """Geometries in longitudes and latitudes as a file keeps them."""
    return [_HEADER + wkb for wkb in shapely.to_wkb(shapes, byte_order=1)]


def wkb_of(blob: Any) -> bytes:
    """The well-known binary in what a geometry column holds; BlobError if it is none."""
    try:
        return _checked(blob)
    except (ValueError, TypeError, IndexError, KeyError, struct.error) as error:
        raise BlobError(str(error)) from error


def _checked(blob: bytes) -> bytes:
    if blob[:2] != b"GP":
        raise ValueError("it does not begin as a GeoPackage geometry does")
    wkb = blob[8 + _ENVELOPE_BYTES[blob[3] >> 1 & 7] :]
    _end_of(wkb, 0)
    return wkb


def _end_of(wkb: bytes, at: int, kinds: Sequence[int] = range(1, 7)) -> int:
    """Where the geometry that begins at `at` ends.

    GEOS follows collections within collections until its stack runs over, so only parts of one level get that far.
    """
    number = "<I" if wkb[at] else ">I"
    (code,) = struct.unpack_from(number, wkb, at + 1)
    kind, dimensions = code % 0x10000000 % 1000, code % 0x10000000 // 1000
    if kind not in kinds or code & 0x20000000 or dimensions > 3:
        raise ValueError(f"of an unknown type, {code}")
    bytes_each = 8 * (2 + (dimensions in (1, 3) or code >> 31) + (dimensions in (2, 3) or code >> 30 & 1))
    at += 5
    if kind == 1:
        return at + bytes_each
    (count,) = struct.unpack_from(number, wkb, at)
    at += 4
    if kind == 2:
        return at + count * bytes_each
    for _ in range(count):
        if kind == 3:
            at += 4 + struct.unpack_from(number, wkb, at)[0] * bytes_each
        else:
            at = _end_of(wkb, at, (kind - 3,))
    return at
