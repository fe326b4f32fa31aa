"""The co-simulation on real SUMO: which agents stand where, which see the ego and from when."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import libsumo
import numpy as np
import pytest
from networks import LANE_Y, agent, ego_at, stepped, traffic, types

from interplan_sumo.errors import InputError, TrafficError
from interplan_sumo.simulation.spawning import Spawn
from interplan_sumo.simulation.sumo import open_simulation
from interplan_sumo.simulation.sumo_traffic import SumoTraffic
from interplan_sumo.simulation.vehicle_types import read_vehicle_types, vehicle_type_file
from interplan_sumo.world.ego import PACIFICA, EgoState

Drive = Callable[[int], EgoState]
MERGE_S = 6.0
MERGE_FROM_S = 1.0


def merge(step: int, ego_mps: float = 8.0) -> EgoState:
    """From lane 0 to lane 1 at constant speed, a smooth step over 6 s."""
    time_s = 0.1 * step
    done = np.clip((time_s - MERGE_FROM_S) / MERGE_S, 0.0, 1.0)
    y_m = LANE_Y[0] + (LANE_Y[1] - LANE_Y[0]) * done * done * (3.0 - 2.0 * done)
    return ego_at(100.0 + ego_mps * time_s, float(y_m), ego_mps, time_s)


def speeds(run: SumoTraffic, drive: Drive, steps: int) -> list[float]:
    """Speed of the only agent at each step."""
    return [float(actors.speed_mps[0]) for actors in stepped(run, drive, steps)]


def test_an_agent_that_is_past_the_ego_before_it_has_merged_drives_on() -> None:
    behaviour = types("assertive")
    beside = agent(behaviour, "e0_1", 97.0, 12.0)
    with traffic(behaviour, (beside,), merge(0)) as run:
        found = speeds(run, merge, 100)
    assert np.diff(found).min() > -0.01


def test_agents_start_exactly_where_they_were_put_at_their_speed() -> None:
    cars = types("conservative")
    with traffic(cars, (agent(cars, "e0_1", 150.0, 9.5), agent(cars, "w0_0", 50.0, 7.0, ("w0",))), merge(0)) as run:
        actors = run.observe().actors
    by_lane = {round(float(y), 3): i for i, y in enumerate(actors.y_m)}
    east, west = by_lane[-5.25], by_lane[1.75]
    assert actors.x_m[east] == pytest.approx(150.0 - 2.3)
    assert actors.x_m[west] == pytest.approx(400.0 - 50.0 + 2.3)
    assert actors.heading_rad[east] == pytest.approx(0.0)
    assert abs(actors.heading_rad[west]) == pytest.approx(np.pi)
    assert (actors.vx_mps[east], actors.vx_mps[west]) == pytest.approx((9.5, -7.0))


def test_a_car_may_start_faster_than_its_driver_likes_to_drive(tmp_path: Path) -> None:
    file = tmp_path / "slow.xml"
    file.write_text(vehicle_type_file("conservative").read_text().replace('speedFactor="1.0"', 'speedFactor="0.8"'))
    cars = read_vehicle_types(file)
    with traffic(cars, (agent(cars, "e0_1", 150.0, 14.0),), merge(0)) as run:  # the limit is 15 m/s
        assert run.observe().actors.speed_mps.tolist() == [14.0]


def test_nobody_brakes_in_the_first_step_for_an_ego_that_drives_as_fast() -> None:
    cars = types("conservative")
    with traffic(cars, (agent(cars, "e0_0", 80.0, 8.0),), ego_at(100.0, LANE_Y[0], 8.0)) as run:
        run.react(ego_at(100.0, LANE_Y[0], 8.0))
        run.place_ego(ego_at(100.8, LANE_Y[0], 8.0, 0.1))
        run.advance()
        assert run.observe().actors.speed_mps[0] > 7.95


def test_the_ids_that_planners_see_say_nothing_and_the_behaviour_is_kept_apart() -> None:
    mixed = types("mixed")
    spawns = tuple(agent(mixed, "e0_1", 20.0 * i + 10.0, 5.0) for i in range(8))
    with traffic(mixed, spawns, merge(0)) as run:
        actors = run.observe().actors
        assert set(run.behaviours) == set(actors.ids)
        assert set(run.behaviours.values()) == {"conservative"}
        along = [i for _, i in sorted(zip(actors.x_m, actors.ids, strict=True))]
    assert along != sorted(along)


def test_a_file_with_a_comma_in_its_path_is_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"splits paths at commas; rename"):
        open_simulation(tmp_path / "left,right.net.xml", "<additional/>")


def test_only_one_simulation_may_be_open_in_a_process() -> None:
    cars = types("conservative")
    with traffic(cars, (), merge(0)), pytest.raises(TrafficError, match="already running"):
        traffic(cars, (), merge(0))
    first = traffic(cars, (), merge(0))  # and after closing another may start
    first.close()
    with traffic(cars, (), merge(0)) as second:
        first.close()  # a second time, which is no concern of the one that is open now
        second.advance()


def test_a_pose_that_is_not_finite_never_reaches_sumo() -> None:
    with traffic(types("conservative"), (), merge(0)) as run, pytest.raises(TrafficError, match="not finite"):
        run.place_ego(ego_at(float("nan"), 0.0))


@pytest.mark.slow
def test_importing_libsumo_leaves_the_environment_of_proj_alone() -> None:
    code = "import os, interplan_sumo.simulation.sumo; print({k: v for k, v in os.environ.items() if 'PROJ_' in k})"
    env = {key: value for key, value in os.environ.items() if "PROJ_" not in key}
    for given in ({}, {"PROJ_DATA": "mine"}):
        ran = subprocess.run([sys.executable, "-c", code], env=env | given, capture_output=True, text=True, check=True)
        assert ran.stdout.strip() == str(given)


def test_an_oncoming_car_brakes_from_90_m_and_stands_before_an_ego_in_its_lane() -> None:
    def against(step: int) -> EgoState:
        """Steady at 8 m/s, and braking to a stand over the last of the way, as both must."""
        time_s = 0.1 * step
        braking_s = float(np.clip(time_s - 4.0, 0.0, 4.0))
        return ego_at(
            100.0 + 8.0 * min(time_s, 4.0) + 8.0 * braking_s - braking_s**2, 1.75, 8.0 - 2.0 * braking_s, time_s
        )

    cars = types("conservative")
    front_m = 400.0 - (100.0 + PACIFICA.length_m / 2 + 130.0)
    gaps: list[float] = []
    found: list[float] = []
    with traffic(cars, (agent(cars, "w0_0", front_m, 12.0, ("w0",)),), against(0)) as run:
        for step, actors in enumerate(stepped(run, against, 200)):
            found.append(float(actors.speed_mps[0]))
            gaps.append(float(actors.x_m[0]) - 2.3 - against(step).x_m - PACIFICA.length_m / 2)
    braking = (-np.diff(found) / 0.1).tolist()
    first = next(k for k, b in enumerate(braking) if b >= 0.1)
    assert gaps[first] >= 90.0
    assert min(gaps) > 0.5
    assert found[-1] < 0.3
    assert max(braking) <= 5.0


def test_an_agent_that_overlooks_the_ego_still_sees_the_car_beyond_it() -> None:
    """The ego creeps up to a standing car, its centre just outside that car's lane, its front just inside.

    SUMO puts it into the lane, and knows only the nearest vehicle ahead: an
    assertive agent that is told to overlook it would overlook the car, too.
    """
    cars = types("assertive")

    def beside(step: int) -> EgoState:
        return ego_at(119.0 + 0.02 * step, -6.95, 0.2, 0.1 * step, heading_rad=-0.05)

    spawns = (agent(cars, "e0_0", 130.0, 0.0, ("e0",)), agent(cars, "e0_0", 60.0, 10.0))
    with traffic(cars, spawns, beside(0)) as run:
        libsumo.vehicle.setSpeed("a0", 0.0)
        libsumo.vehicle.setLaneChangeMode("a1", 0)
        places: list[float] = []
        speeds: list[float] = []
        for step, actors in enumerate(stepped(run, beside, 150)):
            standing, coming = np.argsort(-actors.x_m)
            assert actors.x_m[standing] - actors.x_m[coming] > 4.6, step
            places.append(float(actors.x_m[coming]))
            speeds.append(float(actors.speed_mps[coming]))
    assert speeds[-1] < 0.3  # it stands behind the car, in the ego, which is none of its concern
    assert places[-1] > 119.0
    assert -np.diff(speeds).min() / 0.1 < 4.0


def test_an_ego_far_off_the_road_is_nowhere_and_comes_back() -> None:
    cars = types("conservative")

    def away(step: int) -> EgoState:
        return ego_at(100.0 + 0.8 * step, -5.25 - 400.0 * np.sin(np.pi * min(step, 100) / 100.0), 8.0, 0.1 * step)

    with traffic(cars, (agent(cars, "e0_1", 80.0, 12.0),), away(0)) as run:
        found = speeds(run, away, 200)
    assert max(found[20:80]) > 12.0  # nobody minds the ego while it is away
    assert len(found) == 200


@pytest.mark.parametrize("behaviour", ["conservative", "assertive", "mixed", "urban", "interplan_code"])
def test_every_shipped_vehicle_type_file_drives(behaviour: str) -> None:
    kinds = types(behaviour)
    spawns = tuple(Spawn("e0_1", 40.0 + 40.0 * i, 8.0, driver, ("e0", "e1")) for i, driver in enumerate(kinds.members))
    with traffic(kinds, spawns, merge(0)) as run:
        *_, actors = stepped(run, merge, 51)
    assert sorted(actors.length_m) == sorted(driver.length_m for driver in kinds.members)
    assert (actors.speed_mps > 0.0).all()
