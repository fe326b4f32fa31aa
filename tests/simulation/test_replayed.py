"""Replayed traffic: recorded road users are where they were, come and go, and mind nobody."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from interplan_sumo.scenario.recorded_parts import REPLAYED, ReplayedKind, ReplayedTrack
from interplan_sumo.scenario.scenario import LanePosition, Obstacle, Scenario
from interplan_sumo.simulation.replayed import ReplayedTraffic
from interplan_sumo.simulation.setup import open_traffic
from interplan_sumo.tiny_worlds import ego, straight_road
from interplan_sumo.world.actors import Actors

ROADS = straight_road(lanes=2)
BARE = Scenario(
    "tiny.recorded/0", "recorded", "tiny_road", LanePosition("11", 20.0), 10.0, LanePosition("11", 150.0), ("1",)
)


def moves(id: str, x_m: float, steps: int, first_step: int = 0, kind: ReplayedKind = "vehicle") -> ReplayedTrack:
    """Towards +x at 10 m/s on the right lane."""
    x = tuple(float(x_m + k) for k in range(steps))
    zeros = (0.0,) * steps
    return ReplayedTrack(id, kind, 4.6, 1.85, first_step, x, (-3.5,) * steps, zeros, (10.0,) * steps, zeros)


def scenes(traffic: ReplayedTraffic, steps: int) -> list[Actors]:
    found: list[Actors] = []
    for _ in range(steps):
        found.append(traffic.observe().actors)
        traffic.react(ego(30.0, -3.5, speed_mps=10.0))
        traffic.place_ego(ego(31.0, -3.5, speed_mps=10.0))
        traffic.advance()
    return found


def test_a_track_is_there_from_its_first_step_to_its_last_and_moves_as_recorded() -> None:
    with ReplayedTraffic((moves("a", 40.0, steps=3, first_step=2),), ("00ff",), Actors.none()) as traffic:
        seen = scenes(traffic, 6)
    assert [actors.ids for actors in seen] == [(), (), ("00ff",), ("00ff",), ("00ff",), ()]
    assert [float(actors.x_m[0]) for actors in seen[2:5]] == [40.0, 41.0, 42.0]
    assert (float(seen[2].vx_mps[0]), float(seen[2].length_m[0])) == (10.0, 4.6)


def test_an_ego_in_the_way_changes_nothing() -> None:
    with ReplayedTraffic((moves("a", 20.0, steps=9),), ("00ff",), Actors.none()) as traffic:
        assert [float(actors.x_m[0]) for actors in scenes(traffic, 9)] == [20.0 + k for k in range(9)]


@pytest.mark.parametrize("kind", sorted(REPLAYED))
def test_every_kind_has_its_class(kind: ReplayedKind) -> None:
    with ReplayedTraffic((moves("a", 20.0, steps=1, kind=kind),), ("00ff",), Actors.none()) as traffic:
        assert traffic.observe().actors.kind.tolist() == [REPLAYED[kind]]


def test_obstacles_stand_among_them_and_ids_say_nothing() -> None:
    tracks = (moves("AV-1", 40.0, steps=50), moves("AV-2", 60.0, steps=50))
    scenario = replace(BARE, replayed=tracks, obstacles=(Obstacle(LanePosition("11", 100.0), "cone"),))
    with open_traffic(scenario, ROADS, seed=0) as traffic:
        scene = traffic.observe()
        behaviours = dict(traffic.behaviours)
    assert len(scene.actors) == 3
    assert list(scene.actors.ids) == sorted(scene.actors.ids)
    assert not {"AV-1", "AV-2"} & set(scene.actors.ids)
    assert sorted(behaviours.values()) == ["replayed", "replayed"]
    assert set(behaviours) < set(scene.actors.ids)
    assert np.sort(scene.actors.x_m).tolist() == [40.0, 60.0, 100.0]
    assert len(scene.signals.connector_ids) == 0


def test_another_seed_gives_other_ids_and_the_same_traffic() -> None:
    scenario = replace(BARE, replayed=(moves("a", 40.0, steps=5),))
    seen: list[Actors] = []
    for seed in (0, 0, 1):
        with open_traffic(scenario, ROADS, seed=seed) as traffic:
            seen.append(traffic.observe().actors)
    assert seen[0].ids == seen[1].ids != seen[2].ids
    assert seen[0].x_m.tolist() == seen[2].x_m.tolist()
