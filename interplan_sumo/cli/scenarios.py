"""Commands about scenarios: list, show, export, validate, render, freeze."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from interplan_sumo.cli.completion import scenario_ids, scenes, suite_names
from interplan_sumo.cli.options import BAD_INPUT, DONE, LOOKS, JsonOption
from interplan_sumo.errors import InputError, counted
from interplan_sumo.report.printing import print_entries, print_json

if TYPE_CHECKING:
    from interplan_sumo.scenario.scenario import Scenario

scenarios_app = typer.Typer(help="The official scenarios, and one's own.", **LOOKS)


@scenarios_app.command("list")
def list_scenarios(
    place: Annotated[
        Path | None,
        typer.Argument(
            help="Scenarios of one's own: a file, or a folder with scenarios.yaml.", metavar="FILE.yaml|DIR"
        ),
    ] = None,
    suite: Annotated[
        str | None, typer.Option(help="NAME==VERSION; default: all suites.", autocompletion=suite_names)
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """The official scenarios, or one's own: where each is, what its traffic does, and who solves it."""
    from interplan_sumo.report.listings import certified, file_entries, in_words, suite_entries

    if place is not None and suite is not None:
        raise InputError(f"{place} and --suite {suite} are two lists; give one of them")
    if place is not None:
        entries = file_entries(place)
    else:
        entries = [certified(each) if as_json else each for each in suite_entries(suite)]
    hidden = ("hash", "certificate")
    print_entries(entries if as_json else list(map(in_words, entries)), as_json=as_json, hide=hidden)


@scenarios_app.command("show")
def show_scenario(
    what: Annotated[
        str,
        typer.Argument(
            help="A scenario id, such as nudge/0; or a file.", metavar="ID|FILE.yaml|DIR", autocompletion=scenario_ids
        ),
    ],
    as_json: JsonOption = False,
) -> None:
    """One scenario: where it is, what stands in the way, what the traffic does. Of a file all, as a JSON list."""
    from interplan_sumo.batch.jobs import scenario_file
    from interplan_sumo.report.listings import file_details, scenario_details
    from interplan_sumo.scenario.suite import find_scenario

    file = scenario_file(what)
    details = [scenario_details(find_scenario(what))] if file is None else file_details(Path(file))
    if as_json:
        print_json(details[0] if file is None else details)
    else:
        import yaml

        print(yaml.safe_dump_all(details, sort_keys=False, allow_unicode=True), end="")


@scenarios_app.command("export")
def export_scenario(
    scenario_id: Annotated[
        str, typer.Argument(help="A scenario id, such as nudge/0.", metavar="ID", autocompletion=scenario_ids)
    ],
    file: Annotated[Path, typer.Argument(help="Written over, if it is there.", metavar="FILE.yaml")],
) -> None:
    """Write a scenario as a file to edit; `run --scenarios FILE.yaml` drives it."""
    from interplan_sumo.scenario.files import write_scenario
    from interplan_sumo.scenario.suite import find_scenario

    write_scenario(find_scenario(scenario_id), file)
    print(f"wrote {file}; check it: interplan-sumo scenarios validate {file}")


@scenarios_app.command("validate")
def validate_scenarios(
    files: Annotated[list[Path] | None, typer.Argument(help="Scenario files.", metavar="FILE.yaml|DIR")] = None,
    suite: Annotated[
        str | None, typer.Option(help="NAME==VERSION: the scenarios of a suite.", autocompletion=suite_names)
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Only geometry: do not start SUMO for the traffic.")] = False,
    as_json: JsonOption = False,
) -> int:
    """Are scenarios sound at the start? One line for each breach of the rules; exit code 2 if there is any."""
    from interplan_sumo.verification.start_checks import notes, validate

    found, problems = _to_validate(files or [], suite)
    for source, scenario in found:
        problems += [(source, scenario.id, text) for text in validate(scenario, with_traffic=not quick)]
    noted = [(source, scenario.id, text) for source, scenario in found for text in notes(scenario)]
    if as_json:
        rows = [dict(zip(("source", "id", "problem"), problem, strict=True)) for problem in problems]
        told = [dict(zip(("source", "id", "note"), note, strict=True)) for note in noted]
        print_json({"ok": not problems, "scenarios": len(found), "problems": rows, "notes": told})
    else:
        for note in noted:
            print(f"note: {': '.join(note)}", file=sys.stderr)
        for problem in problems:
            print(f"error: {': '.join(part for part in problem if part)}", file=sys.stderr)
        print(f"{counted(len(found), 'scenario')}, {counted(len(problems), 'problem')}")
    return BAD_INPUT if problems else DONE


@scenarios_app.command("render")
def render_scenario(
    what: Annotated[
        str,
        typer.Argument(
            help="A scenario id; or a file or NAME==VERSION, of which several are drawn as one sheet.",
            metavar="ID|FILE.yaml|DIR|SUITE",
            autocompletion=scenes,
        ),
    ],
    picture: Annotated[Path, typer.Argument(help="Its ending says which kind.", metavar="FILE.png")],
) -> None:
    """Draw a scenario: ego, route, goal, obstacles, pedestrians and their ways, the traffic at the start."""
    from interplan_sumo.maps.store import load_roads
    from interplan_sumo.report import scenario_picture

    scenarios = _named(what)
    if len(scenarios) == 1:
        scenario_picture.render_scenario(scenarios[0], load_roads(scenarios[0].map, scenarios[0].maps_beside), picture)
    else:
        scenario_picture.contact_sheet(scenarios, picture)
    print(f"wrote {picture}")


@scenarios_app.command("freeze")
def freeze_suite(
    suite: Annotated[
        str | None,
        typer.Option(help="NAME==VERSION of one that is not released yet. Default: all.", autocompletion=suite_names),
    ] = None,
) -> None:
    """Write the locks of suites anew. For maintainers: it says what the scenarios are, and who solves them."""
    from interplan_sumo.scenario.suite import find_suite, suites
    from interplan_sumo.verification.lock import write_lock

    for each in suites() if suite is None else [suite]:
        print(write_lock(find_suite(each)))


def _named(what: str) -> tuple[Scenario, ...]:
    """The scenarios of a file or a suite, or the one with this id."""
    from interplan_sumo.batch.jobs import scenario_file
    from interplan_sumo.scenario.files import read_scenarios
    from interplan_sumo.scenario.suite import find_scenario, find_suite

    file = scenario_file(what)
    if file is not None:
        return read_scenarios(file)
    return find_suite(what).scenarios if "==" in what else (find_scenario(what),)


def _to_validate(files: list[Path], suite: str | None) -> tuple[list[tuple[str, Scenario]], list[tuple[str, str, str]]]:
    """Scenarios with where they come from; and (source, id, problem) of files that cannot be read."""
    from interplan_sumo.batch.jobs import scenario_file
    from interplan_sumo.errors import ScenarioError
    from interplan_sumo.scenario.files import read_scenarios
    from interplan_sumo.scenario.suite import find_suite

    if not files and suite is None:
        raise InputError("nothing to validate; name a FILE.yaml, or a suite with --suite")
    found = [(suite, scenario) for scenario in find_suite(suite).scenarios] if suite is not None else []
    problems: list[tuple[str, str, str]] = []
    for each in map(str, files):
        file = scenario_file(each) or each
        try:
            found += [(file, scenario) for scenario in read_scenarios(file)]
        except ScenarioError as error:
            problems.append(("", "", str(error)))
    return found, problems
