"""The strip: boulevards between hotels, as in Las Vegas. Wide, fast, signalled; one drives on the right."""

from __future__ import annotations

from interplan_sumo.maps.districts.plan import (
    BusStop,
    CarPark,
    Carriageway,
    Plan,
    PlannedApproach,
    PlannedCrossing,
    PlannedJunction,
    Road,
    RoadSection,
    lanes,
)

_BOULEVARD_3 = lanes(3, 72, width_m=3.5, median_m=7.2)  # 45 mph
_BOULEVARD_4 = lanes(4, 72, width_m=3.5, median_m=7.2)
_CORE_4 = lanes(4, 56, width_m=3.4, median_m=7.2)  # 35 mph between the hotels
_CORE_5 = lanes(5, 56, width_m=3.4, median_m=7.2)
_ARTERIAL = lanes(3, 64, width_m=3.5, median_m=4.4)
_ARTERIAL_SLOW = lanes(3, 56, width_m=3.4, median_m=4.4)
_HARMON = lanes(2, 48, width_m=3.4, median_m=3.8)
_KOVAL = lanes(2, 48, width_m=3.3)
_ARENA = lanes(1, 48, width_m=3.6, parking_m=2.4)
_PARK = lanes(1, 48, width_m=3.5)
_LANE = lanes(1, 40, width_m=3.3)

_DOUBLE_LEFT = PlannedApproach(inner_pockets=2, storage_m=85, taper_m=36)
_DOUBLE_LEFT_AND_RIGHT = PlannedApproach(inner_pockets=2, kerb_pockets=1, storage_m=85, taper_m=36)
_LEFT = PlannedApproach(inner_pockets=1, storage_m=60, taper_m=28)
_LEFT_AND_RIGHT = PlannedApproach(inner_pockets=1, kerb_pockets=1, storage_m=60, taper_m=28)
_SHORT_LEFT = PlannedApproach(inner_pockets=1, storage_m=45, taper_m=26, pocket_width_m=3.0)


def _both(way: Carriageway) -> tuple[RoadSection, ...]:
    return (RoadSection(0, way, way),)


PLAN = Plan(
    name="strip",
    crs="EPSG:32611",
    origin_m=(664400.0, 3997700.0),
    driving_side="right",
    roads=(
        Road(
            10,
            "boulevard",
            points=((-70, -800), (30, -120, 1600), (-50, 780)),
            sections=(
                RoadSection(0, _BOULEVARD_3, _BOULEVARD_3, taper_m=60),
                RoadSection(115, _BOULEVARD_4, _BOULEVARD_4, taper_m=60),
                RoadSection(745, _CORE_5, _CORE_4),
                RoadSection(1145, _CORE_4, _CORE_4),
                RoadSection(1475, _CORE_4, lanes(3, 56, width_m=3.4, median_m=7.2), taper_m=60),
            ),
            bus_stops=(
                BusStop("forward", 520, bay=True),
                BusStop("backward", 610, bay=True),
                BusStop("forward", 1320, bay=True),
                BusStop("backward", 880, bay=True),
            ),
            crossings=(PlannedCrossing(945, signal=True),),
            sidewalk_m=4.5,
        ),
        Road(
            20,
            "tropicana",
            points=((-480, -460), (0, -430, 700), (560, -475)),
            sections=_both(_ARTERIAL),
            bus_stops=(BusStop("forward", 250, bay=True), BusStop("backward", 700, bay=True)),
            sidewalk_m=3.0,
        ),
        Road(
            30,
            "harmon",
            points=((8, -62), (240, -50, 160), (402, 25)),
            sections=_both(_HARMON),
            bus_stops=(BusStop("backward", 200),),
        ),
        Road(
            40,
            "flamingo",
            points=((-490, 365), (-30, 335, 800), (560, 372)),
            sections=_both(_ARTERIAL_SLOW),
            bus_stops=(BusStop("forward", 640, bay=True), BusStop("backward", 300, bay=True)),
            sidewalk_m=3.0,
        ),
        Road(
            50,
            "koval",
            points=((375, -640), (412, -150, 500), (395, 700)),
            sections=_both(_KOVAL),
            bus_stops=(
                BusStop("forward", 500),
                BusStop("backward", 480),
                BusStop("forward", 800),
                BusStop("backward", 860),
                BusStop("backward", 1130),
            ),
            car_parks=(CarPark("forward", 300, 380), CarPark("forward", 1090, 1170)),
        ),
        Road(
            60,
            "arena_drive",
            points=((-345, -640), (-330, -330, 300), (-390, -60, 220), (-335, 240, 260), (-335, 640)),
            sections=_both(_ARENA),
            bus_stops=(
                BusStop("forward", 330),
                BusStop("backward", 450),
                BusStop("forward", 810),
                BusStop("backward", 680),
            ),
        ),
        Road(
            70,
            "park_avenue",
            points=((-383, -82), (-180, -100, 200), (8, -62)),
            sections=_both(_PARK),
        ),
        Road(
            80,
            "linq_lane",
            points=((-30, 570), (200, 590, 150), (396, 560)),
            sections=_both(_LANE),
            sidewalk_m=2.0,
        ),
    ),
    junctions=(
        PlannedJunction(
            1,
            "boulevard and tropicana",
            at=(-15, -431),
            roads=("boulevard", "tropicana"),
            control="signal",
            corner_m=9,
            approaches={
                "boulevard-": _DOUBLE_LEFT_AND_RIGHT,
                "boulevard+": _DOUBLE_LEFT,
                "tropicana-": _LEFT,
                "tropicana+": _LEFT_AND_RIGHT,
            },
        ),
        PlannedJunction(
            2,
            "boulevard and harmon",
            at=(8, -62),
            roads=("boulevard", "harmon", "park_avenue"),
            control="signal",
            corner_m=8,
            approaches={
                "boulevard-": _LEFT_AND_RIGHT,
                "boulevard+": _LEFT,
                "harmon+": PlannedApproach(inner_pockets=1, storage_m=60, taper_m=28, use=("L", "T", "R")),
                "park_avenue-": _SHORT_LEFT,
            },
        ),
        PlannedJunction(
            3,
            "boulevard and flamingo",
            at=(-12, 337),
            roads=("boulevard", "flamingo"),
            control="signal",
            corner_m=9,
            approaches={
                "boulevard-": PlannedApproach(
                    inner_pockets=2, storage_m=85, taper_m=36, use=("L", "L", "T", "T", "T", "T", "R")
                ),
                "boulevard+": _DOUBLE_LEFT,
                "flamingo-": _LEFT_AND_RIGHT,
                "flamingo+": _LEFT,
            },
        ),
        PlannedJunction(
            4,
            "koval and tropicana",
            at=(389, -462),
            roads=("tropicana", "koval"),
            control="signal",
            approaches={
                "tropicana-": _LEFT,
                "tropicana+": _LEFT,
                "koval-": _SHORT_LEFT,
                "koval+": _SHORT_LEFT,
            },
        ),
        PlannedJunction(
            5,
            "koval and harmon",
            at=(402, 25),
            roads=("koval", "harmon"),
            control="signal",
            approaches={"koval-": _SHORT_LEFT},
        ),
        PlannedJunction(
            6,
            "koval and flamingo",
            at=(400, 362),
            roads=("flamingo", "koval"),
            control="signal",
            approaches={
                "flamingo-": _LEFT,
                "flamingo+": _LEFT,
                "koval-": _SHORT_LEFT,
                "koval+": _SHORT_LEFT,
            },
        ),
        PlannedJunction(
            7,
            "arena drive and tropicana",
            at=(-335, -450),
            roads=("tropicana", "arena_drive"),
            control="signal",
            approaches={
                "tropicana-": _LEFT,
                "tropicana+": _LEFT,
                "arena_drive-": _SHORT_LEFT,
                "arena_drive+": _SHORT_LEFT,
            },
        ),
        PlannedJunction(
            8,
            "arena drive and flamingo",
            at=(-335, 355),
            roads=("flamingo", "arena_drive"),
            control="signal",
            approaches={
                "flamingo-": _LEFT,
                "flamingo+": _LEFT,
                "arena_drive-": _SHORT_LEFT,
                "arena_drive+": _SHORT_LEFT,
            },
        ),
        PlannedJunction(
            9,
            "arena drive and park avenue",
            at=(-383, -82),
            roads=("arena_drive", "park_avenue"),
            control="stop",
            crosswalks=("park_avenue+",),
        ),
        PlannedJunction(
            10,
            "boulevard and linq lane",
            at=(-30, 570),
            roads=("boulevard", "linq_lane"),
            control="stop",
            crosswalks=("linq_lane+",),
            carriageway="forward",  # right in, right out
        ),
        PlannedJunction(
            11,
            "koval and linq lane",
            at=(396, 560),
            roads=("koval", "linq_lane"),
            control="stop",
            crosswalks=("linq_lane-",),
        ),
    ),
)
