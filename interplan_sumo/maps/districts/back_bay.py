"""Back bay: brick streets in Boston. Narrow, parked full, many of them one-way; one drives on the right."""

from __future__ import annotations

import math

from interplan_sumo.maps.districts.plan import (
    BusStop,
    Carriageway,
    Plan,
    PlannedCrossing,
    PlannedJunction,
    Road,
    RoadSection,
    lanes,
    one_way,
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


def _both(way: Carriageway) -> tuple[RoadSection, ...]:
    return (RoadSection(0, way, way),)


PLAN = Plan(
    name="back_bay",
    crs="EPSG:32619",
    origin_m=(330000.0, 4690500.0),
    driving_side="right",
    roads=(
        Road(
            10,
            "commonwealth",
            points=(_at(-560, 30), _at(560, 30)),
            sections=_both(_COMMONWEALTH),
            bus_stops=(BusStop("forward", 420), BusStop("backward", 610)),
        ),
        # Eastbound.
        Road(
            20,
            "boylston",
            points=(_at(-560, -185), _at(-330, -192, 600), _at(560, -180)),
            sections=(RoadSection(0, _BOYLSTON),),
            bus_stops=(BusStop("forward", 360), BusStop("forward", 590), BusStop("forward", 960)),
            crossings=(PlannedCrossing(540),),
            sidewalk_m=3.5,
        ),
        Road(
            30,
            "newbury",
            points=(_at(-345, -80), _at(560, -80)),
            sections=_both(_NEWBURY),
            sidewalk_m=3.0,
        ),
        # Westbound.
        Road(
            40,
            "marlborough",
            points=(_at(560, 135), _at(-300, 135)),
            sections=(RoadSection(0, _MARLBOROUGH),),
        ),
        # Westbound.
        Road(
            50,
            "beacon",
            points=(_at(560, 222), _at(150, 228, 700), _at(-150, 226, 500), _at(-540, 270)),
            sections=(RoadSection(0, _BEACON),),
            bus_stops=(BusStop("forward", 200), BusStop("forward", 560)),
        ),
        Road(
            60,
            "massachusetts",
            points=(_at(-395, -390), _at(-345, -100, 300), _at(-300, 130, 300), _at(-275, 430)),
            sections=_both(_MASSACHUSETTS),
            bus_stops=(BusStop("forward", 90), BusStop("backward", 730), BusStop("forward", 780)),
        ),
        # Northbound.
        Road(
            61,
            "fairfield",
            points=(_at(-110, -192), _at(-110, 226)),
            sections=(RoadSection(0, _FAIRFIELD),),
        ),
        Road(
            62,
            "dartmouth",
            points=(_at(95, -420), _at(105, -185, 400), _at(100, 228)),
            sections=_both(_DARTMOUTH),
            bus_stops=(BusStop("forward", 90), BusStop("backward", 120)),
        ),
        # Southbound.
        Road(
            63,
            "clarendon",
            points=(_at(330, 330), _at(330, 20, 300), _at(345, -420)),
            sections=(RoadSection(0, _CLARENDON),),
        ),
        Road(
            70,
            "huntington",
            points=(_at(-170, -430), _at(0, -290, 160), _at(105, -185)),
            sections=(RoadSection(0, _HUNTINGTON_IN, _HUNTINGTON_OUT),),
            bus_stops=(BusStop("forward", 110), BusStop("backward", 140)),
        ),
    ),
    junctions=(
        PlannedJunction(
            1,
            "commonwealth and massachusetts",
            at=_near(-320, 30),
            roads=("commonwealth", "massachusetts"),
            control="signal",
            corner_m=5,
        ),
        PlannedJunction(
            2,
            "commonwealth and fairfield",
            at=_near(-110, 30),
            roads=("commonwealth", "fairfield"),
            control="signal",
            corner_m=5,
        ),
        PlannedJunction(
            3,
            "commonwealth and dartmouth",
            at=_near(102, 30),
            roads=("commonwealth", "dartmouth"),
            control="signal",
            corner_m=5,
        ),
        PlannedJunction(
            4,
            "commonwealth and clarendon",
            at=_near(330, 30),
            roads=("commonwealth", "clarendon"),
            control="signal",
            corner_m=5,
        ),
        PlannedJunction(
            5,
            "boylston and massachusetts",
            at=_near(-360, -190),
            roads=("massachusetts", "boylston"),
            control="signal",
            corner_m=5,
        ),
        PlannedJunction(
            6,
            "boylston and fairfield",
            at=_near(-110, -188),
            roads=("boylston", "fairfield"),
            control="stop",
            crosswalks=("fairfield+",),
            corner_m=5,
        ),
        PlannedJunction(
            7,
            "boylston, dartmouth and huntington",
            at=_near(105, -185),
            roads=("boylston", "dartmouth", "huntington"),
            control="signal",
            corner_m=5,
            # Sharper than a right angle and a half.
            banned=(("huntington-", "dartmouth-"), ("dartmouth-", "huntington-")),
        ),
        PlannedJunction(
            8,
            "boylston and clarendon",
            at=_near(338, -183),
            roads=("boylston", "clarendon"),
            control="signal",
            corner_m=5,
        ),
        PlannedJunction(
            9,
            "newbury and massachusetts",
            at=_near(-341, -80),
            roads=("massachusetts", "newbury"),
            control="stop",
            crosswalks=("newbury+",),
            corner_m=5,
        ),
        PlannedJunction(
            10,
            "newbury and fairfield",
            at=_near(-110, -80),
            roads=("newbury", "fairfield"),
            control="all_way_stop",
            corner_m=5,
        ),
        PlannedJunction(
            11,
            "newbury and dartmouth",
            at=_near(103, -80),
            roads=("newbury", "dartmouth"),
            control="all_way_stop",
            corner_m=5,
        ),
        PlannedJunction(
            12,
            "newbury and clarendon",
            at=_near(335, -80),
            roads=("clarendon", "newbury"),
            control="stop",
            corner_m=5,
        ),
        PlannedJunction(
            13,
            "marlborough and massachusetts",
            at=_near(-300, 135),
            roads=("massachusetts", "marlborough"),
            control="stop",
            crosswalks=("marlborough-",),
            corner_m=5,
        ),
        PlannedJunction(
            14,
            "marlborough and fairfield",
            at=_near(-110, 135),
            roads=("marlborough", "fairfield"),
            control="stop",
            corner_m=5,
        ),
        PlannedJunction(
            15,
            "marlborough and dartmouth",
            at=_near(101, 135),
            roads=("dartmouth", "marlborough"),
            control="stop",
            corner_m=5,
        ),
        PlannedJunction(
            16,
            "marlborough and clarendon",
            at=_near(330, 135),
            roads=("clarendon", "marlborough"),
            control="stop",
            corner_m=5,
        ),
        PlannedJunction(
            17,
            "beacon and massachusetts",
            at=_near(-290, 240),
            roads=("massachusetts", "beacon"),
            control="signal",
            corner_m=5,
        ),
        PlannedJunction(
            18,
            "beacon and fairfield",
            at=_near(-110, 226),
            roads=("beacon", "fairfield"),
            control="stop",
            crosswalks=("fairfield-",),
            corner_m=5,
        ),
        PlannedJunction(
            19,
            "beacon and dartmouth",
            at=_near(100, 228),
            roads=("beacon", "dartmouth"),
            control="stop",
            crosswalks=("dartmouth-",),
            corner_m=5,
        ),
        PlannedJunction(
            20,
            "beacon and clarendon",
            at=_near(330, 226),
            roads=("beacon", "clarendon"),
            control="signal",
            corner_m=5,
        ),
    ),
)
