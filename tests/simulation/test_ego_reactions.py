"""What agents near the ego are told: to keep their lane beside it, and to see what SUMO hides behind it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import libsumo
import numpy as np
import pytest
from networks import LANE_Y, WESTWARD_Y, agent, ego_at, stepped, traffic, two_way_road, types

from interplan_sumo.simulation.agent_control import NEW_STEPS
from interplan_sumo.simulation.agent_registry import AgentRegistry
from interplan_sumo.simulation.anchor import find_anchor
from interplan_sumo.simulation.ego_locator import EgoLocator
from interplan_sumo.simulation.ego_reactions import AgentCommands, EgoReactions
from interplan_sumo.simulation.reactions import DriverModels, Mode
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import PACIFICA, EgoState

KEEPS_LANE = 0
"""SUMO's mode of a car that changes lane for no reason."""
PASSED = 25
"""The step at which an ego of 20 m/s whose centre was at 90 m is ahead of a car of 8 m/s that was at 120 m."""
BOUNDARY_Y = (LANE_Y[0] + LANE_Y[1]) / 2.0


@pytest.mark.parametrize(("behind_m", "keeps"), [(39.5, True), (40.5, False)])
def test_agents_within_40_m_of_a_straddling_ego_keep_their_lane(behind_m: float, keeps: bool) -> None:
    cars = types("conservative")
    ego = ego_at(100.0, BOUNDARY_Y)
    with traffic(cars, (agent(cars, "e0_2", ego.x_m - behind_m, 8.0),), ego) as run:
        for _ in range(NEW_STEPS):
            run.advance()
        run.react(EgoState(0.0, float(run.observe().actors.x_m[0]) + 2.3 + behind_m, ego.y_m, 0.0, vx_mps=8.0))
        assert (libsumo.vehicle.getLaneChangeMode("a0") == KEEPS_LANE) == keeps


MODELS = DriverModels(lambda _name, speed_mps, *_: speed_mps, lambda _name: 0.5, lambda *_: None, 0.1)


class Lane1:
    """Agents on lane 1 at (x, y) of their fronts, at 8 m/s, and an ego on its centre line at x = 100."""

    def __init__(self, *fronts: tuple[float, float], behaviour: str = "conservative") -> None:
        self.network = two_way_road()
        self.fronts = fronts
        self.registry = AgentRegistry(Path("conservative.xml"), Actors.none(), None, (0.0, 0.0), 0.1)
        names = [f"a{i}" for i in range(len(fronts))]
        for name in names:
            self.registry.add(name, name, types(behaviour).members[0], ("e0", "e1"))
        self.registry.enter(names)
        self.registry.kinematics.move(fronts, [90.0] * len(fronts), [8.0] * len(fronts), self.registry.length_m)
        self.reactions = EgoReactions(self.network, (0.0, 0.0), PACIFICA, self.registry, (), MODELS)
        self.place(ego_at(100.0, LANE_Y[1]))

    def place(self, ego: EgoState) -> None:
        self.ego = ego
        reach_m, turned = PACIFICA.length_m / 2.0, self.ego.heading_rad
        front = (self.ego.x_m + reach_m * float(np.cos(turned)), self.ego.y_m + reach_m * float(np.sin(turned)))
        self.anchor = find_anchor(self.network, front, turned, None, ("e0", "e1"))

    def decide(self) -> AgentCommands:
        def positions_m(names: Sequence[str]) -> list[float]:
            return [self.fronts[int(name[1:])][0] for name in names]

        agents = self.registry.snapshot(lambda names: ["e0_1"] * len(names), positions_m, lambda _: ())
        return self.reactions.decide(self.ego, self.anchor, (), {}, agents)


@pytest.mark.parametrize(("beside_m", "mode"), [(2.2, Mode.OVERRIDE_SPEED), (2.4, Mode.SUMO)])
def test_a_follower_is_told_of_a_car_that_the_ego_stands_in_and_not_of_one_that_it_clears(
    beside_m: float, mode: Mode
) -> None:
    """The ego is 2.3 m wide; SUMO knows only the order of the cars on a lane, and so would hide one behind the ego."""
    road = Lane1((80.0, LANE_Y[1]), (101.0, LANE_Y[1] + beside_m))
    assert road.decide().decisions["a0"].mode is mode


@pytest.mark.parametrize(
    ("front_x", "mode"), [(107.1, Mode.OVERRIDE_SPEED), (107.3, Mode.SUMO), (97.5, Mode.OVERRIDE_SPEED)]
)
def test_the_ego_stands_in_a_car_as_long_as_their_boxes_share_a_stretch_of_the_lane(front_x: float, mode: Mode) -> None:
    """The ego reaches from 97.4 to 102.6 m; a car of 4.6 m with its front at 107.2 m begins where it ends."""
    assert Lane1((80.0, LANE_Y[1]), (front_x, LANE_Y[1])).decide().decisions["a0"].mode is mode


def test_who_is_beside_a_car_that_the_ego_stands_in_keeps_its_lane() -> None:
    """SUMO would put it behind cars on the other lane that it is ahead of, and drive those through it."""
    assert "a1" not in Lane1((80.0, LANE_Y[1]), (120.0, LANE_Y[1])).decide().keep_lane
    assert "a1" in Lane1((80.0, LANE_Y[1]), (101.0, LANE_Y[1])).decide().keep_lane


@pytest.mark.parametrize("aside_m", [0.0, 1.5])
def test_a_car_that_the_ego_has_passed_in_its_lane_is_followed_again(aside_m: float) -> None:
    """SUMO keeps the order of the cars on a lane, whoever passes whom: for it the follower's leader would be it."""
    cars = types("conservative")
    ego = ego_at(90.0, LANE_Y[1] + aside_m, 20.0)

    def drive(step: int) -> EgoState:
        return ego_at(90.0 + 2.0 * step, ego.y_m, 20.0)

    spawns = (agent(cars, "e0_1", 80.0, 8.0), agent(cars, "e0_1", 120.0, 8.0))
    with traffic(cars, spawns, ego) as run:
        for step, _ in enumerate(stepped(run, drive, 60)):
            leader, _ = (step > 0 and libsumo.vehicle.getLeader("a0", 200.0)) or ("ego", 0.0)
            assert leader == ("ego" if step < PASSED else "a1") or PASSED <= step <= PASSED + 2
        assert libsumo.lane.getLastStepVehicleIDs("e0_1") == ("a0", "a1", "ego")


def test_an_assertive_agent_follows_an_ego_that_starts_in_its_lane_and_not_one_that_slides_in() -> None:
    """Its centre is in lane 1, and seven tenths of its box."""
    for at_start, mode in ((True, Mode.SUMO), (False, Mode.IGNORE_EGO)):
        road = Lane1((80.0, LANE_Y[1]), behaviour="assertive")
        if not at_start:
            road.place(ego_at(100.0, WESTWARD_Y))
            road.decide()
        road.place(ego_at(100.0, BOUNDARY_Y + 0.2 * PACIFICA.width_m))
        assert road.decide().decisions["a0"].mode is mode


def test_the_quick_ways_to_place_the_ego_on_the_lanes_give_what_the_whole_way_gives() -> None:
    rng = np.random.default_rng(0)
    road = Lane1((80.0, LANE_Y[1]))
    locator = EgoLocator(road.network, (0.0, 0.0), PACIFICA)
    for _ in range(100):
        lane, x_m = int(rng.integers(3)), float(rng.choice((0.0, 410.0)) + rng.uniform(5.0, 380.0))
        y_m, turned = LANE_Y[lane] + float(rng.uniform(-0.9, 0.9)), float(rng.normal(0.0, 0.05))
        ego = EgoState(0.0, x_m, y_m, turned, vx_mps=8.0, vy_mps=0.5)
        road.place(ego)
        (quick, _), (whole, _) = (locator.locate(ego, road.anchor, times, courteous=False) for times in ((), (1.0,)))
        assert quick.straddles == whole.straddles
        assert quick.centre_lanes == whole.centre_lanes == {f"e{int(x_m > 400.0)}_{lane}"}
        along_mps = 8.0 * np.cos(turned) - 0.5 * np.sin(turned)
        for name, part in whole.coverage.items():
            assert part.speed_mps == pytest.approx(along_mps * (-1.0 if name.startswith("w") else 1.0))
        assert quick.coverage.keys() == whole.coverage.keys()
        for (
            lane,
            part,
        ) in quick.coverage.items():  # a box turned a little is taken for straight
            assert tuple(part) == pytest.approx(tuple(whole.coverage[lane]), abs=0.2)


def test_an_agent_is_left_to_sumo_again_once_the_ego_has_gone() -> None:
    cars = types("conservative")
    beside, gone = ego_at(100.0, BOUNDARY_Y), ego_at(100.0, -60.0)
    with traffic(cars, (agent(cars, "e0_1", 90.0, 8.0),), beside) as run:
        brakes: list[bool] = []
        for ego in (beside, gone, gone):
            before_mps = libsumo.vehicle.getSpeed("a0")
            run.react(ego)
            run.place_ego(ego)
            run.advance()
            brakes.append(libsumo.vehicle.getSpeed("a0") < before_mps)
        assert libsumo.vehicle.getSpeedMode("a0") == 31
    assert brakes == [True, False, False]


@pytest.mark.parametrize(("left_mps", "left_m", "lane"), [
    (0.3, 0.0, "e0_2"), (-0.3, 0.0, "e0_0"), (0.1, 0.0, None), (0.3, -0.5, None), (0.3, 0.5, "e0_2"),
    (0.3, 1.2, "e0_2"), (0.3, 1.8, "e0_2"),
])  # fmt: skip
def test_an_ego_that_moves_sideways_from_its_centre_line_approaches_the_next_lane(
    left_mps: float, left_m: float, lane: str | None
) -> None:
    road = Lane1((80.0, LANE_Y[1]))
    ego = EgoState(0.0, 100.0, LANE_Y[1] + left_m, 0.0, vx_mps=8.0, vy_mps=left_mps)
    road.place(ego)
    found, _ = EgoLocator(road.network, (0.0, 0.0), PACIFICA).locate(ego, road.anchor, (), courteous=True)
    assert list(found.approached) == ([] if lane is None else [lane])
    for part in found.approached.values():
        assert (part.start_m, part.end_m, part.speed_mps) == pytest.approx((100 - 2.6, 100 + 2.6, 8.0), abs=0.02)
