"""Command `scenarios harden`: scenes in which given planners do badly, each proved solvable and solved by somebody."""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from interplan_sumo.cli.completion import map_names
from interplan_sumo.cli.options import DONE, INCOMPLETE, JsonOption, QuietOption, take_one_thread
from interplan_sumo.errors import counted
from interplan_sumo.report.printing import print_json

if TYPE_CHECKING:
    from collections.abc import Sequence

    from interplan_sumo.maps.store import MapFiles
    from interplan_sumo.verification.hard_search import HardSearch
    from interplan_sumo.world.roads import Roads


def harden(
    family: Annotated[list[str], typer.Option(help="A family, 'all'; repeatable.")],
    against: Annotated[
        str, typer.Option(help="The panel: planners that are to do badly, with commas between.", metavar="P,Q,...")
    ],
    out: Annotated[Path, typer.Option(help="The folder; the same command on it goes on.", metavar="DIR")],
    map: Annotated[
        list[str] | None,
        typer.Option(
            help="A shipped map's name, or a folder with a map.gpkg. Repeat for several. Default: all shipped ones.",
            autocompletion=map_names,
        ),
    ] = None,
    count: Annotated[int, typer.Option(help="Scenes; families share them.")] = 10,
    seed: Annotated[int, typer.Option(help="Equal seeds give equal scenes, however many work.")] = 0,
    secret_seed: Annotated[
        Path | None,
        typer.Option(help="A file whose content is the seed; the certificates go beside it, not to the scenarios."),
    ] = None,
    difficulty: Annotated[float, typer.Option(help="The share of the panel that must fail in a scene.")] = 0.5,
    plausibility: Annotated[
        float, typer.Option(help="The share of the family's own scenes that must be no more likely than it.")
    ] = 0.05,
    budget: Annotated[int, typer.Option(help="Scenes to drive of each family, up to a batch of 16 more.")] = 2000,
    workers: Annotated[
        str | None,
        typer.Option(
            help="Processes; 0 works in this one; ray[:ADDRESS] takes a Ray cluster. Default: all cores.",
            metavar="N|ray",
        ),
    ] = None,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> int:
    """Search the parameters of families for scenes in which a panel of planners fails, and that can be solved.

    Each scene passes the start checks and has a certificate, and a planner without privileged knowledge solves it:
    one of the panel, or one that it does not have. Exit code 3 if the budget ends before there are as many.
    A folder with scenes of anything else, be it of another search, is left as it is.
    """
    take_one_thread()
    from interplan_sumo.batch.hard_job import hard_verdicts
    from interplan_sumo.batch.processes import Workers
    from interplan_sumo.cli.generate import kept_back_by, secret_of
    from interplan_sumo.families import FAMILIES
    from interplan_sumo.maps.store import find_map, maps
    from interplan_sumo.planner import find_planner
    from interplan_sumo.verification.generation import families_of
    from interplan_sumo.verification.hard_asked import HardAsked
    from interplan_sumo.verification.hard_folder import CANDIDATES, write_hard
    from interplan_sumo.verification.hard_search import HardOptions, HardSearch, shares
    from interplan_sumo.verification.quality_diversity import check_optimiser
    from interplan_sumo.verification.suite_slots import Seed

    check_optimiser()
    who = Workers.parse(workers)
    panel = tuple(name.strip() for name in against.split(",") if name.strip())
    for name in panel:
        find_planner(name)
    families = list(dict.fromkeys(each for name in family for each in families_of(name)))
    for each in families:
        FAMILIES[each]
    given = Seed(seed, f"hard-{seed}-") if secret_seed is None else Seed.secret(secret_of(secret_seed))
    every = [
        HardOptions(name, panel, share, given, difficulty, plausibility, budget)
        for name, share in shares(count, families, last_first=secret_seed is not None).items()
    ]
    places = [find_map(name) for name in map or maps()]
    asked = HardAsked.of(every, places)
    asked.check(out)
    kept_back = None if secret_seed is None else kept_back_by(secret_seed, out)
    roads, maps_beside = _carried(places, out)
    searches: list[HardSearch] = []

    def tell(search: HardSearch) -> None:
        if not quiet:
            print(_line(search), file=sys.stderr, flush=True)

    for options in every:
        search = HardSearch.of(roads, replace(options, maps_beside=maps_beside))
        search.run(lambda candidates: hard_verdicts(candidates, out / CANDIDATES, who), tell)
        searches.append(search)
    asked.write(out)
    write_hard(searches, out, kept_back=kept_back)
    _print(searches, out, kept_back, as_json=as_json)
    return DONE if all(search.complete for search in searches) else INCOMPLETE


def _carried(maps: Sequence[MapFiles], out: Path) -> tuple[list[Roads], Path | None]:
    """The roads to search on, and where maps that are not shipped lie then: whole, as the scenes are driven there."""
    from interplan_sumo.maps.store import load_roads
    from interplan_sumo.scenario.files import MAPS
    from interplan_sumo.verification.map_bundling import carry_map, own_maps_root

    found: list[Roads] = []
    beside: Path | None = None
    for files in maps:
        if own_maps_root(files) is not None:
            roads = load_roads(files.folder)
            files = carry_map(files, roads, (), out / MAPS, overwrite=True, whole_lanes=len(roads.lanes))
            beside = (out / MAPS).resolve()
        found.append(load_roads(files.folder))
    return found, beside


def _line(search: HardSearch) -> str:
    """How far the search has come: yield, and what a scene costs."""
    options, many = search.options, len(search.taken)
    said = ", ".join(f"{number} {stage}" for stage, number in _stages([search]).most_common())
    each = f", {search.cpu_s / many:.0f} for each" if many else ""
    return (
        f"{options.family}: {len(search.judged)} driven ({said}); {many} of {options.count} taken; "
        f"{search.cpu_s:.0f} CPU s{each}"
    )


def _stages(searches: Sequence[HardSearch]) -> Counter[str]:
    """How many of the scenes that were driven failed at which check."""
    return Counter(each.verdict.stage or "hard" for search in searches for each in search.judged)


def _print(searches: Sequence[HardSearch], out: Path, kept_back: Path | None, *, as_json: bool) -> None:
    stages = _stages(searches)
    passed_over = sum((search.passed_over for search in searches), Counter[str]())
    taken = [each for search in searches for each in search.taken]
    asked = sum(search.options.count for search in searches)
    mean = sum(each.verdict.mean_score for each in taken) / len(taken) if taken else None
    if as_json:
        print_json(
            {
                "folder": str(out),
                "scenarios": len(taken),
                "asked": asked,
                "driven": stages.total(),
                "stages": dict(stages),
                "not_driven": dict(passed_over),
                "mean_score": mean,
                "families": {
                    search.options.family: {
                        "scenarios": len(search.taken),
                        "driven": len(search.judged),
                        "plausible_share": round(search.plausible_share, 4),
                        "cpu_s": round(search.cpu_s, 1),
                    }
                    for search in searches
                },
                "certificates": str(kept_back) if kept_back else None,
            }
        )
        return
    for stage, number in [*passed_over.most_common(), *stages.most_common()]:
        print(f"{number:6d}  {stage}")
    for search in searches:
        plausible = f"plausible enough are {search.plausible_share:.0%} of the scenes that found room"
        print(f"{search.options.family}: {counted(len(search.taken), 'scene')}; {plausible}")
    hard = "" if mean is None else f", the panel scores {100.0 * mean:.0f} in them"
    print(f"{len(taken)} of {counted(asked, 'scenario')}, all certified and solved by somebody{hard}: {out}")
    if kept_back is not None:
        print(f"their certificates, to be kept back: {kept_back}")
    if len(taken) < asked:
        print(f"a larger --budget, another --seed or more maps may do; {out / 'rejected.csv'} says what was tried")
