"""The ego's SUMO route: along the scenario's, and on behind it only where that leads to new streets."""

from __future__ import annotations

from itertools import pairwise

from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.store import find_map
from interplan_sumo.simulation.lane_chains import ego_sumo_route
from interplan_sumo.simulation.network import read_network

ROUND_A_BLOCK = (
    "311010", "31101010", "302020", "30202030", "382010", "38201010", "372020", "37202010", "252030", "25203030",
    "302010",
)  # fmt: skip


def test_a_route_round_a_block_ends_where_streets_behind_it_lead_back_into_it() -> None:
    files = find_map("greenfield")
    network = read_network(files.network)
    edges = ego_sumo_route(network, NetworkIds.read(files.ids), ROUND_A_BLOCK)
    assert len(set(edges)) == len(edges)
    lanes, links = network.lanes, (link for links in network.links.values() for link in links)
    assert set(pairwise(edges)) <= {(lanes[link.from_lane].edge, lanes[link.to_lane].edge) for link in links}
