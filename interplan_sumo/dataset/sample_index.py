"""Sample index: what a drive has to offer: the samples of its ego and of its background cars, with what each shows."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from interplan_sumo.dataset.balance import balanced, spread
from interplan_sumo.dataset.cars import CarDrive, Cars, way_of
from interplan_sumo.dataset.labels import GraphWay
from interplan_sumo.dataset.samples import sample_frames
from interplan_sumo.dataset.scenario_tags import ScenarioTags
from interplan_sumo.errors import ScenarioError
from interplan_sumo.features.schema import FUTURE_FRAMES, HISTORY_FRAMES, SITUATIONS
from interplan_sumo.scenario.scenario import LanePosition, Scenario
from interplan_sumo.world.geometry import Ints, wrap_angle
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trace import Trace

MOST_CARS: Final = 24
"""Of one drive; the traffic of one scene is one scene."""
SLIDES_MPS: Final = 0.3
"""A car that SUMO slides sideways faster than this changes lane; in bends it is less."""
CAR_EVERY_FRAMES: Final = 10
MOST_PER_CAR: Final = 8
MOST_STANDING: Final = 2
"""Samples of one drive in which the ego stands and stays: they hardly differ."""
_STANDING: Final = SITUATIONS.index("standing")


@dataclass(frozen=True, slots=True)
class IndexedSamples:
    """The samples that one ego of a drive has to offer."""

    car: str
    """The background car, "" for the ego itself."""
    start: LanePosition
    start_speed_mps: float
    goal: LanePosition
    route: tuple[str, ...]
    frames: tuple[int, ...]
    situations: tuple[int, ...]
    """What each frame shows."""


def index_samples(scenario: Scenario, roads: Roads, trace: Trace, every_frames: int) -> list[IndexedSamples]:
    """What a drive has to offer, the ego first."""
    own = ScenarioTags(scenario, roads, trace, GraphWay(roads, trace))
    frames = np.array(sample_frames(trace, every_frames), dtype=np.int64)
    return [_offer("", scenario, frames, own), *_cars(scenario, roads, trace)]


def _cars(host: Scenario, roads: Roads, trace: Trace) -> list[IndexedSamples]:
    cars = Cars(trace)
    offers: list[IndexedSamples] = []
    for drive in _eventful([cars.drive(token) for token in cars.tokens]):
        offer = _car_offer(drive, host, roads)
        if offer is not None:
            offers.append(offer)
    return offers


def _eventful(drives: Sequence[CarDrive]) -> list[CarDrive]:
    """`MOST_CARS` drives with usable samples: lane changes first, then half turns and half changes of speed."""
    usable = [drive for drive in drives if len(drive.samples)]
    changed = [drive for drive in usable if drive.slid_mps > SLIDES_MPS][: MOST_CARS // 2]
    rest = sorted((d for d in usable if d not in changed), key=lambda drive: (-_turned_rad(drive), drive.token))
    most = (MOST_CARS - len(changed)) // 2
    faster = sorted(rest[most:], key=lambda drive: (-float(np.ptp(drive.trace.ego.vx_mps)), drive.token))
    return [*changed, *rest[:most], *faster[: MOST_CARS - len(changed) - most]]


def _turned_rad(drive: CarDrive) -> float:
    return float(np.abs(wrap_angle(np.diff(drive.trace.ego.heading_rad))).sum())


def _car_offer(drive: CarDrive, host: Scenario, roads: Roads) -> IndexedSamples | None:
    """None where it does not follow the lanes, or has no frame that can be used."""
    try:
        scenario = way_of(drive, host, roads)
    except ScenarioError:
        return None
    own = ScenarioTags(scenario, roads, drive.trace, GraphWay(roads, drive.trace))
    astray = np.concatenate(([0], np.cumsum(~own.on_way)))
    frames = drive.samples[::CAR_EVERY_FRAMES]
    frames = frames[astray[frames + FUTURE_FRAMES + 1] == astray[frames - HISTORY_FRAMES + 1]]
    offer = _offer(drive.token, scenario, frames, own)
    if not offer.frames:
        return None
    rng = np.random.default_rng(zlib.crc32(f"{host.id} {drive.token}".encode()))
    kept = balanced(np.array(offer.situations), MOST_PER_CAR, rng)
    return IndexedSamples(
        offer.car, offer.start, offer.start_speed_mps, offer.goal, offer.route,
        tuple(offer.frames[k] for k in kept), tuple(offer.situations[k] for k in kept),
    )  # fmt: skip


def _offer(car: str, scenario: Scenario, frames: Ints, own: ScenarioTags) -> IndexedSamples:
    """Some frames, of those that stand still only a few."""
    shown = np.array([own.at(frame) for frame in frames.tolist()], dtype=np.int64)
    still = np.flatnonzero(shown == _STANDING)
    kept = np.union1d(np.flatnonzero(shown != _STANDING), still[spread(still, MOST_STANDING)])
    return IndexedSamples(
        car, scenario.start, scenario.start_speed_mps, scenario.goal, scenario.route,
        tuple(frames[kept].tolist()), tuple(shown[kept].tolist()),
    )  # fmt: skip
