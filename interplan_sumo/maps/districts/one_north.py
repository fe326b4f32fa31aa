"""One north: a business park in Singapore. Curved streets and dual carriageways; one drives on the left."""

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


def _both(way: Carriageway) -> tuple[RoadSection, ...]:
    return (RoadSection(0, way, way),)


PLAN = Plan(
    name="one_north",
    crs="EPSG:32648",
    origin_m=(365400.0, 143800.0),
    driving_side="left",
    roads=(
        Road(
            10,
            "buona_vista",
            points=((-20, -620), (-90, 20, 650, 40), (70, 680)),
            sections=_both(_BUONA_VISTA),
            bus_stops=(
                BusStop("forward", 480, bay=True),
                BusStop("backward", 520, bay=True),
                BusStop("forward", 870, bay=True),
                BusStop("backward", 900, bay=True),
            ),
            sidewalk_m=3.0,
        ),
        Road(
            20,
            "commonwealth",
            points=((-620, 340), (0, 445, 700, 50), (640, 400)),
            sections=(
                RoadSection(0, _COMMONWEALTH_2, _COMMONWEALTH_2, taper_m=60),
                RoadSection(110, _COMMONWEALTH, _COMMONWEALTH, taper_m=60),
            ),
            bus_stops=(BusStop("forward", 400, bay=True), BusStop("backward", 930, bay=True)),
            sidewalk_m=3.0,
        ),
        Road(
            30,
            "ayer_rajah",
            points=(
                (-620, -390),
                (-230, -280, 260, 30),
                (120, -350, 220, 30),
                (420, -220, 150, 25),
                (470, 80, 200, 25),
                (395, 421),
            ),
            sections=_both(_AYER_RAJAH),
            bus_stops=(
                BusStop("forward", 180),
                BusStop("backward", 220),
                BusStop("forward", 690, bay=True),
                BusStop("backward", 950, bay=True),
                BusStop("forward", 1480),
                BusStop("backward", 1440),
            ),
            crossings=(PlannedCrossing(990),),
        ),
        Road(
            40,
            "fusionopolis",
            points=((-70, 45), (120, 20, 140, 20), (250, 100, 110, 20), (463, 40)),
            sections=_both(_STREET),
            bus_stops=(BusStop("forward", 120), BusStop("backward", 300, bay=True)),
            car_parks=(CarPark("backward", 255, 325),),
        ),
        Road(
            50,
            "biopolis",
            points=((305, 84), (310, 190, 90, 15), (210, 300, 80, 15), (215, 428)),
            sections=_both(_BIOPOLIS),
            bus_stops=(BusStop("forward", 110), BusStop("backward", 240)),
        ),
        Road(
            60,
            "portsdown",
            points=(
                (-370, -318),
                (-390, -150, 130, 20),
                (-290, -20, 120, 20),
                (-330, 150, 130, 20),
                (-300, 260, 150, 20),
                (-320, 391),
            ),
            sections=_both(_PORTSDOWN),
            bus_stops=(BusStop("forward", 130), BusStop("backward", 150), BusStop("forward", 560)),
        ),
        Road(
            70,
            "stars",
            points=((-300, 25), (-200, 70, 120, 15), (-70, 45)),
            sections=_both(_STREET),
        ),
        Road(
            80,
            "slim_barracks",
            points=((170, -330), (145, -215, 90, 15), (175, -100, 80, 15), (130, 22)),
            sections=_both(_PORTSDOWN),
            bus_stops=(BusStop("forward", 150),),
        ),
    ),
    junctions=(
        PlannedJunction(
            1,
            "buona vista and commonwealth",
            at=(10, 443),
            roads=("commonwealth", "buona_vista"),
            control="signal",
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
            "buona vista and ayer rajah",
            at=(-52, -315),
            roads=("buona_vista", "ayer_rajah"),
            control="signal",
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
            "buona vista and fusionopolis",
            at=(-70, 45),
            roads=("buona_vista", "fusionopolis", "stars"),
            control="signal",
            corner_m=8,
            approaches={
                "buona_vista-": _POCKET,
                "buona_vista+": _POCKET,
                "fusionopolis+": _SHORT_POCKET,
                "stars-": _SHORT_POCKET,
            },
        ),
        PlannedJunction(
            4,
            "commonwealth and ayer rajah",
            at=(395, 421),
            roads=("commonwealth", "ayer_rajah"),
            control="signal",
            corner_m=8,
            approaches={"commonwealth-": _POCKET},
        ),
        PlannedJunction(
            5,
            "commonwealth and portsdown",
            at=(-320, 391),
            roads=("commonwealth", "portsdown"),
            control="signal",
            corner_m=8,
            approaches={"commonwealth-": _POCKET, "portsdown-": _SHORT_POCKET},
        ),
        PlannedJunction(
            6,
            "ayer rajah and portsdown",
            at=(-370, -318),
            roads=("ayer_rajah", "portsdown"),
            control="yield",
            crosswalks=("portsdown+",),
            approaches={"ayer_rajah+": _SHORT_POCKET},
        ),
        PlannedJunction(
            7,
            "ayer rajah and fusionopolis",
            at=(463, 40),
            roads=("ayer_rajah", "fusionopolis"),
            control="signal",
            approaches={"ayer_rajah+": _SHORT_POCKET, "fusionopolis-": _SHORT_POCKET},
        ),
        PlannedJunction(
            8,
            "fusionopolis and biopolis",
            at=(305, 84),
            roads=("fusionopolis", "biopolis"),
            control="yield",
            crosswalks=("biopolis+",),
        ),
        PlannedJunction(
            9,
            "commonwealth and biopolis",
            at=(215, 428),
            roads=("commonwealth", "biopolis"),
            control="yield",
            crosswalks=("biopolis-",),
            carriageway="backward",  # left in, left out
        ),
        PlannedJunction(
            10,
            "portsdown and stars",
            at=(-305, 25),
            roads=("portsdown", "stars"),
            control="yield",
            crosswalks=("stars+",),
        ),
        PlannedJunction(
            11,
            "ayer rajah and slim barracks",
            at=(180, -345),
            roads=("ayer_rajah", "slim_barracks"),
            control="yield",
            crosswalks=("slim_barracks+",),
            approaches={"ayer_rajah+": _SHORT_POCKET},
        ),
        PlannedJunction(
            12,
            "fusionopolis and slim barracks",
            at=(130, 22),
            roads=("fusionopolis", "slim_barracks"),
            control="yield",
            crosswalks=("slim_barracks-",),
        ),
    ),
)
