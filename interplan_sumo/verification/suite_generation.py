"""Suite generation: every slot is filled with the first candidate that passes, round by round.

In a round each slot that is still empty tries one candidate; all of them at the
same time, so that what comes out does not depend on how many work on it. The
slots of a smaller suite are filled before those of the larger one begin, unless
it is released: then the larger one begins with it as it is, and goes on from
what there is of itself.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import yaml

from interplan_sumo.scenario import certificates
from interplan_sumo.scenario.certificates import Certificate
from interplan_sumo.scenario.files import write_scenarios
from interplan_sumo.scenario.route import goal_arc_m, start_arc_m
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.suite import SCENARIOS, SELECTION, Suite, certificate_of, expert, find_scenario
from interplan_sumo.verification.suite_candidates import Candidate, Streams, block_of, changes_asked
from interplan_sumo.verification.suite_judging import Verdict
from interplan_sumo.verification.suite_slots import ORDINARY, Seed, Slot, beginnings, groups, size_of, slots
from interplan_sumo.world.csv_tables import write_table
from interplan_sumo.world.files import OTHER_FOLDER, writing
from interplan_sumo.world.roads import Roads

MOST_ATTEMPTS: Final = 40
"""A slot for which so many candidates failed stays empty."""
REJECTED: Final = "rejected.csv"
SCENES: Final = "scenes.csv"
CANDIDATES: Final = "candidates"
"""The folder of what is known of candidates."""
SMOKE, FEW = "smoke==1", "llm==1"
PER_FAMILY: Final = {SMOKE: 1, FEW: 3}
"""Scenes per family of the suites that are selections of the smallest one."""

Judge = Callable[[Sequence[Candidate]], Iterable[tuple[Candidate, Verdict]]]
"""Finds the verdicts on candidates, in any order."""
Tell = Callable[[Candidate, Verdict], None]


@dataclass(frozen=True, slots=True)
class Filled:
    """A slot with what fills it."""

    candidate: Candidate
    verdict: Verdict


@dataclass(slots=True)
class SuiteSearch:
    """A suite in the making."""

    suite: str
    maps: Sequence[Roads]
    seed: Seed
    begun: Suite | None = None
    """A released suite that this one begins with, or what there is of it: its slots are filled, its places taken."""
    filled: dict[Slot, Filled] = field(default_factory=dict[Slot, Filled])
    failed: list[tuple[Candidate, Verdict]] = field(default_factory=list[tuple[Candidate, Verdict]])
    _streams: Streams = field(init=False, repr=False)
    _begun: set[Slot] = field(init=False, repr=False)
    """The slots that are filled from the beginning, and where:"""
    _taken: set[str] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._streams = Streams(self.maps, self.seed)
        roads = {each.name: each for each in self.maps}
        there = {} if self.begun is None else {scene.id: scene for scene in self.begun.scenarios}
        self._taken = {block_of(scene, roads[scene.map]) for scene in there.values()}
        self._begun = {
            slot
            for slot in slots(self.suite, size_of(self.suite))
            if {self.seed.id(family, slot.number) for family in slot.families} <= there.keys()
        }

    def run(self, judge: Judge, tell: Tell = lambda _candidate, _verdict: None) -> None:
        """Fill all slots for which there is a candidate that passes."""
        first = 0
        for _, size in beginnings(self.suite):
            self._fill([slot for slot in slots(self.suite, size, first) if slot not in self._begun], judge, tell)
            first = size

    def _fill(self, wanted: list[Slot], judge: Judge, tell: Tell) -> None:
        empty = list(wanted)
        for attempt in range(MOST_ATTEMPTS):
            held = [each.candidate for each in self.filled.values()]
            trying: list[Candidate] = []
            for slot in sorted(empty, key=lambda slot: -len(slot.families)):  # who shares a place finds fewest
                others = (*held, *trying)
                taken = {each.block for each in others if not slot.is_ordinary or each.slot.families == slot.families}
                found = self._streams.next(slot, attempt, taken | self._taken)
                if found is not None:
                    trying.append(found)
            if not trying:
                return
            verdicts: dict[Slot, Verdict] = {}
            for candidate, verdict in judge(trying):
                tell(candidate, verdict)
                verdicts[candidate.slot] = verdict
            for candidate in trying:
                verdict = verdicts[candidate.slot]
                if verdict.taken:
                    self.filled[candidate.slot] = Filled(candidate, verdict)
                else:
                    self.failed.append((candidate, verdict))
            empty = [slot for slot in empty if slot not in self.filled]
            if not empty:
                return

    @property
    def missing(self) -> list[Slot]:
        """The slots that nothing fills."""
        every = slots(self.suite, size_of(self.suite))
        return [slot for slot in every if slot not in self.filled and slot not in self._begun]

    def scenes(self, size: int, first: int = 0) -> list[tuple[Scenario, Certificate]]:
        """The scenes with numbers from `first` to before `size`, family by family, those of the beginning, too."""
        found: list[tuple[Scenario, Certificate]] = []
        for families in groups(self.suite):
            for row, family in enumerate(families):
                for number in range(first, size):
                    slot = Slot(families, number)
                    if slot in self._begun:
                        found.append(_released(self.seed.id(family, number)))
                    elif slot in self.filled:
                        each = self.filled[slot]
                        found.append((each.candidate.scenarios[row], Certificate.of(each.verdict.certificates[row])))
        return found

    def rejections(self) -> list[tuple[str, str, str, str, str]]:
        """Everything that was passed over: stage, family, scene or lane, place, reason."""
        rows = [
            (verdict.stage, candidate.slot.families[0], verdict.scenario, candidate.block, verdict.reason)
            for candidate, verdict in self.failed
        ]
        for slot, each in self._streams.passed_over:
            rows.append(("lights", slot.families[0], each.lane, f"{each.at_m:.0f} m", each.reason))
        rows += [
            ("place", family, each.lane, f"{each.at_m:.0f} m", each.reason) for family, each in self._streams.unsuitable
        ]
        return rows


def _released(scenario_id: str) -> tuple[Scenario, Certificate]:
    """A scene of a released suite with its certificate."""
    scenario = find_scenario(scenario_id)
    summary = certificate_of(scenario_id, scenario.hash())
    assert summary is not None, f"{scenario_id} is released without a certificate"
    return scenario, Certificate(summary, expert(scenario))


def counts(rows: Iterable[tuple[str, str, str, str, str]]) -> list[tuple[int, str, str]]:
    """How often each reason was met, the most frequent first: number, stage, reason without its numbers."""
    found = Counter((stage, _without_numbers(reason)) for stage, _, _, _, reason in rows)
    return sorted(((n, stage, reason) for (stage, reason), n in found.items()), key=lambda row: (-row[0], *row[1:]))


def _without_numbers(reason: str) -> str:
    head = re.split(r"; |: .*? (?=from vehicle)| \(", reason)[0]
    named = re.sub(r"\b(vehicle|pedestrian|bicycle|lane|connector) [0-9a-f]+\b", r"\1 ..", head)
    return re.sub(r"-?\d+(\.\d+)?", "#", named)


def write_suites(search: SuiteSearch, folder: Path, *, kept_back: Path | None = None) -> list[Path]:
    """Write the suites as `scenario/suites` has them, and what was rejected; the folders of the suites.

    The larger suite holds its own scenes and names the smaller one for the
    others. With `kept_back` all certificates go there, beside no scene.
    InputError if anything cannot be written.
    """
    made: list[Path] = []
    first, smaller = 0, ""
    secret: list[Certificate] = []
    for key, size in beginnings(search.suite):
        there = folder / key.replace("==", "-")
        scenes = search.scenes(size, first)
        with writing(there, OTHER_FOLDER):
            there.mkdir(parents=True, exist_ok=True)
            write_scenarios([scenario for scenario, _ in scenes], there / SCENARIOS)
            proved = [certificate for _, certificate in scenes]
            if kept_back is None:
                certificates.write_certificates(there / certificates.FILE, proved)
            else:
                secret += proved
            if smaller:
                _write_selection(there / SELECTION, smaller, [s.id for s, _ in search.scenes(first)])
        made.append(there)
        first, smaller = size, key
    if kept_back is not None:
        with writing(kept_back, "give another file as --secret-seed"):
            certificates.write_certificates(kept_back, secret)
    elif search.begun is None and search.suite not in ORDINARY:
        made += _write_derived(search, folder)
    write_table(folder / REJECTED, ("stage", "family", "scene or lane", "place", "reason"), search.rejections())
    _write_scenes(search, folder)
    return made


def _write_derived(search: SuiteSearch, folder: Path) -> list[Path]:
    """The suites that name some scenes of the smallest one: the first that somebody solves of each family."""
    suite, size = beginnings(search.suite)[0]
    made: list[Path] = []
    for key, many in PER_FAMILY.items():
        chosen: list[tuple[Scenario, Certificate]] = []
        for families in groups(suite):
            for family in families:
                mine = [(s, c) for s, c in search.scenes(size) if s.family == family]
                mine.sort(key=lambda each: not each[1].summary.solved_by)  # stable: the open ones last
                chosen += mine[: many * (size // many) : size // many] if many > 1 else mine[:1]
        there = folder / key.replace("==", "-")
        with writing(there, OTHER_FOLDER):
            there.mkdir(parents=True, exist_ok=True)
            _write_selection(there / SELECTION, suite, [scenario.id for scenario, _ in chosen])
            certificates.write_certificates(there / certificates.FILE, [certificate for _, certificate in chosen])
        made.append(there)
    return made


def _write_selection(path: Path, suite: str, ids: Sequence[str]) -> None:
    path.write_text(yaml.safe_dump({"suite": suite, "scenarios": list(ids)}, sort_keys=False), encoding="utf-8")


def _write_scenes(search: SuiteSearch, folder: Path) -> None:
    """What fills each slot, one row per scene."""
    rows: list[tuple[object, ...]] = []
    roads_of = {roads.name: roads for roads in search.maps}
    for slot, each in search.filled.items():
        for scenario, proved, met in zip(
            each.candidate.scenarios, each.verdict.certificates, each.verdict.traffic, strict=True
        ):
            roads = roads_of[scenario.map]
            way_m = goal_arc_m(roads, scenario) - start_arc_m(roads, scenario)
            rows.append(
                (scenario.id, scenario.map, each.candidate.block, roads.driving_side, changes_asked(scenario, roads),
                 f"{way_m:.0f}", scenario.start_speed_mps, slot.behaviour, scenario.traffic.density,
                 scenario.traffic.oncoming, f"{met.vehicles:.1f}", met.crossing, met.oncoming,
                 each.candidate.attempt, proved.summary.score, " ".join(proved.summary.solved_by or ()) or "open")
            )  # fmt: skip
    names = ("id", "map", "roadblock", "driving side", "lane changes",
             "m to the goal", "start m/s", "behaviour", "density",
             "oncoming density", "vehicles within 100 m", "crossing", "oncoming",
             "candidates before", "certificate", "solved by")  # fmt: skip
    write_table(folder / SCENES, names, rows)
