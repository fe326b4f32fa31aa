"""The painted lines of a map."""

from __future__ import annotations

import shapely
from worlds import straight_road

from interplan_sumo.report.markings import markings


def test_markings_are_dashed_between_lanes_and_solid_at_the_edges() -> None:
    roads = straight_road(lanes=3)
    found = markings(roads, roads.drivable_area)
    assert {kind: len(lines) for kind, lines in found.items()} == {"dashed": 2, "solid": 2, "middle": 0}


def test_roads_elsewhere_have_none_here() -> None:
    found = markings(straight_road(), shapely.box(0.0, 500.0, 10.0, 510.0))
    assert not any(found.values())
