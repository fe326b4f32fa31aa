"""One north: a business park in Singapore. Curved streets and dual carriageways; one drives on the left."""

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

_BUONA_VISTA = lanes(3, 60, width_m=3.4, median_m=4.6)
_COMMONWEALTH = lanes(3, 70, width_m=3.5, median_m=6.4)
_COMMONWEALTH_2 = lanes(2, 70, width_m=3.5, median_m=6.4)
_AYER_RAJAH = lanes(2, 50, width_m=3.3, median_m=3.6)
_STREET = lanes(1, 50, width_m=3.6)
_PORTSDOWN = lanes(1, 50, width_m=3.4)
_BIOPOLIS = lanes(1, 40, width_m=3.3, parking_m=2.4)

_POCKET = PlannedApproach(inner_pockets=1, storage_m=60, taper_m=30)
_POCKETS = PlannedApproach(inner_pockets=1, kerb_pockets=1, storage_m=60, taper_m=30)
_SHORT_POCKET = PlannedApproach(inner_pockets=1, storage_m=45, taper_m=26, pocket_width_m=3.0)


PLAN = Plan(
    name="one_north",
    crs="EPSG:32648",
    origin_m=(365400.0, 143800.0),
    driving_side="left",
    roads=(
        Road(
            10,
            "buona_vista",
            ((-20, -620), (-90, 20, 650, 40), (70, 680)),
            both_ways(_BUONA_VISTA),
            bus_stops=stops(480, -520, 870, -900, bays=(480, -520, 870, -900)),
            sidewalk_m=3.0,
        ),
        Road(
            20,
            "commonwealth",
            ((-620, 340), (0, 445, 700, 50), (640, 400)),
            (
                RoadSection(0, _COMMONWEALTH_2, _COMMONWEALTH_2, taper_m=60),
                RoadSection(110, _COMMONWEALTH, _COMMONWEALTH, taper_m=60),
            ),
            bus_stops=stops(400, -930, bays=(400, -930)),
            sidewalk_m=3.0,
        ),
        Road(
            30,
            "ayer_rajah",
            (
                (-620, -390),
                (-230, -280, 260, 30),
                (120, -350, 220, 30),
                (420, -220, 150, 25),
                (470, 80, 200, 25),
                (395, 421),
            ),
            both_ways(_AYER_RAJAH),
            bus_stops=stops(180, -220, 690, -950, 1480, -1440, bays=(690, -950)),
            crossings=(PlannedCrossing(990),),
        ),
        Road(
            40,
            "fusionopolis",
            ((-70, 45), (120, 20, 140, 20), (250, 100, 110, 20), (463, 40)),
            both_ways(_STREET),
            bus_stops=stops(120, -300, bays=(-300,)),
            car_parks=(CarPark("backward", 255, 325),),
        ),
        Road(
            50,
            "biopolis",
            ((305, 84), (310, 190, 90, 15), (210, 300, 80, 15), (215, 428)),
            both_ways(_BIOPOLIS),
            bus_stops=stops(110, -240),
        ),
        Road(
            60,
            "portsdown",
            (
                (-370, -318),
                (-390, -150, 130, 20),
                (-290, -20, 120, 20),
                (-330, 150, 130, 20),
                (-300, 260, 150, 20),
                (-320, 391),
            ),
            both_ways(_PORTSDOWN),
            bus_stops=stops(130, -150, 560),
        ),
        Road(70, "stars", ((-300, 25), (-200, 70, 120, 15), (-70, 45)), both_ways(_STREET)),
        Road(
            80,
            "slim_barracks",
            ((170, -330), (145, -215, 90, 15), (175, -100, 80, 15), (130, 22)),
            both_ways(_PORTSDOWN),
            bus_stops=stops(150),
        ),
    ),
    junctions=(
        PlannedJunction(
            1,
            (10, 443),
            ("commonwealth", "buona_vista"),
            "signal",
            corner_m=9,
            approaches={
                "buona_vista-": _POCKETS,
                "buona_vista+": _POCKET,
                "commonwealth-": _POCKET,
                "commonwealth+": _POCKETS,
            },
        ),
        PlannedJunction(
            2,
            (-52, -315),
            ("buona_vista", "ayer_rajah"),
            "signal",
            corner_m=8,
            approaches={
                "buona_vista-": _POCKET,
                "buona_vista+": _POCKET,
                "ayer_rajah-": _SHORT_POCKET,
                "ayer_rajah+": _SHORT_POCKET,
            },
        ),
        PlannedJunction(
            3,
            (-70, 45),
            ("buona_vista", "fusionopolis", "stars"),
            "signal",
            corner_m=8,
            approaches={
                "buona_vista-": _POCKET,
                "buona_vista+": _POCKET,
                "fusionopolis+": _SHORT_POCKET,
                "stars-": _SHORT_POCKET,
            },
        ),
        PlannedJunction(
            4, (395, 421), ("commonwealth", "ayer_rajah"), "signal", corner_m=8, approaches={"commonwealth-": _POCKET}
        ),
        PlannedJunction(
            5,
            (-320, 391),
            ("commonwealth", "portsdown"),
            "signal",
            corner_m=8,
            approaches={"commonwealth-": _POCKET, "portsdown-": _SHORT_POCKET},
        ),
        PlannedJunction(
            6,
            (-370, -318),
            ("ayer_rajah", "portsdown"),
            "yield",
            crosswalks=("portsdown+",),
            approaches={"ayer_rajah+": _SHORT_POCKET},
        ),
        PlannedJunction(
            7,
            (463, 40),
            ("ayer_rajah", "fusionopolis"),
            "signal",
            approaches={"ayer_rajah+": _SHORT_POCKET, "fusionopolis-": _SHORT_POCKET},
        ),
        PlannedJunction(8, (305, 84), ("fusionopolis", "biopolis"), "yield", crosswalks=("biopolis+",)),
        PlannedJunction(
            9,
            (215, 428),
            ("commonwealth", "biopolis"),
            "yield",
            crosswalks=("biopolis-",),
            carriageway="backward",  # left in, left out
        ),
        PlannedJunction(10, (-305, 25), ("portsdown", "stars"), "yield", crosswalks=("stars+",)),
        PlannedJunction(
            11,
            (180, -345),
            ("ayer_rajah", "slim_barracks"),
            "yield",
            crosswalks=("slim_barracks+",),
            approaches={"ayer_rajah+": _SHORT_POCKET},
        ),
        PlannedJunction(12, (130, 22), ("fusionopolis", "slim_barracks"), "yield", crosswalks=("slim_barracks-",)),
    ),
)
