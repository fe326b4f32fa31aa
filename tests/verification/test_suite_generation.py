"""Suites: slots with the right shares, a roadblock of its own for each, and the small suite inside the large one."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path

import msgspec
import numpy as np
import pytest
import yaml
from worlds import cars, drive

from interplan_sumo.batch.suite_job import verdicts
from interplan_sumo.cli import main
from interplan_sumo.families import names
from interplan_sumo.families.generate import Search
from interplan_sumo.maps.store import load_roads, maps
from interplan_sumo.scenario import certificates
from interplan_sumo.scenario.certificates import Certificate
from interplan_sumo.scenario.files import read_scenarios
from interplan_sumo.scenario.suite import expert, find_scenario, find_suite
from interplan_sumo.verification.light_windows import (
    DELAYS_S,
    TIME_SHARE,
    LitWay,
    green_too_soon,
    light_problems,
)
from interplan_sumo.verification.suite_candidates import Candidate, block_of, changes_asked
from interplan_sumo.verification.suite_generation import SuiteSearch, counts, write_suites
from interplan_sumo.verification.suite_judging import Verdict
from interplan_sumo.verification.suite_slots import Seed, Slot, groups, slots
from interplan_sumo.verification.surrounding_traffic import SurroundingTraffic, surrounding_traffic
from interplan_sumo.world.trace import Trace

MAPS = [load_roads(name) for name in ("one_north", "strip", "back_bay")]
CAUTIOUS, PUSHING = {"conservative", "measured_city_mild"}, {"assertive", "measured_city_bold"}


def proof(candidate: Candidate) -> Verdict:
    """As if every scene had been certified by the same drive."""
    track = expert(find_scenario("nudge/0"))
    summaries = [
        certificates.Summary(s.id, s.hash(), 1.0, 100.0, 100.0, True, "", ("foresight",)) for s in candidate.scenarios
    ]
    met = tuple(SurroundingTraffic(9.0, 1, 1) for _ in summaries)
    return Verdict("", certificates=tuple(Certificate(each, track).record() for each in summaries), traffic=met)


def picky(candidates: Sequence[Candidate]) -> Iterator[tuple[Candidate, Verdict]]:
    """Takes the second candidate for each slot, in an order of its own."""
    for each in reversed(candidates):
        yield each, proof(each) if each.attempt else Verdict("start", "no", each.scenarios[0].id)


def made(suite: str, seed: Seed = Seed(0)) -> SuiteSearch:  # noqa: B008 - frozen
    search = SuiteSearch(suite, MAPS, seed)
    search.run(picky)
    return search


def driven(trace: Trace) -> Trace:
    """The trace with a driver in every vehicle."""
    behaviour = np.full(len(trace.actors.frame), "mixed", dtype=object)
    return replace(trace, actors=replace(trace.actors, behaviour=behaviour))


@pytest.fixture(scope="module")
def small() -> SuiteSearch:
    return made("interplan==1")


def test_of_ten_scenes_three_are_cautious_three_push_and_half_have_the_papers_drivers() -> None:
    for first in (0, 10, 20, 30):
        drawn = [Slot(("nudge",), number).behaviour for number in range(first, first + 10)]
        assert sum(name in CAUTIOUS for name in drawn) == 3
        assert sum(name in PUSHING for name in drawn) == 3
        assert sum(name.startswith("measured") for name in drawn) == 5


def test_one_slot_in_three_lies_on_the_left_where_there_is_a_left_and_one_lane_change_in_five_is_far() -> None:
    ten = [Slot(("nudge",), number) for number in range(30)]
    assert sum(slot.side(("left", "right")) == "left" for slot in ten) == 10
    assert {slot.side(("right",)) for slot in ten} == {"right"}
    assert not any(slot.is_far for slot in ten)
    assert sum(slot.may_be_open for slot in ten) == 6
    assert sum(Slot(groups("interplan==1")[-1], number).is_far for number in range(30)) == 6


def test_lane_changes_of_three_densities_share_their_slots() -> None:
    assert groups("interplan==1")[-1] == ("lane_change_ltd", "lane_change_mtd", "lane_change_htd")
    assert sum(len(slot.families) for slot in slots("interplan==1", 10)) == 80
    assert sum(len(slot.families) for slot in slots("interplan-large==1", 40)) == 320


@pytest.mark.nightly
def test_every_slot_has_a_roadblock_of_its_own_its_drivers_and_its_id(small: SuiteSearch) -> None:
    assert small.missing == []
    assert len({each.candidate.block for each in small.filled.values()}) == 60
    scenes = [scenario for scenario, _ in small.scenes(10)]
    assert len({scenario.id for scenario in scenes}) == 80
    assert Counter(scenario.family for scenario in scenes) == dict.fromkeys(names(ordinary=False), 10)
    assert all(scenario.perception == "occluded" for scenario in scenes)
    by_id = {scenario.id: scenario for scenario in scenes}
    for number in range(10):
        trio = [by_id[f"{family}/{number}"] for family in groups("interplan==1")[-1]]
        assert len({(s.start, s.goal, s.route, s.traffic.behaviour) for s in trio}) == 1
        assert trio[0].traffic.behaviour == Slot(groups("interplan==1")[-1], number).behaviour
    changes = [changes_asked(s, load_roads(s.map)) for s in scenes if s.family == "lane_change_htd"]
    assert set(changes) <= {1, 2, 3}
    assert all(changes[number] >= 2 for number in (2, 8))
    sides = Counter(load_roads(scenario.map).driving_side for scenario in scenes)
    assert sides["left"] >= 20
    assert sides["right"] >= 40


@pytest.mark.slow
def test_ordinary_scenes_have_their_own_drivers_and_share_roads_between_types(
    tmp_path: Path,
) -> None:
    every = slots("common==1", 10)
    assert Counter(slot.families for slot in every) == {(name,): 10 for name in names(ordinary=True)}
    search = SuiteSearch("common==1", MAPS, Seed(0))
    kinds = ("stationary_in_traffic", "starting_right_turn")
    some = [slot for slot in every if slot.families[0] in kinds]
    search._fill(some, lambda candidates: [(each, proof(each)) for each in candidates], lambda *_: None)
    scenes = [scenario for scenario, _ in search.scenes(10)]
    assert Counter(scenario.family for scenario in scenes) == dict.fromkeys(kinds, 10)
    assert {(scenario.traffic.behaviour, scenario.perception) for scenario in scenes} == {("urban", "full")}
    for kind in kinds:
        mine = [each.candidate.block for each in search.filled.values() if each.candidate.slot.families == (kind,)]
        assert len(set(mine)) == 10
    assert [folder.name for folder in write_suites(search, tmp_path)] == ["common-1"]


@pytest.mark.nightly
def test_the_same_seed_gives_the_same_suite_whatever_the_order_of_the_verdicts(small: SuiteSearch) -> None:
    again = SuiteSearch("interplan==1", MAPS, Seed(0))
    again.run(lambda candidates: reversed(list(picky(candidates))))
    assert [s.hash() for s, _ in again.scenes(10)] == [s.hash() for s, _ in small.scenes(10)]
    other = {s.hash() for s, _ in made("interplan==1", Seed(1)).scenes(10)}
    assert other.isdisjoint(s.hash() for s, _ in small.scenes(10))


@pytest.mark.nightly
def test_what_failed_is_written_down_and_counted_without_its_numbers(small: SuiteSearch, tmp_path: Path) -> None:
    found = counts(small.rejections())
    assert (60, "start", "no") in found
    assert any(stage == "place" for _, stage, _ in found)
    assert counts([("start", "", "", "", f"{n}.5 m away; rest {n}") for n in (1, 2)]) == [(2, "start", "# m away")]
    write_suites(small, tmp_path)
    lines = (tmp_path / "rejected.csv").read_text(encoding="utf-8").splitlines()
    assert len(lines) == 1 + sum(number for number, _, _ in found)


@pytest.mark.nightly
def test_suites_are_written_as_the_package_reads_them(small: SuiteSearch, tmp_path: Path) -> None:
    folders = write_suites(small, tmp_path)
    assert [each.name for each in folders] == ["interplan-1", "smoke-1", "llm-1"]
    there = tmp_path / "interplan-1"
    scenes = read_scenarios(there / "scenarios.yaml")
    stored = certificates.read_summaries(there / certificates.FILE)
    assert {s.id: s.hash() for s in scenes} == {name: each.scenario_hash for name, each in stored.items()}
    with (tmp_path / "scenes.csv").open(encoding="utf-8") as file:
        rows = {row["id"]: row for row in csv.DictReader(file)}
    assert set(rows) == set(stored)
    assert all(float(row["m to the goal"]) > 50.0 and row["solved by"] == "foresight" for row in rows.values())
    for name, many in (("smoke-1", 8), ("llm-1", 24)):
        chosen = yaml.safe_load((tmp_path / name / "selection.yaml").read_text(encoding="utf-8"))["scenarios"]
        assert len(chosen) == many
        assert set(certificates.read_summaries(tmp_path / name / certificates.FILE)) == {*chosen}


@pytest.mark.slow
def test_a_larger_suite_begins_with_the_released_one_and_takes_none_of_its_roadblocks(tmp_path: Path) -> None:
    begun = find_suite("interplan==1")
    search = SuiteSearch("interplan-large==1", [load_roads(name) for name in maps()], Seed(3), begun)
    twelve = slots("interplan-large==1", 12, 10)
    assert set(search.missing) == {*slots("interplan-large==1", 40, 10)}
    search._fill(twelve, lambda candidates: [(each, proof(each)) for each in candidates], lambda *_: None)
    assert set(search.filled) == set(twelve)
    taken = {block_of(scene, load_roads(scene.map)) for scene in begun.scenarios}
    assert taken.isdisjoint(each.candidate.block for each in search.filled.values())
    assert [scene for scene, _ in search.scenes(10)] == [*begun.scenarios]
    folders = {folder.name: folder for folder in write_suites(search, tmp_path)}
    there = folders["interplan-large-1"]
    assert (folders["interplan-1"] / "scenarios.yaml").read_bytes() == (begun.folder / "scenarios.yaml").read_bytes()
    chosen = yaml.safe_load((there / "selection.yaml").read_text(encoding="utf-8"))
    assert chosen == {"suite": "interplan==1", "scenarios": [scene.id for scene in begun.scenarios]}
    ids = [scene.id for scene in read_scenarios(there / "scenarios.yaml")]
    assert len(ids) == 16
    assert set(ids).isdisjoint(chosen["scenarios"])


@pytest.mark.slow
def test_a_suite_goes_on_from_what_there_is_of_it_and_writes_that_again_byte_for_byte(tmp_path: Path) -> None:
    there = find_suite("interplan-large==1")
    search = SuiteSearch(there.key, [load_roads(name) for name in maps()], Seed(1), there)
    begun = {scene.id for scene in there.scenarios}
    assert begun.isdisjoint(search.seed.id(family, slot.number) for slot in search.missing for family in slot.families)
    assert sum(len(slot.families) for slot in search.missing) == 320 - len(begun)
    folders = {folder.name: folder for folder in write_suites(search, tmp_path)}
    for name in ("scenarios.yaml", "selection.yaml", certificates.FILE):
        assert (folders["interplan-large-1"] / name).read_bytes() == (there.folder / name).read_bytes()


@pytest.mark.nightly
def test_of_a_secret_seed_the_certificates_lie_elsewhere_and_ids_are_its_own(tmp_path: Path) -> None:
    seed = Seed.secret(b"nobody has ever seen this\n")
    assert seed == Seed.secret(b"nobody has ever seen this")
    assert seed != Seed.secret(b"nobody has ever seen that")
    search = made("interplan==1", seed)
    write_suites(search, tmp_path / "shown", kept_back=tmp_path / "kept.parquet")
    assert not list((tmp_path / "shown").rglob("*.parquet"))
    ids = {s.id for s in read_scenarios(tmp_path / "shown" / "interplan-1" / "scenarios.yaml")}
    assert ids == set(certificates.read_summaries(tmp_path / "kept.parquet"))
    assert all("/hidden-" in each for each in ids)


@pytest.mark.nightly
def test_a_verdict_that_is_kept_is_not_looked_for_again(small: SuiteSearch, tmp_path: Path) -> None:
    candidate = next(iter(small.filled.values())).candidate
    fast = tuple(replace(s, start_speed_mps=99.0) for s in candidate.scenarios)  # against the limit: judged at once
    broken = replace(candidate, scenarios=fast)
    ((_, first),) = verdicts([broken], tmp_path, workers=0)
    assert first.stage == "start"
    (path,) = tmp_path.glob("*.json")
    path.write_bytes(msgspec.json.encode(Verdict("start", "as it was kept")))
    ((_, again),) = verdicts([broken], tmp_path, workers=0)
    assert again.reason == "as it was kept"


@pytest.mark.parametrize(("away_m", "near"), [(99.0, 1.0), (101.0, 0.0)])
def test_vehicles_within_100_m_count_by_where_they_go(away_m: float, near: float) -> None:
    found = surrounding_traffic(driven(drive(*[0.0] * 20, actors=cars((away_m, 0.0, 5.0, 3.1)))))
    assert (found.vehicles, found.crossing, found.oncoming) == (near, 0, int(near))


@pytest.mark.parametrize(("heading", "crossing"), [(0.7, 0), (0.9, 1), (2.3, 1), (2.4, 0)])
def test_who_moves_across_by_45_to_135_degrees_crosses(heading: float, crossing: int) -> None:
    trace = driven(drive(*[0.0] * 5, actors=cars((30.0, 0.0, 5.0, heading))))
    assert surrounding_traffic(trace).crossing == crossing
    standing = driven(drive(*[0.0] * 5, actors=cars((30.0, 0.0, 0.9, heading))))
    assert surrounding_traffic(standing).crossing == 0


def test_a_scene_whose_lights_leave_too_little_time_is_told_before_anybody_drives() -> None:
    roads = load_roads("back_bay")
    scenes = list(islice(Search(roads, "lane_change_ltd", 0), 24))
    needed = [LitWay.of(scene, roads).time_to_goal_s() for scene in scenes]
    tight = [scene for scene, needed_s in zip(scenes, needed, strict=True) if needed_s > TIME_SHARE * scene.duration_s]
    assert 0 < len(tight) < len(scenes)
    assert all("s away with its lights" in light_problems(scene, roads)[0] for scene in tight)
    others = [scene for scene in scenes if scene not in tight]
    late = [
        scene for scene in others if any(LitWay.of(scene, roads).time_to_goal_s(s) > scene.duration_s for s in DELAYS_S)
    ]
    assert 0 < len(late) < len(others)
    assert all("s late misses the light" in light_problems(scene, roads)[0] for scene in late)
    assert all(light_problems(scene, roads) == [] for scene in others if scene not in late)


def test_a_leader_that_is_to_stop_comes_to_a_red_light_and_a_queue_stands_before_one() -> None:
    roads = load_roads("back_bay")
    for family in ("stopping_with_lead", "stationary_in_traffic"):
        scenes = list(islice(Search(roads, family, 0), 12))
        said = [green_too_soon(scene, roads) for scene in scenes]
        assert 0 < sum(each == [] for each in said) < len(scenes)
        assert all("nobody stops for it" in each[0] for each in said if each)
        without = [replace(scene, family="following_lane_with_lead") for scene in scenes]
        assert not any(green_too_soon(scene, roads) for scene in without)


def test_who_is_waited_for_comes_from_the_nearer_kerb() -> None:
    for scene in islice(Search(load_roads("back_bay"), "waiting_for_pedestrian_to_cross", 0), 12):
        first = scene.jaywalkers[0]
        assert abs(first.start.left_m) <= abs(first.end.left_m)


def test_options_that_do_not_go_together_are_refused_with_the_way_out(capsys: pytest.CaptureFixture[str]) -> None:
    for given, said in (
        (["--suite", "interplan==2"], "interplan==1"),
        (["--suite", "interplan==1", "--family", "nudge"], "leave out --family"),
        (
            ["--suite", "interplan==1", "--map", "strip", "--count", "1", "--overwrite"],
            "leave out --count, --overwrite",
        ),
        (["--map", "strip"], "--family"),
        (["--map", "strip", "--family", "nudge", "--secret-seed", "x"], "--secret-seed is for a --suite"),
    ):
        assert main(["scenarios", "generate", "--out", "nowhere", *given]) == 2
        assert said in capsys.readouterr().err
