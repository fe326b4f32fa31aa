"""A cone between two lanes is passed on either side, and by nobody in the middle of a lane change."""

from __future__ import annotations

import numpy as np
import pytest
from networks import LANE_Y, agent, ego_at, stepped, two_way_road, types

from interplan_sumo.simulation.lane_posts import CLOSED_M, LanePosts
from interplan_sumo.simulation.network import plain_ids
from interplan_sumo.simulation.obstacles import LaneBlockage
from interplan_sumo.simulation.sumo import sumo
from interplan_sumo.simulation.sumo_traffic import SumoTraffic, TrafficSetup
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.geometry import penetration_m

BORDER_Y = (LANE_Y[0] + LANE_Y[1]) / 2.0
EGO = ego_at(700.0, LANE_Y[2], 0.0)


def cone(x_m: float, y_m: float) -> Actors:
    column = {name: np.array([value]) for name, value in (("x_m", x_m), ("y_m", y_m), ("heading_rad", 0.7))}
    sizes = {"length_m": np.array([0.5]), "width_m": np.array([0.5]), "vx_mps": np.zeros(1), "vy_mps": np.zeros(1)}
    return Actors(ids=("cone",), kind=np.array([ActorKind.TRAFFIC_CONE], dtype=np.int8), **column, **sizes)


def passing(standing: Actors) -> tuple[float, float]:
    """(How deep one that overtakes gets into a cone, where it changes lane), for one behind a slow one."""
    cars, network = types("assertive"), two_way_road()
    both = (agent(cars, "e0_0", 160.0, 2.0), agent(cars, "e0_0", 110.0, 8.0))
    setup = TrafficSetup(
        network, plain_ids(network), cars, EGO, ("e0", "e1"), spawns=both, tokens=("slow", "fast"), standing=standing
    )
    deepest, changed_m = -np.inf, np.inf
    with SumoTraffic(setup) as run:
        sumo.vehicle.setMaxSpeed("a0", 2.0)
        for actors in stepped(run, lambda _: EGO, 280):
            row, place = actors.ids.index("fast"), actors.ids.index("cone")
            deepest = max(deepest, float(penetration_m(actors.corners[[place]], actors.corners[[row]])[0]))
            if abs(actors.y_m[row] - LANE_Y[0]) > 0.5:
                changed_m = min(changed_m, float(actors.x_m[row]))
    return deepest, changed_m


def test_nobody_sweeps_over_a_cone_between_lanes_and_all_change_lane_once_they_are_past() -> None:
    _, free_m = passing(cone(900.0, BORDER_Y))
    deepest, changed_m = passing(cone(free_m + 8.0, BORDER_Y))
    assert deepest <= 0.0
    assert free_m + 8.0 < changed_m < 400.0


@pytest.mark.parametrize(
    ("y_m", "closed_at_m", "is_one"),
    [(BORDER_Y, None, True), (LANE_Y[0], None, False), (BORDER_Y, 200.0 + CLOSED_M - 1.0, False),
     (BORDER_Y, 200.0 + CLOSED_M + 1.0, True)],
    ids=["between lanes", "in a lane", "near a closed lane", "far from a closed lane"],
)  # fmt: skip
def test_what_counts_as_a_post(y_m: float, closed_at_m: float | None, is_one: bool) -> None:
    closed = () if closed_at_m is None else (LaneBlockage("e0_1", closed_at_m, closed_at_m + 10.0),)
    cars = types("assertive")
    posts = LanePosts(two_way_road(), cone(200.0, y_m), closed, (0.0, 0.0), {"a0": cars.members[0]})
    assert bool(posts._posts) is is_one
