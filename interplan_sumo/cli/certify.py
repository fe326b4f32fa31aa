"""Command `scenarios certify`: prove each scenario of a suite or a file solvable, or check the stored proofs."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from interplan_sumo.cli.completion import suite_names
from interplan_sumo.cli.options import DONE, INCOMPLETE, OUR_FAULT, JsonOption, WorkersOption
from interplan_sumo.errors import InputError
from interplan_sumo.report.printing import print_json

if TYPE_CHECKING:
    from interplan_sumo.scenario.certificates import Certificate, Summary
    from interplan_sumo.scenario.scenario import Scenario
    from interplan_sumo.verification.certificates import Proof


def certify(
    suite: Annotated[str | None, typer.Option(help="NAME==VERSION.", autocompletion=suite_names)] = None,
    scenarios: Annotated[
        list[str] | None,
        typer.Option(help="Only ids that match, such as 'nudge/*'; or a FILE.yaml, or the folder it lies in."),
    ] = None,
    workers: WorkersOption = None,
    check: Annotated[bool, typer.Option("--check", help="Only replay the stored drives and judge them again.")] = False,
    panel: Annotated[
        str | None,
        typer.Option(help="Planners that try what is certified, with commas between; '' for none. [by rules: four]"),
    ] = None,
    as_json: JsonOption = False,
) -> int:
    """Prove scenarios solvable: search a drive that passes, and store it with the suite or file as its expert.

    The certificate also says which planners of the panel solve the scenario; it is open if none does.
    Those of a released suite stay as they are: they can be checked only.
    Exit code 3 if a scenario could not be certified, 1 if a stored proof does not hold.
    """
    from interplan_sumo.batch.jobs import chosen, split_files
    from interplan_sumo.planner import find_planner
    from interplan_sumo.scenario import certificates
    from interplan_sumo.scenario.suite import DEFAULT_SUITE, LOCK
    from interplan_sumo.verification.solvers import PANEL

    files, globs = split_files(scenarios or ())
    everyone, path = _source(suite, files)
    if not check and path.with_name(LOCK).is_file():
        raise InputError(
            f"the certificates of {''.join(files) or suite or DEFAULT_SUITE} are released ({LOCK} lies beside them); "
            "give --check, or certify a file of your own: interplan-sumo scenarios export ID mine.yaml"
        )
    wanted = chosen(everyone, globs)
    stored = certificates.read_certificates(path) if path.is_file() else {}
    asked = list(PANEL) if panel is None else [name.strip() for name in panel.split(",") if name.strip()]
    for name in asked:
        find_planner(name)
    found: list[Proof] = []
    try:
        for proof in proved(wanted, workers, stored if check else None, asked or None):
            found.append(proof)
    finally:
        if not check and found:
            keep_proofs(path, found, everyone, beside=bool(files))
    found.sort(key=lambda proof: [s.id for s in wanted].index(proof.scenario.id))
    failed = [proof for proof in found if proof.certificate is None]
    _print(found, str(path), as_json=as_json)
    return DONE if not failed else OUR_FAULT if check else INCOMPLETE


def keep_proofs(path: Path, found: Sequence[Proof], everyone: Sequence[Scenario], *, beside: bool) -> None:
    """Put the certificates that were found beside those of a file, in the place of former ones.

    Where a search found none a former one stays if it holds. Those of scenarios that have changed or are no more go,
    unless they may be of another file (`beside`).
    """
    from interplan_sumo.scenario import certificates
    from interplan_sumo.verification.certificates import check_certificate
    from interplan_sumo.world.files import replacing, writing

    stored = certificates.read_certificates(path) if path.is_file() else {}
    known = {s.id: s.hash() for s in everyone}
    if beside:
        known = {name: c.summary.scenario_hash for name, c in stored.items()} | known
    kept = {name: c for name, c in stored.items() if known.get(name) == c.summary.scenario_hash}
    for proof in found:
        name = proof.scenario.id
        if proof.certificate is not None:
            kept[name] = proof.certificate
        elif name in kept and check_certificate(proof.scenario, kept[name]):
            del kept[name]
    with writing(path, "make its folder writable, or certify a copy of the file"), replacing(path) as fresh:
        certificates.write_certificates(fresh, kept.values())


def proved(
    scenarios: Sequence[Scenario],
    workers: int | None,
    stored: dict[str, Certificate] | None = None,
    panel: Sequence[str] | None = None,
) -> Iterator[Proof]:
    """`proofs` as they come, each with a line on stderr."""
    from interplan_sumo.batch.certify_job import proofs

    for number, proof in enumerate(proofs(scenarios, workers=workers, stored=stored, panel=panel), start=1):
        print(f"[{number}/{len(scenarios)}] {_line(proof)}", file=sys.stderr, flush=True)
        yield proof


def _source(suite: str | None, files: Sequence[str]) -> tuple[tuple[Scenario, ...], Path]:
    """All scenarios of the suite or the file, and where their certificates lie.

    Of a suite that goes on from another one its own: the others' lie there.
    """
    from interplan_sumo.scenario import certificates
    from interplan_sumo.scenario.files import read_scenarios
    from interplan_sumo.scenario.suite import DEFAULT_SUITE, SCENARIOS, find_suite

    if files:
        if suite is not None or len(files) > 1:
            raise InputError(f"{files[0]} and {suite or files[1]} are two sources of scenarios; give one of them")
        return read_scenarios(files[0]), Path(files[0]).parent / certificates.FILE
    found = find_suite(suite or DEFAULT_SUITE)
    own = found.folder / SCENARIOS
    return read_scenarios(own) if own.is_file() else found.scenarios, found.folder / certificates.FILE


def _line(proof: Proof) -> str:
    if proof.certificate is None:
        return f"{proof.scenario.id}: not certified: {'; '.join(proof.problems)}"
    summary = proof.certificate.summary
    return (
        f"{proof.scenario.id}: score {summary.score:.3f}, {summary.distance_m:.0f} of "
        f"{summary.reference_distance_m:.0f} m, {proof.simulations} simulations, {proof.wall_s:.1f} s{_solved(summary)}"
    )


def _solved(summary: Summary) -> str:
    if summary.solved_by is None:
        return ""
    return f", solved by {summary.solved_words}" if summary.solved_by else ", open: nobody of the panel solves it"


def _print(found: list[Proof], path: str, *, as_json: bool) -> None:
    if as_json:
        from dataclasses import asdict

        rows = [
            {
                "id": proof.scenario.id,
                "certificate": None if proof.certificate is None else asdict(proof.certificate.summary),
                "problems": list(proof.problems),
                "simulations": proof.simulations,
                "wall_s": round(proof.wall_s, 3),
            }
            for proof in found
        ]
        print_json({"ok": all(proof.certificate is not None for proof in found), "file": path, "scenarios": rows})
        return
    certified = [proof for proof in found if proof.certificate is not None]
    for proof in found:
        if proof.certificate is None:
            print(_line(proof))
    print(f"{len(certified)} of {len(found)} certified: {path}")
