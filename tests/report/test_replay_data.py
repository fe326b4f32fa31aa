"""A stored drive as data for the page: whole numbers, who is who, what happened, and where the map ends."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import accumulate
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from interplan_sumo.errors import InputError
from interplan_sumo.report.replay import agents_timeline, surroundings
from interplan_sumo.report.replay.data import replay_data
from interplan_sumo.report.replay.numbers import PER_METRE, column, points, series
from interplan_sumo.scenario.scenario import LanePosition, Obstacle
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.trace import SEEN_BEFORE, ActorTable, EgoTrack, Trace
from tests.metrics.staging import drive_at
from tests.report.tiny_drives import CRUISE_MPS, START_M, crossing_at, drive_at_lights, parked_at, tiny_drive
from tests.worlds import cars, drive, junction, pedestrians, signals, straight_road, together

CRUISE = [CRUISE_MPS] * 80
ORIGIN = np.zeros(2)


def undone(steps: list[int], count: int, per_unit: int) -> list[float]:
    """A column as the page reads it."""
    sums = list(accumulate(steps))
    return [value / per_unit for value in sums + sums[-1:] * (count - len(sums))]


def only(drive_data: dict[str, Any]) -> dict[str, Any]:
    (one,) = drive_data["drives"]
    return one


# --- numbers -------------------------------------------------------------------------------------


@given(st.lists(st.floats(-5e6, 5e6), min_size=1, max_size=40), st.sampled_from((10, 100, 1000)))
def test_a_column_gives_its_values_back_to_half_a_step(values: list[float], per_unit: int) -> None:
    back = undone(column(values, per_unit), len(values), per_unit)
    assert np.abs(np.array(back) - values).max() <= 0.5 / per_unit + 1e-6


def test_a_column_that_never_changes_is_one_number() -> None:
    assert column([3.0] * 50, 100) == [300]
    assert column([3.0, 3.0, 3.01], 100) == [300, 0, 1]
    assert column([], 100) == []


def test_points_are_ways_to_the_next_and_a_series_has_gaps_where_a_value_is_not_finite() -> None:
    assert points(np.array([(101.0, 52.0), (101.5, 51.0)]), np.array((100.0, 50.0))) == [100, 200, 50, -100]
    assert series(np.array([1.0, np.inf, -0.25, np.nan])) == [100, None, -25, None]


# --- the drive -----------------------------------------------------------------------------------


def test_the_data_is_json_and_tells_the_frames_and_the_score() -> None:
    data = replay_data([tiny_drive(CRUISE, reached_goal=True)])
    assert json.loads(json.dumps(data, allow_nan=False)) is not None
    one = only(data)
    told = (data["frames"], data["dt_s"], one["frames"], one["score"], one["end"])
    assert told == (80, 0.1, 80, 100.0, "goal line passed")
    # the origin lies at the lower left of all that is shown
    assert undone(one["ego"]["x"], 80, PER_METRE) == pytest.approx(np.arange(80.0), abs=0.005)
    assert one["deciding"] == {"frame": 79, "metric": "nothing", "reason": "no points were lost"}


def test_metrics_are_listed_gates_first_with_reason_and_frame_where_points_were_lost() -> None:
    metrics = only(replay_data([tiny_drive(CRUISE, actors=cars((50.0, 0.0)))]))["metrics"]
    assert [metric["weight"] is None for metric in metrics] == [True] * 4 + [False] * 5
    first, second = metrics[:2]
    assert (first["name"], first["score"], first["frame"]) == ("no_collision", 0.0, 36)
    assert "drove into standing vehicle car00" in first["reason"]
    assert (second["score"], second["reason"], second["frame"]) == (1.0, None, None)


def test_a_planners_fault_scores_nothing_and_another_leaves_no_score() -> None:
    one = only(replay_data([tiny_drive(CRUISE, fault=("planner", "no way"))]))
    assert (one["score"], one["fault"], one["end"]) == (0.0, "planner fault: no way", "planner fault")
    assert one["events"][-1] == {"frame": 79, "kind": "fault", "text": "planner fault: no way", "decides": True}
    other = only(replay_data([tiny_drive(CRUISE, fault=("traffic", "SUMO gave up"))]))
    assert (other["score"], other["end"]) == (None, "traffic fault")


def test_events_are_in_time_order_and_one_decides() -> None:
    hit = tiny_drive(CRUISE, actors=together(cars((50.0, 0.0)), pedestrians((70.0, 0.0))), reached_goal=True)
    events = only(replay_data([hit]))["events"]
    assert [event["frame"] for event in events] == sorted(event["frame"] for event in events)
    assert [event["kind"] for event in events if event["decides"]] == ["gate"]
    assert any(event["text"] == "at-fault contact with pedestrian ped00" for event in events)
    assert events[-1]["kind"] == "goal"


def test_a_plan_has_a_point_every_half_second_and_its_end() -> None:
    plans = agents_timeline.plans(tiny_drive(CRUISE).trace, ORIGIN)
    assert plans[0] == [1000, 0, 500, 0, 500, 0]  # 1 s at 10 m/s from 10 m on


def test_the_expert_stays_where_it_ended() -> None:
    track = drive(10.0, 10.0, 10.0).ego
    held = agents_timeline.expert(track, drive(*CRUISE).ego.time_us, ORIGIN)
    assert undone(held["x"], 80, PER_METRE)[:5] == pytest.approx([0.0, 1.0, 2.0, 2.0, 2.0])


def test_a_light_is_told_with_its_bar_and_its_way_in_centimetres() -> None:
    roads = junction()
    found = surroundings.lights(roads, roads.drivable_area, ORIGIN)
    assert set(found) == {connector.id for connector in roads.connectors.values()}
    assert np.cumsum(np.reshape(found["13"]["bar"], (2, 2)), axis=0).tolist() == [[-1200, -117], [-1200, -233]]
    assert np.cumsum(np.reshape(found["13"]["way"], (2, 2)), axis=0).tolist() == [[-1200, -175], [1200, -175]]


def test_a_drive_tells_what_the_lights_around_it_showed() -> None:
    shown = signals(red=["13"], green=["24", "99"])
    data = replay_data([drive_at_lights(*[shown] * 5, signals(green=["13", "24"]), speed_mps=CRUISE_MPS)])
    assert only(data)["signals"] == {"13": [(0, 2), (5, 0)], "24": [(0, 0)]}
    assert {"13", "24"} <= set(data["lights"])


def test_a_lane_change_and_a_pedestrian_who_sets_off_are_events() -> None:
    across = np.interp(np.arange(80.0), (20.0, 50.0), (0.0, -3.5))
    two_lanes = straight_road(lanes=2, length_m=300.0)
    changed = tiny_drive([], trace=drive_at(START_M + np.arange(80.0), across), roads=two_lanes, expert_mps=CRUISE)
    assert "lane" in [event["kind"] for event in only(replay_data([changed]))["events"]]
    waits, walks = pedestrians((150.0, -3.0)), pedestrians((150.0, -3.0, 1.0, np.pi / 2))
    crossed = tiny_drive(CRUISE, actors=[waits] * 30 + [walks] * 50, jaywalkers=(crossing_at(150.0),))
    events = only(replay_data([crossed]))["events"]
    assert {"frame": 30, "kind": "trigger", "text": "a pedestrian sets off", "decides": False} in events


# --- charts --------------------------------------------------------------------------------------


def test_every_chart_has_a_value_per_frame_and_speed_stands_beside_the_limit() -> None:
    data = replay_data([tiny_drive(CRUISE)])
    charts = only(data)["charts"]
    assert [chart["key"] for chart in data["charts"]] == list(charts)
    assert {len(chart["values"]) for chart in charts.values()} == {80}
    assert charts["speed"] == {"values": [1000] * 80, "beside": [1500] * 80}
    assert charts["time_to_collision"]["values"] == [None] * 80
    assert charts["progress"]["values"][:3] == charts["progress"]["beside"][:3] == [0, 100, 200]


@pytest.mark.parametrize(("left_m", "edge_m"), [(0.0, 0.6), (0.5, 0.1), (1.0, -0.4)])
def test_the_distance_to_the_edge_is_that_of_the_nearest_corner_and_negative_beyond_it(
    left_m: float, edge_m: float
) -> None:
    # half a lane is 1.75 m wide, half the ego 1.15 m
    aside = tiny_drive([], trace=drive_at(START_M + np.arange(20.0), left_m), expert_mps=CRUISE)
    values = only(replay_data([aside]))["charts"]["edge"]["values"]
    assert np.array(values) / 100.0 == pytest.approx(edge_m, abs=0.011)


# --- who is who ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("length_m", "width_m", "word"),
    [(6.4, 2.0, "car"), (6.5, 2.0, "truck"), (9.9, 2.5, "truck"), (10.0, 2.5, "bus"), (2.2, 1.1, "motorcycle"),
     (2.2, 1.2, "car")],
)  # fmt: skip
def test_vehicles_are_named_by_their_size(length_m: float, width_m: float, word: str) -> None:
    (agent,) = agents_timeline.agents(
        tiny_drive(CRUISE, actors=cars((50.0, 8.0, 5.0), length_m=length_m, width_m=width_m)), ORIGIN
    )
    assert (agent["look"], agent["kind"]) == ("vehicle", word)


def test_what_was_staged_is_told_apart_from_the_traffic() -> None:
    parked = cars((100.0, 0.0), prefix="parked")
    walker = pedestrians((150.0, -3.0))
    workers = cars((120.0, 6.0), kind=ActorKind.PEDESTRIAN, prefix="worker")
    cones = cars((90.0, 6.0), kind=ActorKind.TRAFFIC_CONE, prefix="cone")
    everybody = together(parked, walker, workers, cones)
    obstacles = (parked_at(100.0), Obstacle(LanePosition("11", 120.0, 6.0), "worker"))
    staged = tiny_drive(CRUISE, actors=everybody, obstacles=obstacles, jaywalkers=(crossing_at(150.0),))
    looks = {agent["id"]: (agent["look"], agent["kind"]) for agent in agents_timeline.agents(staged, ORIGIN)}
    assert looks == {
        "cone00": ("cone", "traffic cone"),
        "parked00": ("standing", "parked car"),
        "ped00": ("pedestrian", "pedestrian"),
        "worker00": ("worker", "worker"),
    }
    shown = {look for look, _ in (*looks.values(), *agents_timeline.KIND_LOOKS.values())}
    assert shown <= set(replay_data([staged])["looks"])  # each has a colour


def test_an_actor_that_comes_back_is_told_twice_and_one_far_away_not_at_all() -> None:
    here, gone = cars((50.0, 8.0)), cars()
    far = cars((50.0, 500.0), prefix="far")
    frames = [together(here, far)] * 10 + [gone] * 5 + [here] * 10
    agents = agents_timeline.agents(tiny_drive([CRUISE_MPS] * 25, actors=frames), ORIGIN)
    assert [(agent["id"], agent["first"], agent["frames"]) for agent in agents] == [("car00", 0, 10), ("car00", 15, 10)]


def test_a_trigger_waits_where_the_ego_must_be_at_its_speed_and_ends_when_the_pedestrian_walks() -> None:
    waits, walks = pedestrians((150.0, -3.0)), pedestrians((150.0, -3.0, 1.0, np.pi / 2))
    staged = tiny_drive(CRUISE, actors=[waits] * 30 + [walks] * 50, jaywalkers=(crossing_at(150.0),))
    (trigger,) = agents_timeline.triggers(staged, straight_road(length_m=300.0)["11"].centerline, ORIGIN)
    assert trigger["frame"] == 30
    assert undone(trigger["x"], 30, PER_METRE) == pytest.approx([110.0] * 30)  # 4 s at 10 m/s before it
    assert agents_timeline.set_off(drive(*CRUISE, actors=waits), (150.0, -3.0)) is None


# --- the map -------------------------------------------------------------------------------------


def test_the_map_ends_where_nobody_looks() -> None:
    roads = straight_road(length_m=1000.0)
    area = surroundings.area_around([np.array([(START_M, 0.0), (60.0, 0.0)])])
    shown = surroundings.map_around(roads, area, ORIGIN)
    (outer,) = shown["areas"]["road"][0]
    right = max(accumulate(outer[::2])) / PER_METRE
    assert 60.0 + surroundings.REACH_M - 3.0 <= right <= 60.0 + surroundings.REACH_M
    trembling = np.random.default_rng(0).normal(0.0, 0.01, (2000, 2))  # as an ego that stands
    assert shapely.bounds(surroundings.area_around([trembling])) == pytest.approx((-80, -80, 80, 80), abs=1.5)


# --- what cannot be shown ------------------------------------------------------------------------


def test_three_drives_none_and_drives_of_two_scenarios_are_refused() -> None:
    one = tiny_drive(CRUISE)
    with pytest.raises(InputError, match="not 3; name at most two planners"):
        replay_data([one] * 3)
    with pytest.raises(InputError, match="not 0"):
        replay_data([])
    with pytest.raises(InputError, match="do not fit on one page"):
        replay_data([one, tiny_drive(CRUISE, scenario_id="nudge/1")])


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_a_drive_of_hardly_any_frames_can_be_shown_and_one_of_none_is_refused(frames: int) -> None:
    assert only(replay_data([tiny_drive([CRUISE_MPS] * frames, expert_mps=CRUISE)]))["frames"] == frames
    nothing = Trace(EgoTrack.of([]), ActorTable.of([]), (), (), np.zeros(0))
    with pytest.raises(InputError, match="idm on lane_change_ltd/0, seed 0, ended before its first frame"):
        replay_data([tiny_drive([], trace=nothing, expert_mps=CRUISE)])


def test_what_the_planner_saw_is_shown_from_the_start_on_where_it_was_not_all() -> None:
    away = [START_M + 20.0 + k for k in range(SEEN_BEFORE + len(CRUISE))]
    truth = tiny_drive(CRUISE, actors=[cars((x, 0.0)) for x in away[SEEN_BEFORE:]])
    crowd = [Actors.none() if k == SEEN_BEFORE + 5 else cars((x, 0.3)) for k, x in enumerate(away)]
    trace = replace(truth.trace, seen=ActorTable.of(crowd[: SEEN_BEFORE + len(truth.trace)]))
    assert only(replay_data([truth]))["seen"] == []
    first, second = only(replay_data([tiny_drive(CRUISE, trace=trace)]))["seen"]
    assert (first["first"], first["frames"], second["first"]) == (0, 5, 6)
    assert undone(first["x"], 5, PER_METRE)[0] - undone(second["x"], 1, PER_METRE)[0] == pytest.approx(-6.0)
