"""Generated scenarios: sound ones only, with certificates where a drive passes, as a folder that `run` accepts."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from interplan_sumo.errors import InputError
from interplan_sumo.proving.certificates import Verdict
from interplan_sumo.proving.start_checks import start_problems
from interplan_sumo.scenario import certificates
from interplan_sumo.scenario.families import FAMILIES
from interplan_sumo.scenario.files import write_scenarios
from interplan_sumo.scenario.generate import Search
from interplan_sumo.scenario.ordinary import TYPES
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.sites import Rejected
from interplan_sumo.world.roads import Roads

SCENARIOS: Final = "scenarios.yaml"
REPORT: Final = "report.csv"
REJECTED: Final = "rejected.csv"
GROUPS: Final[dict[str, tuple[str, ...]]] = {"all": tuple(FAMILIES), "ordinary": tuple(TYPES)}
"""Names for several families at once."""
CANDIDATES_PER_SCENARIO: Final = 12
"""The search gives up after so many unsound candidates for each scenario that is asked for."""


@dataclass(slots=True)
class Generated:
    """What was made of one family on one map."""

    family: str
    scenarios: list[Scenario] = field(default_factory=list[Scenario])
    rejected: list[Rejected] = field(default_factory=list[Rejected])
    """Places that do not suit, and candidates that failed a start check."""


def families_of(name: str) -> tuple[str, ...]:
    """A family or ordinary type by its name, or a group of them: `all` is the eight families, `ordinary` the types."""
    return GROUPS.get(name, (name,))


def generate(roads: Roads, family: str, count: int, seed: int) -> Generated:
    """`count` sound scenarios, fewer where the map has no room for more; UnknownNameError for an unknown family."""
    search = Search(roads, family, seed)
    made = Generated(family, rejected=search.rejected)
    if count < 1:
        raise InputError(f"count is {count}, expected 1 or more")
    for number, scenario in enumerate(search):
        problems = start_problems(scenario, roads)
        if problems:
            site = scenario.site(roads)
            lane, at_m = scenario.goal.lane, scenario.goal.arc_m
            search.rejected.append(Rejected(lane, at_m, f"{scenario.id} at {site}: {problems[0]}"))
        else:
            made.scenarios.append(scenario)
        if len(made.scenarios) == count or number + 1 >= count * CANDIDATES_PER_SCENARIO:
            break
    return made


def write_generated(
    folder: Path, made: Sequence[Generated], verdicts: Iterable[Verdict], *, overwrite: bool = False
) -> tuple[int, int]:
    """Write scenarios, certificates, the report and the rejected places; how many scenarios, and how many certified.

    InputError if the folder holds scenarios already and is not to be overwritten, or cannot be written.
    """
    found = {verdict.scenario_id: verdict for verdict in verdicts}
    scenarios = [scenario for each in made for scenario in each.scenarios]
    check_folder(folder, overwrite=overwrite)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_scenarios(scenarios, folder / SCENARIOS)
        passed = [v.certificate for v in found.values() if v.certificate is not None]
        certificates.write_certificates(folder / certificates.FILE, passed)
        with (folder / REPORT).open("w", newline="", encoding="utf-8") as file:
            rows = csv.writer(file)
            rows.writerow(("scenario_id", "certified", "score", "simulations", "reason"))
            for scenario in scenarios:
                verdict = found.get(scenario.id)
                proof = verdict.certificate if verdict is not None else None
                rows.writerow(
                    (
                        scenario.id,
                        proof is not None,
                        "" if proof is None else proof.summary.score,
                        "" if verdict is None else verdict.simulations,
                        "not looked for" if verdict is None else verdict.reason or "",
                    )
                )
        with (folder / REJECTED).open("w", newline="", encoding="utf-8") as file:
            rows = csv.writer(file)
            rows.writerow(("family", "lane", "at_m", "reason"))
            rows.writerows((each.family, r.lane, r.at_m, r.reason) for each in made for r in each.rejected)
    except OSError as error:
        raise InputError(f"cannot write {folder}: {error.strerror or error}") from None
    return len(scenarios), len(passed)


def check_folder(folder: Path, *, overwrite: bool) -> None:
    """InputError if the folder holds generated scenarios already and these are not to be overwritten."""
    if not overwrite and (folder / SCENARIOS).exists():
        raise InputError(f"{folder / SCENARIOS} exists; name another folder with --out, or give --overwrite")
