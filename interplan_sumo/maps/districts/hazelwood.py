"""Hazelwood: a suburb of Pittsburgh between hill and river, with a parkway; one drives on the right."""

from __future__ import annotations

import math

from interplan_sumo.maps.districts.plan import (
    BusStop,
    CarPark,
    Carriageway,
    Plan,
    PlannedApproach,
    PlannedCrossing,
    PlannedJunction,
    Ramp,
    Road,
    RoadSection,
    lanes,
    one_way,
    ramp_mouth,
)

_PARKWAY_2 = lanes(2, 88, width_m=3.6, median_m=6.0)  # 55 mph
_PARKWAY_3 = lanes(3, 88, width_m=3.6, median_m=6.0)
_SECOND = lanes(1, 56, width_m=3.6)  # 35 mph
_SECOND_TOWN = lanes(1, 40, width_m=3.4, parking_m=2.3)  # 25 mph
_RIVER = lanes(1, 64, width_m=3.6)
_AVENUE = lanes(1, 40, width_m=3.3, parking_m=2.2)
_STREET = lanes(1, 40, width_m=3.3)
_RAMP = one_way(1, 48, width_m=3.6)  # 30 mph

_POCKET = PlannedApproach(inner_pockets=1, storage_m=45, taper_m=30, pocket_width_m=3.1)


def _both(way: Carriageway) -> tuple[RoadSection, ...]:
    return (RoadSection(0, way, way),)


_EXIT_EAST = Ramp("parkway", "forward", 420, "river_exit", "exit")
_ENTRY_EAST = Ramp("parkway", "forward", 1010, "river_entry", "entry")
_EXIT_WEST = Ramp("parkway", "backward", 1290, "town_exit", "exit")
_ENTRY_WEST = Ramp("parkway", "backward", 470, "town_entry", "entry")

_PARKWAY = Road(
    10,
    "parkway",
    points=((-880, -330), (-40, -440, 1100, 80), (880, -330)),
    sections=(
        # Eastbound: an exit lane from 200 on, the exit at 420; an entry at 1010, whose lane ends at 1400.
        # Westbound: an exit lane from 1500 on, the exit at 1290; an entry at 470, whose lane ends at 150.
        RoadSection(0, _PARKWAY_2, _PARKWAY_2),
        RoadSection(150, _PARKWAY_2, _PARKWAY_3, taper_m=80),
        RoadSection(200, _PARKWAY_3, _PARKWAY_3, taper_m=60),
        RoadSection(420, _PARKWAY_2, _PARKWAY_3, taper_m=24),
        RoadSection(470, _PARKWAY_2, _PARKWAY_2, taper_m=24),
        RoadSection(1010, _PARKWAY_3, _PARKWAY_2, taper_m=24),
        RoadSection(1290, _PARKWAY_3, _PARKWAY_3, taper_m=24),
        RoadSection(1400, _PARKWAY_2, _PARKWAY_3, taper_m=80),
        RoadSection(1500, _PARKWAY_2, _PARKWAY_2, taper_m=60),
    ),
    sidewalk_m=0,
)


def _mouth(ramp: Ramp) -> tuple[float, float]:
    x_m, y_m, _ = ramp_mouth(_PARKWAY, "right", ramp)
    return x_m, y_m


def _bend(ramp: Ramp, ahead_m: float, radius_m: float, spiral_m: float) -> tuple[float, float, float, float]:
    """A bend of a ramp on the tangent of its mouth, ahead in the direction of travel."""
    x_m, y_m, heading = ramp_mouth(_PARKWAY, "right", ramp)
    return (x_m + ahead_m * math.cos(heading), y_m + ahead_m * math.sin(heading), radius_m, spiral_m)


PLAN = Plan(
    name="hazelwood",
    crs="EPSG:32617",
    origin_m=(588500.0, 4476000.0),
    driving_side="right",
    roads=(
        _PARKWAY,
        Road(
            20,
            "second_avenue",
            points=((-880, -20), (-430, -150, 260, 40), (60, -60, 420, 40), (430, -160, 300, 40), (880, -40)),
            sections=(
                RoadSection(0, _SECOND, _SECOND),
                RoadSection(560, _SECOND_TOWN, _SECOND_TOWN),
                RoadSection(1140, _SECOND, _SECOND),
            ),
            bus_stops=(
                BusStop("forward", 260),
                BusStop("backward", 250, bay=True),
                BusStop("forward", 740),
                BusStop("backward", 730),
                BusStop("forward", 1000),
                BusStop("backward", 980),
                BusStop("backward", 1660),
                BusStop("forward", 1400),
            ),
            crossings=(PlannedCrossing(930),),
            car_parks=(CarPark("backward", 1180, 1270, depth_m=40),),
        ),
        Road(
            30,
            "river_road",
            points=((-880, -560), (-300, -610, 500, 40), (260, -600, 600, 40), (880, -510)),
            sections=_both(_RIVER),
            sidewalk_m=0,
        ),
        Road(
            40,
            "hazelwood_avenue",
            points=((-55, -80), (-70, 130, 130, 20), (-190, 290, 120, 20), (-170, 520, 150, 20), (-230, 700)),
            sections=_both(_AVENUE),
            bus_stops=(
                BusStop("forward", 250),
                BusStop("backward", 220),
                BusStop("forward", 460),
                BusStop("backward", 700),
            ),
        ),
        Road(
            41,
            "glenwood",
            points=((-65, 65), (150, 120, 140, 20), (350, 40, 110, 20), (400, -148)),
            sections=_both(_STREET),
        ),
        Road(
            42,
            "sylvan",
            points=((-165, 262), (-280, 225, 90, 15), (-420, 300, 100, 20), (-530, 140, 120, 20), (-500, -128)),
            sections=_both(_STREET),
        ),
        Road(
            43,
            "johnston",
            points=((180, 112), (240, 300, 110, 20), (90, 470, 110, 20), (-175, 470)),
            sections=_both(_STREET),
        ),
        Road(
            44,
            "elizabeth",
            points=((226, 256), (450, 330, 130, 20), (620, 130, 140, 20), (640, -100)),
            sections=_both(_AVENUE),
            bus_stops=(BusStop("forward", 300), BusStop("backward", 330)),
        ),
        Road(
            50,
            "town_exit",
            points=(_mouth(_EXIT_WEST), _bend(_EXIT_WEST, 90, 120, 30), (170, -300, 80, 20), (150, -78)),
            sections=(RoadSection(0, _RAMP),),
            sidewalk_m=0,
        ),
        Road(
            51,
            "town_entry",
            points=((-262, -112), _bend(_ENTRY_WEST, -150, 80, 20), _mouth(_ENTRY_WEST)),
            sections=(RoadSection(0, _RAMP),),
            sidewalk_m=0,
        ),
        Road(
            52,
            "river_exit",
            points=(_mouth(_EXIT_EAST), _bend(_EXIT_EAST, 80, 120, 30), (-280, -490, 80, 20), (-262, -606)),
            sections=(RoadSection(0, _RAMP),),
            sidewalk_m=0,
        ),
        Road(
            53,
            "river_entry",
            points=((-8, -607), _bend(_ENTRY_EAST, -110, 70, 20), _mouth(_ENTRY_EAST)),
            sections=(RoadSection(0, _RAMP),),
            sidewalk_m=0,
        ),
    ),
    junctions=(
        PlannedJunction(
            1,
            "second avenue and hazelwood avenue",
            at=(-55, -78),
            roads=("second_avenue", "hazelwood_avenue"),
            control="signal",
            approaches={"second_avenue-": _POCKET, "hazelwood_avenue+": _POCKET},
        ),
        PlannedJunction(
            2,
            "second avenue and town exit",
            at=(150, -80),
            roads=("second_avenue", "town_exit"),
            control="signal",
            corner_m=8,
        ),
        PlannedJunction(
            3,
            "second avenue and town entry",
            at=(-262, -118),
            roads=("second_avenue", "town_entry"),
            control="none",
            crosswalks=(),
            corner_m=10,
            approaches={
                "second_avenue+": PlannedApproach(inner_pockets=1, storage_m=35, taper_m=24, pocket_width_m=3.0)
            },
        ),
        PlannedJunction(
            4,
            "second avenue and glenwood",
            at=(400, -150),
            roads=("second_avenue", "glenwood"),
            control="stop",
            crosswalks=("glenwood-",),
        ),
        PlannedJunction(
            5,
            "second avenue and sylvan",
            at=(-500, -130),
            roads=("second_avenue", "sylvan"),
            control="stop",
            crosswalks=("sylvan-",),
        ),
        PlannedJunction(
            6,
            "second avenue and elizabeth",
            at=(640, -104),
            roads=("second_avenue", "elizabeth"),
            control="signal",
            approaches={"second_avenue-": _POCKET},
        ),
        PlannedJunction(
            7,
            "hazelwood avenue and glenwood",
            at=(-65, 65),
            roads=("hazelwood_avenue", "glenwood"),
            control="all_way_stop",
        ),
        PlannedJunction(
            8,
            "hazelwood avenue and sylvan",
            at=(-170, 262),
            roads=("hazelwood_avenue", "sylvan"),
            control="stop",
            crosswalks=("sylvan+",),
        ),
        PlannedJunction(
            9,
            "hazelwood avenue and johnston",
            at=(-175, 470),
            roads=("hazelwood_avenue", "johnston"),
            control="all_way_stop",
        ),
        PlannedJunction(
            10,
            "glenwood and johnston",
            at=(180, 112),
            roads=("glenwood", "johnston"),
            control="stop",
            crosswalks=("johnston+",),
        ),
        PlannedJunction(
            11,
            "johnston and elizabeth",
            at=(226, 256),
            roads=("johnston", "elizabeth"),
            control="stop",
            crosswalks=("elizabeth+",),
        ),
        PlannedJunction(
            12,
            "river road and river exit",
            at=(-262, -608),
            roads=("river_road", "river_exit"),
            control="stop",
            crosswalks=(),
            corner_m=10,
        ),
        PlannedJunction(
            13,
            "river road and river entry",
            at=(-8, -607),
            roads=("river_road", "river_entry"),
            control="none",
            crosswalks=(),
            corner_m=10,
        ),
    ),
    ramps=(_EXIT_EAST, _ENTRY_EAST, _EXIT_WEST, _ENTRY_WEST),
)
