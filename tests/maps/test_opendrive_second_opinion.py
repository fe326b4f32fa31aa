"""netconvert's reading of OpenDRIVE files beside ours: the same, or told why not."""

from __future__ import annotations

from pathlib import Path

import pytest

from interplan_sumo.maps.importers.opendrive.second_opinion import opinion_of_netconvert
from interplan_sumo.maps.importers.opinion import OpinionPair, SecondOpinion
from tests.maps.opendrive_files import (
    connection,
    crossing,
    geometry,
    lane,
    road,
    section,
    to_junction,
    to_road,
    written,
    xodr,
)
from tests.quick import few
from tests.realdata import real


def opinion(folder: Path, *parts: str) -> SecondOpinion:
    return opinion_of_netconvert(written(folder, xodr(*parts)))


def test_both_find_the_lanes_and_links_of_a_crossing(tmp_path: Path) -> None:
    found = opinion(tmp_path, crossing())
    assert (found.lanes, found.links) == (OpinionPair(6, 6), OpinionPair(2, 6))
    assert found.lane_km.ours == pytest.approx(found.lane_km.theirs, abs=1e-3)
    assert found.explanations == ("4 links there are guesses, for lanes from which the file has none.",)
    assert found.problems == ()


def test_lanes_of_other_kinds_are_explained(tmp_path: Path) -> None:
    parked = road("1", section(lane(-1), lane(-2, "parking")))
    found = opinion(tmp_path, parked, road("2", section(lane(-1, "slipLane"))))
    assert found.lanes == OpinionPair(2, 2)
    assert found.explanations == (
        "1 lanes are for cars there and left out here, such as 1_-2.",
        "1 lanes are left out there (slipLane), such as 2_-1.",
    )
    assert found.problems == ()


def test_links_that_only_netconvert_has_are_a_problem(tmp_path: Path) -> None:
    """Of two links of road 1 the second leads to a road that begins 30 m away, which is none for us."""
    fork = (
        '<junction id="9" type="default">'
        + connection("1", "2", (-1, -1))
        + connection("1", "3", (-1, -1))
        + "</junction>"
    )
    ways = [
        road(id_, section(lane(-1, before=(-1,), after=(-1,))), plan=geometry(place=(x, 0, 0)), head='junction="9"',
             links=(to_road("1", "end"), to_road(f"{id_}0")))
        for id_, x in (("2", 100), ("3", 130))
    ]  # fmt: skip
    ends = [road(f"{id_}0", plan=geometry(place=(x, 0, 0))) for id_, x in (("2", 200), ("3", 230))]
    found = opinion(tmp_path, road("1", links=("", to_junction("9"))), *ways, *ends, fork)
    assert found.links == OpinionPair(1, 2)
    assert [problem.message for problem in found.problems] == ["netconvert has 1 links more, such as 1_-1 to 30_-1"]


def test_what_netconvert_cannot_read_is_told(tmp_path: Path) -> None:
    found = opinion(tmp_path, road("1"), '<junction id="9"><connection id="0"/></junction>')
    assert "netconvert cannot read the file" in found.explanations[0]
    assert found.lanes == OpinionPair(1, 0)
    assert found.problems == ()


@pytest.mark.parametrize("name", few(["fabriksgatan_traffic_lights", "e6mini-lht", "Town01", "multi_intersections"], 2))
def test_real_files_are_read_alike(name: str) -> None:
    found = opinion_of_netconvert(real("opendrive", f"{name}.xodr"))
    assert found.problems == ()
    assert found.links.ours == found.links.theirs
    assert found.lanes.ours + 2 * (name == "e6mini-lht") == found.lanes.theirs
