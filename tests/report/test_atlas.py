"""Atlas: which parameters tell failures, which scenes are nearly alike, and a page and a picture of it."""

from __future__ import annotations

import csv
import json
import time
from pathlib import Path

import numpy as np
import pytest

from interplan_sumo.cli import main
from interplan_sumo.errors import InputError, UnknownNameError
from interplan_sumo.report.atlas import Atlas, AtlasScene, atlas, read_atlas, told_share
from interplan_sumo.report.atlas_page import atlas_map, atlas_page, scene_link, summary
from interplan_sumo.report.atlas_plot import plot_atlas
from interplan_sumo.verification.generation import NotedDraw
from tests.commands import ran

HIDDEN = ("no", "van", "bus")


def scene(number: int) -> AtlasScene:
    """One of many: where people walk fast and a bus hides them the planner fails; the distance says nothing."""
    rng = np.random.default_rng(number)
    walk, far = float(rng.random()), float(rng.random())
    word = int(rng.integers(3))
    draws = {
        "place": NotedDraw(str(number), 0.5),
        "walk_mps": NotedDraw(f"{1.0 + walk}", walk),
        "distance_m": NotedDraw(f"{30.0 + 90.0 * far}", far),
        "hidden_by": NotedDraw(HIDDEN[word], (word + 0.5) / 3.0),
        "cyclist": NotedDraw("no", 0.4),
    }
    failed = walk > 0.5 and HIDDEN[word] == "bus"
    return AtlasScene(f"strip.jaywalker/{number}", "jaywalker", 0, 0.3 if failed else 0.9, draws)


def of(scenes: list[AtlasScene], over: tuple[str, ...] = (), run: Path | None = None) -> Atlas:
    return atlas("mine", scenes, None, over, run=run, source=Path("hard"))


@pytest.fixture(scope="module")
def found() -> Atlas:
    return of([scene(number) for number in range(80)])


def test_the_two_parameters_are_found_that_failures_depend_on_and_not_by_chance(found: Atlas) -> None:
    assert {axis.name for axis in found.shown} == {"walk_mps", "hidden_by"}
    assert found.told is not None
    assert found.told.share > 0.4
    assert found.by_chance == 0.0
    assert "cyclist" not in found.axes  # the same in all
    assert {told.names[0] for told in found.alone[:2]} == {"walk_mps", "hidden_by"}


def test_where_nothing_tells_the_page_says_so() -> None:
    scores = np.random.default_rng(0).permutation([0.0, 0.9] * 20).tolist()
    drawn = [scene(number) for number in range(40)]
    found = of([AtlasScene(each.id, each.family, 0, s, each.draws) for each, s in zip(drawn, scores, strict=True)])
    assert found.by_chance is not None
    assert found.by_chance > 0.05
    assert "That may be chance" in summary(found)[1]


def test_what_is_told_is_nothing_for_who_stands_alone_and_much_among_equals() -> None:
    solved = np.array([[1.0], [1.0], [1.0], [0.0], [0.0], [0.0]])
    group = np.arange(6) // 3
    alone, apart = np.eye(6), (group[:, None] == group[None, :]).astype(np.float64)
    assert told_share(alone, solved)[0] == pytest.approx(0.0)
    assert told_share(apart, solved)[0] > 0.3
    assert told_share(np.roll(np.eye(6), 3, axis=1), solved)[0] < 0.0


@pytest.mark.parametrize("score", [0.0, 0.9])
def test_where_all_or_none_are_solved_there_is_a_map_but_nothing_told(score: float) -> None:
    found = of([AtlasScene(each.id, "jaywalker", 0, score, each.draws) for each in map(scene, range(12))])
    assert (found.told, found.alone, found.near) == (None, (), ())
    assert len(atlas_map(found).marks) == 12
    assert "nothing tells them apart" in atlas_page(found)


def test_a_failed_scene_stands_beside_the_solved_one_most_like_it(found: Atlas) -> None:
    solved = [each for each in found.scenes if each.solved]
    for pair in found.near:
        assert not pair.failed.solved
        assert pair.solved.solved
        there = pair.failed.draws
        distances = [
            np.mean([abs(there[name].quantile - each.draws[name].quantile) for name in there if name != "place"])
            for each in solved
        ]
        assert pair.apart == pytest.approx(min(distances))
        assert {name for name, _, _ in pair.differences} <= {"walk_mps", "distance_m", "hidden_by"}
    assert [pair.apart for pair in found.near] == sorted(pair.apart for pair in found.near)


def test_parameters_that_are_asked_for_are_shown_and_others_are_refused() -> None:
    scenes = [scene(number) for number in range(30)]
    assert [axis.name for axis in of(scenes, ("distance_m", "walk_mps")).shown] == ["distance_m", "walk_mps"]
    with pytest.raises(UnknownNameError, match="Did you mean 'walk_mps'"):
        of(scenes, ("distance_m", "walk_mp"))
    for wrong in (("walk_mps",), ("walk_mps", "walk_mps")):
        with pytest.raises(InputError, match="name two parameters"):
            of(scenes, wrong)


def test_a_cell_is_shaded_by_the_scenes_of_its_word_and_only_where_some_are_near(found: Atlas) -> None:
    drawn = atlas_map(found)
    assert len({mark.text for mark in drawn.marks}) == 80
    by_row: dict[float, list[float]] = {}
    words_up = found.shown[1].name == "hidden_by"
    for x, y, share in drawn.shades:
        by_row.setdefault(y if words_up else x, []).append(share)
    assert sorted(max(shares) > 0.5 for shares in by_row.values()) == [False, False, True]


def test_links_lead_to_replays_that_are_there_and_commands_make_the_others(found: Atlas, tmp_path: Path) -> None:
    first = found.scenes[0]
    tried = scene_link(found, first, None)
    assert "run --planner mine --scenarios hard/tried/scenarios.yaml" in tried.make
    ran_before = of(list(found.scenes), run=Path("runs/mine"))
    made = scene_link(ran_before, first, tmp_path / "a.html")
    assert made.make.startswith(f"interplan-sumo replay runs/mine {first.id} --planner mine --html ")
    (tmp_path / "a-replays").mkdir()
    (tmp_path / "a-replays" / made.make.split()[-1]).touch()
    assert scene_link(ran_before, first, tmp_path / "a.html").link.startswith("a-replays/strip.jaywalker_0")


def folder(place: Path, scenes: list[AtlasScene]) -> Path:
    """As scenarios harden leaves it."""
    (place / "tried").mkdir(parents=True)
    with (place / "tried" / "parameters.csv").open("w", newline="") as file:
        rows = [(s.id, name, draw.value, draw.quantile) for s in scenes for name, draw in s.draws.items()]
        csv.writer(file).writerows([("scenario_id", "parameter", "value", "quantile"), *rows])
    with (place / "tried" / "scores.csv").open("w", newline="") as file:
        rows = [(s.id, s.score, "" if number % 2 else "0.5") for number, s in enumerate(scenes)]
        csv.writer(file).writerows([("scenario_id", "mine", "<i>other"), *rows])
    return place


def test_the_command_tells_what_a_search_tried_and_writes_a_page_in_which_names_are_text(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = folder(tmp_path / "hard", [scene(number) for number in range(40)])
    page, picture = tmp_path / "a.html", tmp_path / "a.png"
    code, out, err = ran(capsys, "atlas", place, "--planner", "<i>other", "--html", page, "--json")
    assert code == 0, err
    assert json.loads(out)["scenarios"] == 20
    assert "<i>other" not in page.read_text()
    assert "&lt;i&gt;other" in page.read_text()
    code, out, _ = ran(capsys, "atlas", place, "--png", picture)
    assert code == 0
    assert "of 40 scenes of jaywalker" in out
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("kind", ["png", "pdf", "svg"])
def test_equal_atlases_give_equal_pictures_at_any_time(kind: str, found: Atlas, tmp_path: Path) -> None:
    first, second = tmp_path / f"a.{kind}", tmp_path / f"b.{kind}"
    plot_atlas(found, first)
    time.sleep(1.1)  # what a picture says of when it was made is in seconds
    plot_atlas(found, second)
    assert first.read_bytes() == second.read_bytes()


def test_a_picture_of_no_known_kind_is_one_line(found: Atlas, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.jpeg2: pictures end in \.png, \.svg or \.pdf"):
        plot_atlas(found, tmp_path / "a.jpeg2")


def test_what_cannot_be_told_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place = folder(tmp_path / "hard", [scene(number) for number in range(10)])
    for words, given in (
        ("neither a run folder nor one of scenarios harden", (tmp_path,)),
        ("Did you mean 'mine'", (place, "--planner", "mines")),
        ("Did you mean 'jaywalker'", (place, "--family", "jaywalkr")),
        ("--replays puts them beside the page of a run", (place, "--replays", "--html", tmp_path / "a.html")),
    ):
        code, _, err = ran(capsys, "atlas", *given)
        assert (code, words in err, err.count("\n")) == (2, True, 1), err
    (place / "tried" / "parameters.csv").write_text("scenario_id,parameter,value,quantile\na,b,c,d\n")
    assert main(["atlas", str(place)]) == 2
    assert "'d' is no number" in capsys.readouterr().err
    (place / "tried" / "parameters.csv").write_text("scene,x\n")
    with pytest.raises(InputError, match="has no column scenario_id"):
        read_atlas(place)
