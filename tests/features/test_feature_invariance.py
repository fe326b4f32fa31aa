"""Invariance: what the ego sees does not depend on where the map has its axes, on names, or on who else looked."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from worlds import cars, curved_road, ego, ego_on, junction, mission, observation, pedestrians, signals, together

from interplan_sumo.features.view import Arrays, EgoView
from interplan_sumo.planner import Mission, Observation, Past
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import Floats, Pose, wrap_angle
from interplan_sumo.world.roads import Area, DrivingSide
from tests.metrics.staging import moved_roads


@dataclass(frozen=True)
class Move:
    """A turn about the origin, then a shift."""

    turn_rad: float
    x_m: float
    y_m: float

    def points(self, xy: Floats) -> Floats:
        c, s = np.cos(self.turn_rad), np.sin(self.turn_rad)
        return np.asarray(xy) @ np.array(((c, s), (-s, c))) + (self.x_m, self.y_m)

    def mission(self, mission: Mission) -> Mission:
        goal = mission.goal
        x, y = self.points(np.array((goal.x_m, goal.y_m)))
        pose = Pose(float(x), float(y), float(wrap_angle(goal.heading_rad + self.turn_rad)))
        return replace(mission, roads=moved_roads(mission.roads, self.points), goal=pose)

    def observation(self, observation: Observation) -> Observation:
        past = Past(tuple(map(self.ego, observation.past.egos)), tuple(map(self.actors, observation.past.actors)))
        return replace(observation, ego=self.ego(observation.ego), actors=self.actors(observation.actors), past=past)

    def ego(self, ego: EgoState) -> EgoState:
        x, y = self.points(np.array((ego.x_m, ego.y_m)))
        heading = float(wrap_angle(ego.heading_rad + self.turn_rad))
        return replace(ego, x_m=float(x), y_m=float(y), heading_rad=heading)

    def actors(self, actors: Actors) -> Actors:
        x, y = self.points(np.stack((actors.x_m, actors.y_m), axis=1)).T
        vx, vy = Move(self.turn_rad, 0.0, 0.0).points(np.stack((actors.vx_mps, actors.vy_mps), axis=1)).T
        heading = wrap_angle(actors.heading_rad + self.turn_rad)
        return replace(actors, x_m=x, y_m=y, heading_rad=heading, vx_mps=vx, vy_mps=vy)


MOVES = st.builds(Move, st.floats(-pi, pi), st.floats(-2e5, 2e5), st.floats(-2e5, 2e5))


def crossing(side: DrivingSide) -> tuple[Mission, Observation]:
    """A junction with everything a view can hold, a second after the first frame."""
    roads = replace(junction(driving_side=side), crosswalks=(Area("1", shapely.box(-20.3, -6.1, -17.2, 6.2)),))
    here = ego_on(roads, "1", 41.3, 7.0)
    before = tuple(ego(here.x_m - 0.7 * k, here.y_m + 0.01 * k, 7.0, 0.01 * k) for k in range(10, 0, -1))

    def scene(k: int) -> Observation:
        moving = cars((5.2, 1.4, 4.0, 2.9), (-40.1 + 0.5 * k, -1.3, 5.0, 0.02 * k), (1.1, 30.6, 3.0, -1.5))
        cones = cars((-15.3, -3.1), (-14.1, -2.2), kind=3, prefix="cone", length_m=0.5, width_m=0.5)  # type: ignore[arg-type]
        return observation(here, together(moving, pedestrians((-18.4, 4.0 - 0.1 * k, 1.0, -1.6)), cones))

    lights = signals(red=("13",), green=("24",))
    past = Past(before, tuple(scene(k).actors for k in range(10)))
    return mission(roads, ("1", "14", "8")), replace(scene(10), signals=lights, past=past)


def bend() -> tuple[Mission, Observation]:
    roads = curved_road(lanes=2)
    return mission(roads, ("12",)), observation(ego_on(roads, "11", 55.7, 6.0), cars((70.3, 11.2, 5.0, 0.7)))


def same(one: Arrays, other: Arrays) -> None:
    assert one.keys() == other.keys()
    for name in one.keys() - {"origin"}:
        np.testing.assert_allclose(one[name], other[name], atol=1e-4, rtol=0.0, err_msg=name)


WORLDS = {"right": crossing("right"), "left": crossing("left"), "bend": bend()}
SEEN = {name: EgoView(asked).arrays(seen) for name, (asked, seen) in WORLDS.items()}


@pytest.mark.parametrize("world", WORLDS)
@settings(max_examples=4)
@given(move=MOVES)
def test_turning_and_shifting_the_whole_world_changes_nothing(world: str, move: Move) -> None:
    asked, seen = WORLDS[world]
    same(EgoView(move.mission(asked)).arrays(move.observation(seen)), SEEN[world])


@pytest.mark.parametrize("world", WORLDS)
def test_a_view_gives_the_same_bits_again_whatever_it_saw_before(world: str) -> None:
    asked, seen = WORLDS[world]
    view = EgoView(asked)
    view.arrays(observation(ego(0.0, 0.0, 3.0, 1.0), cars((3.0, 3.0))))
    for name, values in view.arrays(seen).items():
        assert values.tobytes() == SEEN[world][name].tobytes(), name
