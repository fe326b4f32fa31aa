"""Who yields to whom by the regulatory elements of a Lanelet2 map."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Container, Mapping, Sequence
from itertools import product

from interplan_sumo.maps.importers.lanelet2.osm import OsmFile
from interplan_sumo.maps.importers.lanelet2.travel_directions import TravelDirection
from interplan_sumo.maps.importers.source import SourceJunction, SourceWay


def junctions_of(
    file: OsmFile,
    directions: Sequence[TravelDirection],
    followers: Mapping[str, Sequence[str]],
    predecessors: Mapping[str, Sequence[str]],
    overruled: Container[str],
) -> tuple[SourceJunction, ...]:
    """One per right_of_way element: the lanelets that it lets go first, and those that it makes yield to them.

    A lanelet may be named that leads to the junction, or one within it; so both
    its ends count. Elements about `overruled` lanes hold while a light is out only.
    """
    lanes: defaultdict[str, list[str]] = defaultdict(list)
    for direction in directions:
        lanes[direction.lanelet.id].append(direction.id)

    def ways(lanelets: Sequence[str]) -> dict[tuple[str, ...], None]:
        named = [lane for lanelet in lanelets for lane in lanes.get(lanelet, ())]
        ends = [(before, lane) for lane in named for before in predecessors.get(lane, ())]
        return dict.fromkeys((*ends, *((lane, after) for lane in named for after in followers.get(lane, ()))))

    found: list[SourceJunction] = []
    for element in file.of_type("regulatory_element"):
        if element.tags.get("subtype") != "right_of_way":
            continue
        waiting, going = (element.refs(role, "relation") for role in ("yield", "right_of_way"))
        if any(lane in overruled for lanelet in waiting for lane in lanes.get(lanelet, ())):
            continue
        late = ways(waiting)
        first = [way for way in ways(going) if way not in late]
        if late and first:
            together = tuple(SourceWay(way) for way in (*late, *first))
            pairs = product(range(len(late)), range(len(late), len(together)))
            found.append(SourceJunction(element.id, "", together, frozenset(pairs)))
    return tuple(found)
