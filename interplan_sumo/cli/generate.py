"""Command `scenarios generate`: new scenarios on any map, or a whole suite of the benchmark."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from interplan_sumo.cli.certify import proved
from interplan_sumo.cli.options import DONE, INCOMPLETE, JsonOption, WorkersOption
from interplan_sumo.errors import InputError, counted
from interplan_sumo.report.printing import print_json

if TYPE_CHECKING:
    from interplan_sumo.scenario.suite import Suite

COUNT: Final = 10


def generate(
    out: Annotated[Path, typer.Option(help="The folder for scenarios, certificates and reports.")],
    map: Annotated[
        list[str] | None,
        typer.Option(help="A shipped map's name, or a folder with a map.gpkg and its network; of a suite several."),
    ] = None,
    family: Annotated[
        str | None, typer.Option(help="A family, an ordinary type, 'all' families or all 'ordinary' types.")
    ] = None,
    suite: Annotated[
        str | None,
        typer.Option(help="interplan==1, interplan-large==1 or common==1: a whole suite, on all shipped maps."),
    ] = None,
    count: Annotated[int | None, typer.Option(help=f"How many of each family. [default: {COUNT}]")] = None,
    seed: Annotated[int, typer.Option(help="Equal seeds give equal scenarios.")] = 0,
    secret_seed: Annotated[
        Path | None,
        typer.Option(
            help="Of a suite: a file whose content is the seed; the certificates go beside it, not to the scenarios."
        ),
    ] = None,
    no_certify: Annotated[bool, typer.Option("--no-certify", help="Look for no drive that passes each.")] = False,
    workers: WorkersOption = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace what the folder holds.")] = False,
    as_json: JsonOption = False,
) -> int:
    """Find sites on a map and make new scenarios there, each checked and, where a drive passes, certified.

    The folder also holds what they need of a map that is not shipped, so that it can be moved and driven anywhere.
    Exit code 3 if the map has no room for as many as were asked for. With --suite instead of --map and --family:
    all scenes of the benchmark, certified all of them; the same command goes on where it was stopped.
    """
    if suite is not None:
        said = {
            "--family": family,
            "--count": count,
            "--no-certify": no_certify or None,
            "--overwrite": overwrite or None,
        }
        if given := [name for name, value in said.items() if value is not None]:
            raise InputError(
                "--suite makes all scenes of all families, certifies each and goes on in its folder; "
                f"leave out {', '.join(given)}"
            )
        return _suite(suite, out, map or [], seed, secret_seed, workers, as_json=as_json)
    if map is None or len(map) > 1 or family is None:
        raise InputError("give one --map and a --family, or a --suite, such as --suite interplan==1")
    if secret_seed is not None:
        raise InputError("--secret-seed is for a --suite; give --seed")
    return _on_map(
        map[0], family, out, count, seed, workers, certify=not no_certify, overwrite=overwrite, as_json=as_json
    )


def _on_map(
    map: str, family: str, out: Path, count: int | None, seed: int, workers: int | None, *,
    certify: bool, overwrite: bool, as_json: bool,
) -> int:  # fmt: skip
    from interplan_sumo.maps.store import find_map, load_roads
    from interplan_sumo.verification.generation import Generated, carry, check_folder, families_of, write_generated
    from interplan_sumo.verification.generation import generate as generated
    from interplan_sumo.verification.map_bundling import own_maps_root

    check_folder(out, overwrite=overwrite)
    count = COUNT if count is None else count
    files = find_map(map)
    root = own_maps_root(files)
    made: list[Generated] = []
    for name in families_of(family):
        made.append(generated(load_roads(files.folder), name, count, seed, maps_beside=root))
        sound = counted(len(made[-1].scenarios), "sound scenario")
        print(f"{name}: {sound}, {counted(len(made[-1].rejected), 'place')} rejected", file=sys.stderr, flush=True)
    if root is not None and any(each.scenarios for each in made):
        carry(made, files, out, overwrite=overwrite)
    scenarios = [scenario for each in made for scenario in each.scenarios]
    proofs = proved(scenarios, workers) if certify else []
    total, passed = write_generated(out, made, proofs, overwrite=overwrite)
    short = {each.family: len(each.scenarios) for each in made if len(each.scenarios) < count}
    if as_json:
        print_json({"folder": str(out), "scenarios": total, "certified": passed if certify else None, "short": short})
    else:
        print(f"{counted(total, 'scenario')}{f', {passed} certified' if certify else ''}: {out}")
        for name, number in short.items():
            print(f"{name}: {number} of {count}; {out / 'rejected.csv'} says why places do not suit")
    return INCOMPLETE if short else DONE


def _suite(
    suite: str, out: Path, map_names: list[str], seed: int, secret: Path | None, workers: int | None, *, as_json: bool
) -> int:
    from interplan_sumo.batch.suite_job import verdicts
    from interplan_sumo.maps.store import find_map, load_roads, maps
    from interplan_sumo.verification.suite_candidates import Candidate
    from interplan_sumo.verification.suite_generation import CANDIDATES, SuiteSearch, counts, write_suites
    from interplan_sumo.verification.suite_judging import Verdict
    from interplan_sumo.verification.suite_slots import Seed, size_of

    size_of(suite)
    roads = [load_roads(find_map(name).name) for name in map_names or maps()]
    begun = None if secret is not None or map_names else _beginning(suite)
    search = SuiteSearch(suite, roads, Seed(seed) if secret is None else Seed.secret(secret_of(secret)), begun)

    def tell(candidate: Candidate, verdict: Verdict) -> None:
        found = "taken" if verdict.taken else f"{verdict.stage}: {verdict.scenario}: {verdict.reason}"
        print(f"{candidate.slot.name}, try {candidate.attempt + 1}, {candidate.block}: {found}", file=sys.stderr)

    kept_back = None if secret is None else kept_back_by(secret, out)
    search.run(lambda candidates: verdicts(candidates, out / CANDIDATES, workers=workers), tell)
    folders = write_suites(search, out, kept_back=kept_back)
    scenes = sum(len(slot.families) for slot in search.filled)
    missing = [slot.name for slot in search.missing]
    reasons = counts(search.rejections())
    if as_json:
        rows = [{"stage": stage, "reason": reason, "count": number} for number, stage, reason in reasons]
        print_json(
            {"folders": [str(each) for each in folders], "scenarios": scenes, "missing": missing, "rejected": rows}
        )
    else:
        for number, stage, reason in reasons:
            print(f"{number:6d}  {stage:12s} {reason}")
        print(f"{counted(scenes, 'scenario')}, all certified: {', '.join(str(each) for each in folders)}")
        if kept_back is not None:
            print(f"their certificates, to be kept back: {kept_back}")
        if missing:
            print(f"nothing found for {', '.join(missing)}; {out / 'rejected.csv'} says why, another --seed may do")
    return INCOMPLETE if missing else DONE


def _beginning(suite: str) -> Suite | None:
    """What there is of a suite, else the released one that it begins with; the smallest of all is made anew."""
    from interplan_sumo.scenario.suite import find_suite, suites
    from interplan_sumo.verification.suite_slots import beginnings

    there = [key for key, _ in beginnings(suite) if key in suites()]
    return find_suite(there[-1]) if there and len(beginnings(suite)) > 1 else None


def secret_of(path: Path) -> bytes:
    """The content of a file with a secret; InputError if it cannot be read, or is soon guessed."""
    try:
        text = path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    if len(text.strip()) < 16:
        raise InputError(f"{path} holds {len(text.strip())} characters, expected 16 or more, so that nobody guesses it")
    return text


def kept_back_by(secret: Path, out: Path) -> Path:
    """Where certificates of a secret seed go; InputError if there are some of scenes elsewhere than in `out`."""
    path = secret.with_name(f"{secret.name}.certificates.parquet")
    if path.exists() and not any(out.glob("**/scenarios.yaml")):
        raise InputError(
            f"{path} holds the certificates of scenes that are not in {out}; give another file as --secret-seed"
        )
    return path
