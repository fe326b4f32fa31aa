"""Nudge: parked cars, an open door, a van that unloads or a slow cyclist reach into the lane."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

import numpy as np

from interplan_sumo.families.draws import Draws
from interplan_sumo.families.family import Family
from interplan_sumo.families.passing import is_small, offset_asked_m, passing_problems, small_offset
from interplan_sumo.families.shapes import LARGEST_OFFSET_M, PASSING_M
from interplan_sumo.families.staging import (
    Approach,
    along,
    approach,
    behaviour,
    beside_traffic,
    obstacle,
    oncoming_traffic,
    parked,
    site_for,
)
from interplan_sumo.scenario.kinds import SLOW_SIZES_M
from interplan_sumo.scenario.scenario import Obstacle, PlacedVehicle, Scenario, TrafficDemand
from interplan_sumo.scenario.sites import Site, UnsuitableError
from interplan_sumo.world.roads import Roads

FASTEST_MPS: Final = 16.0
"""Nobody parks half in the lane on faster roads."""
SCENES: Final = {"row": 0.35, "door": 0.25, "van": 0.25, "cyclist": 0.15}
OFFSET_M: Final = (0.5, LARGEST_OFFSET_M)
"""With which the ego passes, 0.3 m clear."""
ROW: Final = (2, 5)
"""Parked cars."""
GAP_M: Final = (0.8, 1.8)
"""Between them: parallel parking bays are 5 to 6 m long (AASHTO, Green Book)."""
UNEVEN_M: Final = (0.0, 0.35)
"""Less than the one that stands farthest out they reach into the lane."""
TURNED_RAD: Final = (-0.06, 0.06)
DOOR_M: Final = 0.9
"""An open door reaches so far beyond its car (decisions.md)."""
DOOR_RAD: Final = 1.15
"""So far it is open: 66 degrees."""
UNLOADS_M: Final = (0.7, 1.6)
"""Somebody stands so far behind the van, middle to rear, and so far inside its outer side."""
INSIDE_M: Final = (0.3, 0.9)
CYCLIST_MPS: Final = (3.0, 4.6)
CYCLIST_M: Final = (25.0, 45.0)
FOLLOWED_M: Final = 165.0
"""To here nobody comes in time who stays behind one at 4 m/s."""
ONCOMING_SHARE: Final = 0.6
"""Of the scenes on two-way roads in which cars meet the ego at what it passes."""


def suitable(roads: Roads, lane_id: str, at_m: float) -> Site:
    """A kerb lane of a road that is not too fast, and wide enough to pass on; UnsuitableError otherwise."""
    site = site_for(roads, lane_id, at_m, FASTEST_MPS)
    if site.lanes_near:
        raise UnsuitableError("it is not the lane at the kerb")
    if site.far_edge_m < LARGEST_OFFSET_M + PASSING_M:
        raise UnsuitableError(f"the road ends {site.far_edge_m:.1f} m beside the lane's centre line: no room to pass")
    return site


def drawn(id: str, roads: Roads, site: Site, draws: Draws) -> Scenario:
    """A scenario of the family at a site, what varies drawn at random."""
    scene = draws.by_share("scene", SCENES)
    most_m = min(OFFSET_M[1], site.width_m / 2.0)  # the ego's centre stays in its lane
    offset_m = draws.uniform("offset_m", (OFFSET_M[0], most_m))
    if scene == "cyclist":
        return _cyclist(id, roads, site, offset_m, draws)
    many = draws.whole("row", ROW) if scene == "row" else 1
    classes = ("van",) if scene == "van" else ("small car", "car", "sport utility")
    cars = [parked(draws, *classes) for _ in range(many)]
    gaps_m = [draws.uniform("gap_m", GAP_M) for _ in range(many - 1)]
    length_m = sum(size[0] for _, size in cars) + sum(gaps_m)
    to = approach(roads, site, draws, before_m=length_m / 2.0, after_m=length_m / 2.0)
    edge_m = PASSING_M - offset_m
    """From the lane's centre line towards the kerb to where what stands begins."""
    farthest = draws.whole("farthest_out", (0, many - 1))
    standing: list[Obstacle] = []
    ahead_m = -length_m / 2.0
    for i, (kind, size) in enumerate(cars):
        back_m = (0.0 if i == farthest else draws.uniform("uneven_m", UNEVEN_M)) + (DOOR_M if scene == "door" else 0.0)
        turned_rad = draws.uniform("turned_rad", TURNED_RAD) if scene == "row" else 0.0
        half_m = (np.sin(abs(turned_rad)) * size[0] + np.cos(turned_rad) * size[1]) / 2.0
        place = along(roads, to.site, ahead_m + size[0] / 2.0, edge_m + back_m + float(half_m))
        standing.append(obstacle(place, (kind, size), turned_rad))
        ahead_m += size[0] + (gaps_m[i] if i < many - 1 else 0.0)
    if scene == "door":
        standing.append(_door(roads, to, edge_m, cars[0][1][0], draws))
    elif scene == "van":
        behind_m = -length_m / 2.0 - draws.uniform("unloads_behind_m", UNLOADS_M)
        inside_m = edge_m + draws.uniform("unloads_inside_m", INSIDE_M) + 0.4
        standing.append(Obstacle(along(roads, to.site, behind_m, inside_m), "person"))
    return to.scenario(id, "nudge", obstacles=tuple(standing), **_traffic(roads, to, draws))


def _door(roads: Roads, to: Approach, edge_m: float, length_m: float, draws: Draws) -> Obstacle:
    """The driver's door, hinged a third of the way behind the front bumper; its tip ends where the ego's room does."""
    door_m = DOOR_M / np.sin(DOOR_RAD)
    hinge_m = length_m / 2.0 - draws.uniform("door_hinge_share", (0.28, 0.36)) * length_m
    ahead_m = hinge_m - door_m / 2.0 * float(np.cos(DOOR_RAD))
    place = along(roads, to.site, ahead_m, edge_m + DOOR_M / 2.0)
    return Obstacle(place, "door", round(-to.site.kerb * (np.pi - DOOR_RAD), 3), round(float(door_m), 2))


def _cyclist(id: str, roads: Roads, site: Site, offset_m: float, draws: Draws) -> Scenario:
    """Somebody who rides slowly along the kerb."""
    to = approach(roads, site, draws, distance_m=CYCLIST_M, beyond_m=(FOLLOWED_M - CYCLIST_M[0], FOLLOWED_M))
    length_m, width_m = SLOW_SIZES_M["bicycle"]
    place = to.site.place(length_m / 2.0, PASSING_M - offset_m + width_m / 2.0)
    rides = PlacedVehicle(place, draws.uniform("cyclist_mps", CYCLIST_MPS, 1), "bicycle")
    staged = _traffic(roads, to, draws)
    return to.scenario(id, "nudge", **{**staged, "vehicles": (rides, *staged.get("vehicles", ()))})


def _traffic(roads: Roads, to: Approach, draws: Draws) -> dict[str, Any]:
    """Where the own direction has one lane, others come when the ego is there, or hardly anybody does."""
    if to.site.lanes_near + to.site.lanes_far:
        return beside_traffic(roads, to, draws, towards_kerb=to.site.lanes_far == 0)
    if draws.happens("platoon_comes", ONCOMING_SHARE):
        return oncoming_traffic(roads, to, draws)
    return {"traffic": TrafficDemand(density="medium", behaviour=behaviour(draws), oncoming="sparse")}


def asks(scenario: Scenario, roads: Roads) -> bool:
    """Whether what stands or crawls there is passed with a small offset."""
    offset_m = offset_asked_m(scenario, roads)
    return is_small(offset_m) and offset_m != 0.0


FAMILY: Final = Family(
    title="Nudge",
    description="Parked cars, a door, a van or a cyclist reach into the lane; pass on the own side, a little aside.",
    suitable=suitable,
    drawn=drawn,
    telling=("scene", "offset_m"),
    order=40,
    checks=(partial(passing_problems, own_side_only=True, offset=small_offset),),
    weighs_direction=True,
    asks=asks,
    original="nudge_around_parked_vehicle",
)
