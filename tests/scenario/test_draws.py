"""Draws: what a family leaves to chance has a name, a place in its distribution, and can be chosen."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from worlds import straight_road

from interplan_sumo.errors import InputError, ScenarioError
from interplan_sumo.families import FAMILIES
from interplan_sumo.families.draws import Draw, Draws
from interplan_sumo.families.scene_space import PLACE, ScenePoint, SceneSpace, likelihood, quantiles
from interplan_sumo.maps.store import load_roads
from interplan_sumo.scenario.sites import UnsuitableError, places
from interplan_sumo.world.geometry import Floats
from tests.quick import few

MAP = load_roads("hazelwood")


@pytest.fixture(scope="module")
def space() -> SceneSpace:
    return SceneSpace([MAP], "overtake", 0)


def chosen(**at: float) -> Draws:
    return Draws(np.random.default_rng(0), at)


def test_without_a_choice_the_generator_is_used_as_it_is() -> None:
    draws, rng = Draws(np.random.default_rng(4)), np.random.default_rng(4)
    assert draws.uniform("a", (1.0, 2.0), None) == rng.uniform(1.0, 2.0)
    assert draws.whole("b", (1, 6)) == rng.integers(1, 7)
    assert draws.normal("c", (1.4, 0.3), (1.0, 1.9)) == np.clip(rng.normal(1.4, 0.3), 1.0, 1.9)
    assert draws.happens("d", 0.4) == (rng.random() < 0.4)
    assert draws.one_of("e", "xyz") == "xyz"[rng.integers(3)]
    assert draws.by_share("f", {"x": 0.2, "y": 0.8}) == str(rng.choice(["x", "y"], p=[0.2, 0.8]))
    assert draws.order(5) == rng.permutation(5).tolist()


@pytest.mark.parametrize(("at", "value"), [(0.0, 30.0), (0.25, 52.5), (1.0, 120.0)])
def test_a_chosen_quantile_is_taken_from_the_range(at: float, value: float) -> None:
    draws = chosen(distance=at)
    assert draws.uniform("distance", (30.0, 120.0)) == value
    assert draws.found["distance"] == Draw(value, at, 2.0 * min(at, 1.0 - at))


def test_chosen_words_whole_numbers_and_normal_numbers_follow_their_shares() -> None:
    shares = {"nothing": 0.3, "row": 0.3, "bus": 0.4}
    assert [chosen(w=at).by_share("w", shares) for at in (0.0, 0.299, 0.301, 0.61, 1.0)] == [
        "nothing", "nothing", "row", "bus", "bus",
    ]  # fmt: skip
    assert [chosen(w=at).happens("w", 0.3) for at in (0.29, 0.31)] == [True, False]
    assert [chosen(w=at).whole("w", (2, 5)) for at in (0.0, 0.26, 1.0)] == [2, 3, 5]
    assert [chosen(w=at).one_of("w", "ab") for at in (0.49, 0.51)] == ["a", "b"]
    assert chosen(w=0.8413).normal("w", (1.42, 0.26), (1.0, 1.9)) == pytest.approx(1.68, abs=1e-3)
    assert chosen(w=0.0).normal("w", (1.42, 0.26), (1.0, 1.9)) == 1.0


def test_a_name_drawn_again_has_a_number_and_of_tries_only_the_last_counts() -> None:
    draws = chosen(**{"gap": 0.5, "gap 2": 1.0})
    assert [draws.uniform("gap", (0.0, 1.0)) for _ in range(2)] == [0.5, 1.0]
    for _ in draws.tries(3):
        draws.uniform("gap", (0.0, 1.0))
        draws.uniform("away", (0.0, 1.0))
    assert list(draws.found) == ["gap", "gap 2", "gap 3", "away"]


def test_a_choice_that_did_not_do_is_not_tried_again() -> None:
    draws = chosen(away=0.5)
    assert len({draws.uniform("away", (0.0, 1.0), None) for _ in draws.tries(4)}) == 4


def test_rare_words_lie_farther_out_than_usual_ones_and_words_alike_in_share_alike() -> None:
    draws = chosen(rare=0.05, usual=0.5, even=0.1)
    draws.happens("rare", 0.1)
    draws.happens("usual", 0.1)
    draws.one_of("even", "abcd")
    assert [each.tail for each in draws.found.values()] == pytest.approx([0.05, 0.55, 0.5])


@pytest.mark.parametrize("family", few(["jaywalker", "nudge", "construction", "accident", "overtake"], 2))
def test_a_scene_is_made_again_from_the_quantiles_noted_for_it(family: str) -> None:
    (lane, at_m), kind = placed(family), FAMILIES[family]
    place, first = kind.suitable(MAP, lane, at_m), Draws(np.random.default_rng(5))
    scene = kind.drawn("x/0", MAP, place, first)
    again = Draws(np.random.default_rng(99), {name: each.quantile for name, each in first.found.items()})
    same = kind.drawn("x/0", MAP, place, again)
    assert [each.value for each in again.found.values()] == pytest.approx([e.value for e in first.found.values()])
    assert replace(same, obstacles=()) == replace(scene, obstacles=())  # cones jitter


def placed(family: str) -> tuple[str, float]:
    """A place where a scene of the family with seed 5 finds room."""
    for lane, at_m in places(MAP):
        with suppress(UnsuitableError, ScenarioError):
            place = FAMILIES[family].suitable(MAP, lane, at_m)
            FAMILIES[family].drawn("x/0", MAP, place, Draws(np.random.default_rng(5)))
            return lane, at_m
    raise AssertionError


def test_a_space_has_what_is_drawn_often_and_its_point_in_the_middle_is_a_usual_scene(space: SceneSpace) -> None:
    assert space.names[0] == PLACE
    assert {"offset_m", "start_speed_share", "drivers", "vehicle_length_m"} <= set(space.names)
    assert "platoon_headway_s 9" not in space.names
    scenes = drawn(space)
    share = np.mean([space.plausibility(scene.draws) > 0.5 for scene in scenes])
    assert 0.3 < share < 0.7
    (middle,) = drawn(space, np.zeros(len(space.names)), many=1)
    assert space.plausibility(middle.draws) > 0.9


def test_where_everything_lies_at_the_end_of_its_range_a_scene_is_implausible_though_each_number_may_be(
    space: SceneSpace,
) -> None:
    (edge,) = drawn(space, np.where(np.arange(len(space.names)) == 0, 0.0, 1.9), many=1)
    assert space.plausibility(edge.draws) < 0.02
    one = {"a": Draw(1.0, 0.97, 0.06)}
    middle = {f"b{number}": Draw(1.0, 0.5, 1.0) for number in range(9)}
    assert likelihood(one) == pytest.approx(0.06)
    assert likelihood(one | middle) > 0.9 > likelihood({f"c{number}": one["a"] for number in range(9)})


def test_scenes_lie_apart_by_what_was_drawn_for_them_and_not_by_where_they_are(space: SceneSpace) -> None:
    first, second = list(drawn(space))[:2]
    assert first.apart(first) == 0.0
    assert 0.1 < first.apart(second) == second.apart(first) < 0.7
    elsewhere = replace(first, draws={**first.draws, PLACE: Draw(0, 0.0, 1.0)})
    assert first.apart(elsewhere) == 0.0
    more = replace(first, draws={**first.draws, "more": Draw(0, 0.5, 1.0)})
    assert first.apart(more) == pytest.approx(1.0 / len(first.draws))


def test_a_map_without_a_place_says_so() -> None:
    with pytest.raises(InputError, match="suits overtake; name another --map"):
        SceneSpace([straight_road(lanes=1, length_m=300.0)], "overtake", 0)


def drawn(space: SceneSpace, point: Floats | None = None, many: int = 40) -> list[ScenePoint]:
    """Scenes of a space, ordinary ones or those of a point."""
    found: list[ScenePoint] = []
    for number in range(200):
        at = None if point is None else quantiles(space.names, point)
        with suppress(UnsuitableError, ScenarioError):
            found.append(space.scene("overtake/0", np.random.default_rng(number), at))
        if len(found) == many:
            break
    return found
