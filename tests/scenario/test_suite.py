"""Suites: frozen data, read lazily; every official scenario is what its lock says, sound, and has its expert."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from worlds import ego

from interplan_sumo.errors import InputError, UnknownNameError
from interplan_sumo.families import names
from interplan_sumo.maps.store import load_roads
from interplan_sumo.scenario import suite
from interplan_sumo.scenario.certificates import FILE, Certificate, Summary, read_certificates, write_certificates
from interplan_sumo.scenario.difficulty import HARD, read_difficulties
from interplan_sumo.scenario.files import write_scenarios
from interplan_sumo.scenario.route import route_centerline
from interplan_sumo.scenario.scenario import LanePosition, Scenario
from interplan_sumo.scenario.suite import (
    DEFAULT_SUITE,
    certificate_of,
    expert,
    find_scenario,
    find_suite,
    ids_of,
    read_lock,
    suites,
    suites_with,
)
from interplan_sumo.simulation.setup import start_state
from interplan_sumo.verification.hard_folder import ABOUT
from interplan_sumo.verification.hard_search import MOST_MEAN, shares
from interplan_sumo.verification.lock import lock
from interplan_sumo.verification.reachability import unreachable
from interplan_sumo.verification.start_checks import start_problems
from interplan_sumo.world.csv_tables import read_table
from interplan_sumo.world.trace import EgoTrack
from tests.quick import nightly

RELEASED = {
    "interplan==1": (80, "0babd01f52b400c03b3dcc3e5ffa22c767a6dbe43734be8900eda1d735e0b8af"),
    "common==1": (140, "9d25bf926c8a70c8141ca5ce941a6def017c5720f6ffef45ca31148bdb2fb6a4"),
    "interplan-hard==1": (100, "7b8d9849c59b95cf82e861112cd51cb8f4a291b7edbc1bb99307b536c45b0f64"),
    "interplan-large==1": (320, "26854b319ac14ba798db88b8562d79977d70f010aee88ef6869f193264ad50b7"),
    "llm==1": (24, "98197429ef6eac00a91e308987ec184f102844735b3ee2c7ccb367005be315b9"),
    "smoke==1": (8, "ffbd0c50cab2a8d077e8fadda8af390df95c7fe6826708223a8d58e4b2ae8c50"),
}
"""How many scenarios, and their hash: for ever."""
WHOLE = ("interplan-large==1", "interplan-hard==1", "common==1")
"""The others choose from these."""
often_and_whole = pytest.mark.parametrize("key", ["llm==1", *map(nightly, WHOLE)])
"""Three scenes of each family with every change."""
MINE = Scenario("mine/0", "mine", "tiny", LanePosition("11", 20.0), 10.0, LanePosition("11", 200.0), ("1",))


def scenarios_of(*keys: str) -> list[Scenario]:
    return [scenario for key in keys for scenario in find_suite(key).scenarios]


def test_the_released_suites_hold_what_they_held() -> None:
    assert list(suites()) == list(RELEASED)
    for key, (count, digest) in RELEASED.items():
        assert (len(find_suite(key).scenarios), find_suite(key).hash()) == (count, digest)
        assert read_lock(key).hash == digest


def test_a_suite_may_begin_with_scenarios_of_another_and_go_on_with_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small, large = tmp_path / "mine-1", tmp_path / "more-1"
    for folder, number in ((small, 0), (large, 1)):
        folder.mkdir()
        write_scenarios([replace(MINE, id=f"mine/{number}")], folder / "scenarios.yaml")
    (large / "selection.yaml").write_text("suite: mine==1\nscenarios: [mine/0]\n", encoding="utf-8")
    monkeypatch.setattr(suite, "SUITES_ROOT", tmp_path)
    found = suite._Released(tmp_path)
    assert [s.id for s in found["more==1"].scenarios] == ["mine/0", "mine/1"]
    assert [s.id for s in found["mine==1"].scenarios] == ["mine/0"]


def test_scenarios_are_those_of_the_lock_in_the_same_order() -> None:
    for key in suites():
        scenarios = find_suite(key).scenarios
        hashes = {name: entry.scenario for name, entry in read_lock(key).scenarios.items()}
        assert {scenario.id: scenario.hash() for scenario in scenarios} == hashes
        assert ids_of(key) == tuple(scenario.id for scenario in scenarios)


@often_and_whole
@pytest.mark.slow
def test_a_suite_is_what_its_lock_says(key: str) -> None:
    assert lock(find_suite(key)) == read_lock(key)


@pytest.mark.nightly
@pytest.mark.parametrize("key", WHOLE)
def test_official_scenarios_pass_every_start_check(key: str) -> None:
    for scenario in find_suite(key).scenarios:
        assert start_problems(scenario, load_roads(scenario.map)) == [], scenario.id


@often_and_whole
@pytest.mark.slow
def test_every_expert_drives_as_a_car_can_for_no_longer_than_its_scenario_lasts(key: str) -> None:
    for scenario in find_suite(key).scenarios:
        start = start_state(scenario, load_roads(scenario.map))
        assert unreachable(start, expert(scenario), scenario.duration_s) == [], scenario.id


@often_and_whole
@pytest.mark.slow
def test_official_scenarios_are_sound_before_anybody_moves(key: str) -> None:
    for scenario in find_suite(key).scenarios:
        assert start_problems(scenario, load_roads(scenario.map), with_traffic=False) == [], scenario.id


def test_the_large_suite_begins_with_the_eighty_and_each_place_is_a_road_of_its_own() -> None:
    large = find_suite("interplan-large==1").scenarios
    assert large[:80] == find_suite("interplan==1").scenarios
    assert Counter(scenario.family for scenario in large) == dict.fromkeys(names(ordinary=False), 40)
    held = read_lock("interplan-large==1").overview
    assert len({(entry.map, entry.site.partition("@")[0]) for entry in held}) == 6 * 40
    solved = Counter(entry.family for entry in held if entry.solved_by)
    assert min(solved.values()) >= 0.8 * 40
    assert solved.total() >= 0.9 * len(held)


def test_hard_scenes_are_solved_by_somebody_and_nobody_of_the_panel_has_half_of_the_points_of_a_family() -> None:
    hard = find_suite("interplan-hard==1")
    families = {scenario.id: scenario.family for scenario in hard.scenarios}
    assert shares(100, names(ordinary=False)) == Counter(families.values())
    entries = read_lock(hard.key).overview
    assert all(entry.solved_by for entry in entries)
    assert len({entry.site.partition("@")[0] for entry in entries}) == 80
    rows = read_table(hard.folder / HARD, ABOUT)
    assert [row["scenario_id"] for row in rows] == [entry.id for entry in entries]
    assert min(read_difficulties(hard.folder).values()) >= 0.5
    assert min(float(row["plausibility"]) for row in rows) >= 0.05
    panel = rows[0].keys() - set(ABOUT)
    assert len(panel) == 5
    for family, count in Counter(families.values()).items():
        of_family = [row for row in rows if families[row["scenario_id"]] == family]
        for name in panel:
            assert sum(float(row[name]) for row in of_family) <= MOST_MEAN * count + 1e-3, (name, family)


def test_ordinary_driving_has_ten_scenes_of_each_type_with_lights_anywhere_in_their_cycle() -> None:
    common = find_suite("common==1").scenarios
    assert Counter(scenario.family for scenario in common) == dict.fromkeys(names(ordinary=True), 10)
    assert len({scenario.light_time_s for scenario in common}) > 70
    assert sum(1 for entry in read_lock("common==1").overview if entry.solved_by) >= 0.9 * len(common)


def test_smaller_suites_have_the_scenarios_locks_and_experts_of_the_benchmark() -> None:
    theirs, proofs = read_lock(DEFAULT_SUITE), read_certificates(find_suite(DEFAULT_SUITE).folder / FILE)
    for key in ("llm==1", "smoke==1"):
        ours = read_lock(key)
        assert set(find_suite(key).scenarios) <= set(find_suite(DEFAULT_SUITE).scenarios)
        assert all(entry == theirs.scenarios[name] for name, entry in ours.scenarios.items())
        assert all(entry in theirs.overview for entry in ours.overview)
        assert set(ours.maps.items()) <= set(theirs.maps.items())
    experts = read_certificates(find_suite("llm==1").folder / FILE)
    assert len(experts) == 24
    assert all(proof.record() == proofs[name].record() for name, proof in experts.items())


def test_every_official_scenario_is_certified_and_its_expert_starts_where_the_ego_does_and_gets_somewhere() -> None:
    for scenario in scenarios_of(*WHOLE):
        proof, track = certificate_of(scenario.id, scenario.hash()), expert(scenario)
        assert proof is not None
        assert proof.score >= (0.8 if scenario.family == "lane_change_htd" else 0.9)
        roads = load_roads(scenario.map)
        start, line = scenario.start.pose(roads), route_centerline(roads, scenario)
        assert (track.x_m[0], track.y_m[0]) == pytest.approx((start.x_m, start.y_m), abs=1e-6)
        arcs, _ = line.project([(track.x_m[0], track.y_m[0]), (track.x_m[-1], track.y_m[-1])])
        assert arcs[1] - arcs[0] >= 0.7 * proof.reference_distance_m
        assert arcs[1] - arcs[0] > (5.0 if scenario.family == "stationary_in_traffic" else 50.0)


def test_the_suite_for_language_models_has_three_of_each_family_and_smoke_one() -> None:
    benchmark = names(ordinary=False)
    assert Counter(scenario.family for scenario in find_suite("llm==1").scenarios) == dict.fromkeys(benchmark, 3)
    assert [scenario.family for scenario in find_suite("smoke==1").scenarios] == list(benchmark)


def test_a_scenario_is_found_in_every_suite_that_holds_it() -> None:
    held = find_suite("llm==1").scenarios[1].id
    assert suites_with(held) == ("interplan==1", "interplan-large==1", "llm==1")
    assert suites_with("trip/0") == ()
    assert find_scenario("changing_lane/0").family == "changing_lane"
    with pytest.raises(UnknownNameError, match="Did you mean 'nudge/0'"):
        find_scenario("nudg/0")
    with pytest.raises(UnknownNameError, match="Did you mean 'interplan==1'"):
        find_suite("interplan==2")


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder of suites of one's own."""
    monkeypatch.setattr(suite, "SUITES_ROOT", tmp_path)
    monkeypatch.setattr(suite, "_SUITES", suite._Released(tmp_path))
    read_lock.cache_clear()
    yield tmp_path
    read_lock.cache_clear()


def test_a_suite_is_a_folder_and_only_the_one_asked_for_is_read(root: Path) -> None:
    for name in ("mine-3", "broken-1"):
        (root / name).mkdir()
    write_scenarios([MINE], root / "mine-3" / "scenarios.yaml")
    (root / "broken-1" / "scenarios.yaml").write_text("{")
    assert list(suites()) == ["broken==1", "mine==3"]
    assert find_suite("mine==3").scenarios == (MINE,)
    assert ids_of("mine==3") == ("mine/0",)
    with pytest.raises(InputError, match="this is not YAML"):
        find_suite("broken==1")
    (root / "broken-1" / "lock.json").write_text("{")
    with pytest.raises(InputError, match=r"cannot read .*lock\.json"):
        ids_of("broken==1")


@pytest.mark.parametrize("changed", [False, True])
def test_a_scenario_that_was_changed_since_counts_as_not_certified_but_keeps_its_expert(
    root: Path, changed: bool
) -> None:
    (root / "mine-1").mkdir()
    write_scenarios([MINE], root / "mine-1" / "scenarios.yaml")
    summary = Summary(MINE.id, "0" * 64 if changed else MINE.hash(), 0.95, 150.0, 148.5, False, "0" * 64)
    track = EgoTrack.of([replace(ego(0.5 * k), time_s=0.1 * k) for k in range(20)])
    write_certificates(root / "mine-1" / FILE, [Certificate(summary, track)])
    assert (certificate_of(MINE.id, MINE.hash()) is None) == changed
    assert len(expert(MINE)) == 20
