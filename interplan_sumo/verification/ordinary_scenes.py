"""Ordinary scenes: further scenes of ordinary driving, from a seed, none of them near one of an official suite."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import islice
from typing import Final

import numpy as np

from interplan_sumo.errors import InputError
from interplan_sumo.families.generate import Search
from interplan_sumo.scenario.scenario import DRIVERS, Behaviour, Density, Scenario
from interplan_sumo.scenario.suite import suites
from interplan_sumo.verification.start_checks import start_problems
from interplan_sumo.world.geometry import wrap_angle
from interplan_sumo.world.roads import Roads

MAPS: Final = ("one_north", "hazelwood", "strip", "queenstown", "south_end", "paradise", "back_bay")
"""Of the shipped districts those that are learned from: roads of the others are new to what learned. The last one is
there to be held out."""
FIRST_SEED: Final = 100_000
"""Suites were made from seeds below this one; training data are made from this one on."""
CHANGE: Final = "changing_lane"
KINDS: Final = (
    "starting_left_turn",
    "starting_right_turn",
    "starting_straight_traffic_light_intersection_traversal",
    "stopping_with_lead",
    "high_lateral_acceleration",
    "high_magnitude_speed",
    "low_magnitude_speed",
    "traversing_pickup_dropoff",
    "behind_long_vehicle",
    "stationary_in_traffic",
    "near_multiple_vehicles",
    "following_lane_with_lead",
)
"""Types of nuPlan's challenge that take turns, not the one with a jaywalker; named, so that a seed stays what it is."""
KINDS_PER_ROUND: Final = 3
TRIPS_PER_ROUND: Final = 3
MOST_CANDIDATES: Final = 40
"""The search for each scene of a round gives up after so many."""
NEAR_M: Final = 5.0
NEAR_RAD: Final = float(np.radians(30.0))
"""A start nearer than both to that of an official scene with the same route would be that scene."""
DENSITIES: Final[tuple[tuple[Density, float], ...]] = (("none", 0.1), ("low", 0.3), ("medium", 0.35), ("high", 0.25))
BEHAVIOURS: Final[tuple[Behaviour, ...]] = (*DRIVERS, "urban")


def ordinary_scenes(roads: Roads, seed: int) -> list[Scenario]:
    """One round on one map: three types in turn, a lane change and three trips; fewer where it has no room.

    Equal seeds give equal scenes. InputError for a seed that suites may have used.
    """
    check_seed(seed)
    kinds = [KINDS[(seed * KINDS_PER_ROUND + k) % len(KINDS)] for k in range(KINDS_PER_ROUND)]
    counts = {**dict.fromkeys((*kinds, CHANGE), 1), "trip": TRIPS_PER_ROUND}
    return [scene for kind, count in counts.items() for scene in islice(_sound(roads, kind, seed), count)]


def check_seed(seed: int) -> None:
    """InputError for a seed that suites may have used."""
    if seed < FIRST_SEED:
        raise InputError(f"seed is {seed}, expected {FIRST_SEED} or more: smaller ones may have made official scenes")


def is_official(scenario: Scenario, roads: Roads) -> bool:
    """Whether an official scene begins with the same route from where this one begins."""
    here = scenario.start.pose(roads)
    for other in _official(scenario.map, scenario.route):
        there = other.start.pose(roads)
        off_m = float(np.hypot(here.x_m - there.x_m, here.y_m - there.y_m))
        if off_m < NEAR_M and abs(float(wrap_angle(here.heading_rad - there.heading_rad))) < NEAR_RAD:
            return True
    return False


def _sound(roads: Roads, kind: str, seed: int) -> Iterator[Scenario]:
    """Scenes of a kind in traffic of all sorts, that break no rule and are no official one."""
    for found in islice(Search(roads, kind, seed), MOST_CANDIDATES):
        scenario = _in_other_traffic(found)
        if is_official(scenario, roads) or start_problems(scenario, roads, with_traffic=False):
            continue
        if not start_problems(scenario, roads):
            yield scenario


def _in_other_traffic(scenario: Scenario) -> Scenario:
    """Density and drivers drawn anew; dense traffic stays dense, and placed vehicles need drivers of a kind."""
    rng = np.random.default_rng(np.frombuffer(hashlib.sha256(f"traffic {scenario.id}".encode()).digest(), np.uint32))
    density, oncoming = _drawn(rng), _drawn(rng)
    behaviour = BEHAVIOURS[int(rng.integers(len(BEHAVIOURS)))]
    traffic = replace(
        scenario.traffic,
        density="high" if scenario.traffic.density == "high" else density,
        oncoming=oncoming,
        behaviour="urban" if scenario.vehicles else behaviour,
    )
    return replace(scenario, traffic=traffic)


def _drawn(rng: np.random.Generator) -> Density:
    at = rng.random()
    for density, share in DENSITIES:
        at -= share
        if at < 0.0:
            return density
    return DENSITIES[-1][0]


@cache
def _official(map_name: str, route: tuple[str, ...]) -> tuple[Scenario, ...]:
    every = [scenario for suite in suites().values() for scenario in suite.scenarios]
    return tuple(scenario for scenario in every if scenario.map == map_name and scenario.route == route)
