"""Road markings: painted lines, whose stop bar lies where, and what a light shows when."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from interplan_sumo.report.road_markings import markings, signal_changes, status_at, stop_bars
from interplan_sumo.world.signals import Signals, SignalStatus
from tests.worlds import drive, junction, signals, straight_road

HERE = shapely.box(-100.0, -100.0, 100.0, 100.0)


def test_the_connectors_of_a_lane_share_the_bar_across_its_end_from_left_to_right() -> None:
    bars = stop_bars(junction(), HERE)
    left, straight, right = bars["14"], bars["13"], bars["12"]
    assert left[0] == pytest.approx((-12.0, 0.0))
    assert right[1] == pytest.approx((-12.0, -3.5))
    assert left[1] == pytest.approx(straight[0])
    assert straight[1] == pytest.approx(right[0])
    assert np.hypot(*(straight[1] - straight[0])) == pytest.approx(3.5 / 3.0)


def test_a_connector_without_a_light_and_one_elsewhere_have_no_bar() -> None:
    roads = junction()
    unlit = {**roads.connectors, "13": replace(roads.connectors["13"], stop_line_ids=())}
    bars = stop_bars(replace(roads, connectors=unlit), HERE)
    assert "13" not in bars
    assert np.hypot(*(bars["12"][1] - bars["12"][0])) == pytest.approx(3.5 / 2.0)  # the two others share
    assert stop_bars(roads, shapely.box(20.0, -5.0, 40.0, 5.0)) == {}
    assert stop_bars(straight_road(), HERE) == {}


def test_lights_are_told_by_their_changes() -> None:
    trace = replace(drive(*[0.0] * 5), signals=(signals(red=["13"]),) * 2 + (signals(green=["13"]),) * 3)
    assert signal_changes(trace, ["13", "14"]) == {"13": [(0, 2), (2, 0)]}


def test_a_light_is_unknown_until_it_shows_something() -> None:
    trace = replace(drive(*[0.0] * 4), signals=(Signals.none(),) * 2 + (signals(yellow=["13"]),) * 2)
    changes = signal_changes(trace, ["13"])["13"]
    assert [status_at(changes, frame).name for frame in range(4)] == ["UNKNOWN", "UNKNOWN", "YELLOW", "YELLOW"]


@given(st.lists(st.sampled_from(SignalStatus), min_size=1, max_size=12))
def test_the_changes_give_the_status_of_every_frame_back(shown: list[SignalStatus]) -> None:
    seen = tuple(Signals(("13",), np.array([status])) for status in shown)
    changes = signal_changes(replace(drive(*[0.0] * len(shown)), signals=seen), ["13"])["13"]
    assert [status_at(changes, frame) for frame in range(len(shown))] == shown


def test_markings_are_dashed_between_lanes_and_solid_at_the_edges() -> None:
    roads = straight_road(lanes=3)
    found = markings(roads, roads.drivable_area)
    assert {kind: len(lines) for kind, lines in found.items()} == {"dashed": 2, "solid": 2, "middle": 0}


def test_roads_elsewhere_have_none_here() -> None:
    found = markings(straight_road(), shapely.box(0.0, 500.0, 10.0, 510.0))
    assert not any(found.values())
