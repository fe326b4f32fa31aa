"""The hybrid in motion: what is chosen is driven, whoever chooses."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from worlds import cars, ego, mission, straight_road

from interplan_llm.hybrid.behaviours import Behaviour
from interplan_llm.hybrid.choosers import ModelChooser, RandomChooser
from interplan_llm.hybrid.planner import HybridLlmPlanner, HybridPlanner
from interplan_llm.hybrid.scene import DecisionScene
from interplan_sumo.errors import InputError
from interplan_sumo.planner import Mission, load_planner
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import EgoState
from tests.planners.staging_planners import driven

WIDE = straight_road(lanes=2, length_m=600.0, limit_mps=12.0)
TO_THE_LEFT = mission(WIDE, ("11",), goal_arc_m=400.0)
BROAD = mission(straight_road(lanes=1, length_m=600.0, limit_mps=12.0), ("11",))


class Scripted:
    """Chooses by a rule, after a delay."""

    def __init__(self, rule: Callable[[DecisionScene, tuple[Behaviour, ...]], Behaviour], delay_s: float = 0.0) -> None:
        self.rule = rule
        self.delay_s = delay_s
        self.asked_at_s: list[float] = []

    def start(self, mission: Mission) -> None:  # noqa: ARG002
        self.asked_at_s = []

    def choose(
        self,
        scene: DecisionScene,
        options: tuple[Behaviour, ...],
        now: Behaviour | None,  # noqa: ARG002
    ) -> tuple[Behaviour, float]:
        self.asked_at_s.append(round(scene.time_s, 3))
        return self.rule(scene, options), self.delay_s


def always(behaviour: Behaviour) -> Scripted:
    """The behaviour whenever it is offered, else the first option."""
    return Scripted(lambda _, options: behaviour if behaviour in options else options[0])


def late_merge(scene: DecisionScene, options: tuple[Behaviour, ...]) -> Behaviour:
    return Behaviour.MERGE_LEFT if scene.time_s > 0.5 and Behaviour.MERGE_LEFT in options else options[0]


def drive(
    chooser: Scripted | RandomChooser,
    seconds: float,
    job: Mission = TO_THE_LEFT,
    start: EgoState | None = None,
    actors: Actors | None = None,
) -> tuple[list[EgoState], HybridPlanner]:
    planner = HybridPlanner(chooser)
    planner.start(job)
    return driven(planner, start or ego(50.0, -3.5, 8.0), round(10 * seconds), actors), planner


def test_following_keeps_the_lane_and_reaches_the_limit() -> None:
    states, _ = drive(always(Behaviour.FOLLOW), 6.0)
    assert max(abs(s.y_m + 3.5) for s in states) < 0.1
    assert states[-1].vx_mps == pytest.approx(12.0, abs=0.5)


def test_a_merge_arrives_on_the_other_lane_and_stays_there() -> None:
    states, planner = drive(always(Behaviour.MERGE_LEFT), 10.0)
    assert states[-1].y_m == pytest.approx(0.0, abs=0.15)
    assert max(s.y_m for s in states) < 0.4
    assert planner.decisions[-1].behaviour is Behaviour.FOLLOW


@pytest.mark.slow
def test_a_merge_that_is_called_off_goes_back() -> None:
    def rule(scene: DecisionScene, options: tuple[Behaviour, ...]) -> Behaviour:
        return Behaviour.MERGE_LEFT if scene.time_s < 0.5 and Behaviour.MERGE_LEFT in options else options[0]

    states, _ = drive(Scripted(rule), 9.0)
    assert -3.4 < max(s.y_m for s in states) < -2.0
    assert states[-1].y_m == pytest.approx(-3.5, abs=0.15)


def test_waiting_brings_the_car_to_a_stand() -> None:
    states, _ = drive(always(Behaviour.STOP), 7.0, start=ego(85.0, -3.5, 6.0), actors=cars((120.0, -3.5)))
    assert states[-1].vx_mps < 0.3


@pytest.mark.slow
def test_what_leaves_room_is_passed_and_the_lane_taken_up_again() -> None:
    aside = cars((130.0, -1.75), width_m=1.5)  # 1 m into a lane of 3.5 m beside an open verge
    start = ego(80.0, 0.0, 8.0)
    states, _ = drive(always(Behaviour.OVERTAKE), 12.0, mission(WIDE, ("11",)), start, aside)
    assert states[-1].x_m > 150.0
    assert states[-1].y_m == pytest.approx(0.0, abs=0.2)


def test_one_is_asked_once_a_second_and_only_where_there_is_a_choice() -> None:
    chooser = always(Behaviour.FOLLOW)
    drive(chooser, 3.1)
    assert chooser.asked_at_s == [0.0, 1.0, 2.0, 3.0]
    alone = always(Behaviour.FOLLOW)
    _, planner = drive(alone, 3.1, BROAD, ego(50.0, 0.0, 8.0))
    assert alone.asked_at_s == []
    assert [d.behaviour for d in planner.decisions] == [Behaviour.FOLLOW] * 4


def test_nobody_is_asked_again_before_the_answer_is_known_and_a_slow_answer_is_not_lost() -> None:
    slow = Scripted(late_merge, delay_s=1.6)
    states, _ = drive(slow, 4.4)
    assert slow.asked_at_s == [0.0, 1.0, 2.6, 4.2]  # the first decision is waited for
    assert 2.6 < next(s.time_s for s in states if s.y_m > -3.45) < 3.6


def test_what_is_no_longer_offered_is_not_done() -> None:
    chooser = Scripted(lambda _, options: options[-1])
    states, planner = drive(chooser, 9.0, start=ego(50.0, 0.0, 8.0))
    assert all(d.behaviour in d.options for d in planner.decisions)
    assert abs(states[-1].y_m) < 0.2


def test_the_same_coin_gives_the_same_drive_every_time() -> None:
    chooser = RandomChooser(seed=3)
    once, planner = drive(chooser, 3.5)
    again, same = drive(chooser, 3.5)
    assert once == again
    assert planner.decisions == same.decisions
    assert {d.behaviour for d in planner.decisions} > {Behaviour.FOLLOW}


def test_the_seed_of_a_planners_options_is_the_models() -> None:
    planner = load_planner("llm_hybrid?model=scripted:stop&seed=3")
    assert isinstance(planner, HybridLlmPlanner)
    assert isinstance(planner.chooser, ModelChooser)
    assert planner.chooser.seed == 3


@pytest.mark.parametrize(("options", "idle"), [
    ("model=rules&memory=true&seed=1", "memory, seed"), ("model=random&seed=1&timeout_s=5", "timeout_s"),
    ("model=random&store=a.jsonl&mode=replay", "store, mode"), ("model=rules&threads=2", "threads"),
])  # fmt: skip
def test_options_of_a_language_model_are_refused_where_none_is_asked(options: str, idle: str) -> None:
    with pytest.raises(InputError, match=f"is no language model, so leave {idle} away"):
        load_planner(f"llm_hybrid?{options}")


@pytest.mark.parametrize("options", ["model=random&seed=1&every_s=2", "model=rules&every_s=2&timeout_s=60"])
def test_a_coin_and_rules_take_their_own_options(options: str) -> None:
    planner = load_planner(f"llm_hybrid?{options}")
    assert isinstance(planner, HybridLlmPlanner)
    assert planner.exchanges is None
    assert planner.report() == {}


def test_a_period_must_be_positive() -> None:
    with pytest.raises(ValueError, match="every_s is 0"):
        HybridPlanner(RandomChooser(), every_s=0.0)
