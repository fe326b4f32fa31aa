"""What the constants of foresight do: the factors that are found, and effects that are known beforehand."""

import importlib

import numpy as np

from benchmarks.foresight_sensitivity import PACKAGE, Effects, factor_names, levels, sources, spread
from interplan_sumo.world.geometry import Pose


def test_every_number_of_a_constant_is_a_factor_once():
    names = factor_names()
    assert len(set(names)) == len(names)
    assert {"speeds.HEADWAY_S[1]", "costs.HIT[1]", "costs.HIT_FADES_S[1]", "merging.RULES[3]"} <= set(names)
    assert not any("STEP_S" in name for name in names)  # what arrays are laid out by
    assert not any("MOST_CHECKED" in name for name in names)  # a count


def test_a_factor_is_in_force_wherever_its_constant_is_used():
    found = {source.module.__name__.rpartition(".")[2]: source for source in sources()}
    prediction, obstacles = found["prediction"], found["st_obstacles"]
    as_it_is = obstacles.module.MOVING_MPS
    try:
        prediction.run([1.2 if name == "prediction.MOVING_MPS[1]" else 1.0 for name in prediction.names])
        obstacles.run([1.0] * len(obstacles.names))
        assert 1.2 * as_it_is == obstacles.module.MOVING_MPS
    finally:
        for source in sources():
            source.run([1.0] * len(source.names))
    assert as_it_is == importlib.import_module(f"{PACKAGE}.st_obstacles").MOVING_MPS


def test_modules_come_after_those_that_they_need():
    order = [source.module.__name__.rpartition(".")[2] for source in sources()]
    assert order.index("prediction") < order.index("st_obstacles") < order.index("speeds") < order.index("planner")


def test_levels_are_those_of_a_scene_and_a_pair():
    here, there = Pose(1.0, 2.0, 0.0), Pose(1.0, 3.0, 0.0)
    drawn = levels(("a",), here, 0, 999)
    assert np.array_equal(drawn, levels(("a",), here, 0, 999))
    assert not np.array_equal(drawn, levels(("a",), there, 0, 999))
    assert not np.array_equal(drawn, levels(("a",), here, 1, 999))
    assert [round(3 * float(np.mean(drawn == level))) for level in (-1, 0, 1)] == [1, 1, 1]


def _made_up(linear: np.ndarray, square: np.ndarray, pairs: int = 1200, noise: float = 15.0) -> Effects:
    rng = np.random.default_rng(5)
    x = rng.integers(-1, 2, (pairs, len(linear))).astype(float)
    scene = rng.uniform(20.0, 100.0, pairs)
    mean = scene + x**2 @ square
    scores = np.stack([mean + x @ linear, mean - x @ linear], axis=1) + noise * rng.standard_normal((pairs, 2))
    return Effects.of(scores, x, scene)


def test_effects_that_are_known_are_found_whatever_the_scenes_are_worth():
    linear, square = np.zeros(60), np.zeros(60)
    linear[3], linear[7], square[9] = 4.0, -3.0, -6.0
    found = _made_up(linear, square)
    assert np.abs((found.linear - linear) / found.linear_error).max() < 4.0
    assert np.abs((found.square - square) / found.square_error).max() < 4.0
    assert np.argmin(found.worst()) in (3, 7, 9)
    assert found.worst()[3] < -2.0  # a fifth less costs it


def test_where_nothing_matters_the_largest_estimate_is_taken_for_chance():
    found = _made_up(np.zeros(60), np.zeros(60))
    assert np.abs(found.linear).max() > 0.8
    assert spread(found.linear, found.linear_error) < 0.35
    assert found.worst().min() > -1.0
