"""The ego's SUMO route: along the scenario's, and on behind it only where that leads to new streets."""

from __future__ import annotations

from itertools import pairwise

import pytest

from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.store import find_map
from interplan_sumo.simulation.lane_chains import ego_sumo_route
from interplan_sumo.simulation.network import read_network

ROUND_A_BLOCK = (
    "311010", "31101010", "302020", "30202030", "382010", "38201010", "372020", "37202010", "252030", "25203030",
    "302010",
)  # fmt: skip


def edges_along(map_name: str, lanes: tuple[str, ...]) -> tuple[str, ...]:
    """The route of a chain of lanes; each of its edges leads to the next one, and none comes twice."""
    files = find_map(map_name)
    network = read_network(files.network)
    edges = ego_sumo_route(network, NetworkIds.read(files.ids), lanes)
    assert len(set(edges)) == len(edges)
    among, links = network.lanes, (link for links in network.links.values() for link in links)
    assert set(pairwise(edges)) <= {(among[link.from_lane].edge, among[link.to_lane].edge) for link in links}
    return edges


def test_a_route_round_a_block_ends_where_streets_behind_it_lead_back_into_it() -> None:
    assert len(edges_along("greenfield", ROUND_A_BLOCK)) >= len(ROUND_A_BLOCK[::2])


@pytest.mark.parametrize(
    "lanes", [("302090", "302091"), ("302091", "302090"), ("101010", "101023", "302090", "302091")]
)
def test_a_change_of_lane_on_a_road_of_several_edges_passes_each_of_them_once(lanes: tuple[str, ...]) -> None:
    edges = edges_along("one_north", lanes)
    first = edges.index("30209.0")
    assert edges[first : first + 2] == ("30209.0", "30209.1")
