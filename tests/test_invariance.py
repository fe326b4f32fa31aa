"""What must not change an episode: where the map lies and who is far away."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from interplan_sumo.maps.geopackage_writer import write_map
from interplan_sumo.maps.store import MapFiles, load_roads
from interplan_sumo.maps.to_sumo import convert
from interplan_sumo.metrics.score import score
from interplan_sumo.planner import load_planner
from interplan_sumo.scenario.scenario import LanePosition, PlacedVehicle, Scenario
from interplan_sumo.simulation.episode import Episode, drive
from interplan_sumo.verification.replay import reference_drive
from tests.metrics.staging import moved_roads
from tests.quick import few
from tests.scenes import scene

SHORT_S = 12.0


def scored(scenario: Scenario, episode: Episode) -> dict[str, float | None]:
    assert episode.trace is not None
    sheet = score(episode.trace, load_roads(scenario.map), reference_drive(scenario).ego, scenario)
    return {"score": sheet.score, **{name: result.score for name, result in sheet.metrics.items()}}


@pytest.mark.parametrize("family", few(["nudge", "lane_change_mtd"], 0))
def test_an_episode_on_a_shifted_map_gives_equal_scores(family: str, tmp_path: Path) -> None:
    here = scene({"nudge": "nudge/0", "lane_change_mtd": "lane_change_mtd/9"}[family])
    files = MapFiles("elsewhere", "1.0", tmp_path / "elsewhere" / "1.0")
    files.folder.mkdir(parents=True)
    write_map(moved_roads(load_roads("back_bay"), lambda xy: xy + np.array([4096.0, -2048.0])), files.gpkg)
    convert(load_roads(files.folder), files.folder)
    there = replace(here, map=str(files.folder))
    scores = [scored(s, drive(s, load_planner("idm"))) for s in (here, there)]
    assert scores[0] == pytest.approx(scores[1], abs=1e-3)


def test_a_vehicle_out_of_reach_changes_nothing() -> None:
    scenario = replace(scene("nudge/2"), duration_s=SHORT_S)
    far = PlacedVehicle(LanePosition("302010", 100.0), 12.0)
    roads = load_roads(scenario.map)
    here, there = scenario.start.pose(roads), far.place.pose(roads)
    assert np.hypot(here.x_m - there.x_m, here.y_m - there.y_m) > 300.0
    alone, accompanied = (drive(s, load_planner("idm")).trace for s in (scenario, replace(scenario, vehicles=(far,))))
    assert alone is not None
    assert accompanied is not None
    assert len(set(accompanied.actors.ids)) == len(set(alone.actors.ids)) + 1
    for column in ("x_m", "y_m", "heading_rad", "vx_mps"):
        np.testing.assert_array_equal(getattr(alone.ego, column), getattr(accompanied.ego, column))
