"""Lanes that no street can have are refused or left out, whatever the format."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from interplan_sumo.errors import MapError
from interplan_sumo.maps.importers.build import build
from interplan_sumo.maps.importers.implausible import plausible
from interplan_sumo.maps.importers.source import SourceLane
from tests.maps.source_worlds import lane, linked, neighbours, road_of_two, straight, world


def test_a_lane_with_a_point_in_another_country_is_refused() -> None:
    build(world({"a": straight("a", 0.0, 11_000.0)}))
    with pytest.raises(MapError, match="tiny: lane a is 13 km long, 13 km of them in one straight; look at its coord"):
        build(world({"a": straight("a", 0.0, 13_000.0)}))
    with pytest.raises(MapError, match="lane a is 110 km long, 11 km of them in one straight"):
        build(world({"a": lane("a", [(11_000.0 * n, 0.0) for n in range(11)])}))


def test_a_lane_with_a_spike_of_a_kilometre_is_refused_and_a_shorter_one_or_a_hairpin_is_not() -> None:
    def spike(out_m: float) -> SourceLane:
        there = [(0.0, 0.0), (20.0, 0.0), (20.0 + out_m, 30.0), (40.0, 0.0), (60.0, 0.0)]
        return replace(straight("a", 0.0, 60.0), right=np.array(there))

    with pytest.raises(MapError, match=r"tiny: lane a leads 1\.1 km out and straight back; look at its coordinates"):
        plausible(world({"a": spike(1_100.0)}))
    hairpin = lane("a", [(0.0, 0.0), (1_500.0, 0.0), (1_500.0, 50.0), (0.0, 50.0)])
    for kept in (spike(900.0), hairpin):
        assert plausible(world({"a": kept}))[0].lanes == {"a": kept}


def test_a_lane_as_wide_as_a_field_is_refused_and_a_street_that_widens_to_a_square_is_not() -> None:
    def widening(by_m: float) -> SourceLane:
        street = straight("a", 0.0, 60.0)
        left = street.left[[0, -1]]
        return replace(street, left=left + np.array([(0.0, 0.0), (0.0, by_m)]))

    with pytest.raises(MapError, match="tiny: lane a is 202 m wide; look at its boundaries"):
        build(world({"a": widening(397.0)}))
    build(world({"a": widening(27.0)}))


def test_a_lane_whose_boundaries_run_against_each_other_is_left_out() -> None:
    """Its middle is one point; what lies beside it and behind it stays."""
    source = road_of_two()
    lanes = neighbours(
        linked([straight("a", 0, 50), straight("b", 50, 100), straight("c", 50, 100, -3.5)], [("a", "b")]), "b", "c"
    )
    lanes["b"] = replace(lanes["b"], right=lanes["b"].right[::-1])
    made = build(replace(source, lanes=lanes))
    assert {row.source_id for rows in made.origins.values() for row in rows} == {"a", "c"}
    assert "b: left out, its boundaries run against each other" in made.notes


def test_a_ring_is_no_such_lane() -> None:
    ring = lane("r", [(0.0, 0.0), (50.0, 0.0), (50.0, 50.0), (0.0, 50.0), (0.0, 0.01)])
    assert len(build(world({"r": ring})).roads.lanes) == 1
