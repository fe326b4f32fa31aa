"""Back bay: brick streets in Boston. Narrow, parked full, many of them one-way; one drives on the right."""

from __future__ import annotations

import math

from tools.make_maps.plan import (
    Plan,
    PlannedCrossing,
    PlannedJunction,
    Road,
    RoadSection,
    both_ways,
    lanes,
    one_section,
    one_way,
    stops,
)

_COMMONWEALTH = lanes(2, 40, width_m=3.1, median_m=12.0, parking_m=2.2)  # 25 mph, the city's default
_BOYLSTON = one_way(3, 40, width_m=3.2, parking_m=2.4)
_NEWBURY = lanes(1, 32, width_m=3.1, parking_m=2.2)
_MARLBOROUGH = one_way(1, 32, width_m=3.6, parking_m=2.2, far_parking_m=2.2)
_BEACON = one_way(2, 40, width_m=3.3, parking_m=2.2, far_parking_m=2.2)
_MASSACHUSETTS = lanes(2, 48, width_m=3.2)
_FAIRFIELD = one_way(1, 32, width_m=3.4, parking_m=2.2)
_DARTMOUTH = lanes(1, 40, width_m=3.3, parking_m=2.2)
_CLARENDON = one_way(2, 40, width_m=3.1, parking_m=2.2)
_HUNTINGTON_IN = lanes(2, 48, width_m=3.2, median_m=1.6)
_HUNTINGTON_OUT = lanes(1, 48, width_m=3.5, median_m=1.6, parking_m=2.4)

_STREETS_RAD = math.radians(17.0)
"""The streets run east-north-east."""


def _at(along_m: float, across_m: float, *bend: float) -> tuple[float, ...]:
    """A point in the frame of the street grid."""
    cos, sin = math.cos(_STREETS_RAD), math.sin(_STREETS_RAD)
    return (along_m * cos - across_m * sin, along_m * sin + across_m * cos, *bend)


def _near(along_m: float, across_m: float) -> tuple[float, float]:
    x_m, y_m = _at(along_m, across_m)
    return x_m, y_m


PLAN = Plan(
    name="back_bay",
    crs="EPSG:32619",
    origin_m=(330000.0, 4690500.0),
    driving_side="right",
    roads=(
        Road(10, "commonwealth", (_at(-560, 30), _at(560, 30)), both_ways(_COMMONWEALTH), bus_stops=stops(420, -610)),
        # Eastbound.
        Road(
            20,
            "boylston",
            (_at(-560, -185), _at(-330, -192, 600), _at(560, -180)),
            one_section(_BOYLSTON),
            bus_stops=stops(360, 590, 960),
            crossings=(PlannedCrossing(540),),
            sidewalk_m=3.5,
        ),
        Road(30, "newbury", (_at(-345, -80), _at(560, -80)), both_ways(_NEWBURY), sidewalk_m=3.0),
        # Westbound.
        Road(40, "marlborough", (_at(560, 135), _at(-300, 135)), one_section(_MARLBOROUGH)),
        # Westbound.
        Road(
            50,
            "beacon",
            (_at(560, 222), _at(150, 228, 700), _at(-150, 226, 500), _at(-540, 270)),
            one_section(_BEACON),
            bus_stops=stops(200, 560),
        ),
        Road(
            60,
            "massachusetts",
            (_at(-395, -390), _at(-345, -100, 300), _at(-300, 130, 300), _at(-275, 430)),
            both_ways(_MASSACHUSETTS),
            bus_stops=stops(90, -730, 780),
        ),
        # Northbound.
        Road(61, "fairfield", (_at(-110, -192), _at(-110, 226)), one_section(_FAIRFIELD)),
        Road(
            62,
            "dartmouth",
            (_at(95, -420), _at(105, -185, 400), _at(100, 228)),
            both_ways(_DARTMOUTH),
            bus_stops=stops(90, -120),
        ),
        # Southbound.
        Road(63, "clarendon", (_at(330, 330), _at(330, 20, 300), _at(345, -420)), one_section(_CLARENDON)),
        Road(
            70,
            "huntington",
            (_at(-170, -430), _at(0, -290, 160), _at(105, -185)),
            (RoadSection(0, _HUNTINGTON_IN, _HUNTINGTON_OUT),),
            bus_stops=stops(110, -140),
        ),
    ),
    junctions=(
        PlannedJunction(1, _near(-320, 30), ("commonwealth", "massachusetts"), "signal", corner_m=5),
        PlannedJunction(2, _near(-110, 30), ("commonwealth", "fairfield"), "signal", corner_m=5),
        PlannedJunction(3, _near(102, 30), ("commonwealth", "dartmouth"), "signal", corner_m=5),
        PlannedJunction(4, _near(330, 30), ("commonwealth", "clarendon"), "signal", corner_m=5),
        PlannedJunction(5, _near(-360, -190), ("massachusetts", "boylston"), "signal", corner_m=5),
        PlannedJunction(
            6, _near(-110, -188), ("boylston", "fairfield"), "stop", crosswalks=("fairfield+",), corner_m=5
        ),
        PlannedJunction(
            7,
            _near(105, -185),
            ("boylston", "dartmouth", "huntington"),
            "signal",
            corner_m=5,
            # Sharper than a right angle and a half.
            banned=(("huntington-", "dartmouth-"), ("dartmouth-", "huntington-")),
        ),
        PlannedJunction(8, _near(338, -183), ("boylston", "clarendon"), "signal", corner_m=5),
        PlannedJunction(
            9, _near(-341, -80), ("massachusetts", "newbury"), "stop", crosswalks=("newbury+",), corner_m=5
        ),
        PlannedJunction(10, _near(-110, -80), ("newbury", "fairfield"), "all_way_stop", corner_m=5),
        PlannedJunction(11, _near(103, -80), ("newbury", "dartmouth"), "all_way_stop", corner_m=5),
        PlannedJunction(12, _near(335, -80), ("clarendon", "newbury"), "stop", corner_m=5),
        PlannedJunction(
            13, _near(-300, 135), ("massachusetts", "marlborough"), "stop", crosswalks=("marlborough-",), corner_m=5
        ),
        PlannedJunction(14, _near(-110, 135), ("marlborough", "fairfield"), "stop", corner_m=5),
        PlannedJunction(15, _near(101, 135), ("dartmouth", "marlborough"), "stop", corner_m=5),
        PlannedJunction(16, _near(330, 135), ("clarendon", "marlborough"), "stop", corner_m=5),
        PlannedJunction(17, _near(-290, 240), ("massachusetts", "beacon"), "signal", corner_m=5),
        PlannedJunction(18, _near(-110, 226), ("beacon", "fairfield"), "stop", crosswalks=("fairfield-",), corner_m=5),
        PlannedJunction(19, _near(100, 228), ("beacon", "dartmouth"), "stop", crosswalks=("dartmouth-",), corner_m=5),
        PlannedJunction(20, _near(330, 226), ("beacon", "clarendon"), "signal", corner_m=5),
    ),
)
