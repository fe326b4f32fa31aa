"""What the constants of foresight do: the factors that are found, and effects that are known beforehand."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from worlds import ego, mission, observation, straight_road

from benchmarks.foresight_sensitivity import Source, effects, factor_names, levels, sources, spread
from interplan_sumo.world.geometry import Pose


@pytest.fixture
def modules() -> Iterator[dict[str, Source]]:
    """The planner's modules by name; they are afterwards what they were, classes included."""
    found = {source.module.__name__.rpartition(".")[2]: source for source in sources()}
    before = {name: dict(vars(source.module)) for name, source in found.items()}
    yield found
    for name, source in found.items():
        vars(source.module).clear()
        vars(source.module).update(before[name])


def test_every_number_of_a_constant_is_a_factor_once() -> None:
    names = factor_names()
    assert len(set(names)) == len(names)
    assert {"speeds.HEADWAY_S[1]", "costs.HIT[1]", "costs.HIT_FADES_S[1]", "merging.RULES[3]"} <= set(names)
    assert not any("STEP_S" in name for name in names)  # what arrays are laid out by
    assert not any("MOST_CHECKED" in name for name in names)  # a count


def test_a_factor_is_in_force_wherever_its_constant_is_used(modules: dict[str, Source]) -> None:
    prediction, obstacles = modules["prediction"], modules["st_obstacles"]
    as_it_is = obstacles.module.MOVING_MPS
    prediction.run([1.2 if name == "prediction.MOVING_MPS[1]" else 1.0 for name in prediction.names])
    obstacles.run([1.0] * len(obstacles.names))
    assert pytest.approx(1.2 * as_it_is) == obstacles.module.MOVING_MPS
    prediction.run([1.0] * len(prediction.names))
    assert as_it_is == prediction.module.MOVING_MPS


def test_modules_come_after_those_that_they_need() -> None:
    order = [source.module.__name__.rpartition(".")[2] for source in sources()]
    assert order.index("prediction") < order.index("st_obstacles") < order.index("speeds") < order.index("planner")


def test_levels_are_those_of_a_scene_a_pair_and_a_factor() -> None:
    here, there, names = Pose(1.0, 2.0, 0.0), Pose(1.0, 3.0, 0.0), [f"a.B[{k}]" for k in range(999)]
    drawn = levels(("a",), here, 0, names)
    assert np.array_equal(drawn[100:], levels(("a",), here, 0, names[100:]))
    assert not np.array_equal(drawn, levels(("a",), there, 0, names))
    assert not np.array_equal(drawn, levels(("a",), here, 1, names))
    assert [round(3 * float(np.mean(drawn == level)), 0) for level in (-1, 0, 1)] == [1, 1, 1]


@pytest.mark.parametrize("factor", [0.8, 1.2])
def test_whatever_is_drawn_the_modules_can_be_made(modules: dict[str, Source], factor: float) -> None:
    for source in modules.values():
        source.run([factor] * len(source.names))
    planner = modules["planner"].module.ForesightPlanner()
    planner.start(mission(straight_road(), ("11",)))
    assert planner.plan(observation(ego(20.0, 0.0, 9.0))).x_m[-1] > 40.0


def made_up(linear: np.ndarray, pairs: int = 1200, noise: float = 15.0) -> tuple[np.ndarray, np.ndarray]:
    """Estimates and errors from scenes of any worth, in which factors that are off cost something besides."""
    rng = np.random.default_rng(5)
    x = rng.integers(-1, 2, (pairs, len(linear))).astype(float)
    mean = rng.uniform(20.0, 100.0, pairs) - 0.3 * (x**2).sum(axis=1)
    scores = np.stack([mean + x @ linear, mean - x @ linear], axis=1) + noise * rng.standard_normal((pairs, 2))
    return effects(scores, x)


def test_effects_that_are_known_are_found_whatever_the_scenes_are_worth() -> None:
    linear = np.zeros(60)
    linear[3], linear[7] = 4.0, -3.0
    found, errors = made_up(linear)
    assert np.abs((found - linear) / errors).max() < 4.0
    assert (np.argmax(found), np.argmin(found)) == (3, 7)
    assert spread(found, errors)[1] > np.std(linear)


def test_where_nothing_matters_the_largest_estimate_is_taken_for_chance() -> None:
    found, errors = made_up(np.zeros(60))
    assert np.abs(found).max() > 0.8
    usual, most = spread(found, errors)
    assert usual < 0.3
    assert usual < most < 0.6
