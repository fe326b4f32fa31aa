"""The strip: boulevards between hotels, as in Las Vegas. Wide, fast, signalled; one drives on the right."""

from __future__ import annotations

from tools.make_maps.plan import (
    CarPark,
    Plan,
    PlannedApproach,
    PlannedCrossing,
    PlannedJunction,
    Road,
    RoadSection,
    both_ways,
    lanes,
    stops,
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


PLAN = Plan(
    name="strip",
    crs="EPSG:32611",
    origin_m=(664400.0, 3997700.0),
    driving_side="right",
    roads=(
        Road(
            10,
            "boulevard",
            ((-70, -800), (30, -120, 1600), (-50, 780)),
            (
                RoadSection(0, _BOULEVARD_3, _BOULEVARD_3, taper_m=60),
                RoadSection(115, _BOULEVARD_4, _BOULEVARD_4, taper_m=60),
                RoadSection(745, _CORE_5, _CORE_4),
                RoadSection(1145, _CORE_4, _CORE_4),
                RoadSection(1475, _CORE_4, lanes(3, 56, width_m=3.4, median_m=7.2), taper_m=60),
            ),
            bus_stops=stops(520, -610, 1320, -880, bays=(520, -610, 1320, -880)),
            crossings=(PlannedCrossing(945, signal=True),),
            sidewalk_m=4.5,
        ),
        Road(
            20,
            "tropicana",
            ((-480, -460), (0, -430, 700), (560, -475)),
            both_ways(_ARTERIAL),
            bus_stops=stops(250, -700, bays=(250, -700)),
            sidewalk_m=3.0,
        ),
        Road(30, "harmon", ((8, -62), (240, -50, 160), (402, 25)), both_ways(_HARMON), bus_stops=stops(-200)),
        Road(
            40,
            "flamingo",
            ((-490, 365), (-30, 335, 800), (560, 372)),
            both_ways(_ARTERIAL_SLOW),
            bus_stops=stops(640, -300, bays=(640, -300)),
            sidewalk_m=3.0,
        ),
        Road(
            50,
            "koval",
            ((375, -640), (412, -150, 500), (395, 700)),
            both_ways(_KOVAL),
            bus_stops=stops(500, -480, 800, -860, -1130),
            car_parks=(CarPark("forward", 300, 380), CarPark("forward", 1090, 1170)),
        ),
        Road(
            60,
            "arena_drive",
            ((-345, -640), (-330, -330, 300), (-390, -60, 220), (-335, 240, 260), (-335, 640)),
            both_ways(_ARENA),
            bus_stops=stops(330, -450, 810, -680),
        ),
        Road(70, "park_avenue", ((-383, -82), (-180, -100, 200), (8, -62)), both_ways(_PARK)),
        Road(80, "linq_lane", ((-30, 570), (200, 590, 150), (396, 560)), both_ways(_LANE), sidewalk_m=2.0),
    ),
    junctions=(
        PlannedJunction(
            1,
            (-15, -431),
            ("boulevard", "tropicana"),
            "signal",
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
            (8, -62),
            ("boulevard", "harmon", "park_avenue"),
            "signal",
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
            (-12, 337),
            ("boulevard", "flamingo"),
            "signal",
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
            (389, -462),
            ("tropicana", "koval"),
            "signal",
            approaches={"tropicana-": _LEFT, "tropicana+": _LEFT, "koval-": _SHORT_LEFT, "koval+": _SHORT_LEFT},
        ),
        PlannedJunction(5, (402, 25), ("koval", "harmon"), "signal", approaches={"koval-": _SHORT_LEFT}),
        PlannedJunction(
            6,
            (400, 362),
            ("flamingo", "koval"),
            "signal",
            approaches={"flamingo-": _LEFT, "flamingo+": _LEFT, "koval-": _SHORT_LEFT, "koval+": _SHORT_LEFT},
        ),
        PlannedJunction(
            7,
            (-335, -450),
            ("tropicana", "arena_drive"),
            "signal",
            approaches={
                "tropicana-": _LEFT,
                "tropicana+": _LEFT,
                "arena_drive-": _SHORT_LEFT,
                "arena_drive+": _SHORT_LEFT,
            },
        ),
        PlannedJunction(
            8,
            (-335, 355),
            ("flamingo", "arena_drive"),
            "signal",
            approaches={
                "flamingo-": _LEFT,
                "flamingo+": _LEFT,
                "arena_drive-": _SHORT_LEFT,
                "arena_drive+": _SHORT_LEFT,
            },
        ),
        PlannedJunction(9, (-383, -82), ("arena_drive", "park_avenue"), "stop", crosswalks=("park_avenue+",)),
        PlannedJunction(
            10,
            (-30, 570),
            ("boulevard", "linq_lane"),
            "stop",
            crosswalks=("linq_lane+",),
            carriageway="forward",  # right in, right out
        ),
        PlannedJunction(11, (396, 560), ("koval", "linq_lane"), "stop", crosswalks=("linq_lane-",)),
    ),
)
