"""The strip: wide boulevards between hotels, as in Las Vegas; one drives on the right."""

from __future__ import annotations

from interplan_sumo.maps.districts.plan import Approach, BusStop, Junction, Plan, Road, Section, lanes

_BOULEVARD = lanes(4, 72, width_m=3.5, median_m=7.2)
_SIDE_STREET = lanes(2, 48, width_m=3.4, median_m=3.8)

PLAN = Plan(
    name="strip",
    crs="EPSG:32611",
    origin_m=(664400.0, 3997700.0),
    driving_side="right",
    roads=(
        Road(
            10,
            "boulevard",
            points=((-60, -420), (20, 0, 1400), (-40, 460)),
            sections=(Section(0, _BOULEVARD, _BOULEVARD),),
            bus_stops=(BusStop("forward", 100, bay=True),),
        ),
        Road(
            20,
            "flamingo",
            points=((-300, 40), (0, 50, 500), (300, 20)),
            sections=(Section(0, _SIDE_STREET, _SIDE_STREET),),
        ),
    ),
    junctions=(
        Junction(
            1,
            "boulevard and flamingo",
            at=(15, 50),
            roads=("boulevard", "flamingo"),
            control="signal",
            approaches={
                "boulevard-": Approach(inner_pockets=2, storage_m=80, taper_m=35),
                "boulevard+": Approach(inner_pockets=2, storage_m=80, taper_m=35),
                "flamingo-": Approach(inner_pockets=1, storage_m=60),
                "flamingo+": Approach(inner_pockets=1, storage_m=60),
            },
            corner_m=8.0,
        ),
    ),
)
