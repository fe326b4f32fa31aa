"""Speed limits of signs on OpenDRIVE roads, which overrule those that a file gives for roads and lanes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

from interplan_sumo.maps.importers.opendrive.controls import lanes_under, names
from interplan_sumo.maps.importers.opendrive.elements import XodrFile, XodrRoad, XodrSignal
from interplan_sumo.maps.importers.opendrive.links import Sides
from interplan_sumo.maps.importers.opendrive.travel import Network, TravelLane


@dataclass(eq=False)
class SignLimits:
    """What signs say of speed."""

    limit_mps: dict[str, float] = field(default_factory=dict[str, float])
    """By lane; only of lanes on which a sign holds."""
    unknown: list[str] = field(default_factory=list[str])
    """Signs whose limit cannot be told."""


def limit_signs(road: XodrRoad, known: Mapping[str, XodrSignal]) -> Iterator[XodrSignal]:
    """The signs of a road that begin or end a limit; `known` are the signals of the file by id."""
    for signal in road.signals:
        origin = known.get(signal.id, signal) if signal.is_reference else signal
        if origin.says_limit:
            yield replace(signal, says_limit=True, limit_mps=origin.limit_mps)


def limit_cuts(road: XodrRoad, known: Mapping[str, XodrSignal]) -> Iterator[float]:
    """Stations at which the limit of a sign begins or ends: lanes are cut there."""
    yield from (sign.station_m for sign in limit_signs(road, known) if _is_told(sign))


def sign_limits(file: XodrFile, known: Mapping[str, XodrSignal], sides: Sides, network: Network) -> SignLimits:
    """The limits of signs: each holds from where it stands, in its direction, to the next or the end of the road."""
    found = SignLimits()
    signed: dict[str, list[tuple[XodrSignal, bool]]] = {}
    for road in file.roads.values():
        for sign in limit_signs(road, known):
            if _is_told(sign):
                ways = {lane.along for lane in lanes_under(sides, network, road, sign)}
                signed.setdefault(road.id, []).extend((sign, along) for along in sorted(ways))
            else:
                found.unknown.append(sign.id)
    for lane in network.lanes.values():
        limit_mps = _held(lane, signed.get(lane.stretch.road.id, ()))
        if limit_mps is not None:
            found.limit_mps[lane.id] = limit_mps
    return found


def _is_told(sign: XodrSignal) -> bool:
    return sign.limit_mps is None or not math.isnan(sign.limit_mps)


def _held(lane: TravelLane, signed: Iterable[tuple[XodrSignal, bool]]) -> float | None:
    """The limit of the last sign that one passes before the middle of a lane; None for none, or if it ended one.

    Of several at one place the lowest limit, before the end of one.
    """
    middle_m = (lane.stretch.start_m + lane.stretch.end_m) / 2.0
    passed = [
        (sign.station_m if along else -sign.station_m, -math.inf if sign.limit_mps is None else -sign.limit_mps)
        for sign, along in signed
        if along == lane.along and names(sign, lane.stretch) and (sign.station_m <= middle_m) == along
    ]
    limit_mps = -max(passed)[1] if passed else math.inf
    return limit_mps if limit_mps < math.inf else None
