"""What a language model is told, and what is done with its answer."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from worlds import cars, ego, mission, pedestrians, straight_road, unmoved

from interplan_llm.hybrid.behaviours import Behaviour, offered
from interplan_llm.hybrid.choosers import ModelChooser
from interplan_llm.hybrid.scene import DecisionScene, Oncoming, SceneObserver
from interplan_llm.hybrid.text import messages
from interplan_llm.models.protocol import ModelFailure, Request
from interplan_llm.models.scripted import ScriptedModel, always
from interplan_llm.models.store import key_of
from interplan_sumo.world.actors import Actors

ROAD = straight_road(lanes=3, length_m=500.0, limit_mps=12.0)
JOB = mission(ROAD, ("11",), goal_arc_m=200.0)
BOTH = (Behaviour.FOLLOW, Behaviour.MERGE_LEFT)


def seen(actors: Actors | None = None, y_m: float = -3.5, speed_mps: float = 8.0) -> DecisionScene:
    return SceneObserver(JOB, 15.0).scene(unmoved(ego(100.0, y_m, speed_mps), actors))


def told(scene: DecisionScene, past: tuple[tuple[float, Behaviour], ...] = ()) -> str:
    return messages(scene, offered(scene), past)[1].text


AROUND = "Driving around it is possible on the left, with room, 2.5 beside the lane's middle."


@pytest.mark.parametrize(
    ("actors", "y_m", "sentences"),
    [
        (None, -3.5, ("Own speed 8.0, limit 12.0.", "The goal is 1 lane to the left, 100 ahead.", "Own lane: free.")),
        (None, -7.0, ("The goal is 2 lanes to the left", "Right lane: none.")),
        (None, 0.0, ("The own lane leads to the goal, 100 ahead.",)),
        (cars((140.0, -3.5, 6.0)), -3.5, ("Own lane: vehicle 35 ahead at 6.0.",)),
        (cars((80.0, 0.0, 11.0)), -3.5, ("Left lane: vehicle 15 behind at 11.0.",)),
        (cars((100.5, 0.0, 8.0)), -3.5, ("Left lane: vehicle right beside you at 8.0.",)),
        (cars((130.0, -3.5)), -3.5, ("Own lane: blocked by a stopped vehicle 25 ahead.", AROUND)),
    ],
)
def test_speed_goal_lanes_and_others_are_told(actors: Actors | None, y_m: float, sentences: tuple[str, ...]) -> None:
    text = told(seen(actors, y_m))
    assert [sentence for sentence in sentences if sentence not in text] == []
    assert "- follow_current_lane: " in text or actors
    assert ("- merge_left: " in text) is (y_m < 0.0)
    assert "overtake" not in text or actors


def test_who_comes_and_who_may_step_out_is_told() -> None:
    scene = replace(seen(pedestrians((130.0, -7.5, 1.4, 1.5707963))), oncoming=Oncoming(60.0, 10.0, 18.0))
    text = told(scene)
    assert "Oncoming: vehicle 60 ahead at 10.0, you meet in 3.3 s." in text
    assert "A pedestrian 27 ahead, 4 to the right, walks towards your lane at 1.4." in text


def test_memory_tells_the_last_five_decisions() -> None:
    past = tuple((float(-7 + k), Behaviour.FOLLOW) for k in range(7))
    text = told(seen(), past)
    assert "follow_current_lane 5 s ago" in text
    assert "6 s ago" not in text


def test_thoughts_ask_for_a_marked_answer() -> None:
    scene = seen()
    assert "<<follow_current_lane>>" in messages(scene, offered(scene), thoughts=True)[0].text
    assert "<<" not in messages(scene, offered(scene))[0].text


def test_an_answer_is_taken() -> None:
    chooser = ModelChooser(always("merge_left"))
    chooser.start(JOB)
    assert chooser.choose(seen(), BOTH, None) == (Behaviour.MERGE_LEFT, 0.0)
    assert len(chooser.exchanges) == 1


@pytest.mark.parametrize(("answer", "cause"), [("stop_and_wait", "not_offered"), ("banana", "parse"), ("", "parse")])
def test_what_was_not_offered_is_not_done_but_counted(answer: str, cause: str) -> None:
    chooser = ModelChooser(always(answer))
    chooser.start(JOB)
    assert chooser.choose(seen(), BOTH, Behaviour.MERGE_LEFT)[0] is Behaviour.MERGE_LEFT
    assert chooser.choose(seen(), BOTH, Behaviour.STOP)[0] is Behaviour.FOLLOW
    assert [each.failure and each.failure.cause for each in chooser.exchanges] == [cause] * 2


def test_a_model_that_fails_leaves_what_is_done() -> None:
    chooser = ModelChooser(ScriptedModel([ModelFailure("timeout", "too slow", latency_s=2.5)]), real_time=True)
    chooser.start(JOB)
    assert chooser.choose(seen(), BOTH, Behaviour.MERGE_LEFT) == (Behaviour.MERGE_LEFT, 2.5)


def test_only_with_memory_the_past_is_told() -> None:
    asked: list[str] = []

    def answer(request: Request) -> str:
        asked.append(request.messages[1].text)
        return "merge_left"

    for memory in (False, True):
        chooser = ModelChooser(ScriptedModel(answer), memory=memory)
        chooser.start(JOB)
        chooser.choose(seen(), BOTH, None)
        chooser.choose(seen(), BOTH, None)
    assert ["You chose" in text for text in asked] == [False, False, False, True]


@pytest.mark.parametrize("timeout_s", [0.0, -1.0, math.inf, math.nan, 1e7])
def test_nobody_can_wait_for_no_time_or_for_ever(timeout_s: float) -> None:
    with pytest.raises(ValueError, match="expected more than 0 and at most 1e"):
        ModelChooser(always("merge_left"), timeout_s=timeout_s)


def test_a_seed_goes_along_with_the_question_and_0_is_as_none() -> None:
    def key(chooser: ModelChooser) -> str:
        return key_of("toy", chooser.request(seen(), BOTH))

    plain = ModelChooser(always("x"))
    assert plain.request(seen(), BOTH).seed == 0
    assert key(plain) == key(ModelChooser(always("x"), seed=0)) != key(ModelChooser(always("x"), seed=3))


def test_a_new_episode_starts_without_counts_and_memory() -> None:
    chooser = ModelChooser(always("merge_left"), memory=True)
    chooser.start(JOB)
    chooser.choose(seen(), BOTH, None)
    chooser.start(JOB)
    assert chooser.exchanges == []
    assert "You chose" not in chooser.request(seen(), BOTH).messages[1].text
