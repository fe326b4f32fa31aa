"""The SUMO network as read by us: damaged files never reach SUMO."""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest
import shapely
from networks import NETWORK_FILE, two_way_road

from interplan_sumo.errors import MapError
from interplan_sumo.simulation.network import read_network


def test_lanes_links_and_the_other_direction_are_read() -> None:
    network = two_way_road()
    assert network.edges["e0"] == ("e0_0", "e0_1", "e0_2")
    (link,) = network.links["e0_1"]
    assert (link.to_lane, link.via, link.major, link.light) == ("e1_1", (":B_1_1",), True, None)
    area = shapely.union_all([piece.polygon for piece in network.lanes["e0_1"].pieces])
    assert area.bounds == pytest.approx((0.0, -7.0, 400.0, -3.5))
    assert {piece.lane.id for piece in network.pieces[0] if piece.holds(100.0, -5.0)} == {"e0_1"}
    assert network.continuations("e0_1") == {"e0_1", ":B_1_1", "e1_1"}


def test_an_internal_lane_is_on_a_route_only_between_its_own_edges() -> None:
    network = two_way_road()
    assert network.on_route(":B_1_0", ("e0", "e1"))
    assert not network.on_route(":B_0_0", ("e0", "e1"))


@pytest.mark.parametrize("keep", [0, 1, 200, 2000, -20])
def test_a_truncated_network_is_refused_in_one_line(tmp_path: Path, keep: int) -> None:
    whole = NETWORK_FILE.read_bytes()
    path = tmp_path / "map.net.xml"
    path.write_bytes(whole[:keep])
    with pytest.raises(MapError, match=r"map\.net\.xml"):
        read_network(path)


def test_a_truncated_gzip_and_other_files_are_refused(tmp_path: Path) -> None:
    packed = tmp_path / "map.net.xml.gz"
    packed.write_bytes(gzip.compress(NETWORK_FILE.read_bytes())[:-100])
    with pytest.raises(MapError, match="damaged"):
        read_network(packed)
    packed.write_bytes(b"this is no gzip file")
    with pytest.raises(MapError, match="damaged"):
        read_network(packed)
    (tmp_path / "other.xml").write_text("<routes/>")
    with pytest.raises(MapError, match="root is <routes>"):
        read_network(tmp_path / "other.xml")
    with pytest.raises(MapError, match="no SUMO network"):
        read_network(tmp_path / "missing.net.xml")


def test_a_connection_to_nowhere_is_named(tmp_path: Path) -> None:
    path = tmp_path / "map.net.xml"
    whole = NETWORK_FILE.read_text()
    path.write_text(whole.replace('to="e1" fromLane="1" toLane="1"', 'to="e9" fromLane="1" toLane="1"'))
    with pytest.raises(MapError, match="lane e9_1, which does not exist"):
        read_network(path)
