"""Training labels: what is written, for which scenes, and that it is the same however it was made."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from worlds import cars, ego, mission, observation, straight_road, unmoved

from interplan_llm.hybrid.behaviours import Behaviour, offered
from interplan_llm.hybrid.choosers import ModelChooser, RandomChooser, RuleChooser
from interplan_llm.hybrid.scene import DecisionScene, SceneObserver
from interplan_llm.models.scripted import always
from interplan_sumo.errors import InputError
from interplan_sumo.families import names
from interplan_sumo.maps.store import load_roads, maps
from interplan_sumo.scenario.files import write_scenarios
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.suite import find_scenario, find_suite, suites
from interplan_sumo.verification.generation import generate
from interplan_sumo.verification.ordinary_scenes import FIRST_SEED
from tools.oracle import Tried, Value
from tools.tune_llm.labels import LabelSettings, Parts, balanced, main, make_labels
from tools.tune_llm.rollouts import (
    HOPELESS,
    MARGIN,
    STEPS_PER_PLAN,
    Curiosity,
    SparingPlanner,
    StrayingChooser,
    labelled,
    tried_example,
)
from tools.tune_llm.scenes import (
    HELD_OUT,
    START_APART_M,
    TrainingScene,
    generated_scenes,
    near_official,
    scenes_of,
)

FOLLOW, STOP = Behaviour.FOLLOW, Behaviour.STOP
FULL = Value(1.0, 5, 1.0)
QUICK = LabelSettings(every=2, hold=1, drives_per_scene=2)


@cache
def short_scenes() -> tuple[Scenario, ...]:
    """Two generated scenes, cut to two seconds, at places where nothing official happens."""
    made = generate(load_roads("strip"), "construction", 6, FIRST_SEED).scenarios
    apart = [scenario for scenario in made if near_official(scenario) is None][:2]
    return tuple(replace(scenario, duration_s=2.0) for scenario in apart)


def training(number: int = 0) -> TrainingScene:
    return TrainingScene(number, short_scenes()[number % 2], FIRST_SEED + number)


@cache
def scene() -> DecisionScene:
    road = straight_road(lanes=2, length_m=500.0, limit_mps=12.0)
    seen = unmoved(ego(100.0, -3.5, 8.0), cars((118.0, -3.5)))
    return SceneObserver(mission(road, ("11",), goal_arc_m=200.0), 15.0).scene(seen)


def tried(*scores: float, held: int = 0) -> Tried:
    """A decision between two options or more, with what they led to."""
    options = offered(scene())[: len(scores)]
    best = max(range(len(scores)), key=lambda k: (scores[k], k == held))
    values = tuple(replace(FULL, score=score) for score in scores)
    return Tried(scene(), options, values, options[held], options[best])


def example(**about: Any) -> dict[str, Any]:
    return {"about": {"scenario": "a/0", "time_s": 0.0, "split": "train", "decisive": True, **about}}


def lines(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


@pytest.mark.slow
def test_an_example_is_the_question_of_a_model_and_the_best_option_as_its_answer() -> None:
    made = tried_example(tried(0.2, 0.8), training())
    request = ModelChooser(always("x")).request(scene(), offered(scene())[:2])
    assert [(m["role"], m["content"]) for m in made["messages"][:2]] == [(m.role, m.text) for m in request.messages]
    assert made["messages"][2] == {"role": "assistant", "content": made["choices"][1]}
    assert made["choices"] == list(request.choices or ())
    about = made["about"]
    assert list(about["values"]) == made["choices"]
    assert about["values"][made["choices"][0]] == {"score": 0.2, "gates": 5, "progress": 1.0}
    assert (about["decisive"], about["held"], about["split"]) == (True, made["choices"][0], "train")
    assert (about["scenario"], about["seed"]) == (short_scenes()[0].id, FIRST_SEED)


@pytest.mark.parametrize(("gain", "better"), [(MARGIN + 1e-9, True), (MARGIN / 2, False), (0.0, False)])
def test_what_is_hardly_better_is_no_reason_to_change_and_decides_nothing(gain: float, better: bool) -> None:
    made = tried_example(tried(0.5, 0.5 + gain), training())
    assert (made["messages"][2]["content"] == made["choices"][1]) is better
    assert made["about"]["decisive"] is better


def test_a_worse_option_makes_a_decision_decisive_though_nothing_changes() -> None:
    made = tried_example(tried(1.0, 0.0), training())
    assert made["about"]["decisive"]
    assert made["messages"][2]["content"] == made["choices"][0] == made["about"]["held"]


@pytest.mark.parametrize("decisive", [True, False])
def test_after_a_decision_that_decides_nothing_some_are_left_out(decisive: bool) -> None:
    curious, looked_at = Curiosity(every=3), list[Tried]()
    for time_s in range(7):
        now = replace(scene(), speed_mps=float(time_s))
        if curious.wants(now, offered(now), looked_at):
            looked_at.append(replace(tried(1.0, 0.0 if decisive else 1.0), scene=now))
    assert [each.scene.speed_mps for each in looked_at] == ([*range(7)] if decisive else [0, 3, 6])


def test_a_question_that_was_asked_before_is_not_asked_again() -> None:
    curious = Curiosity(every=1)
    assert [curious.wants(scene(), offered(scene()), ()) for _ in range(2)] == [True, False]


@pytest.mark.parametrize(("worst", "wanted"), [(0.0, False), (0.1, True)])
def test_a_scene_where_nothing_helps_is_given_up(worst: float, wanted: bool) -> None:
    before = [tried(0.0, 0.0)] * (HOPELESS - 1) + [tried(0.0, worst)]
    assert Curiosity(every=1).wants(scene(), offered(scene()), before) is wanted
    assert Curiosity(every=1).wants(scene(), offered(scene()), [tried(0.0, 0.0)] * (HOPELESS - 1))


def test_most_scenes_begin_with_the_rules_and_some_go_astray_for_seconds() -> None:
    scenes = [training(number) for number in range(6)]
    assert [each.strays for each in scenes] == [False, False, True, False, False, True]
    job = mission(straight_road(lanes=2, length_m=500.0), ("11",))
    for each in scenes:
        chooser = StrayingChooser(each)
        coin, rules = RandomChooser(each.seed), RuleChooser()
        for every in (chooser, coin, rules):
            every.start(job)
        options = offered(scene())
        for time_s in range(12):
            now = replace(scene(), time_s=float(time_s))
            expected = (coin if each.strays and time_s < chooser.until_s else rules).choose(now, options, None)
            assert chooser.choose(now, options, None) == expected
        assert (1.0 <= chooser.until_s <= 5.0) is each.strays


def test_in_rollouts_a_plan_is_followed_for_half_a_second() -> None:
    job = mission(straight_road(lanes=2, length_m=500.0), ("11",))
    planner = SparingPlanner(RuleChooser())
    for _ in range(2):
        planner.start(job)
        plans = [planner.plan(observation(replace(ego(50.0 + k, -3.5, 10.0), time_s=k / 10), None)) for k in range(11)]
        assert [k for k in range(1, 11) if plans[k] is not plans[k - 1]] == [STEPS_PER_PLAN, 2 * STEPS_PER_PLAN]


def test_whole_rounds_of_scenes_are_held_out_so_that_no_scene_is_in_both_splits() -> None:
    count = len(names(ordinary=False))
    rounds = [{training(first + k).split for k in range(count)} for first in range(0, 3 * 10 * count, count)]
    assert all(len(each) == 1 for each in rounds)
    assert [k % HELD_OUT[0] for k, each in enumerate(rounds) if each == {"val"}] == [HELD_OUT[1]] * 3


def test_no_scene_of_a_suite_may_be_trained_on_nor_its_site_wherever_one_starts() -> None:
    everything = [scenario for suite in suites().values() for scenario in suite.scenarios]
    assert len(everything) > 80
    assert all(near_official(scenario) is not None for scenario in everything[::16])
    official = next(each for each in find_suite("interplan==1").scenarios if each.start.arc_m > 20.0)
    moved = replace(official, id="mine/0", start=replace(official.start, arc_m=official.start.arc_m - 12.0))
    assert near_official(moved) is not None


@pytest.mark.parametrize(("ahead_m", "near"), [(START_APART_M - 0.1, True), (START_APART_M + 0.1, False)])
def test_a_start_near_one_of_a_suite_is_too_near_and_one_beyond_is_not(ahead_m: float, near: bool) -> None:
    official = find_scenario("lane_change_ltd/0")
    roads = load_roads(official.map)
    place = replace(official.start, arc_m=official.start.arc_m + ahead_m)
    goal = replace(official.goal, arc_m=official.goal.arc_m - 20.0)
    moved = replace(official, id="mine/0", start=place, goal=goal)
    assert moved.site(roads) != official.site(roads)
    found = near_official(moved)
    assert (found is not None and found.id == official.id) is near


def test_files_are_taken_in_their_order_but_not_with_scenes_of_a_suite_or_twice(tmp_path: Path) -> None:
    write_scenarios(short_scenes(), tmp_path / "mine.yaml")
    scenes = scenes_of([tmp_path / "mine.yaml"], FIRST_SEED + 7)
    assert [each.scenario for each in scenes] == list(short_scenes())
    assert [(each.number, each.seed) for each in scenes] == [(0, FIRST_SEED + 7), (1, FIRST_SEED + 8)]
    with pytest.raises(InputError, match="there are two scenarios"):
        scenes_of([tmp_path / "mine.yaml"] * 2)
    write_scenarios([replace(find_scenario("nudge/0"), id="mine/0")], tmp_path / "official.yaml")
    with pytest.raises(InputError, match="mine/0 is where nudge/0 is, which is for testing"):
        scenes_of([tmp_path / "official.yaml"])


@pytest.mark.parametrize("make", [lambda seed: generated_scenes(1, seed), lambda seed: scenes_of([], seed)])
def test_seeds_for_testing_are_refused(make: Any) -> None:
    with pytest.raises(InputError, match=f"seeds-from is 99999, expected {FIRST_SEED} or more"):
        make(FIRST_SEED - 1)


@pytest.mark.nightly
def test_generated_scenes_go_round_families_and_maps_and_more_of_them_begin_alike() -> None:
    few, more = generated_scenes(1), generated_scenes(3)
    assert [each.scenario.family for each in few] == list(names(ordinary=False))
    assert more[: len(few)] == few
    assert {each.scenario.map for each in more} == set(maps())
    assert len({each.seed for each in more}) == len(more) == 3 * len(names(ordinary=False))
    assert all(near_official(each.scenario) is None and each.seed >= FIRST_SEED for each in more)


def test_of_what_decides_nothing_no_more_is_kept_than_of_what_does_in_each_split() -> None:
    examples = [example(time_s=float(k), decisive=k < 2) for k in range(6)]
    examples += [example(time_s=float(k), decisive=False, split="val") for k in range(3)]
    kept = balanced(examples)
    assert kept[:2] == examples[:2]
    assert [each["about"]["split"] for each in kept] == ["train"] * 4
    assert kept == [each for each in examples if each in kept]
    assert balanced(examples[:3]) == examples[:3]
    assert len(balanced(examples, 0.5)) == 3
    assert len(balanced(examples, 0.0)) == 2


@pytest.mark.nightly
def test_the_file_depends_on_the_scenes_alone_and_what_is_done_is_not_done_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tools.tune_llm.rollouts.ENOUGH", 0.0)  # two seconds never score full marks
    scenes = [training(0), training(1)]
    whole, halves = tmp_path / "whole.jsonl", tmp_path / "halves.jsonl"
    card = make_labels(whole, scenes, QUICK, workers=0)
    make_labels(halves, scenes[1:], QUICK, workers=0)
    assert len(lines(halves)) <= len(lines(whole))
    parts = halves.with_name("halves.jsonl.parts")
    parts.write_bytes(parts.read_bytes() + b'{"scene": "cut o')  # as a kill leaves it
    first_done = lines(whole.with_name("whole.jsonl.parts"))[1:]
    make_labels(halves, scenes, QUICK, workers=0)
    assert halves.read_bytes() == whole.read_bytes()
    assert sorted(map(json.dumps, lines(parts)[1:])) == sorted(map(json.dumps, first_done))
    monkeypatch.setattr("tools.tune_llm.labels.labelled", None)
    again = make_labels(whole, scenes, QUICK, workers=0)
    assert again == card == json.loads(whole.with_name("whole.jsonl.card.json").read_text())
    assert card["scenes"]["done"] == 2
    assert card["scenes"]["seeds"] == [FIRST_SEED, FIRST_SEED + 1]
    assert card["examples"]["all"] == len(lines(whole))
    for scene in scenes:
        here = [each for each in lines(whole) if each["about"]["seed"] == scene.seed]
        questions = [each["messages"][1]["content"] for each in here]
        assert len(set(questions)) == len(questions)
        assert [each["about"]["time_s"] for each in here] == sorted(each["about"]["time_s"] for each in here)


@pytest.mark.nightly
def test_workers_make_the_same_file(tmp_path: Path) -> None:
    scenes = [replace(training(number), scenario=replace(short_scenes()[number], duration_s=12.0)) for number in (0, 1)]
    for workers in (0, 2):
        make_labels(tmp_path / f"{workers}.jsonl", scenes, QUICK, workers=workers)
    assert (tmp_path / "0.jsonl").read_bytes() == (tmp_path / "2.jsonl").read_bytes()
    assert lines(tmp_path / "0.jsonl")


def test_a_scene_that_cannot_be_driven_says_why_and_after_its_time_none_is_waited_for(tmp_path: Path) -> None:
    nowhere = replace(training(), scenario=replace(short_scenes()[0], goal=replace(short_scenes()[0].goal, arc_m=1e6)))
    found = labelled(nowhere, every=1, hold=1, most_drives=1)
    assert found.examples == ()
    assert "there is no place at 1000000.0 m" in (found.reason or "")
    card = make_labels(tmp_path / "a.jsonl", [training(0), training(1)], QUICK, workers=0, minutes=0.0)
    assert card["scenes"]["done"] == 1


def test_files_of_other_options_and_damaged_ones_are_refused(tmp_path: Path) -> None:
    out, parts = tmp_path / "a.jsonl", tmp_path / "a.jsonl.parts"
    Parts(out, QUICK)
    Parts(out, QUICK)
    with pytest.raises(InputError, match="made with other options or by another version"):
        Parts(out, replace(QUICK, every=3))
    parts.write_text("{}\nnonsense\n")
    with pytest.raises(InputError, match="is damaged"):
        Parts(out, QUICK)


@pytest.mark.parametrize(("arguments", "message"), [
    (["--every", "0"], "error: every is 0, expected 1 or more"),
    (["--others", "-1"], "error: others is -1.0, expected 0 or more"),
    (["--workers", "-1"], "error: workers is -1, expected 0 (in this process) or more"),
    (["--per-family", "0"], "error: per-family is 0, expected 1 or more"),
    (["--seeds-from", "0"], "error: seeds-from is 0, expected 100000 or more"),
    (["--scenes", "nowhere.yaml"], "error: "),
])  # fmt: skip
def test_the_command_refuses_what_cannot_be_in_one_line(
    arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--out", str(tmp_path / "a.jsonl"), *arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith(message)
    assert error.count("\n") == 1


@pytest.mark.slow
def test_the_command_says_what_it_made(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_scenarios(short_scenes()[:1], tmp_path / "mine.yaml")
    out = tmp_path / "a.jsonl"
    options = ["--scenes", str(tmp_path / "mine.yaml"), "--drives-per-scene", "2", "--workers", "0"]
    assert main(["--out", str(out), *options]) == 0
    said = capsys.readouterr()
    assert said.out.endswith(f"of 1 scenes: {out}\n")
    assert said.err.startswith(f"[1/1] {short_scenes()[0].id}: ")
