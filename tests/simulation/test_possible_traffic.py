"""Whatever the ego does, its neighbours brake, turn and wait as cars and their drivers can."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import libsumo
import numpy as np
import pytest
import shapely

from interplan_sumo.maps.store import load_roads
from interplan_sumo.scenario.suite import find_scenario
from interplan_sumo.simulation.setup import open_traffic
from interplan_sumo.simulation.traffic import EgoPresence
from interplan_sumo.simulation.vehicle_types import VehicleTypes, read_vehicle_types, vehicle_type_file
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.geometry import box_polygons
from tests.networks import LANE_Y, WESTWARD_Y, agent, ego_at, stepped, traffic, types
from tests.simulation.fuzz_drivers import MODELS
from tests.simulation.merges import Merge, measured, sites
from tests.simulation.traffic_invariants import Body, Drive, Frame, violations

Array = np.ndarray
DT_S = 0.1


def derived(folder: Path, *changes: tuple[str, str], base: str = "conservative") -> VehicleTypes:
    """A shipped file with parts of its text replaced."""
    text = vehicle_type_file(base).read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "types.xml"
    path.write_text(text)
    return read_vehicle_types(path)


def with_keys(folder: Path, **values: float) -> VehicleTypes:
    """The conservative drivers with other values of our own keys."""
    old = '<param key="interplan.reactOverlap" value="0"/>'
    lines = "".join(f'<param key="interplan.{key}" value="{value:g}"/>' for key, value in values.items())
    return derived(folder, (old, lines))


def speeds(
    of: VehicleTypes, ego: Callable[[int], EgoState], steps: int, *, lane: str = "e0_1", at_m: float = 60.0,
    mps: float = 10.0, presence: EgoPresence = EgoPresence.DRIVES,
) -> Array:  # fmt: skip
    """Of one agent on a straight road, step by step."""
    with traffic(of, (agent(of, lane, at_m, mps),), ego(0), presence) as run:
        return np.array([float(actors.speed_mps[0]) for actors in stepped(run, ego, steps)])


@pytest.mark.parametrize("anticipation", [0, 3])
def test_a_leader_never_brakes_for_the_ego_behind_it(anticipation: int, tmp_path: Path) -> None:
    """Swept ahead, the faster ego's box begins behind the leader and ends ahead of it."""
    drivers = derived(tmp_path, ('anticipation" value="0"', f'anticipation" value="{anticipation}"'))
    ego = lambda step: ego_at(100.0 - 4.6 - 12.0 - PACIFICA.length_m / 2.0 + 1.2 * step, LANE_Y[1], 12.0)  # noqa: E731
    with_ego, without = (
        speeds(drivers, ego, 12, at_m=100.0, presence=there) for there in (EgoPresence.DRIVES, EgoPresence.ABSENT)
    )
    assert with_ego == pytest.approx(without, abs=1e-6)


def test_in_the_twin_run_nobody_meets_the_ego() -> None:
    drivers = types("conservative")
    ego = lambda _: ego_at(100.0, LANE_Y[1], 0.0)  # noqa: E731
    with_ego, unseen, plain = (speeds(drivers, ego, 60, presence=each) for each in EgoPresence)
    assert with_ego[-1] < 3.0
    assert unseen == pytest.approx(plain, abs=1e-6)


def crossing(step: int, *, ahead_m: float, takes_s: float) -> EgoState:
    """An ego that crosses all lanes at 5 m/s, its middle `ahead_m` before the front of an agent at 60 m."""
    t = DT_S * step
    y = LANE_Y[0] + (LANE_Y[2] - LANE_Y[0]) * min(1.0, t / takes_s)
    return ego_at(60.0 + ahead_m + 5.0 * t, y, 5.0, t, 0.35)


@pytest.mark.parametrize("behaviour", ["conservative", "assertive"])
@pytest.mark.parametrize("ahead_m", [-2.0, 2.6, 4.6, 8.6, 14.0])
@pytest.mark.parametrize("takes_s", [1.5, 3.0])
def test_nobody_brakes_harder_than_brakes_can_whoever_crosses_its_lane(
    behaviour: str, ahead_m: float, takes_s: float
) -> None:
    """It brakes at 9 m/s2 at most, also as it passes the ego beside which SUMO holds it to be behind."""
    drivers = types(behaviour)
    ego = lambda step: crossing(step, ahead_m=ahead_m, takes_s=takes_s)  # noqa: E731
    both = tuple(agent(drivers, "e0_1", at_m, 13.0) for at_m in (60.0, 130.0))
    with traffic(drivers, both, ego(0)) as run:
        change = np.diff([actors.speed_mps for actors in stepped(run, ego, 50)], axis=0) / DT_S
    assert change.min() > -9.05
    assert change.max() < 1.05


def test_whom_the_ego_has_passed_through_is_seen_by_those_far_behind_it_too() -> None:
    """One stands in the lane; an ego drives through it and on at 15 m/s before another one comes."""
    drivers = types("conservative")
    ego = lambda step: ego_at(100.0 + 1.5 * step, LANE_Y[1], 15.0)  # noqa: E731
    both = (agent(drivers, "e0_1", 150.0, 0.0), agent(drivers, "e0_1", 20.0, 8.0))
    with traffic(drivers, both, ego(0)) as run:
        for each in stepped(run, ego, 200):
            assert len(each) == 2
            libsumo.vehicle.setMaxSpeed("a0", 0.001)
            libsumo.vehicle.setLaneChangeMode("a0", 0)
            libsumo.vehicle.setLaneChangeMode("a1", 0)
        assert 140.0 < libsumo.vehicle.getLanePosition("a1") < 150.0 - 4.6


def overtaking(step: int) -> EgoState:
    """Past an agent at 6 m/s on the oncoming lane, back in before it, then to a stop."""
    x_m, mps = 60.0 + 1.2 * step, 12.0
    if x_m > 165.0:
        braking_s = min(3.0, (x_m - 165.0) / 12.0)
        x_m, mps = 165.0 + 12.0 * braking_s - 2.0 * braking_s**2, 12.0 - 4.0 * braking_s
    y_m = float(np.interp(x_m, (60.0, 75.0, 140.0, 160.0), (LANE_Y[2], WESTWARD_Y, WESTWARD_Y, LANE_Y[2])))
    return ego_at(x_m, y_m, mps)


@pytest.mark.parametrize("behaviour", ["conservative", "assertive", "measured_city"])
def test_an_ego_that_has_overtaken_and_stops_is_not_driven_into(behaviour: str) -> None:
    """SUMO, which had it in the agent's own lane all the while, still has it behind the agent."""
    drivers, front_m = types(behaviour), 0.0
    with traffic(drivers, (agent(drivers, "e0_2", 90.0, 6.0),), overtaking(0)) as run:
        for each in stepped(run, overtaking, 350):
            libsumo.vehicle.setLaneChangeMode("a0", 0)
            libsumo.vehicle.setMaxSpeed("a0", 6.0)
            front_m = float(each.x_m[0] + each.length_m[0] / 2.0)
        stands_m = overtaking(400).x_m - PACIFICA.length_m / 2.0
        assert stands_m - 12.0 < front_m < stands_m - 0.5


@pytest.mark.parametrize("gap_m", [0.5, 1.0, 2.0])
def test_who_changes_lane_right_behind_a_standing_ego_does_not_touch_it(gap_m: float) -> None:
    drivers, ego = types("conservative"), ego_at(150.0, LANE_Y[1], 0.0)
    front_m = ego.x_m - PACIFICA.length_m / 2.0 - gap_m
    stands = shapely.box(
        *(ego.x_m - PACIFICA.length_m / 2.0, ego.y_m - PACIFICA.width_m / 2.0),
        *(ego.x_m + PACIFICA.length_m / 2.0, ego.y_m + PACIFICA.width_m / 2.0),
    )
    with traffic(drivers, (agent(drivers, "e0_1", front_m, 0.0),), ego) as run:
        for step, each in enumerate(stepped(run, lambda _: ego, 150)):
            if step == 40:
                libsumo.vehicle.changeLane("a0", 2, 10.0)
            (box,) = box_polygons(each.x_m, each.y_m, each.heading_rad, each.length_m, each.width_m)
            assert not box.intersects(stands)


def followed(of: VehicleTypes, y_m: float) -> Array:
    """Speeds of a follower behind an ego that drives 8 m/s at this offset, 20 m ahead."""
    ego = lambda step: ego_at(60.0 + 20.0 + PACIFICA.length_m / 2.0 + 0.8 * step, y_m, 8.0)  # noqa: E731
    return speeds(of, ego, 60, mps=12.0)


@pytest.mark.parametrize("model", ["IDM", *(each for each in MODELS if each != "PWagner2009")])
def test_an_ego_astride_is_followed_as_one_in_the_lane_is_by_whatever_model(model: str, tmp_path: Path) -> None:
    """Each driver's own model decides; noise is switched off, which would fall differently on both."""
    stays = ('lcSpeedGain="0.5"', 'lcSpeedGain="0" lcStrategic="-1"')
    drivers = derived(tmp_path, ('carFollowModel="IDM"', f'carFollowModel="{model}" sigma="0"'), stays)
    astride, inside = followed(drivers, (2.0 * LANE_Y[0] + LANE_Y[1]) / 3.0), followed(drivers, LANE_Y[1])
    assert inside.min() < 11.5
    assert astride == pytest.approx(inside, abs=0.15)


READ_BY_SUMO = (
    'carFollowModel="W99" cc1="1.2" cc9="1.5"', 'carFollowModel="EIDM" treaction="0.6" sigmaleader="0.02"',
    'carFollowModel="IDMM" adaptTime="600"', 'carFollowModel="Wiedemann" security="0.4"',
    'carFollowModel="ACC" speedControlGain="-0.5"', 'carFollowModel="Krauss" sigmaStep="0.2"',
    'carFollowModel="IDM" desiredMaxSpeed="14"',
)  # fmt: skip


@pytest.mark.parametrize("attributes", READ_BY_SUMO)
def test_every_attribute_that_sumo_reads_may_be_set(attributes: str, tmp_path: Path) -> None:
    drivers = derived(tmp_path, ('carFollowModel="IDM"', attributes))
    assert len(speeds(drivers, lambda step: ego_at(200.0 + 0.8 * step, LANE_Y[1]), 10)) == 10


def test_numbers_may_be_distributions_drawn_per_agent(tmp_path: Path) -> None:
    drivers = derived(tmp_path, ('speedFactor="1.0" speedDev="0"', 'speedFactor="normc(1,0.1,0.8,1.2)"'))
    rng = np.random.default_rng(0)
    factors = [drivers.draw(rng).speed_factor for _ in range(200)]
    assert len(set(factors)) > 100
    assert min(factors) >= 0.8
    assert max(factors) <= 1.2
    assert np.mean(factors) == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("gap_m", [16.0, 20.0])
def test_the_dial_is_a_slope_and_no_cliff(gap_m: float, tmp_path: Path) -> None:
    """Late drivers brake hard, or do not yield at all; those who make room before the boxes touch need not."""
    merge = Merge(sites("strip", "straight")[0], gap_m)
    keys = {"reactOverlap": 0.5, "reactionTime": 0.8}
    rude, kind = (measured(merge, with_keys(tmp_path, **keys, courtesy=c))[0] for c in (0.0, 1.0))
    assert kind.stays_behind
    assert kind.hardest_mps2 < 6.0
    assert not rude.stays_behind or rude.hardest_mps2 > 8.0


@pytest.mark.parametrize("reaction_s", [0.5, 1.2])
def test_a_driver_responds_a_reaction_time_after_the_condition(reaction_s: float, tmp_path: Path) -> None:
    merge = Merge(sites("strip", "straight")[0], gap_m=20.0)
    at_once, late = (
        measured(merge, with_keys(tmp_path, reactOverlap=0.0, reactionTime=each))[0].reaction_s
        for each in (0.0, reaction_s)
    )
    assert at_once is not None
    assert late is not None
    assert late - at_once == pytest.approx(reaction_s, abs=0.15)


def recorded(scenario_id: str, presence: EgoPresence, steps: int) -> tuple[Drive, dict[str, Body]]:
    """A suite's scene as an ego sees it that drives on along its lane's first heading."""
    scenario = find_scenario(scenario_id)
    frames: list[Frame] = []
    with open_traffic(scenario, load_roads(scenario.map), presence=presence) as run:
        pose, mps = scenario.start.pose(load_roads(scenario.map)), scenario.start_speed_mps
        for _ in range(steps):
            actors = run.observe().actors
            ego = (pose.x_m, pose.y_m, pose.heading_rad, PACIFICA.length_m, PACIFICA.width_m)
            frames.append(
                Frame(
                    actors.ids, actors.x_m, actors.y_m, actors.heading_rad, actors.length_m, actors.width_m,
                    actors.speed_mps, actors.speed_mps, ego,
                )
            )  # fmt: skip
            state = EgoState(
                0.0, pose.x_m, pose.y_m, pose.heading_rad, vx_mps=mps if presence is EgoPresence.DRIVES else 0.0
            )
            run.react(state)
            run.place_ego(state)
            run.advance()
        agents = {name: Body("?", 1.0, 9.0) for name in run.behaviours}
    return Drive.of(frames), agents


@pytest.mark.slow
def test_bodies_follow_their_wheels_and_lane_changes_last_differently() -> None:
    """Dense traffic before a lane that ends: many lane changes, slow ones, too."""
    durations: list[float] = []
    for scenario_id in ("lane_change_htd/0", "lane_change_htd/2", "lane_change_htd/5"):
        driven, agents = recorded(scenario_id, EgoPresence.ABSENT, steps=200)
        found = violations(driven, agents)
        assert [each for each in found if each.kind == "side_slip"] == []
        durations += lane_changes_s(driven)
    assert len(durations) > 5
    assert np.std(durations) > 0.3


def lane_changes_s(driven: Drive) -> list[float]:
    """How long each lateral move of 2.5 m and more on a straight lasts, by the time its body is turned."""
    lasts: list[float] = []
    turned = np.gradient(np.unwrap(np.nan_to_num(driven.heading_rad), axis=0), axis=0)
    for i in range(len(driven.ids)):
        moving = np.flatnonzero((np.abs(turned[:, i]) > 0.001) & (driven.speed_mps[:, i] > 5.0))
        for spell in np.split(moving, np.flatnonzero(np.diff(moving) > 3) + 1):
            if 8 <= len(spell) <= 100:
                begin, end = int(spell[0]), int(spell[-1])
                heading = driven.heading_rad[begin, i]
                dx, dy = (part[end, i] - part[begin, i] for part in (driven.x_m, driven.y_m))
                aside = abs(-np.sin(heading) * dx + np.cos(heading) * dy)
                back = abs(driven.heading_rad[end, i] - heading) < 0.03
                if 2.5 < aside < 4.0 and back:
                    lasts.append(DT_S * len(spell))
    return lasts
