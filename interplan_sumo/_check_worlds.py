"""The little worlds on which the conformance suite drives a planner."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, pi, sin

import numpy as np

from interplan_sumo.planner import Mission, Observation, Past
from interplan_sumo.tiny_worlds import (
    DT_S,
    cars,
    curved_road,
    ego_on,
    junction,
    mission,
    pedestrians,
    signals,
    straight_road,
    together,
)
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import wrap_angle
from interplan_sumo.world.signals import Signals

PAST_STEPS = 20


@dataclass(frozen=True, eq=False)
class CheckWorld:
    """One world: a mission, a start and what is around. Actors keep their velocity and yield to nobody."""

    name: str
    mission: Mission
    ego: EgoState
    actors: Actors
    signals: Callable[[float], Signals]
    """By time in seconds."""
    has_past: bool = True

    def actors_at(self, time_s: float) -> Actors:
        """The actors, moved on at constant velocity."""
        a = self.actors
        x_m, y_m = a.x_m + time_s * a.vx_mps, a.y_m + time_s * a.vy_mps
        return Actors(a.ids, a.kind, x_m, y_m, a.heading_rad, a.length_m, a.width_m, a.vx_mps, a.vy_mps)

    def observation(self, ego: EgoState, earlier: list[EgoState]) -> Observation:
        """What the planner sees; the past before the start is extrapolated at constant velocity."""
        past = Past()
        if self.has_past:
            before = [_moved(self.ego, -DT_S * k) for k in range(PAST_STEPS, 0, -1)]
            egos = tuple((before + earlier)[-PAST_STEPS:])
            past = Past(egos, tuple(self.actors_at(e.time_s) for e in egos))
        return Observation(ego.time_s, ego, self.actors_at(ego.time_s), self.signals(ego.time_s), past)


def check_worlds() -> tuple[CheckWorld, ...]:
    """All worlds of the suite, built anew."""
    road = straight_road(lanes=1, length_m=300.0, limit_mps=13.9, cuts_m=((120.0, 135.0),))
    wide = straight_road(lanes=3, length_m=300.0, limit_mps=13.9, cuts_m=((120.0, 135.0),))
    unknown = straight_road(lanes=1, length_m=300.0, limit_mps=None, cuts_m=((120.0, 135.0),))
    bend = curved_road(radius_m=25.0, angle_rad=-pi / 2, run_in_m=40.0, limit_mps=8.3, cuts_m=((35.0, 85.0),))
    crossing, crossing_left = junction(), junction(driving_side="left")
    chain = ("11", "21", "31")
    dark = Signals.none()
    red = signals(red=("12", "13", "14"), green=("24", "42"))
    green = signals(red=("24", "42"), green=("12", "13", "14"))
    return (
        CheckWorld("empty road", mission(road, chain), ego_on(road, "11", 20.0, 10.0), Actors.none(), lambda _: dark),
        CheckWorld(
            "standing car ahead",
            mission(road, chain), ego_on(road, "11", 20.0, 6.0), cars((42.0, 0.0)), lambda _: dark,
        ),
        CheckWorld(
            "red light",
            mission(crossing, ("1", "13", "7")), ego_on(crossing, "1", 35.0, 6.0), Actors.none(), lambda _: red,
        ),
        CheckWorld(
            "standing at a light that turns green",
            mission(crossing, ("1", "14", "8")),
            ego_on(crossing, "1", 56.0),
            together(cars((40.0, 1.75, 8.0, pi)), pedestrians((-20.0, 6.0, 1.4, -pi / 2))),
            lambda time_s: red if time_s < 1.5 else green,
        ),
        CheckWorld(
            "left-hand traffic",
            mission(crossing_left, ("1", "12", "6")), ego_on(crossing_left, "1", 40.0, 5.0),
            cars((30.0, -1.75, 8.0, pi)), lambda _: green,
        ),
        CheckWorld("bend", mission(bend, chain), ego_on(bend, "11", 25.0, 7.0), Actors.none(), lambda _: dark),
        CheckWorld(
            "dense traffic", mission(wide, chain), ego_on(wide, "12", 60.0, 9.0),
            cars(*((12.0 * i, -3.5 * lane, 8.0) for i in range(13) for lane in range(3) if (i, lane) != (5, 1))),
            lambda _: dark,
        ),
        CheckWorld(
            "200 actors, one of them inside the ego", mission(wide, chain), ego_on(wide, "12", 60.0, 4.0), _crowd(200),
            lambda _: dark,
        ),
        CheckWorld(
            "no speed limits, no past", mission(unknown, chain), ego_on(unknown, "11", 20.0, 8.0),
            cars((70.0, 0.0, 5.0)), lambda _: dark, has_past=False,
        ),
        CheckWorld(
            "end of the road, goal behind",
            mission(road, chain, goal_arc_m=20.0), ego_on(road, "31", 150.0, 6.0), Actors.none(), lambda _: dark,
        ),
    )  # fmt: skip


def _crowd(count: int) -> Actors:
    """Actors all over the place, in a fixed spiral, each heading outwards; the first stands inside the ego."""
    angle = pi * (3.0 - 5.0**0.5) * np.arange(count)
    radius_m = 1.0 + 4.0 * np.sqrt(np.arange(count))
    x_m, y_m = 60.0 + radius_m * np.cos(angle), -3.5 + radius_m * np.sin(angle)
    rows = np.stack((x_m, y_m, np.arange(count) % 4, wrap_angle(angle)), axis=1)
    return cars(*(tuple(row) for row in rows.tolist()), prefix="a")


def _moved(ego: EgoState, time_s: float) -> EgoState:
    """The ego some time later (earlier if negative) at constant velocity."""
    travelled_m = ego.speed_mps * time_s
    return EgoState(
        round(ego.time_s + time_s, 6),
        ego.x_m + travelled_m * cos(ego.heading_rad),
        ego.y_m + travelled_m * sin(ego.heading_rad),
        wrap_angle(ego.heading_rad),
        vx_mps=ego.vx_mps,
    )
