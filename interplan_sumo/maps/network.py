"""The tie between a map and its SUMO network: which SUMO lane follows which piece of which lane.

Read by the simulation; needs no SUMO. Arc lengths are metres along the centre
line of the source lane or connector. A SUMO lane is addressed by a *fraction*
of its length, because the lanes of a SUMO edge share one nominal length that
need not be the length of their shape.
"""

from __future__ import annotations

import json
from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, NamedTuple

import msgspec

from interplan_sumo.errors import MapError
from interplan_sumo.world.roads import DrivingSide

IDS_FORMAT = 1
"""Version of the layout of ids.json; another one is refused."""

_Id = Annotated[str, msgspec.Meta(min_length=1)]
_GAP_M = 1e-3  # ids.json keeps 0.1 mm; a larger step between pieces means a damaged file


class SumoPiece(NamedTuple):
    """One SUMO lane and the stretch of a source lane or connector that it follows."""

    sumo_lane: _Id
    """SUMO lane id ("12_0") or internal lane (":J3_0_0")."""
    start_m: float
    end_m: float
    """Equal to `start_m` for the internal lane at a cut inside a lane, which has no extent of its own."""

    @property
    def length_m(self) -> float:
        """Length along the source centre line, which may differ from SUMO's nominal length."""
        return self.end_m - self.start_m


@dataclass(frozen=True, eq=False)
class NetworkIds:
    """The id map of one network, checked on construction (MapError names the id)."""

    origin_m: tuple[float, float]
    """Map coordinates = SUMO coordinates + origin."""
    driving_side: DrivingSide
    pieces: Mapping[str, tuple[SumoPiece, ...]]
    """Lane or connector id -> its SUMO lanes, upstream to downstream, without gaps from arc length 0."""
    links: Mapping[str, tuple[_Id, Annotated[int, msgspec.Meta(ge=0)]]]
    """Light-controlled connector id -> (traffic light id, link index in its state string)."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "pieces", MappingProxyType({k: tuple(v) for k, v in self.pieces.items()}))
        object.__setattr__(self, "links", MappingProxyType(dict(self.links)))
        for lane_id, pieces in self.pieces.items():
            if not pieces or pieces[0].start_m != 0.0 or pieces[-1].end_m <= 0.0:
                raise MapError(f"network ids: lane {lane_id} has no SUMO lanes that start at arc length 0")
            for piece, following in pairwise(pieces):
                if abs(piece.end_m - following.start_m) > _GAP_M:
                    raise MapError(f"network ids: lane {lane_id} has a gap after SUMO lane {piece.sumo_lane}")
            if any(p.end_m < p.start_m for p in pieces):
                raise MapError(f"network ids: lane {lane_id} has a piece that ends before it starts")
        for connector_id in self.links:
            if connector_id not in self.pieces:
                raise MapError(f"network ids: light-controlled connector {connector_id} has no SUMO lanes")
        _ = self.sources

    @cached_property
    def sources(self) -> Mapping[str, tuple[str, float, float]]:
        """SUMO lane -> (lane or connector id, start, end) of the stretch that it follows."""
        found: dict[str, tuple[str, float, float]] = {}
        for lane_id, pieces in self.pieces.items():
            for piece in pieces:
                if piece.sumo_lane in found:
                    other = found[piece.sumo_lane][0]
                    raise MapError(f"network ids: SUMO lane {piece.sumo_lane} follows both {other} and {lane_id}")
                found[piece.sumo_lane] = (lane_id, piece.start_m, piece.end_m)
        return MappingProxyType(found)

    @cached_property
    def _extents(self) -> dict[str, tuple[list[float], tuple[SumoPiece, ...]]]:
        """Per source lane the pieces with an extent, and their starts, for bisection."""
        extents: dict[str, tuple[list[float], tuple[SumoPiece, ...]]] = {}
        for lane_id, pieces in self.pieces.items():
            long = tuple(p for p in pieces if p.length_m > 0.0)
            extents[lane_id] = ([p.start_m for p in long], long)
        return extents

    def sumo_place(self, lane_id: str, arc_m: float) -> tuple[str, float]:
        """The SUMO lane at an arc length of a lane or connector, and the fraction 0..1 along it.

        Arc lengths beyond the ends are clamped; on a cut the downstream lane is
        given. KeyError if the map has no such lane.
        """
        starts, pieces = self._extents[lane_id]
        piece = pieces[max(0, bisect_right(starts, arc_m) - 1)]
        return piece.sumo_lane, min(1.0, max(0.0, (arc_m - piece.start_m) / piece.length_m))

    # --- on disk -------------------------------------------------------------------------------

    def write(self, path: Path) -> None:
        """Write ids.json: one lane per line, sorted, numbers rounded to 0.1 mm; equal ids give equal bytes."""

        def number(value: float) -> float:
            return round(float(value), 4) + 0.0

        pieces = {
            lane: [[p.sumo_lane, number(p.start_m), number(p.end_m)] for p in self.pieces[lane]]
            for lane in sorted(self.pieces)
        }
        lines = [
            "{",
            f'"format": {IDS_FORMAT},',
            f'"origin_m": {json.dumps([number(v) for v in self.origin_m])},',
            f'"driving_side": {json.dumps(self.driving_side)},',
            '"pieces": {',
            ",\n".join(f"{json.dumps(lane)}: {json.dumps(rows)}" for lane, rows in pieces.items()),
            "},",
            '"links": {',
            ",\n".join(f"{json.dumps(c)}: {json.dumps(list(self.links[c]))}" for c in sorted(self.links)),
            "}",
            "}",
        ]
        path.write_text("\n".join(line for line in lines if line) + "\n", encoding="utf-8", newline="\n")

    @classmethod
    def read(cls, path: Path) -> NetworkIds:
        """Read what `write` wrote; MapError names the file and what is wrong with it."""
        try:
            content = path.read_bytes()
            kind = msgspec.json.decode(content, type=_Head).format
            if kind != IDS_FORMAT:
                raise MapError(f"format {kind} instead of {IDS_FORMAT}")
            return msgspec.json.decode(content, type=cls)
        except FileNotFoundError:
            raise MapError(f"no id map at {path}; run `interplan-sumo maps convert {path.parent}`") from None
        except (OSError, ValueError, MapError) as error:
            raise _damaged(path, str(error)) from error


class _Head(msgspec.Struct):
    format: int


def _damaged(path: Path, what: str) -> MapError:
    return MapError(
        f"id map {path} is damaged: {what}; run `interplan-sumo maps convert {path.parent}` to write it anew"
    )
