"""Generated scenarios: the same seed gives the same ones, on any map, for every family and ordinary type."""

from __future__ import annotations

from itertools import islice

import pytest
from worlds import straight_road

from interplan_sumo.families import names
from interplan_sumo.families.generate import Search
from interplan_sumo.maps.store import load_roads
from interplan_sumo.scenario.route import goal_arc_m, route_centerline
from tests.quick import few


@pytest.mark.parametrize("family", few(names(ordinary=False), 2))
def test_every_family_finds_places_on_every_district(family: str) -> None:
    for name in ("strip", "one_north", "back_bay", "hazelwood"):
        roads = load_roads(name)
        made = list(islice(Search(roads, family, seed=3), 4))
        assert [s.id for s in made] == [f"{name}.{family}/3-{k}" for k in range(4)]
        assert {s.family for s in made} == {family}
        assert len({s.site(roads) for s in made}) == 4


@pytest.mark.parametrize("kind", few(names(ordinary=True), 4))
def test_every_ordinary_type_finds_places_on_some_district(kind: str) -> None:
    made = [s for name in ("one_north", "hazelwood", "strip") for s in islice(Search(load_roads(name), kind, 1), 2)]
    assert len(made) >= 2
    for scenario in made:
        roads = load_roads(scenario.map)
        start = scenario.start.pose(roads)
        line = route_centerline(roads, scenario)
        assert goal_arc_m(roads, scenario) > line.project_point(start.x_m, start.y_m)[0] + 30.0


@pytest.mark.slow
def test_ordinary_driving_has_traffic_both_ways_and_people_who_cross_and_wait() -> None:
    turning, waiting, parking = (
        [s for name in ("one_north", "hazelwood", "strip") for s in islice(Search(load_roads(name), kind, 1), 10)]
        for kind in ("starting_right_turn", "waiting_for_pedestrian_to_cross", "traversing_pickup_dropoff")
    )
    everybody = (*turning, *waiting, *parking)
    assert {(s.traffic.density != "none", s.traffic.oncoming != "none") for s in everybody} == {(True, True)}
    assert {1, 2} <= {len(s.jaywalkers) for s in waiting} <= {1, 2, 3}
    assert {bool(s.jaywalkers) for s in turning} == {True, False}
    assert all(1.0 <= walker.speed_mps <= 1.9 for s in (*turning, *waiting) for walker in s.jaywalkers)
    assert {"car", "person"} == {each.kind for s in parking for each in s.obstacles}


def test_equal_seeds_give_equal_scenarios_and_other_seeds_others() -> None:
    roads = load_roads("hazelwood")
    first, again, other = (list(islice(Search(roads, "overtake", seed), 5)) for seed in (0, 0, 1))
    assert first == again
    assert {s.hash() for s in first}.isdisjoint({s.hash() for s in other})


def test_a_map_without_a_place_gives_nothing_and_says_why() -> None:
    search = Search(straight_road(lanes=1, length_m=300.0), "overtake", 0)
    assert list(search) == []
    assert any("there is no oncoming lane beside it" in each.reason for each in search.rejected)


def test_more_scenarios_than_sites_come_from_places_beside_them() -> None:
    roads = straight_road(lanes=3, length_m=300.0)
    made = list(islice(Search(roads, "construction", 0), 30))
    assert len(made) == 30
    assert len({s.id for s in made}) == 30
