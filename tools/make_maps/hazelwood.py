"""Hazelwood: a suburb of Pittsburgh between hill and river, with a parkway; one drives on the right."""

from __future__ import annotations

import math

from tools.make_maps.plan import (
    CarPark,
    Plan,
    PlannedApproach,
    PlannedCrossing,
    PlannedJunction,
    Ramp,
    Road,
    RoadSection,
    both_ways,
    lanes,
    one_section,
    one_way,
    ramp_end,
    stops,
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


_EXIT_EAST = Ramp("parkway", "forward", 420, "river_exit", "exit")
_ENTRY_EAST = Ramp("parkway", "forward", 1010, "river_entry", "entry")
_EXIT_WEST = Ramp("parkway", "backward", 1290, "town_exit", "exit")
_ENTRY_WEST = Ramp("parkway", "backward", 470, "town_entry", "entry")

_PARKWAY = Road(
    10,
    "parkway",
    ((-880, -330), (-40, -440, 1100, 80), (880, -330)),
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


def _end(ramp: Ramp) -> tuple[float, float]:
    x_m, y_m, _ = ramp_end(_PARKWAY, "right", ramp)
    return x_m, y_m


def _bend(ramp: Ramp, ahead_m: float, radius_m: float, spiral_m: float) -> tuple[float, float, float, float]:
    """A bend of a ramp on the tangent of its arm, ahead in the direction of travel."""
    x_m, y_m, heading = ramp_end(_PARKWAY, "right", ramp)
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
            ((-880, -20), (-430, -150, 260, 40), (60, -60, 420, 40), (430, -160, 300, 40), (880, -40)),
            (
                RoadSection(0, _SECOND, _SECOND),
                RoadSection(560, _SECOND_TOWN, _SECOND_TOWN),
                RoadSection(1140, _SECOND, _SECOND),
            ),
            bus_stops=stops(260, -250, 740, -730, 1000, -980, -1660, 1400, bays=(-250,)),
            crossings=(PlannedCrossing(930),),
            car_parks=(CarPark("backward", 1180, 1270, depth_m=40),),
        ),
        Road(
            30,
            "river_road",
            ((-880, -560), (-300, -610, 500, 40), (260, -600, 600, 40), (880, -510)),
            both_ways(_RIVER),
            sidewalk_m=0,
        ),
        Road(
            40,
            "hazelwood_avenue",
            ((-55, -80), (-70, 130, 130, 20), (-190, 290, 120, 20), (-170, 520, 150, 20), (-230, 700)),
            both_ways(_AVENUE),
            bus_stops=stops(250, -220, 460, -700),
        ),
        Road(41, "glenwood", ((-65, 65), (150, 120, 140, 20), (350, 40, 110, 20), (400, -148)), both_ways(_STREET)),
        Road(
            42,
            "sylvan",
            ((-165, 262), (-280, 225, 90, 15), (-420, 300, 100, 20), (-530, 140, 120, 20), (-500, -128)),
            both_ways(_STREET),
        ),
        Road(43, "johnston", ((180, 112), (240, 300, 110, 20), (90, 470, 110, 20), (-175, 470)), both_ways(_STREET)),
        Road(
            44,
            "elizabeth",
            ((226, 256), (450, 330, 130, 20), (620, 130, 140, 20), (640, -100)),
            both_ways(_AVENUE),
            bus_stops=stops(300, -330),
        ),
        Road(
            50,
            "town_exit",
            (_end(_EXIT_WEST), _bend(_EXIT_WEST, 90, 120, 30), (170, -300, 80, 20), (150, -78)),
            one_section(_RAMP),
            sidewalk_m=0,
        ),
        Road(
            51,
            "town_entry",
            ((-262, -112), _bend(_ENTRY_WEST, -150, 80, 20), _end(_ENTRY_WEST)),
            one_section(_RAMP),
            sidewalk_m=0,
        ),
        Road(
            52,
            "river_exit",
            (_end(_EXIT_EAST), _bend(_EXIT_EAST, 80, 120, 30), (-280, -490, 80, 20), (-262, -606)),
            one_section(_RAMP),
            sidewalk_m=0,
        ),
        Road(
            53,
            "river_entry",
            ((-8, -607), _bend(_ENTRY_EAST, -110, 70, 20), _end(_ENTRY_EAST)),
            one_section(_RAMP),
            sidewalk_m=0,
        ),
    ),
    junctions=(
        PlannedJunction(
            1,
            (-55, -78),
            ("second_avenue", "hazelwood_avenue"),
            "signal",
            approaches={"second_avenue-": _POCKET, "hazelwood_avenue+": _POCKET},
        ),
        PlannedJunction(2, (150, -80), ("second_avenue", "town_exit"), "signal", corner_m=8),
        PlannedJunction(
            3,
            (-262, -118),
            ("second_avenue", "town_entry"),
            "none",
            crosswalks=(),
            corner_m=10,
            approaches={
                "second_avenue+": PlannedApproach(inner_pockets=1, storage_m=35, taper_m=24, pocket_width_m=3.0)
            },
        ),
        PlannedJunction(4, (400, -150), ("second_avenue", "glenwood"), "stop", crosswalks=("glenwood-",)),
        PlannedJunction(5, (-500, -130), ("second_avenue", "sylvan"), "stop", crosswalks=("sylvan-",)),
        PlannedJunction(
            6, (640, -104), ("second_avenue", "elizabeth"), "signal", approaches={"second_avenue-": _POCKET}
        ),
        PlannedJunction(7, (-65, 65), ("hazelwood_avenue", "glenwood"), "all_way_stop"),
        PlannedJunction(8, (-170, 262), ("hazelwood_avenue", "sylvan"), "stop", crosswalks=("sylvan+",)),
        PlannedJunction(9, (-175, 470), ("hazelwood_avenue", "johnston"), "all_way_stop"),
        PlannedJunction(10, (180, 112), ("glenwood", "johnston"), "stop", crosswalks=("johnston+",)),
        PlannedJunction(11, (226, 256), ("johnston", "elizabeth"), "stop", crosswalks=("elizabeth+",)),
        PlannedJunction(12, (-262, -608), ("river_road", "river_exit"), "stop", crosswalks=(), corner_m=10),
        PlannedJunction(13, (-8, -607), ("river_road", "river_entry"), "none", crosswalks=(), corner_m=10),
    ),
    ramps=(_EXIT_EAST, _ENTRY_EAST, _EXIT_WEST, _ENTRY_WEST),
)
