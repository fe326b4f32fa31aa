"""Hard search: hard scenes, certified and solved by somebody, apart from one another, the same however many judge."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import msgspec
import numpy as np
import pytest

from interplan_sumo.batch.hard_job import answer_path
from interplan_sumo.errors import InputError
from interplan_sumo.families.scene_space import SceneSpace
from interplan_sumo.maps.store import find_map, load_roads
from interplan_sumo.report.listings import file_entries
from interplan_sumo.scenario import certificates
from interplan_sumo.scenario.certificates import Certificate
from interplan_sumo.scenario.files import read_scenarios
from interplan_sumo.scenario.suite import expert, find_scenario
from interplan_sumo.verification.hard_asked import HardAsked
from interplan_sumo.verification.hard_folder import read_scores, read_tried_scores, write_hard
from interplan_sumo.verification.hard_judging import HardCandidate, HardVerdict
from interplan_sumo.verification.hard_search import APART, MOST_MEAN, HardOptions, HardSearch, shares
from interplan_sumo.verification.quality_diversity import CELLS, DiverseSearch, EliteGrid
from interplan_sumo.verification.suite_slots import Seed
from tests.commands import ran

MAP = load_roads("hazelwood")
OPTIONS = HardOptions("overtake", ("idm", "foresight"), 4, Seed(3, "hard-3-"))


@cache
def space() -> SceneSpace:
    """Two seconds that only those who search should wait."""
    return SceneSpace([MAP], "overtake", 3)


def judged(candidates: Sequence[HardCandidate]) -> Iterator[tuple[HardCandidate, HardVerdict]]:
    """As if who starts fast failed, in an order of its own; a bus has no certificate."""
    track = expert(find_scenario("nudge/0"))
    for each in reversed(candidates):
        scenario = each.scenario
        proof = certificates.Summary(scenario.id, scenario.hash(), 1.0, 100.0, 100.0, True, "", ("foresight",))
        scores = {"idm": 0.0, "foresight": 1.0 if scenario.start_speed_mps < 9.0 else 0.2}
        if any(obstacle.kind == "bus" for obstacle in scenario.obstacles):
            yield each, HardVerdict("certificate", "no drive was found", scores, cpu_s=9.0)
        else:
            yield each, HardVerdict("", "", scores, Certificate(proof, track).record(), 1.0)


def found(options: HardOptions = OPTIONS) -> HardSearch:
    search = HardSearch({MAP.name: MAP}, options, space())
    search.run(judged)
    return search


@pytest.fixture(scope="module")
def search() -> HardSearch:
    return found()


def test_scenes_are_certified_lie_apart_on_their_own_roads_and_nobody_solves_most_of_them(search: HardSearch) -> None:
    assert search.complete
    assert [scene.verdict.stage for scene in search.taken] == [""] * 4
    assert len({scene.drawn.scenario.site(MAP).partition("@")[0] for scene in search.taken}) == 4
    pairs = [(a.drawn, b.drawn) for a in search.taken for b in search.taken if a is not b]
    assert min(one.apart(other) for one, other in pairs) >= APART
    assert sum(scene.verdict.scores["foresight"] for scene in search.taken) <= MOST_MEAN * 4
    assert min(scene.plausibility for scene in search.judged) >= OPTIONS.least_plausibility
    assert {scene.id.partition("/")[0] for scene in search.taken} == {"hazelwood.overtake"}


@pytest.mark.slow
def test_equal_seeds_give_equal_scenes_and_other_seeds_others(search: HardSearch) -> None:
    hashes = [scene.drawn.scenario.hash() for scene in search.taken]
    assert [scene.drawn.scenario.hash() for scene in found().taken] == hashes
    other = found(replace(OPTIONS, seed=Seed(4, "hard-4-")))
    assert {scene.drawn.scenario.hash() for scene in other.taken}.isdisjoint(hashes)


def test_a_stricter_bound_passes_over_more_and_a_spent_budget_ends_the_search(search: HardSearch) -> None:
    strict = found(replace(OPTIONS, count=20, least_plausibility=0.6, most_judged=8))
    assert strict.plausible_share < search.plausible_share
    assert strict.passed_over["implausible"] > 0
    assert min(scene.plausibility for scene in strict.judged) >= 0.6
    assert not strict.complete


def test_the_folder_has_the_scenes_their_certificates_difficulty_and_parameters(
    search: HardSearch, tmp_path: Path
) -> None:
    write_hard([search], tmp_path)
    scenes = read_scenarios(tmp_path / "scenarios.yaml")
    assert {scene.id for scene in scenes} == set(certificates.read_certificates(tmp_path / certificates.FILE))
    rows = table(tmp_path / "hard.csv")
    assert [row["scenario_id"] for row in rows] == [scene.id for scene in scenes]
    assert {row["difficulty"] for row in rows} <= {"0.50", "1.00"}
    drawn = table(tmp_path / "parameters.csv")
    assert {row["scenario_id"] for row in drawn} == {scene.id for scene in scenes}
    assert {"start_speed_share", "place"} <= {row["parameter"] for row in drawn}
    tried = read_scenarios(tmp_path / "tried" / "scenarios.yaml")
    assert {scene.id for scene in tried} >= {scene.id for scene in scenes}
    scores = read_tried_scores(tmp_path)
    assert {name: set(of) for name, of in scores.items()} == {
        name: {each.id for each in tried} for name in OPTIONS.panel
    }
    assert read_scores(tmp_path) == {
        name: {row["scenario_id"]: float(row[name]) for row in rows} for name in OPTIONS.panel
    }
    assert all(scores["idm"][row["scenario_id"]] == float(row["idm"]) for row in rows)
    assert len(table(tmp_path / "rejected.csv")) == len(search.judged) - 4


def test_a_list_says_how_hard_the_scenes_of_a_folder_are(search: HardSearch, tmp_path: Path) -> None:
    write_hard([search], tmp_path / "sound")
    entries = file_entries(tmp_path / "sound")
    assert {entry["id"]: entry["difficulty"] for entry in entries} == {
        scene.id: scene.verdict.difficulty for scene in search.taken
    }
    write_hard([search], tmp_path / "damaged")
    (tmp_path / "damaged" / "hard.csv").write_text("scenario_id,difficulty\none,much\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"hard\.csv: 'much' is no number"):
        file_entries(tmp_path / "damaged")


def test_the_scenes_of_another_search_or_of_anything_else_stay(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "scenarios.yaml").write_text("mine", encoding="utf-8")
    given = ("--family", "overtake", "--map", "hazelwood", "--against", "idm", "--count", 1, "--out", tmp_path)
    code, _, err = ran(capsys, "scenarios", "harden", *given)
    assert code == 2
    assert "scenarios.yaml exists, and no search.json beside it" in err
    asked = HardAsked.of([OPTIONS], [find_map("hazelwood")])
    asked.write(tmp_path)
    asked.check(tmp_path)
    HardAsked.of([replace(OPTIONS, most_judged=3000)], [find_map("hazelwood")]).check(tmp_path)
    code, _, err = ran(capsys, "scenarios", "harden", *given, "--seed", 4)
    assert code == 2
    assert "families overtake 4, asked overtake 1; against idm " in err
    assert "seed hard-3-, asked hard-4-" in err
    for other in ({"seed": Seed(4, "hard-4-")}, {"least_difficulty": 0.6}, {"most_judged": 20}):
        with pytest.raises(InputError, match="holds the scenes of another search"):
            HardAsked.of([replace(OPTIONS, **other)], [find_map("hazelwood")]).check(tmp_path)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"maps hazelwood .*, asked strip "):
        HardAsked.of([OPTIONS], [find_map("strip")]).check(tmp_path)
    assert (tmp_path / "scenarios.yaml").read_text(encoding="utf-8") == "mine"


def test_of_a_secret_seed_the_certificates_lie_elsewhere(tmp_path: Path) -> None:
    search = found(replace(OPTIONS, seed=Seed.secret(b"nobody has ever seen this")))
    write_hard([search], tmp_path / "shown", kept_back=tmp_path / "kept.parquet")
    assert not list((tmp_path / "shown").rglob("*.parquet"))
    assert all("/hidden-" in each for each in certificates.read_certificates(tmp_path / "kept.parquet"))


@pytest.mark.parametrize(
    "asked",
    [("harden", "--family", "nudge", "--against", "idm"), ("generate", "--suite", "interplan==1")],
    ids=lambda asked: asked[0],
)
def test_certificates_kept_back_of_one_search_are_not_overwritten_by_another(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, asked: tuple[str, ...]
) -> None:
    secret, kept = tmp_path / "secret.txt", tmp_path / "secret.txt.certificates.parquet"
    secret.write_text("nobody has ever seen this", encoding="utf-8")
    kept.write_bytes(b"hours of work")
    code, _, err = ran(
        capsys, "scenarios", *asked, "--map", "strip", "--secret-seed", secret, "--out", tmp_path / "new"
    )
    assert code == 2
    assert f"{kept} holds the certificates of scenes that are not in {tmp_path / 'new'}; give another file" in err
    assert kept.read_bytes() == b"hours of work"


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"panel": ()}, "--against"),
        ({"panel": ("idm", "idm")}, "twice"),
        ({"count": 0}, "expected 1 or more"),
        ({"least_difficulty": 1.1}, "expected 0 to 1"),
    ],
)
def test_what_cannot_be_searched_for_is_refused(wrong: dict[str, object], said: str) -> None:
    with pytest.raises(InputError, match=said):
        replace(OPTIONS, **wrong)  # type: ignore[arg-type]


def test_families_share_the_scenes_and_two_halves_even_out() -> None:
    families = ("a", "b", "c", "d", "e")
    assert shares(10, families) == dict.fromkeys(families, 2)
    first, last = shares(13, families), shares(12, families, last_first=True)
    assert first == {"a": 3, "b": 3, "c": 3, "d": 2, "e": 2}
    assert {family: first[family] + last[family] for family in families} == dict.fromkeys(families, 5)
    with pytest.raises(InputError, match="expected 5 or more"):
        shares(4, families)


@pytest.mark.slow
def test_nobody_gets_more_than_half_of_the_points_where_failures_have_points_too() -> None:
    def half_solved(candidates: Sequence[HardCandidate]) -> Iterator[tuple[HardCandidate, HardVerdict]]:
        for number, (each, verdict) in enumerate(judged(candidates)):
            got = 0.0 if "foresight" in each.must_fail and number % 2 else 0.7
            yield each, msgspec.structs.replace(verdict, scores={"idm": 0.7, "foresight": got})

    again = HardSearch({MAP.name: MAP}, replace(OPTIONS, most_judged=40), space())
    again.run(half_solved)
    got = [scene.verdict.scores for scene in again.taken]
    assert all(sum(each[name] for each in got) <= MOST_MEAN * OPTIONS.count for name in OPTIONS.panel)
    assert len(got) == 2
    assert not again.complete


def test_scenes_that_one_solves_take_the_place_of_those_that_two_solve() -> None:
    asked: list[HardCandidate] = []
    panel = ("idm", "foresight", "pdm_closed")

    def first_two_then_one(candidates: Sequence[HardCandidate]) -> Iterator[tuple[HardCandidate, HardVerdict]]:
        first = not asked
        asked.extend(candidates)
        for number, (each, verdict) in enumerate(judged(candidates)):
            free = [name for name in panel[1:] if name not in each.must_fail]
            who = free if first else free[number % 2 :][:1]
            scores = {name: float(name in who) for name in panel}
            yield each, msgspec.structs.replace(verdict, scores=scores)

    again = HardSearch({MAP.name: MAP}, replace(OPTIONS, panel=panel, least_difficulty=0.3), space())
    again.run(first_two_then_one)
    assert (asked[0].alone, asked[-1].alone | asked[-1].must_fail) == (frozenset(), {"foresight", "pdm_closed"})
    assert again.complete
    assert all(len(scene.verdict.solved_by) <= 1 for scene in again.taken)
    assert all(sum(scene.verdict.scores[name] for scene in again.taken) <= 2.0 for name in panel)


def test_as_many_scenes_are_taken_as_can_be_even_if_more_solve_them() -> None:
    panel = ("idm", "foresight", "pdm_closed")

    def points_without_solving_or_one_solves(
        candidates: Sequence[HardCandidate],
    ) -> Iterator[tuple[HardCandidate, HardVerdict]]:
        for number, (each, verdict) in enumerate(judged(candidates)):
            solves = {name: float(name == panel[number // 2 % 3]) for name in panel}
            scores = dict.fromkeys(panel, 0.7) if number % 2 else solves
            yield each, msgspec.structs.replace(verdict, stage="", scores=scores)

    again = HardSearch({MAP.name: MAP}, replace(OPTIONS, panel=panel, most_judged=1), space())
    again.run(points_without_solving_or_one_solves)
    solvers = sorted(len(scene.verdict.solved_by) for scene in again.taken)
    assert solvers == [0, 1, 1, 1]  # two of those that nobody solves would leave no room for any other
    assert all(sum(scene.verdict.scores[name] for scene in again.taken) <= 2.0 for name in panel)


def test_who_has_half_of_the_points_must_fail_in_the_rest_and_drives_first() -> None:
    asked: list[HardCandidate] = []

    def solved_where_it_may_be(candidates: Sequence[HardCandidate]) -> Iterator[tuple[HardCandidate, HardVerdict]]:
        asked.extend(candidates)
        for each, verdict in judged(candidates):
            scores = {"idm": 0.0, "foresight": 0.0 if "foresight" in each.must_fail else 1.0}
            yield each, msgspec.structs.replace(verdict, scores=scores)

    again = HardSearch({MAP.name: MAP}, OPTIONS, space())
    again.run(solved_where_it_may_be)
    assert again.complete
    assert not any("foresight" in scene.verdict.solved_by for scene in again.taken)  # enough are solved by nobody now
    assert (asked[0].must_fail, asked[0].order) == (frozenset(), ("idm", "foresight"))
    assert (asked[-1].must_fail, asked[-1].order) == ({"foresight"}, ("foresight", "idm"))


def test_a_panel_of_one_may_solve_nothing_but_by_the_difficulty_that_is_asked_for() -> None:
    alone = found(replace(OPTIONS, panel=("idm",), count=2))
    assert all(scene.candidate.must_fail == frozenset() for scene in alone.judged)


def test_a_scene_is_too_easy_if_one_who_must_fail_solves_it_or_too_many_do() -> None:
    candidate = HardCandidate(find_scenario("nudge/0"), ("a", "b", "c", "d"), 0.5, frozenset({"b"}))
    assert candidate.too_easy(("a", "c")) == ""
    assert candidate.too_easy(("b",)) == "b solves it, and enough others"
    assert candidate.too_easy(("a", "c", "d")) == "3 of the panel solve it"
    shared = replace(candidate, must_fail=frozenset(), alone=frozenset({"c"}))
    assert (shared.too_easy(("c",)), shared.too_easy(("a", "b"))) == ("", "")
    assert shared.too_easy(("a", "c")) == "c solves it, and not alone"


def test_an_answer_is_kept_for_what_was_asked_and_for_nothing_else(tmp_path: Path) -> None:
    candidate = HardCandidate(find_scenario("nudge/0"), ("idm", "foresight"), 0.5)
    others = [replace(candidate, must_fail=frozenset({name})) for name in candidate.panel]
    others += [replace(candidate, alone=frozenset({name})) for name in candidate.panel]
    others += [replace(candidate, least_difficulty=1.0), replace(candidate, panel=("idm",))]
    places = [answer_path(tmp_path, each) for each in (candidate, *others)]
    assert len(set(places)) == 7
    assert answer_path(tmp_path, replace(candidate)) == places[0]


@pytest.mark.parametrize(("share", "most"), [(0.5, 2), (0.75, 1), (0.76, 0), (1.0, 0), (0.0, 4)])
def test_of_a_panel_so_many_may_solve_a_scene(share: float, most: int) -> None:
    candidate = HardCandidate(find_scenario("nudge/0"), ("a", "b", "c", "d"), share)
    assert candidate.most_solved == most


def test_the_optimiser_comes_nearer_to_what_is_good_in_every_direction_than_chance_does() -> None:
    search = DiverseSearch(12, 16, 0)
    values: list[list[float]] = []
    for _ in range(25):
        points = search.ask(lambda _: True)
        values.append([1.0 - float(np.mean((point[2:] - 1.0) ** 2)) for point in points])
        search.tell(points, values[-1], [tuple(1.0 / (1.0 + np.exp(-point[:2]))) for point in points])
    assert np.mean(values[-5:]) > np.mean(values[:5]) + 0.8
    assert len(search.grid.best) > CELLS**2 / 2


def test_points_that_are_not_worth_a_look_are_asked_for_again_and_a_batch_ends_where_none_is() -> None:
    search = DiverseSearch(3, 8, 0)
    assert all(point[0] > 0.0 for point in search.ask(lambda point: bool(point[0] > 0.0)))
    assert search.ask(lambda _: False) == []


def test_a_cell_of_the_grid_keeps_its_best_point() -> None:
    grid, point = EliteGrid(), np.zeros(2)
    for value in (0.2, 0.5, 0.3):
        grid.add(point + value, value, (0.0, 1.0))
    assert list(grid.best) == [(0, CELLS - 1)]
    assert grid.improvement(0.6, (0.0, 1.0)) == pytest.approx(0.1)
    assert grid.best[0, CELLS - 1][1].tolist() == [0.5, 0.5]


def table(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.nightly
def test_scenes_hard_for_a_planner_are_found_on_a_shipped_map_driven_by_others_and_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ("--family", "jaywalker", "--map", "hazelwood", "--against", "idm", "--count", 2, "--out", tmp_path)
    code, out, err = ran(capsys, "scenarios", "harden", *given, "--workers", 2)
    assert code == 0, err
    assert "2 of 2 scenarios, all certified and solved by somebody" in out
    assert "2 of 2 taken" in err
    rows = table(tmp_path / "hard.csv")
    assert all(float(row["idm"]) < 0.8 and row["solved_by"] for row in rows)
    written = {path.name: path.read_bytes() for path in tmp_path.glob("*.*")}
    kept = sorted((tmp_path / "candidates").iterdir())
    (tmp_path / "hard.csv").unlink()
    kept[0].unlink()
    code, again, _ = ran(capsys, "scenarios", "harden", *given, "--workers", 0)
    assert (code, again) == (0, out)
    assert {path.name: path.read_bytes() for path in tmp_path.glob("*.*")} == written
    file = tmp_path / "scenarios.yaml"
    assert ran(capsys, "scenarios", "certify", "--scenarios", file, "--check", "--workers", 0)[0] == 0
    driven = ran(
        capsys, "run", "--planner", "idm", "--scenarios", file, "--out", tmp_path / "run", "--workers", 0, "--quiet"
    )
    assert driven[0] == 0
    assert "certificates.parquet" in written
