"""Standard situations: how a driver of a vehicle-type file answers to an ego that does one thing, measured.

The road (standard_road.net.xml) is straight and nobody may change lane on it, so what a driver does about the ego it
does with its pedals. In each situation the ego does its one thing at `Situation.at_s`; a twin run, in which the ego
goes on as before, tells what the driver would have done.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from math import atan2, inf, nan, pi
from pathlib import Path

import numpy as np

from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.simulation.network import SumoNetwork, plain_ids, read_network
from interplan_sumo.simulation.spawning import Spawn
from interplan_sumo.simulation.sumo import DT_S
from interplan_sumo.simulation.sumo_traffic import SumoTraffic, TrafficSetup
from interplan_sumo.simulation.vehicle_types import VehicleType, VehicleTypes
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.geometry import Floats

ROAD = Path(__file__).parent / "standard_road.net.xml"
LANE_Y = {"in_0": -8.75, "in_1": -5.25, "in_2": -1.75, "back_out_0": 1.75}
CROSSING_X, STREET_X = 800.0, 801.75
"""Middle of the junction, and of the lane that crosses it northward."""
DURATION_S = 25.0
RESPONSE_MPS2 = 0.3
"""A response is an acceleration this much below that of the twin run."""
SETTLED_MPS2, SETTLED_S = 0.3, 1.0
"""A driver has recovered once its speed changes no faster than this for so long, or is what it was before."""

Motion = Callable[[float], tuple[float, float]]
"""Place of the ego's centre at a time."""


@dataclass(frozen=True, slots=True)
class Situation:
    """One thing that an ego does before, beside or across the way of one driver."""

    name: str
    description: str
    lane: str
    """The driver's, in SUMO."""
    front_m: float
    """Where on it the driver's front bumper begins."""
    speed_mps: float
    route: tuple[str, ...]
    ego_route: tuple[str, ...]
    at_s: float
    """When the ego begins to do it."""
    ego: Motion
    undisturbed: Motion
    """The ego of the twin run."""


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What a driver did, step by step, and what that comes to."""

    time_s: Floats
    speed_mps: Floats
    gap_m: Floats
    """From the front bumper to what of the ego is in the driver's way; nan while nothing is."""
    ego_mps: Floats
    reaction_s: float | None
    """From the moment the ego begins to the first response; None: it never responds."""
    hardest_mps2: float
    """Hardest braking, positive."""
    least_gap_m: float
    """Negative: they collide. inf: nothing was ever in the way."""
    recovery_s: float | None
    """From the first response until the speed is steady again, or what it was; None: neither until the end."""


def _profile(start_m: float, mps: float, *parts: tuple[float, float]) -> Callable[[float], float]:
    """Way along a line over time: speed `mps`, then parts of (duration, acceleration); never backwards."""

    def at(t: float) -> float:
        way, speed = start_m, mps
        for duration_s, rate in parts:
            lasts = min(t, duration_s) if rate >= 0.0 else min(t, duration_s, speed / -rate)
            way += speed * lasts + 0.5 * rate * lasts * lasts
            speed += rate * lasts
            t -= duration_s
            if t <= 0.0:
                return way
        return way + speed * t

    return at


def _across(t: float, begins_s: float, takes_s: float) -> float:
    """How much of a lane change is done: a smooth step from 0 to 1."""
    done = min(max((t - begins_s) / takes_s, 0.0), 1.0)
    return done * done * (3.0 - 2.0 * done)


def _behind(name: str, description: str, *braking: tuple[float, float]) -> Situation:
    """The driver follows the ego at 10 m/s, 20 m behind it, on the lane westward."""
    way, steady = _profile(400.0, 10.0, (2.0, 0.0), *braking), _profile(400.0, 10.0)
    y, half = LANE_Y["back_out_0"], PACIFICA.length_m / 2.0
    return Situation(
        name, description, "back_out_0", 400.0 - half - 20.0, 10.0, ("back_out",), ("back_out",), 2.0,
        lambda t: (792.5 - way(t), y), lambda t: (792.5 - steady(t), y),
    )  # fmt: skip


def _sliding(name: str, description: str, takes_s: float, gap_m: float) -> Situation:
    """An ego at 8 m/s slides from the kerb lane before a driver who comes at 10 m/s."""
    at_s = 2.0
    front_m = 300.0
    start_m = front_m + gap_m + PACIFICA.length_m / 2.0 + (10.0 - 8.0) * at_s
    beside, inside = LANE_Y["in_0"], LANE_Y["in_1"]
    return Situation(
        name, description, "in_1", front_m, 10.0, ("in", "out"), ("in", "out"), at_s,
        lambda t: (start_m + 8.0 * t, beside + (inside - beside) * _across(t, at_s, takes_s)),
        lambda t: (start_m + 8.0 * t, beside),
    )  # fmt: skip


def _oncoming() -> Situation:
    """The ego swings out into the lane of one who comes towards it, and back."""
    own, other = LANE_Y["in_2"], LANE_Y["back_out_0"]
    aside = lambda t: _across(t, 2.0, 3.0) - _across(t, 6.0, 3.0)  # noqa: E731
    return Situation(
        "oncoming", "the ego at 8 m/s overtakes through the lane of one who comes at 10 m/s, 170 m ahead, for 7 s",
        "back_out_0", 792.5 - 470.0, 10.0, ("back_out",), ("in", "out"), 2.0,
        lambda t: (300.0 + 8.0 * t, own + (other - own) * aside(t)), lambda t: (300.0 + 8.0 * t, own),
    )  # fmt: skip


def _junction() -> Situation:
    """The ego starts from the stop line of a side street, stops dead on the driver's lane, and goes on."""
    stop_line_y = -17.2
    way = _profile(stop_line_y, 0.0, (2.0, 0.0), (1.65, 3.0), (0.9, 0.0), (5.0 / 6.0, -6.0), (2.0, 0.0), (4.0, 2.0))
    return Situation(
        "junction", "the ego comes out of a side street and stops 2 s on the lane of one who comes at 12 m/s",
        "in_1", CROSSING_X - 87.0, 12.0, ("in", "out"), ("up_in", "up_out"), 2.0,
        lambda t: (STREET_X, way(t)), lambda _t: (STREET_X, stop_line_y),
    )  # fmt: skip


SITUATIONS: tuple[Situation, ...] = (
    _behind("following", "the leader brakes at 3 m/s2 from 10 to 4 m/s and speeds up again", (2.0, -3.0), (3.0, 0.0),
            (4.0, 1.5)),
    _behind("standstill", "the leader brakes at 4 m/s2 from 10 m/s to a stop and stays", (20.0, -4.0)),
    _sliding("cut_in", "the ego at 8 m/s slides within 2 s into a gap of 15 m before one at 10 m/s", 2.0, 15.0),
    _sliding("merge", "the ego at 8 m/s slides within 6 s into a gap of 30 m before one at 10 m/s", 6.0, 30.0),
    _oncoming(),
    _junction(),
)  # fmt: skip


@cache
def road() -> tuple[SumoNetwork, NetworkIds]:
    """The road of all situations; every SUMO lane is its own source lane."""
    network = read_network(ROAD)
    return network, plain_ids(network)


def answer(situation: Situation, types: VehicleTypes, driver: VehicleType) -> Answer:
    """How one driver answers. TrafficError if SUMO fails."""
    speeds, gaps = _run(situation, types, driver, situation.ego)
    undisturbed, _ = _run(situation, types, driver, situation.undisturbed)
    steps = len(speeds)
    rates = np.diff(speeds) / DT_S
    slower = np.diff(undisturbed)[: steps - 1] / DT_S - rates[: len(undisturbed) - 1]
    begins = round(situation.at_s / DT_S)
    found = begins + np.flatnonzero(slower[begins:] >= RESPONSE_MPS2)
    first = int(found[0]) if len(found) else None
    recovery = None
    if first is not None:
        hardest = first + int(np.argmin(rates[first:]))
        calm = np.abs(rates) <= SETTLED_MPS2
        lasts = round(SETTLED_S / DT_S)
        settled = [
            k
            for k in range(hardest, len(rates) - lasts)
            if calm[k : k + lasts].all() or (k > hardest and speeds[k] >= speeds[first])
        ]
        recovery = DT_S * (settled[0] - first) if settled else None
    times = np.arange(steps, dtype=np.float64) * DT_S
    ego_mps = np.array([ego.speed_mps for ego in _egos(situation.ego, 0.0)[:steps]], dtype=np.float64)
    return Answer(
        times, speeds, gaps, ego_mps,
        None if first is None else DT_S * (first - begins),
        float(-rates[begins:].min()),
        float(np.nanmin(gaps)) if np.isfinite(gaps).any() else inf,
        recovery,
    )  # fmt: skip


def _egos(motion: Motion, heading_rad: float) -> list[EgoState]:
    """The ego at each step, turned the way it goes, and at first as told."""
    places = [motion(DT_S * k) for k in range(-1, round(DURATION_S / DT_S) + 2)]
    heading, egos = heading_rad, list[EgoState]()
    for k, ((x, y), (next_x, next_y)) in enumerate(pairwise(places[1:])):
        (before_x, before_y), dx, dy = places[k], next_x - x, next_y - y
        if np.hypot(dx, dy) > 1e-6:
            heading = atan2(dy, dx)
        speed = float(np.hypot(x - before_x, y - before_y)) / DT_S
        egos.append(EgoState(DT_S * k, x, y, heading, vx_mps=speed))
    return egos


def _run(situation: Situation, types: VehicleTypes, driver: VehicleType, motion: Motion) -> tuple[Floats, Floats]:
    """Speed of the driver and gap to the ego at each step."""
    network, ids = road()
    egos = _egos(motion, pi / 2.0 if situation.ego_route[0] == "up_in" else 0.0)
    spawn = Spawn(situation.lane, situation.front_m, situation.speed_mps, driver, situation.route)
    setup = TrafficSetup(network, ids, types, egos[0], situation.ego_route, spawns=(spawn,), tokens=("a",))
    speeds: list[float] = []
    gaps: list[float] = []
    with SumoTraffic(setup) as traffic:
        for now, then in pairwise(egos):
            actors = traffic.observe().actors
            if not len(actors):
                break
            speeds.append(float(actors.speed_mps[0]))
            gaps.append(_gap_m(actors, now))
            traffic.react(now)
            traffic.place_ego(then)
            traffic.advance()
    return np.array(speeds, dtype=np.float64), np.array(gaps, dtype=np.float64)


def _gap_m(actors: Actors, ego: EgoState) -> float:
    """From the front bumper of the only agent to the ego's nearest part in its way; nan if none is there."""
    x, y, heading = (float(part[0]) for part in (actors.x_m, actors.y_m, actors.heading_rad))
    length_m, width_m = float(actors.length_m[0]), float(actors.width_m[0])
    corners = ego.corners(PACIFICA) - (x, y)
    ahead = corners @ np.array((np.cos(heading), np.sin(heading)))
    left = corners @ np.array((np.cos(heading + pi / 2.0), np.sin(heading + pi / 2.0)))
    beside = left.min() > width_m / 2.0 or left.max() < -width_m / 2.0
    behind = ahead.max() < -length_m / 2.0
    return nan if beside or behind else float(ahead.min()) - length_m / 2.0
