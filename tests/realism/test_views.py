"""Views: how far and how long recordings see, and what of simulated traffic lies within."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tracking import steady, track

from interplan_sumo.maps.store import find_map
from interplan_sumo.realism.tracker_noise import NO_NOISE
from interplan_sumo.realism.tracks import RecordedTraffic, Track
from interplan_sumo.realism.views import LOOKS, RecordedView, looked_at, signalled_junctions, views_of
from interplan_sumo.simulation.network import read_network


def traffic(*tracks: Track) -> RecordedTraffic:
    return RecordedTraffic("x", "x", tracks)


def view(radius_m: float, lasts_s: float, drivers: float = 1.0) -> RecordedView:
    return RecordedView(radius_m, lasts_s, drivers, NO_NOISE)


HERE = np.zeros((1, 2))


def test_a_view_reaches_as_far_as_people_drive_and_lasts_as_long_as_anybody_is_seen() -> None:
    drives = steady("a", -100.0, 20.0, seconds=10.0)
    parked = steady("b", 500.0, 0.0, seconds=12.0)
    found = RecordedView.of(traffic(drives, parked))
    assert found is not None
    assert found.radius_m == pytest.approx(95.0, abs=1.0)
    assert found.lasts_s == pytest.approx(12.0)
    assert views_of([traffic(parked), traffic(drives)])[0].radius_m == found.radius_m
    assert len(views_of([traffic(parked), traffic(drives)])) == 1


def test_a_view_has_the_noise_of_its_recording() -> None:
    at_m = steady("a", 0.0, 10.0).x_m
    shaken = traffic(track("a", at_m + np.random.default_rng(0).normal(0.0, 0.1, len(at_m))))
    (found,) = views_of([shaken])
    assert found.noise.sigma_m[0, 0] == pytest.approx(0.1, rel=0.3)
    (look, *_) = looked_at(traffic(steady("a", 0.0, 0.0)), HERE, [replace(found, radius_m=50.0, lasts_s=5.0)], 0)
    assert 0.05 < np.std(look.tracks[0].x_m) < 0.2


def test_nobody_is_seen_outside_and_nobody_inside_is_missed() -> None:
    passes, far = steady("a", -100.0, 10.0, seconds=20.0), steady("b", -100.0, 10.0, seconds=20.0, y_m=31.0)
    looks = [*looked_at(traffic(passes, far), HERE, [view(30.0, 20.0)], 0)]
    assert len(looks) >= LOOKS
    for each in looks:
        (seen,) = each.tracks
        assert (seen.x_m[0], seen.x_m[-1]) == pytest.approx((-30.0, 30.0))
        assert len(seen.x_m) == 61


def test_who_leaves_and_comes_back_is_another() -> None:
    out_and_in_m = np.concatenate([np.linspace(0.0, 60.0, 61), np.linspace(60.0, 0.0, 61)])
    (look, *_) = looked_at(traffic(track("a", out_and_in_m)), HERE, [view(30.0, 12.1)], 0)
    assert [each.id for each in look.tracks] == ["a", "a~2"]


def test_a_look_lasts_as_long_as_its_view_and_begins_at_any_time() -> None:
    stands = traffic(steady("a", 0.0, 0.0, seconds=60.0))
    looks = [*looked_at(stands, HERE, [view(30.0, 4.0)], 0)]
    lasts_s = [each.tracks[0].time_s[-1] - each.tracks[0].time_s[0] for each in looks]
    begins_s = [each.tracks[0].time_s[0] for each in looks]
    assert lasts_s == pytest.approx([3.95] * len(looks), abs=0.06)
    assert min(begins_s) < 6.0
    assert max(begins_s) > 50.0


def test_a_longer_view_than_the_traffic_is_taken_in_parts_and_views_take_turns() -> None:
    stands = traffic(steady("a", 0.0, 0.0, seconds=60.0))
    looks = [*looked_at(stands, HERE, [view(30.0, 150.0), view(30.0, 10.0)], 0)]
    lasts_s = [round(each.tracks[0].time_s[-1] - each.tracks[0].time_s[0]) for each in looks]
    assert lasts_s.count(50) == 3 * lasts_s.count(10)
    assert len(lasts_s) >= LOOKS


TWO_PLACES = np.array([[0.0, 0.0], [200.0, 0.0]])


def test_a_seed_says_where_and_when_for_all_drivers_alike() -> None:
    def starts(seed: int, *also: Track) -> list[tuple[float, float]]:
        one = traffic(steady("a", 0.0, 0.0, seconds=60.0), steady("b", 200.0, 0.0, seconds=60.0), *also)
        looks = looked_at(one, TWO_PLACES, [view(30.0, 5.0)], seed)
        return [(each.tracks[0].x_m[0], each.tracks[0].time_s[0]) for each in looks]

    assert starts(0) == starts(0, steady("c", 5.0, 0.0, seconds=60.0)) != starts(1)
    assert {x_m for x_m, _ in starts(0)} == {0.0, 200.0}


def test_a_view_holds_those_who_drive_for_as_long_as_they_are_seen() -> None:
    half = steady("a", 0.0, 5.0, seconds=10.0)
    (found,) = views_of([traffic(half, steady("b", 0.0, 5.0, seconds=20.0), steady("c", 9.0, 0.0, seconds=20.0))])
    assert found.drivers == pytest.approx(0.95 * 1.5)


@pytest.mark.parametrize(("drivers", "seen_at_m"), [(1.0, 0.0), (3.0, 200.0)])
def test_looks_are_taken_where_as_many_drive_as_in_the_recording(drivers: float, seen_at_m: float) -> None:
    """One drives back and forth at the first place and two stand there, three drive at the second."""
    swings_m = 5.0 * np.sin(np.arange(0.0, 60.0, 0.1))
    fast, still = np.full(600, 5.0), np.zeros(600)
    stands = (replace(track(f"s{n}", 0.0 * still, 5.0 * n), speed_mps=still) for n in (1, 2))
    drive = (replace(track(f"b{n}", 200.0 * (n > 0) + swings_m, 5.0 * n), speed_mps=fast) for n in range(4))
    looks = [*looked_at(traffic(*drive, *stands), TWO_PLACES, [view(30.0, 5.0, drivers)], 0)]
    assert {100.0 * round(np.median(each.tracks[0].x_m) / 100.0) for each in looks} == {seen_at_m}


def test_without_views_places_or_traffic_there_is_nothing_to_see() -> None:
    stands = traffic(steady("a", 0.0, 0.0))
    assert not [*looked_at(stands, HERE, [], 0)]
    assert not [*looked_at(stands, HERE[:0], [view(30.0, 5.0)], 0)]
    assert not [*looked_at(traffic(), HERE, [view(30.0, 5.0)], 0)]


@pytest.mark.parametrize(("name", "junctions"), [("back_bay", 9), ("strip", 9)])
def test_junctions_with_lights_are_where_ways_of_several_streets_meet(name: str, junctions: int) -> None:
    network = read_network(find_map(name).network)
    found = signalled_junctions(network)
    assert len(found) == junctions
    inside_m = [
        min(np.hypot(*(network.lanes[lane].line.points - middle).T).min() for link in links for lane in link.via)
        for middle in found
        for links in [[link for each in network.links.values() for link in each if link.light and link.via]]
    ]
    assert max(inside_m) < 25.0
