"""Chats: one moment a scenario, with the future that came true, and never a scene of the benchmark unawares."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from worlds import drive

from interplan_llm.models.protocol import Message
from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.run import run
from interplan_sumo.dataset.chats import ChatRequest, future_places, side_of, write_chats
from interplan_sumo.dataset.drives import DriveSelection
from interplan_sumo.errors import InputError
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.scenario.files import write_scenarios
from interplan_sumo.scenario.scenario import TrafficDemand
from interplan_sumo.scenario.suite import find_scenario
from interplan_sumo.world.geometry import Floats, Pose

ANY_SCORE = DriveSelection(min_score=0.0)
ALONE = replace(find_scenario("following_lane_with_lead/0"), traffic=TrafficDemand(), vehicles=(), duration_s=12.0)
"""Nobody else on the road."""


class Teller:
    """Says what it was shown."""

    def start(self, mission: Mission) -> None: ...

    def example(self, observation: Observation, places: Floats) -> list[Message]:
        return [Message("user", f"{observation.time_s:.1f}"), Message("assistant", str(places.tolist()))]


@pytest.fixture(scope="module")
def ours(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of three scenes of one's own, two seeds each; the last one is too short for a sample."""
    folder = tmp_path_factory.mktemp("chats")
    scenes = [replace(ALONE, id=f"mine/{k}", start_speed_mps=4.0 + k) for k in range(3)]
    scenes[2] = replace(scenes[2], duration_s=7.9)
    write_scenarios(scenes, folder / "mine.yaml")
    run(RunOptions(("idm",), folder / "run", scenarios=(str(folder / "mine.yaml"),), seeds=2, workers=0))
    return folder / "run"


def written(out: Path, *runs: Path, **options: Any) -> tuple[list[Any], dict[str, Any]]:
    card = write_chats(ChatRequest(out, runs, choice=ANY_SCORE, **options), Teller())
    return [json.loads(line)["messages"] for line in out.read_text(encoding="utf-8").splitlines()], card


def test_a_scenario_gives_one_line_however_often_it_was_driven(ours: Path, tmp_path: Path) -> None:
    lines, card = written(tmp_path / "a.jsonl", ours)
    assert len(lines) == card["samples"] == 2
    assert {each["scenario"] for each in card["drawn"]} == {"mine/0", "mine/1"}
    assert card["left_out"] == {"shorter than 8 s": 2}
    raw = (tmp_path / "a.jsonl").read_text(encoding="utf-8").splitlines()
    assert {tuple(json.loads(line)) for line in raw} == {("messages",)}  # nothing of what they are for


def test_the_answer_is_where_the_car_came_to_be(ours: Path, tmp_path: Path) -> None:
    lines, _ = written(tmp_path / "a.jsonl", ours)
    for _, answer in lines:
        places = np.array(json.loads(answer["content"]))
        steps_m = np.hypot(*np.diff(places, axis=0).T)
        assert places.shape == (16, 2)
        assert np.all((steps_m > 1.5) & (steps_m < 10.0))  # it drives on


def test_places_are_in_the_cars_own_frame() -> None:
    trace = drive(*[10.0] * 100, start=Pose(100.0, 50.0, np.pi / 2))
    places = future_places(trace, 5)
    assert places == pytest.approx(np.stack((np.arange(5.0, 85.0, 5.0), np.zeros(16)), axis=1), abs=1e-6)


def test_equal_drives_and_seeds_give_equal_bytes_and_other_seeds_other_moments(ours: Path, tmp_path: Path) -> None:
    files = [tmp_path / name for name in ("a.jsonl", "b.jsonl", "c.jsonl")]
    for file, seed in zip(files, (0, 0, 1), strict=True):
        written(file, ours, seed=seed)
    first, same, other = (file.read_bytes() for file in files)
    assert first == same != other


def test_fewer_samples_are_the_first_of_more_and_every_scenario_is_taken_before_a_second_moment_of_one(
    ours: Path, tmp_path: Path
) -> None:
    more, _ = written(tmp_path / "a.jsonl", ours)
    fewer, card = written(tmp_path / "b.jsonl", ours, count=1)
    assert fewer == more[:1]
    assert card["options"]["count"] == 1
    _, card = written(tmp_path / "c.jsonl", ours, each=3, count=2)
    assert {each["scenario"] for each in card["drawn"]} == {"mine/0", "mine/1"}


@pytest.mark.parametrize(("each", "least", "most"), [(3, 3, 3), (1000, 3, 8)])
def test_a_scenario_gives_the_moments_that_are_asked_for_if_they_lie_a_second_apart(
    ours: Path, tmp_path: Path, each: int, least: int, most: int
) -> None:
    _, card = written(tmp_path / "a.jsonl", ours, each=each, count=3000)
    for name in ("mine/0", "mine/1"):
        frames = [drawn["frame"] for drawn in card["drawn"] if drawn["scenario"] == name]
        assert least <= len(frames) <= most
        assert min(np.diff(frames)) >= 10


def test_all_moments_of_a_scenario_are_on_the_same_side_whatever_the_seed(ours: Path, tmp_path: Path) -> None:
    for seed in (0, 1):
        out = tmp_path / f"{seed}.jsonl"
        _, card = written(out, ours, each=3, seed=seed, hold_out=True)
        lines = [json.loads(line) for line in out.read_text(encoding="utf-8").splitlines()]
        assert [line["about"]["split"] for line in lines] == [side_of(drawn["scenario"]) for drawn in card["drawn"]]
        assert card["options"]["hold_out"] is True


def test_one_scenario_in_ten_is_held_out() -> None:
    sides = [side_of(f"mine/{number}") for number in range(2000)]
    assert set(sides) == {"train", "val"}
    assert 160 <= sides.count("val") <= 240  # three standard deviations


def test_the_card_tells_what_the_lines_are_made_of(ours: Path, tmp_path: Path) -> None:
    _, card = written(tmp_path / "a.jsonl", ours, form={"planner": "teller"})
    assert json.loads((tmp_path / "a.json").read_text(encoding="utf-8")) == card
    assert card["sha256"] == hashlib.sha256((tmp_path / "a.jsonl").read_bytes()).hexdigest()
    assert card["counts"]["by_driver"] == {"idm": 2}
    options = {"count": 600, "each": 1, "seed": 0, "min_score": 0.0, "hold_out": False}
    assert card["options"] == {**options, "planner": "teller"}
    assert card["of_suites"] == 0
    assert card["versions"]["interplan_sumo"]


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("a.json", {}, r"give a file whose name ends in \.jsonl"),
        ("a.jsonl", {"count": 0}, "count is 0, expected 1 or more"),
    ],
)
def test_what_cannot_be_written_is_refused(
    ours: Path, tmp_path: Path, name: str, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        written(tmp_path / name, ours, **options)


@pytest.mark.slow
def test_only_clean_drives_teach(driven: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no drive is left to export \(. score below 0\.9\)"):
        write_chats(ChatRequest(tmp_path / "a.jsonl", (driven,), benchmark=True), Teller())
