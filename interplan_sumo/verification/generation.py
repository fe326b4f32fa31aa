"""Generated scenarios: sound ones only, with certificates where a drive passes, as a folder that `run` accepts.

A map that is not shipped goes into the folder, too, so that it can be driven anywhere.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final, NamedTuple

from interplan_sumo.errors import InputError
from interplan_sumo.families import names
from interplan_sumo.families.draws import Draw
from interplan_sumo.families.generate import Search
from interplan_sumo.maps.store import MapFiles, load_roads
from interplan_sumo.scenario import certificates
from interplan_sumo.scenario.files import MAPS, write_scenarios
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.sites import Rejected
from interplan_sumo.verification.certificates import Proof
from interplan_sumo.verification.light_windows import light_problems
from interplan_sumo.verification.map_bundling import carry_map
from interplan_sumo.verification.start_checks import start_problems
from interplan_sumo.world.csv_tables import number_in, read_table, write_table
from interplan_sumo.world.files import OTHER_FOLDER, writing
from interplan_sumo.world.roads import Roads

SCENARIOS: Final = "scenarios.yaml"
REPORT: Final = "report.csv"
REJECTED: Final = "rejected.csv"
PARAMETERS: Final = "parameters.csv"
CANDIDATES_PER_SCENARIO: Final = 12
LEAST_CANDIDATES: Final = 60
"""The search gives up after so many candidates for each scenario that is asked for, and so many in all."""


@dataclass(slots=True)
class Generated:
    """What was made of one family on one map."""

    family: str
    scenarios: list[Scenario] = field(default_factory=list[Scenario])
    rejected: list[Rejected] = field(default_factory=list[Rejected])
    """Places that do not suit, and candidates that failed a start check."""


def families_of(name: str) -> tuple[str, ...]:
    """A family by its name; or `ordinary`, the types of ordinary driving, or `all` others."""
    return names(ordinary=name == "ordinary") if name in ("all", "ordinary") else (name,)


def generate(roads: Roads, family: str, count: int, seed: int, *, maps_beside: Path | None = None) -> Generated:
    """`count` sound scenarios, fewer where the map has no room for more; UnknownNameError for an unknown family.

    `maps_beside` is the maps root in which the map lies if it is not shipped.
    """
    search = Search(roads, family, seed)
    made = Generated(family, rejected=search.rejected)
    if count < 1:
        raise InputError(f"count is {count}, expected 1 or more")
    most = max(count * CANDIDATES_PER_SCENARIO, LEAST_CANDIDATES)
    for number, found in enumerate(search, start=1):
        scenario = replace(found, maps_beside=maps_beside)
        problems = (
            start_problems(scenario, roads, with_traffic=False)
            or light_problems(scenario, roads)
            or start_problems(scenario, roads)
        )
        if problems:
            search.rejected.append(_unsound(scenario, roads, problems[0]))
        else:
            made.scenarios.append(scenario)
        if len(made.scenarios) == count or number == most:
            break
    return made


def _unsound(scenario: Scenario, roads: Roads, problem: str) -> Rejected:
    goal = scenario.goal
    return Rejected(goal.lane, goal.arc_m, f"{scenario.id} at {scenario.site(roads)}: {problem}")


def carry(made: Sequence[Generated], files: MapFiles, folder: Path, *, overwrite: bool = False) -> None:
    """Store what the scenarios need of their map in the folder, and let them take place there.

    Those that the part of the map is no longer sound for are rejected; traffic
    may begin elsewhere where the map was cut. InputError as from `carry_map`.
    """
    roads = load_roads(files.folder)
    scenarios = [scenario for each in made for scenario in each.scenarios]
    carried = carry_map(files, roads, scenarios, folder / MAPS, overwrite=overwrite)
    part = load_roads(carried.folder)
    for each in made:
        there = [replace(scenario, maps_beside=folder.resolve() / MAPS) for scenario in each.scenarios]
        problems = [start_problems(scenario, part) if len(part.lanes) < len(roads.lanes) else [] for scenario in there]
        each.scenarios = [scenario for scenario, found in zip(there, problems, strict=True) if not found]
        each.rejected += [_unsound(s, part, found[0]) for s, found in zip(there, problems, strict=True) if found]


def write_generated(
    folder: Path, made: Sequence[Generated], proofs: Iterable[Proof], *, overwrite: bool = False
) -> tuple[int, int]:
    """Write scenarios, certificates, the report and the rejected places; how many scenarios, and how many certified.

    InputError if the folder holds scenarios already and is not to be overwritten, or cannot be written.
    """
    scenarios = [scenario for each in made for scenario in each.scenarios]
    check_folder(folder, overwrite=overwrite)
    passed = write_proved(folder, scenarios, proofs)
    rows = [(each.family, r.lane, r.at_m, r.reason) for each in made for r in each.rejected]
    write_table(folder / REJECTED, ("family", "lane", "at_m", "reason"), rows)
    return len(scenarios), passed


def write_proved(folder: Path, scenarios: Sequence[Scenario], proofs: Iterable[Proof]) -> int:
    """Write scenarios, certificates and the report into a folder, made if needed; how many are certified.

    InputError if it cannot be written.
    """
    found = {proof.scenario.id: proof for proof in proofs}
    passed = [proof.certificate for proof in found.values() if proof.certificate is not None]
    with writing(folder, OTHER_FOLDER):
        folder.mkdir(parents=True, exist_ok=True)
        write_scenarios(scenarios, folder / SCENARIOS)
        certificates.write_certificates(folder / certificates.FILE, passed)
    rows = [_report_row(scenario, found.get(scenario.id)) for scenario in scenarios]
    write_table(folder / REPORT, ("scenario_id", "certified", "score", "simulations", "reason"), rows)
    return len(passed)


def _report_row(scenario: Scenario, proof: Proof | None) -> tuple[object, ...]:
    if proof is None:
        return scenario.id, False, "", "", "not looked for"
    held = proof.certificate
    score = "" if held is None else held.summary.score
    return scenario.id, held is not None, score, proof.simulations, "; ".join(proof.problems)


def write_parameters(path: Path, scenes: Iterable[tuple[str, Mapping[str, Draw]]]) -> None:
    """Write what was drawn for each scene, by its id, a row for each parameter; InputError if it cannot be written."""
    rows = ((id, name, each.value, f"{each.quantile:.6f}") for id, draws in scenes for name, each in draws.items())
    write_table(path, ("scenario_id", "parameter", "value", "quantile"), rows)


class NotedDraw(NamedTuple):
    """What `write_parameters` wrote of a draw."""

    value: str
    quantile: float


def read_parameters(path: Path) -> dict[str, dict[str, NotedDraw]]:
    """What was drawn for each scene, by id and name; InputError if it cannot be read or is something else."""
    found: dict[str, dict[str, NotedDraw]] = {}
    for row in read_table(path, ("scenario_id", "parameter", "value", "quantile")):
        draw = NotedDraw(row["value"], number_in(row["quantile"], path))
        found.setdefault(row["scenario_id"], {})[row["parameter"]] = draw
    return found


def check_folder(folder: Path, *, overwrite: bool) -> None:
    """InputError if the folder holds generated scenarios already and these are not to be overwritten."""
    if not overwrite and (folder / SCENARIOS).exists():
        raise InputError(f"{folder / SCENARIOS} exists; name another folder with --out, or give --overwrite")
