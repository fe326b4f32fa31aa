"""What agents are told, in real SUMO: within their brakes, relaxed after a cut-in, each with its own lane change."""

from __future__ import annotations

from pathlib import Path

import libsumo
import numpy as np
import pytest
from networks import LANE_Y, agent, ego_at, traffic, types

from interplan_sumo.simulation.agent_control import AgentChance
from interplan_sumo.simulation.ego_reactions import AgentCommands
from interplan_sumo.simulation.headway_relaxation import HeadwayRelaxation
from interplan_sumo.simulation.reactions import Mode, ReactionDecision
from interplan_sumo.simulation.traffic import EgoPresence
from interplan_sumo.simulation.vehicle_types import VehicleType, VehicleTypes, read_vehicle_types, vehicle_type_file
from interplan_sumo.world.ego import EgoState

BOUNDARY_Y = (LANE_Y[0] + LANE_Y[1]) / 2.0


def with_relaxation(folder: Path, relaxation_s: float) -> VehicleTypes:
    path = folder / f"relaxing_{relaxation_s:g}.xml"
    line = f'<param key="interplan.relaxation" value="{relaxation_s:g}"/></vType>'
    path.write_text(vehicle_type_file("conservative").read_text().replace("</vType>", line))
    return read_vehicle_types(path)


def followed(of: VehicleTypes, y_m: float, steps: int) -> np.ndarray:
    """Speeds of an agent at 12 m/s, step by step, before which an ego as fast as it comes in 10 m ahead."""

    def ego(step: int) -> EgoState:
        return ego_at(110.0 + 1.2 * step, y_m if step > 0 else LANE_Y[0], 12.0)

    speeds: list[float] = []
    with traffic(of, (agent(of, "e0_1", 97.4, 12.0),), ego(0)) as run:
        for step in range(steps):
            run.react(ego(step))
            run.place_ego(ego(step + 1))
            run.advance()
            speeds.append(float(run.observe().actors.speed_mps[0]))
    return np.array(speeds)


@pytest.mark.parametrize("y_m", [LANE_Y[1], BOUNDARY_Y], ids=["in the lane", "astride"])
def test_whoever_relaxes_brakes_less_for_a_cut_in_and_comes_back_to_its_headway(y_m: float, tmp_path: Path) -> None:
    strict, relaxed = (followed(with_relaxation(tmp_path, each), y_m, 150) for each in (0.0, 5.0))
    assert np.diff(strict).min() / 0.1 < -2.0
    assert np.diff(relaxed).min() / 0.1 > -1.0
    assert relaxed.min() < 11.5  # it does fall back


def test_relaxation_starts_at_the_actual_headway_and_returns_with_its_time_constant() -> None:
    told: list[float] = []
    drivers = {"a": VehicleType("d", tau_s=1.5, relaxation_s=5.0)}
    relaxation = HeadwayRelaxation(drivers, lambda _, tau_s: told.append(tau_s), 0.1)
    for leader in (("far", 30.0), *[("near", 6.0)] * 50):
        relaxation.step(["a"], lambda _: 10.0, {"a": leader}.get)
    assert told[0] == pytest.approx(0.6)
    assert told[-1] == pytest.approx(1.5 - 0.9 * np.exp(-49 * 0.1 / 5.0))
    assert told == sorted(told)


@pytest.mark.parametrize(("gap_m", "relaxes"), [(14.9, True), (15.1, False)])
def test_a_new_leader_at_no_less_than_the_own_headway_changes_nothing(gap_m: float, relaxes: bool) -> None:
    told: list[float] = []
    drivers = {"a": VehicleType("d", tau_s=1.5, relaxation_s=5.0)}
    HeadwayRelaxation(drivers, lambda _, tau_s: told.append(tau_s), 0.1).cut_in("a", gap_m, 10.0)
    assert bool(told) is relaxes


def test_an_agent_that_is_told_a_speed_brakes_for_sumos_reasons_as_hard_as_ever() -> None:
    """Told to go on, it stops before what SUMO has on its lane just as it does untold."""
    cars = types("conservative")
    spawns = (agent(cars, "e0_1", 60.0, 10.0), agent(cars, "e0_1", 100.0, 10.0))

    def speeds(told: ReactionDecision) -> list[float]:
        found: list[float] = []
        with traffic(cars, spawns, ego_at(300.0, LANE_Y[0])) as run:
            libsumo.vehicle.setSpeedMode("a1", 0)
            for step in range(80):
                libsumo.vehicle.setSpeed("a1", 10.0 if step < 30 else 0.0)
                run._control.tell(
                    run._agents.snapshot(run._lanes_of, run._positions_m, run._choice_of),
                    AgentCommands({"a0": told}, frozenset(), {}, {}),
                )
                run.advance()
                found.append(libsumo.vehicle.getSpeed("a0"))
        return found

    left, told = (
        speeds(ReactionDecision(mode, 0.0, False, mps))
        for mode, mps in ((Mode.SUMO, None), (Mode.OVERRIDE_SPEED, 13.0))
    )
    assert min(np.diff(left)) < -0.3  # harder than `decel`
    assert told == pytest.approx(left, abs=0.3)


def test_who_follows_another_agent_at_our_word_drives_as_behind_one_that_sumo_shows_it(tmp_path: Path) -> None:
    """Krauss's model reckons with the leader's brakes, and other agents brake no harder than their own `decel`."""
    path = tmp_path / "krauss.xml"
    path.write_text(vehicle_type_file("assertive").read_text().replace('"IDM"', '"Krauss" sigma="0"'))
    cars = read_vehicle_types(path)
    gap_m, speed_mps = 12.0, 10.0
    both = (
        agent(cars, "e0_1", 200.0, speed_mps),
        agent(cars, "e0_1", 200.0 - cars.members[0].length_m - gap_m, speed_mps),
    )
    with traffic(cars, both, ego_at(1000.0, LANE_Y[0])) as run:
        follow = run._control.models.follow
        other, nobody = (follow("a1", speed_mps, gap_m, speed_mps, each) for each in ("a0", ""))
        run.advance()
        assert libsumo.vehicle.getSpeed("a1") == pytest.approx(other, abs=0.01)
    assert nobody < other - 0.2


def lane_changes_s(cars: VehicleTypes, presence: EgoPresence = EgoPresence.DRIVES) -> list[float]:
    """How long six agents take to change lane."""
    spawns = tuple(agent(cars, "e0_0", 40.0 + 40.0 * i, 10.0) for i in range(6))
    with traffic(cars, spawns, ego_at(20.0, LANE_Y[2]), presence) as run:
        for i in range(6):
            libsumo.vehicle.changeLane(f"a{i}", 1, 100.0)
        heights: list[list[float]] = []
        for step in range(100):
            run.react(ego_at(20.0 + 0.01 * step, LANE_Y[2], 0.1))
            run.place_ego(ego_at(20.0 + 0.01 * step, LANE_Y[2], 0.1))
            run.advance()
            heights.append([libsumo.vehicle.getPosition(f"a{i}")[1] for i in range(6)])
    return (np.count_nonzero(np.abs(np.diff(heights, axis=0)) > 1e-6, axis=0) * 0.1).tolist()


def test_each_driver_takes_its_own_time_to_change_lane_and_without_an_ego_sumos() -> None:
    cars = types("conservative")
    own, plain = lane_changes_s(cars), lane_changes_s(cars, EgoPresence.ABSENT)
    assert len({round(each, 1) for each in own}) >= 4
    assert min(own) >= 2.8
    assert max(own) <= 8.1
    assert plain == pytest.approx([2.95] * 6, abs=0.11)
    assert lane_changes_s(cars, EgoPresence.UNSEEN) == own


def test_a_type_with_a_lateral_speed_of_its_own_keeps_it_and_nobody_is_warned_of_it(tmp_path: Path) -> None:
    path = tmp_path / "slow.xml"
    path.write_text(vehicle_type_file("conservative").read_text().replace("<vType ", '<vType maxSpeedLat="0.7" '))
    cars = read_vehicle_types(path)
    assert cars.warnings == ()
    assert lane_changes_s(cars) == pytest.approx([3.5 / 0.7] * 6, abs=0.15)


def test_chance_falls_to_each_agent_from_the_seed_alone() -> None:
    one, again, other = AgentChance(7), AgentChance(7), AgentChance(8)
    first = [one.of("a"), one.of("a"), one.of("b")]
    again.of("b")
    assert [again.of("a"), again.of("a")] == first[:2]
    assert other.of("a") != first[0]


def test_lane_changes_take_as_long_as_recorded_ones() -> None:
    drawn = [AgentChance(0).lane_change_s(f"a{i}") for i in range(2000)]
    assert (min(drawn), max(drawn)) == (3.0, 8.0)
    assert np.median(drawn) == pytest.approx(4.12, abs=0.15)
