"""Seen again: from a stored trace comes, bit for bit, what the planner of the drive was given."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from worlds import rolling, straight_road

from interplan_planners.straight_ahead import StraightAhead
from interplan_sumo.dataset.observation_replay import ObservationReplay
from interplan_sumo.features.view import Arrays, EgoView
from interplan_sumo.maps.store import load_roads
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.scenario.recorded_parts import LoggedLight
from interplan_sumo.scenario.scenario import LanePosition, Scenario
from interplan_sumo.scenario.suite import find_scenario
from interplan_sumo.simulation.episode import Episode, EpisodeOptions, drive, run_loop
from interplan_sumo.simulation.lights import LoggedLights
from interplan_sumo.simulation.replayed import ReplayedTraffic
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.geometry import Polyline
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trace import Trace
from interplan_sumo.world.trajectory import Trajectory


class Witness:
    """Drives straight ahead and keeps what it saw, as arrays."""

    def __init__(self) -> None:
        self._driver = StraightAhead()
        self.seen: list[Observation] = []
        self.arrays: list[Arrays] = []

    def start(self, mission: Mission) -> None:
        self._driver.start(mission)
        self.view = EgoView(mission)

    def plan(self, observation: Observation) -> Trajectory:
        self.seen.append(observation)
        self.arrays.append(self.view.arrays(observation))
        return self._driver.plan(observation)


def hold_against(witness: Witness, episode: Episode, scenario: Scenario, roads: Roads, folder: Path) -> None:
    """Every frame of the trace, written and read, against what the witness was given."""
    assert episode.trace is not None
    assert episode.fault is None
    episode.trace.write(folder)
    again = ObservationReplay(scenario, roads, Trace.read(folder))
    view = EgoView(again.mission)
    assert len(witness.seen) == len(episode.trace)
    for k, (seen, arrays) in enumerate(zip(witness.seen, witness.arrays, strict=True)):
        made = again.at(k)
        assert made.actors.ids == seen.actors.ids
        assert [each.ids for each in made.past.actors] == [each.ids for each in seen.past.actors]
        assert [each.pose for each in made.past.egos] == [each.pose for each in seen.past.egos]
        for name, values in view.arrays(made).items():
            assert values.tobytes() == arrays[name].tobytes(), f"{name} in frame {k}"


def test_a_drive_past_cars_is_seen_again(tmp_path: Path) -> None:
    roads = straight_road(lanes=2, length_m=400.0)
    scenario = Scenario(
        "test/0", "test", "test", LanePosition("12", 20.0), 10.0, LanePosition("12", 390.0), ("1",), duration_s=4.0
    )
    line = Polyline(np.array(((0.0, 0.0), (400.0, 1.0))))
    actors = (
        rolling("b", line, 130.0),  # comes into sight on the way
        rolling("a", line, 30.0, 7.3),
        rolling("c", line, 60.0, kind="cone", size_m=(0.5, 0.5)),
    )
    witness = Witness()
    red = LoggedLights((LoggedLight("12", (0,), ("red",)),))
    traffic = ReplayedTraffic(actors, ("b", "a", "c"), Actors.none(), red)
    episode = run_loop(scenario, roads, witness, traffic, options=EpisodeOptions(), on_phase=lambda _phase: None)
    hold_against(witness, episode, scenario, roads, tmp_path)
    counts = [len(seen.actors) for seen in witness.seen]
    assert counts[0] == 2
    assert counts[-1] == 3


@pytest.mark.slow
def test_what_was_seen_too_late_and_with_errors_is_seen_again(tmp_path: Path) -> None:
    scenario = replace(find_scenario("jaywalker/0"), duration_s=3.0, perception="occluded+noisy+late")
    witness = Witness()
    episode = drive(scenario, witness, seed=3)
    hold_against(witness, episode, scenario, load_roads(scenario.map), tmp_path)


def test_pedestrians_behind_the_bus_stay_hidden_in_what_is_seen_again(tmp_path: Path) -> None:
    hiding = find_scenario("jaywalker/0")
    scenario = replace(hiding, duration_s=5.0)
    roads = load_roads(scenario.map)
    witness = Witness()
    episode = drive(scenario, witness)
    hold_against(witness, episode, scenario, roads, tmp_path)
    assert episode.trace is not None
    hidden = {
        actor
        for k, seen in enumerate(witness.seen)
        for actor in set(episode.trace.actors.at(k).within(seen.ego.x_m, seen.ego.y_m, 100.0).ids)
        - set(seen.actors.ids)
    }
    assert hidden  # or the test would prove nothing
