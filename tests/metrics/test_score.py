"""The score: gates multiply, weights average, and every profile has its own table."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from interplan_sumo.batch.records import ScoreRecord, decode, encode
from interplan_sumo.errors import InputError
from interplan_sumo.families import FAMILIES
from interplan_sumo.metrics.collisions import STOPPED_MPS
from interplan_sumo.metrics.comfort import BOUNDS
from interplan_sumo.metrics.diagnostics import LONGEST_GAP_M
from interplan_sumo.metrics.drivable_area import TOLERANCE_M
from interplan_sumo.metrics.driving_direction import FORBIDDEN_M, TOLERATED_M
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.interplan_code import UNKNOWN_START_SCORE
from interplan_sumo.metrics.manoeuvres import REACH_M
from interplan_sumo.metrics.metric import plain
from interplan_sumo.metrics.profile import Profile, Term, find_profile, lane_blocked
from interplan_sumo.metrics.progress import FLOOR_M, LEAST_RATIO
from interplan_sumo.metrics.score import SCORING_VERSION, score, score_facts
from interplan_sumo.metrics.speed_limit import OVERSPEED_SCALE_MPS
from interplan_sumo.metrics.time_to_collision import LEAST_S
from interplan_sumo.scenario.scenario import LanePosition, Obstacle, Scenario
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.geometry import Pose
from interplan_sumo.world.trace import ActorTable, EgoTrack, Trace
from tests.metrics.staging import NOBODY, drive_at, lane_y_m, scenario_on
from tests.worlds import cars, drive, straight_road

ROAD = straight_road(lanes=2, length_m=600.0)
PROFILES = ("interplan-strict", "interplan-paper", "interplan-code", "nuplan")
SCENARIO = scenario_on(ROAD, ("11", 20.0), ("11", 550.0))
CRUISE = drive(*[10.0] * 301, start=Pose(20.0, 0.0, 0.0))
EXPERT = CRUISE.ego
CAR = Obstacle(LanePosition("11", 80.0, 3.0))


NOTHING = Trace(NOBODY, ActorTable.of([]), (), (), np.zeros(0))
"""A trace without a single frame."""


def facts_of(trace: Trace = CRUISE, scenario: Scenario | None = SCENARIO, expert: EgoTrack = EXPERT) -> Facts:
    return Facts(trace, ROAD, expert, scenario)


def test_a_perfect_drive_scores_one_in_every_profile():
    for profile in PROFILES:
        sheet = score(CRUISE, ROAD, EXPERT, SCENARIO, profile)
        assert sheet.score == 1.0
        assert (sheet.profile, sheet.version) == (profile, SCORING_VERSION)
        assert sheet.reasons() == {}


def test_a_lane_keeper_that_needs_a_lane_change_gets_four_fifths():
    scenario = scenario_on(ROAD, ("11", 20.0), ("12", 550.0))
    sheet = score_facts(facts_of(scenario=scenario), "interplan-paper")
    assert sheet.score == pytest.approx(0.8)
    assert sheet.reasons() == {"lane_changes": "ended 1 lane beside the goal lane, on lane 11"}


def test_one_cone_is_a_zero_in_the_paper_and_a_half_elsewhere():
    cone = cars((150.0, 0.0), kind=ActorKind.TRAFFIC_CONE, length_m=0.5, width_m=0.5)
    facts = facts_of(drive_at(CRUISE.ego.x_m, actors=cone))
    gates = {profile: score_facts(facts, profile).metrics["no_collision"].score for profile in PROFILES}
    assert gates == {"interplan-strict": 0.0, "interplan-paper": 0.0, "interplan-code": 0.5, "nuplan": 0.5}
    assert score_facts(facts).score == 0.0


def wrong_way() -> Trace:
    """Forwards, then 4 m back within a second, then on to the end."""
    x_m = np.concatenate((np.linspace(20.0, 120.0, 101), np.linspace(119.6, 116.0, 10), np.linspace(117.0, 320.0, 190)))
    return drive_at(x_m)


def test_exempt_gates_are_reported_but_do_not_count():
    counted = score_facts(facts_of(wrong_way()))
    exempt = score_facts(facts_of(wrong_way(), replace(SCENARIO, exempt=("driving_direction",))))
    assert counted.metrics["driving_direction"].score == exempt.metrics["driving_direction"].score == 0.5
    assert "driving_direction" not in exempt.gates
    assert counted.score == pytest.approx(exempt.score / 2)
    assert score_facts(facts_of(wrong_way(), replace(SCENARIO, exempt=("driving_direction",))), "nuplan").score > 0


def test_the_published_code_weighs_driving_direction_where_a_lane_is_blocked_and_gates_it_elsewhere():
    blocked = {name for name in FAMILIES if lane_blocked(facts_of(scenario=replace(SCENARIO, family=name)))}
    assert blocked == {"construction", "accident", "nudge", "overtake"}
    weighed = score_facts(facts_of(wrong_way(), replace(SCENARIO, family="nudge")), "interplan-code")
    assert (weighed.weights["driving_direction"], sum(weighed.weights.values())) == (1.0, 21.0)
    assert "driving_direction" not in weighed.gates
    gated = score_facts(facts_of(wrong_way(), replace(SCENARIO, family="jaywalker")), "interplan-code")
    assert "driving_direction" in gated.gates
    assert sum(gated.weights.values()) == 20.0


def test_an_obstacle_gate_exists_only_where_there_is_an_obstacle():
    blocked = facts_of(scenario=replace(SCENARIO, obstacles=(CAR,)))
    assert "obstacle_passed" not in score_facts(facts_of(), "interplan-paper").metrics
    for profile in ("interplan-paper", "interplan-code"):
        passed = score_facts(blocked, profile)
        assert "obstacle_passed" in passed.gates
        assert passed.score == 1.0
    assert "obstacle_passed" not in score_facts(blocked, "nuplan").metrics
    beyond_the_end = replace(SCENARIO, obstacles=(Obstacle(LanePosition("11", 500.0, 3.0)),))
    assert score_facts(facts_of(scenario=beyond_the_end), "interplan-paper").score == 0.0


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("frames", [0, 1, 2, 3, 4, 7])
def test_a_trace_of_any_length_can_be_scored(frames: int, profile: str):
    around = cars((40.0, 0.0, 3.0), (20.0, lane_y_m(1), 5.0))
    trace = drive_at(CRUISE.ego.x_m[:frames], actors=around) if frames else NOTHING
    for expert in (EXPERT, NOBODY):
        sheet = score_facts(facts_of(trace, replace(SCENARIO, obstacles=(CAR,)), expert), profile)
        assert 0.0 <= sheet.score <= 1.0
        record = ScoreRecord.of(sheet)
        assert decode(encode(record), ScoreRecord) == record


@pytest.mark.parametrize("profile", ["interplan-paper", "interplan-code"])
def test_interplans_profiles_need_the_scenario(profile: str):
    with pytest.raises(InputError, match="needs the scenario"):
        score(CRUISE, ROAD, EXPERT, None, profile)
    assert score(CRUISE, ROAD, EXPERT, None, "nuplan").score == 1.0


def test_plain_data_have_no_numpy_and_no_infinity():
    mixed = {"a": np.float64(2.5), "b": (np.int64(1), np.bool_(True)), 3: np.array([1.0, np.inf, np.nan]), "n": None}
    assert plain(mixed) == {"a": 2.5, "b": [1, True], "3": [1.0, None, None], "n": None}
    assert type(plain(mixed)["b"][1]) is bool


def test_a_term_that_cannot_be_judged_leaves_the_mean():
    quiet = Term("lane_crossings", "quiet", weight=5.0)
    profile = Profile(
        needs_scenario=False,
        honours_exemptions=False,
        gates=(Term("lane_crossings"),),
        weights=(Term("comfort", weight=2.0), quiet),
    )
    sheet = score_facts(facts_of(), profile)
    assert (sheet.gates, sheet.weights, sheet.score) == ((), {"comfort": 2.0}, 1.0)


CONDITIONS = {
    "always": "",
    "with_obstacles": " (with obstacles)",
    "lane_free": " (lane free)",
    "lane_blocked": " (lane blocked)",
}
DOCS = Path(__file__).parents[2] / "docs" / "metrics.md"


def documented_table() -> list[str]:
    """The table of gates and weights in Markdown, as the profiles have it."""
    profiles = [find_profile(name) for name in PROFILES]
    names = dict.fromkeys(term.name for profile in profiles for term in profile.terms)
    lines = [f"| metric | {' | '.join(f'`{name}`' for name in PROFILES)} |", "|---" * (len(PROFILES) + 1) + "|"]
    for name in names:
        cells: list[str] = []
        for profile in profiles:
            terms = [term for term in profile.terms if term.name == name]
            kinds = ["gate" if term.weight is None else f"weight {term.weight:g}" for term in terms]
            said = [kind + CONDITIONS[term.when] for kind, term in zip(kinds, terms, strict=True)]
            cells.append(", ".join(said) or "-")
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return lines


def test_the_documented_table_is_the_one_that_scores():
    assert "\n".join(documented_table()) in DOCS.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "number",
    [
        f"{STOPPED_MPS:g} m/s",
        f"{TOLERANCE_M:g} m or more",
        f"less than {TOLERATED_M:g} m: 1; less than {FORBIDDEN_M:g} m: 0.5",
        f"ratio below is {LEAST_RATIO:g} or more",
        f"max(ego, {FLOOR_M:g} m) / max(expert, {FLOOR_M:g} m)",
        f"more than {LEAST_S:g} s",
        f"mean overspeed / {OVERSPEED_SCALE_MPS:g} m/s",
        f"{UNKNOWN_START_SCORE:g} if the start",
        f"at most {LONGEST_GAP_M:g} m away",
        f"(at most {REACH_M:g} m)",
        *(f"{high:.2f} " for _, high in BOUNDS.values()),
    ],
)
def test_documented_thresholds_are_those_in_force(number: str):
    assert number in " ".join(DOCS.read_text(encoding="utf-8").split())


def test_every_diagnostic_is_documented():
    found = score_facts(facts_of()).metrics["diagnostics"].detail
    text = DOCS.read_text(encoding="utf-8")
    assert [key for key in found if key not in text] == []
