"""Who yields to whom by the regulatory elements of a Lanelet2 map."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Container, Mapping, Sequence
from itertools import product

from interplan_sumo.errors import counted
from interplan_sumo.maps.importers.lanelet2.osm import OsmFile
from interplan_sumo.maps.importers.lanelet2.travel_directions import TravelDirection
from interplan_sumo.maps.importers.source import SourceJunction, SourceWay


def junctions_of(
    file: OsmFile,
    directions: Sequence[TravelDirection],
    followers: Mapping[str, Sequence[str]],
    predecessors: Mapping[str, Sequence[str]],
    overruled: Container[str],
) -> tuple[tuple[SourceJunction, ...], tuple[str, ...]]:
    """One per right_of_way element: the lanelets that it lets go first, and those that it makes yield to them.

    A lanelet may be named that leads to the junction, or one within it; so both
    its ends count. Elements about `overruled` lanes hold while a light is out only.
    Of two lanelets that elements make yield to each other neither does: that is
    left to signs and geometry, and a note says so.
    """
    lanes: defaultdict[str, list[str]] = defaultdict(list)
    for direction in directions:
        lanes[direction.lanelet.id].append(direction.id)

    def ways(lanelets: Sequence[str]) -> dict[tuple[str, ...], None]:
        named = [lane for lanelet in lanelets for lane in lanes.get(lanelet, ())]
        ends = [(before, lane) for lane in named for before in predecessors.get(lane, ())]
        return dict.fromkeys((*ends, *((lane, after) for lane in named for after in followers.get(lane, ()))))

    elements: list[tuple[str, Sequence[str], Sequence[str]]] = []
    for element in file.of_type("regulatory_element"):
        if element.tags.get("subtype") != "right_of_way":
            continue
        waiting, going = (element.refs(role, "relation") for role in ("yield", "right_of_way"))
        if not any(lane in overruled for lanelet in waiting for lane in lanes.get(lanelet, ())):
            elements.append((element.id, waiting, going))
    orders = dict.fromkeys(pair for _, waiting, going in elements for pair in product(waiting, going))
    contested = {(one, other) for one, other in orders if one != other and (other, one) in orders}
    found: list[SourceJunction] = []
    for id_, waiting, going in elements:
        late = ways(waiting)
        first = [way for way in ways(going) if way not in late]
        place = {way: k for k, way in enumerate((*late, *first))}
        yields = {
            (place[one], place[other])
            for pair in product(waiting, going)
            if pair not in contested
            for one, other in product(*(ways([lanelet]) for lanelet in pair))
            if other not in late
        }
        if yields:
            found.append(SourceJunction(id_, "", tuple(map(SourceWay, place)), frozenset(yields)))
    pairs = [(one, other) for one, other in orders if (one, other) in contested and one < other]
    if not pairs:
        return tuple(found), ()
    one, other = pairs[0]
    said = f"{counted(len(pairs), 'pair')} of lanelets yield to each other by right_of_way elements"
    return tuple(found), (f"{said}, such as {one} and {other}: signs and geometry decide there.",)
