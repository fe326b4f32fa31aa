"""Egos that no driver would wish to meet, each moved by a bicycle of its own: nothing teleports, nothing slides.

A behaviour is a function of time and place that says what the driver wants: an offset from the route's line, a speed
(negative: reverse gear) and a direction along it. One bicycle model makes poses of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import atan2, cos, hypot, pi, sin, tan

import numpy as np

from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.geometry import Polyline

DT_S = 0.1
FULL_LOCK_RAD = 0.55
STEER_RADPS = 0.9
"""How fast the front wheels turn."""
PUSH_MPS2, BRAKE_MPS2 = 4.0, 8.5
LATERAL_MPS2 = 6.0
"""What the tyres hold."""


@dataclass(frozen=True, slots=True)
class Wish:
    """What the driver wants now."""

    left_m: float = 0.0
    """Offset from the line."""
    speed_mps: float = 8.0
    against: bool = False
    """Whether to drive along the line backwards, nose first."""


Driver = Callable[[float, float], Wish]
"""From the time in s and the arc length on the line to a wish."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What a behaviour may know of the route."""

    cruise_mps: float
    lane_m: float
    """Lane width."""
    side: float
    """+1 if the wider choice of lanes is to the left, -1 to the right."""
    oncoming_m: float | None
    """Offset of the nearest oncoming lane, None without one."""
    junctions_m: tuple[tuple[float, float], ...]
    """Stretches of the line inside junctions."""


def weaving(at: Surroundings, rng: np.random.Generator) -> Driver:
    half_s, speed, width = (
        rng.uniform(1.2, 3.0),
        at.cruise_mps * rng.uniform(0.6, 1.2),
        at.lane_m * rng.uniform(0.6, 1.4),
    )
    return lambda t, _: Wish(
        width * at.side if int(t / half_s) % 2 else rng_free(t, half_s, -width * at.side / 2), speed
    )


def rng_free(t: float, half_s: float, left_m: float) -> float:
    """Every other time to the middle of the lane, else to the other side."""
    return 0.0 if int(t / half_s) % 4 else left_m


def wrong_way(at: Surroundings, rng: np.random.Generator) -> Driver:
    """Against traffic: in the oncoming lane, or after a turn on the spot."""
    speed, turns_s = rng.uniform(3.0, 13.0), rng.uniform(0.5, 4.0)
    if at.oncoming_m is not None and rng.random() < 0.5:
        return lambda t, _: Wish(at.oncoming_m or 0.0 if t > turns_s else 0.0, speed)
    left_m = float(rng.choice((0.0, at.lane_m, -at.lane_m)))
    return lambda t, _: (
        Wish(left_m, 4.0 if t < turns_s + 5.0 else speed, against=True) if t > turns_s else Wish(0.0, 5.0)
    )


def reversing(at: Surroundings, rng: np.random.Generator) -> Driver:
    first_s, back_s, back_mps = rng.uniform(0.0, 5.0), rng.uniform(4.0, 12.0), -rng.uniform(1.0, 6.0)
    left_m = float(rng.choice((0.0, 0.0, at.side * at.lane_m)))
    return lambda t, _: Wish(left_m, back_mps if first_s < t < first_s + back_s else at.cruise_mps)


def stopping_on_junctions(at: Surroundings, rng: np.random.Generator) -> Driver:
    stays_s = rng.uniform(5.0, 15.0)
    since: dict[int, float] = {}

    def wish(t: float, arc_m: float) -> Wish:
        for i, (start_m, end_m) in enumerate(at.junctions_m):
            if start_m + 0.3 * (end_m - start_m) <= arc_m <= end_m + 3.0 and t < since.setdefault(i, t) + stays_s:
                return Wish(0.0, 0.0)
        return Wish(0.0, max(6.0, at.cruise_mps))

    return wish


def astride(at: Surroundings, rng: np.random.Generator) -> Driver:
    speed, share = at.cruise_mps * rng.uniform(0.0, 1.1), rng.uniform(0.35, 0.65)
    return lambda _t, _: Wish(at.side * at.lane_m * share, speed)


def leaving_and_returning(at: Surroundings, rng: np.random.Generator) -> Driver:
    half_s, far_m, speed = rng.uniform(2.5, 5.0), rng.uniform(6.0, 16.0), at.cruise_mps * rng.uniform(0.5, 1.1)
    side = float(rng.choice((-1.0, 1.0)))
    return lambda t, _: Wish(side * far_m if int(t / half_s) % 2 else 0.0, speed)


def hard_pedals(at: Surroundings, rng: np.random.Generator) -> Driver:
    half_s = rng.uniform(1.0, 4.0)
    return lambda t, _: Wish(0.0, 0.0 if int(t / half_s) % 2 else 1.5 * at.cruise_mps)


def cutting_in(at: Surroundings, rng: np.random.Generator) -> Driver:
    """Beside the line first, then into it and dead on the brakes."""
    cuts_s, brakes_s = rng.uniform(1.5, 6.0), rng.uniform(0.5, 3.5)
    speed = at.cruise_mps * rng.uniform(0.8, 1.2)
    return lambda t, _: Wish(
        at.side * at.lane_m if t < cuts_s else 0.0, 0.0 if cuts_s + brakes_s < t < cuts_s + brakes_s + 6.0 else speed
    )


def crawling(at: Surroundings, rng: np.random.Generator) -> Driver:
    speed = rng.uniform(0.0, 2.0)
    left_m = float(rng.choice((0.0, at.side * at.lane_m / 2.0)))
    return lambda _t, _: Wish(left_m, speed)


def cruising(at: Surroundings, rng: np.random.Generator) -> Driver:
    speed = at.cruise_mps * rng.uniform(0.7, 1.2)
    return lambda _t, _: Wish(0.0, speed)


BEHAVIOURS: dict[str, Callable[[Surroundings, np.random.Generator], Driver]] = {
    "weaving": weaving, "wrong_way": wrong_way, "reversing": reversing, "stopping_on_junctions": stopping_on_junctions,
    "astride": astride, "leaving_and_returning": leaving_and_returning, "hard_pedals": hard_pedals,
    "cutting_in": cutting_in, "crawling": crawling, "cruising": cruising,
}  # fmt: skip


def random_walk(at: Surroundings, rng: np.random.Generator) -> Driver:
    """One behaviour after another."""
    names = list(BEHAVIOURS)
    parts = [BEHAVIOURS[str(rng.choice(names))](at, rng) for _ in range(40)]
    lasts_s = rng.uniform(2.0, 6.0)
    return lambda t, arc_m: parts[int(t / lasts_s) % len(parts)](t, arc_m)


def behaviours() -> dict[str, Callable[[Surroundings, np.random.Generator], Driver]]:
    """All of them by name."""
    return {**BEHAVIOURS, "random_walk": random_walk}


def driven(line: Polyline, start: EgoState, wish: Driver, steps: int) -> list[EgoState]:
    """`steps` + 1 states of an ego that does what is wished as far as wheels, tyres, engine and brakes allow."""
    shape = PACIFICA
    heading, speed, steer = start.heading_rad, start.speed_mps, 0.0
    x = start.x_m - shape.rear_axle_to_center_m * cos(heading)
    y = start.y_m - shape.rear_axle_to_center_m * sin(heading)
    egos = [start]
    for step in range(1, steps + 1):
        arc_m, _ = line.project_point(x, y)
        wanted = wish(DT_S * step, arc_m)
        speed += min(max(wanted.speed_mps - speed, -BRAKE_MPS2 * DT_S), PUSH_MPS2 * DT_S)
        aim_m = max(6.0, 0.9 * abs(speed))
        reverse = speed < 0.0
        way = -1.0 if wanted.against != reverse else 1.0
        aim = line.pose_at(min(max(arc_m + way * aim_m, 0.0), line.length_m), wanted.left_m)
        bearing = atan2(aim.y_m - y, aim.x_m - x) - heading - (pi if reverse else 0.0)
        bearing = atan2(sin(bearing), cos(bearing))
        distance = max(1.0, hypot(aim.y_m - y, aim.x_m - x))
        curvature = 2.0 * sin(bearing) / distance if abs(bearing) < pi / 2 else (1.0 if bearing > 0.0 else -1.0)
        wheels = atan2(shape.wheelbase_m * (-curvature if reverse else curvature), 1.0)
        lock = min(FULL_LOCK_RAD, atan2(LATERAL_MPS2 * shape.wheelbase_m, max(speed * speed, 1.0)))
        steer += min(max(wheels - steer, -STEER_RADPS * DT_S), STEER_RADPS * DT_S)
        steer = min(max(steer, -lock), lock)
        turned = DT_S * speed * tan(steer) / shape.wheelbase_m
        middle = heading + turned / 2.0
        x, y, heading = x + DT_S * speed * cos(middle), y + DT_S * speed * sin(middle), heading + turned
        heading = atan2(sin(heading), cos(heading))
        reach = shape.rear_axle_to_center_m
        egos.append(
            EgoState(
                DT_S * step, x + reach * cos(heading), y + reach * sin(heading), heading, vx_mps=speed,
                tire_angle_rad=steer, yaw_rate_radps=turned / DT_S,
            )
        )  # fmt: skip
    return egos
