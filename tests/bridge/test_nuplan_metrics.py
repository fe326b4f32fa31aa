"""The devkit's own metrics say of our drives what ours say."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from devkit import devkit

from interplan_sumo.bridge.nuplan.frames import START_US
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.score import score_facts
from interplan_sumo.planner import load_planner
from interplan_sumo.scenario.suite import expert, find_scenario, find_suite
from interplan_sumo.simulation.episode import drive
from interplan_sumo.world.geometry import Pose
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trace import EgoTrack, Trace
from tests.golden_values import TOLERANCE
from tests.metrics.golden_metrics import Case, pairs

OFFICIAL = [scenario.id for scenario in find_suite("interplan==1").scenarios[::4]]
"""Twenty of the eighty, from every family."""


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    ("scenario_id", "planner"), [("nudge/0", "idm"), ("nudge/0", "pdm_closed"), ("lane_change_htd/3", "straight_ahead")]
)
def test_every_score_statistic_and_series_is_the_same(scenario_id: str, planner: str) -> None:
    _compare(scenario_id, planner)


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("planner", ["idm", "pdm_closed"])
@pytest.mark.parametrize("scenario_id", OFFICIAL)
def test_they_are_the_same_on_twenty_official_scenarios(scenario_id: str, planner: str) -> None:
    _compare(scenario_id, planner)


def _compare(scenario_id: str, planner: str) -> None:
    devkit()
    scenario = find_scenario(scenario_id)
    episode = drive(scenario, load_planner(planner))
    assert episode.trace is not None
    roads = devkit("interplan_sumo.maps.store").load_roads(scenario.map)
    facts = Facts(episode.trace, roads, expert(scenario))
    theirs = nuplan_results(episode.trace, roads, facts.expert, scenario.goal.pose(roads))
    case = Case(Path(), {}, {"metrics": theirs}, facts, score_facts(facts, "nuplan"))
    found = list(pairs(case))
    assert len(found) > 60
    assert [(pair.what, pair.difference) for pair in found if not pair.difference <= TOLERANCE] == []


def nuplan_results(trace: Trace, roads: Roads, expert: EgoTrack, goal: Pose) -> dict[str, dict[str, Any]]:
    """What every metric of the closed-loop challenges says of a drive: score, statistics and series, by its name."""
    history = _history(trace, roads, goal)
    objects = devkit("interplan_sumo.bridge.nuplan.objects")
    vehicle = objects.vehicle_parameters(trace.shape)
    experts = [objects.nuplan_ego(expert.state(k), _time_us(expert, k), vehicle) for k in range(len(expert))]
    scenario = SimpleNamespace(get_expert_ego_trajectory=lambda: experts)
    found: dict[str, dict[str, Any]] = {}
    for metric in _metrics():
        for result in metric.compute(history, scenario):
            series = result.time_series
            found[result.name] = {
                "score": result.metric_score,
                "statistics": [{"name": each.name, "value": each.value} for each in result.statistics],
                "time_series": None if series is None else {"values": series.values},
            }
    return found


def _history(trace: Trace, roads: Roads, goal: Pose) -> Any:
    """A drive as nuPlan's simulation would have written it down."""
    objects = devkit("interplan_sumo.bridge.nuplan.objects")
    history = devkit("nuplan.planning.simulation.history.simulation_history")
    iteration = devkit("nuplan.planning.simulation.simulation_time_controller.simulation_iteration")
    map_ = devkit("interplan_sumo.bridge.nuplan.map_api").map_api(roads)
    vehicle = objects.vehicle_parameters(trace.shape)
    numbers: dict[str, int] = {}

    def sample(frame: int) -> Any:
        time_us = _time_us(trace.ego, frame)
        return history.SimulationHistorySample(
            iteration=iteration.SimulationIteration(objects.TimePoint(time_us), frame),
            ego_state=objects.nuplan_ego(trace.ego.state(frame), time_us, vehicle),
            trajectory=None,
            observation=objects.nuplan_tracks(trace.actors.at(frame), time_us, numbers),
            traffic_light_status=objects.nuplan_lights(trace.signals[frame], time_us),
        )

    place = objects.StateSE2(goal.x_m, goal.y_m, goal.heading_rad)
    return history.SimulationHistory(map_, place, [sample(frame) for frame in range(len(trace))])


def _time_us(track: EgoTrack, frame: int) -> int:
    return START_US + int(np.asarray(track.time_us)[frame])


def _metrics() -> list[Any]:
    """The metrics in their order; those that need others get them as nuPlan's builder hands them over."""
    folder = Path(devkit("nuplan.planning").__path__[0]) / "script" / "config" / "common" / "simulation_metric"
    made: dict[str, Any] = {}
    for group in yaml.safe_load((folder / "simulation_closed_loop_reactive_agents.yaml").read_text())["defaults"]:
        for level, names in group.items():
            for name in names:
                config = yaml.safe_load((folder / level / f"{name}.yaml").read_text())[name]
                config.pop("_convert_")
                module, _, kind = config.pop("_target_").rpartition(".")
                needed = {key: made[other] for key, other in config.pop("required_metrics", {}).items()}
                made[name] = getattr(import_module(module), kind)(**config, **needed)
    return list(made.values())
