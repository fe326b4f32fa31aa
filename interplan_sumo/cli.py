"""Commands: parsing and printing only; the work is in the library.

Exit codes: 0 done; 1 a fault of ours or of SUMO; 2 bad input; 3 the run is incomplete.
"""

from __future__ import annotations

import contextlib
import os
import shlex
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from interplan_sumo import __version__
from interplan_sumo.errors import InputError, InterplanError
from interplan_sumo.report.printing import (
    Form,
    print_comparison,
    print_entries,
    print_json,
    print_table,
    progress,
    write_page,
)

if TYPE_CHECKING:
    from interplan_sumo.batch.run_folder import StoredRun

DONE, OUR_FAULT, BAD_INPUT, INCOMPLETE = 0, 1, 2, 3

_LOOKS: dict[str, Any] = {"no_args_is_help": True, "add_completion": True, "pretty_exceptions_enable": False}
app = typer.Typer(name="interplan-sumo", rich_markup_mode="rich", **_LOOKS)
scenarios_app = typer.Typer(help="The official scenarios.", **_LOOKS)
planners_app = typer.Typer(help="Registered planners, and the conformance suite.", **_LOOKS)
maps_app = typer.Typer(help="Maps and their SUMO networks.", **_LOOKS)
app.add_typer(scenarios_app, name="scenarios")
app.add_typer(planners_app, name="planners")
app.add_typer(maps_app, name="maps")

_UsageError: type[Exception] = next(kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "ClickException")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; its exit code. The one place where errors become a line on stderr."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    try:
        code = app(args=given, prog_name="interplan-sumo", standalone_mode=False, obj=given)
        sys.stdout.flush()
        return int(code or DONE)
    except _UsageError as error:
        if type(error).__name__ == "NoArgsIsHelpError":
            error.show()  # type: ignore[attr-defined]
            return BAD_INPUT
        message = " ".join(str(error.format_message()).split())  # type: ignore[attr-defined]
        return _failed(
            f"{message if message.endswith(('.', '?')) else f'{message}.'} See: interplan-sumo {_command(given)}--help",
            BAD_INPUT,
        )
    except InputError as error:
        return _failed(str(error), BAD_INPUT)
    except InterplanError as error:
        return _failed(str(error), OUR_FAULT)
    except BrokenPipeError:  # the reader has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE


def _failed(message: str, code: int) -> int:
    print(f"error: {' '.join(message.split())}", file=sys.stderr)
    return code


def _command(arguments: Sequence[str]) -> str:
    """The commands that were named before something went wrong: `scenarios list `."""
    groups = {g.name: g.typer_instance for g in app.registered_groups if g.name and g.typer_instance}
    words, here = "", app
    for word in arguments:
        names = {c.name or getattr(c.callback, "__name__", "") for c in here.registered_commands}
        if word not in names and not (here is app and word in groups):
            break
        words += f"{word} "
        here = groups.get(word, typer.Typer()) if here is app else typer.Typer()
    return words


def _version(asked: bool) -> None:
    if asked:
        print(f"interplan-sumo {__version__}")
        raise typer.Exit


@app.callback()
def interplan_sumo(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and leave.")
    ] = False,
) -> None:
    """Can a motion planner cope with rare, interactive traffic? A closed-loop benchmark on SUMO."""


def _planner_names(incomplete: str) -> list[str]:
    from interplan_sumo.planner import registered

    return [name for name in registered() if name.startswith(incomplete)]


def _scenario_ids(incomplete: str) -> list[str]:
    from interplan_sumo.scenario.suite import suites

    return sorted({s.id for suite in suites().values() for s in suite.scenarios if s.id.startswith(incomplete)})


PlannerOption = Annotated[
    list[str] | None,
    typer.Option(
        "--planner",
        help="A registered name, module:Class, or name?option=value&... Default: the recommended one.",
        autocompletion=_planner_names,
    ),
]
MapArgument = Annotated[str, typer.Argument(help="A folder with a map.gpkg, or a shipped map's name.", metavar="DIR")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")]


@app.command()
def run(
    context: typer.Context,
    planner: PlannerOption = None,
    suite: Annotated[str | None, typer.Option(help="NAME==VERSION.")] = None,
    scenarios: Annotated[list[str] | None, typer.Option(help="Only ids that match, such as 'nudge/*'.")] = None,
    seeds: Annotated[int, typer.Option(help="Seeds 0 to N-1; seed 0 is the certified one.")] = 1,
    workers: Annotated[int | None, typer.Option(help="Processes; 0 runs in this one. Default: all cores.")] = None,
    out: Annotated[Path | None, typer.Option(help="The run folder; the same command on it goes on.")] = None,
    traffic: Annotated[Path | None, typer.Option(help="A vehicle-type file instead of the scenarios' own.")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="density=low|medium|high or behaviour=NAME.")] = None,
    limit: Annotated[int | None, typer.Option(help="At most so many scenarios.")] = None,
    plan_limit: Annotated[float, typer.Option(help="Seconds that one plan() call may take; 0 for no limit.")] = 10.0,
    job_limit: Annotated[float, typer.Option(help="Seconds that one drive may take; 0 for no limit.")] = 3600.0,
    memory_gb: Annotated[float, typer.Option(help="Memory that a worker may allocate (Linux); 0 for no limit.")] = 8.0,
    quiet: Annotated[bool, typer.Option("--quiet", help="No progress.")] = False,
    as_json: JsonOption = False,
) -> int:
    """Drive and score scenarios, and print the table. Repeating the command on the same folder resumes it."""
    from interplan_sumo.batch.processes import SINGLE_THREAD, available_cores

    os.environ.update({name: os.environ.get(name, value) for name, value in SINGLE_THREAD.items()})
    from interplan_sumo.batch import run as batch
    from interplan_sumo.batch.jobs import Overrides
    from interplan_sumo.batch.tasks import Limits
    from interplan_sumo.planner import RECOMMENDED
    from interplan_sumo.scenario.suite import DEFAULT_SUITE

    folder = out or Path("runs") / f"{time.strftime('%Y%m%d-%H%M%S')}-{os.getpid()}"
    command = ["interplan-sumo", *context.obj, *([] if out else ["--out", str(folder)])]
    request = batch.RunRequest(
        planners=tuple(planner or (RECOMMENDED,)),
        suite=suite or DEFAULT_SUITE,
        folder=folder,
        scenarios=tuple(scenarios or ()),
        seeds=seeds,
        workers=available_cores() if workers is None else workers,
        overrides=Overrides.parse(set_ or (), traffic),
        limit=limit,
        limits=Limits(
            plan_s=plan_limit or float("inf"),
            task_s=job_limit or float("inf"),
            memory_bytes=round(memory_gb * 2**30) or None,
        ),
        command=tuple(command),
    )
    stdout = contextlib.redirect_stdout(sys.stderr) if as_json else contextlib.nullcontext()
    try:
        with progress(quiet=quiet) as watch, stdout:  # in-process planners may print: not into the JSON
            stored = batch.run(request, watch)
    except KeyboardInterrupt:
        print(f"stopped; what was done is kept. Go on with: {shlex.join(command)}", file=sys.stderr)
        return INCOMPLETE
    if not quiet:
        print(f"results in {folder}", file=sys.stderr)
    return _report([stored], "json" if as_json else "text", folder / "report.html")


@app.command()
def report(
    folders: Annotated[list[Path], typer.Argument(help="Run folders.", metavar="DIR...")],
    as_json: JsonOption = False,
    as_csv: Annotated[bool, typer.Option("--csv", help="Print the table as CSV.")] = False,
    as_markdown: Annotated[bool, typer.Option("--markdown", help="Print the table as Markdown.")] = False,
    html: Annotated[Path | None, typer.Option(help="Write one self-contained page.", metavar="FILE")] = None,
    paper: Annotated[bool, typer.Option("--paper", help="Add the published rows for comparison.")] = False,
    why: Annotated[bool, typer.Option("--why", help="One sentence for every zero and every lost gate.")] = False,
    details: Annotated[
        bool, typer.Option("--details", help="Every drive with its score and what cost points.")
    ] = False,
) -> int:
    """The paper's table of one or more runs, with faults, missing rows and intervals over seeds."""
    from interplan_sumo.batch.run_folder import read_run

    asked: list[tuple[Form, bool]] = [("json", as_json), ("csv", as_csv), ("markdown", as_markdown)]
    forms: list[Form] = [form for form, wanted in asked if wanted]
    if len(forms) > 1:
        raise InputError(f"--{forms[0]} and --{forms[1]} both print on stdout; give one of them")
    runs = [read_run(folder) for folder in folders]
    return _report(runs, forms[0] if forms else "text", html, paper=paper, why=why, details=details)


@app.command()
def score(
    folder: Annotated[Path, typer.Argument(help="A run folder.", metavar="DIR")],
    profile: Annotated[str | None, typer.Option(help="interplan-paper, interplan-code or nuplan.")] = None,
    out: Annotated[Path | None, typer.Option(help="Write the rows, as in results.jsonl.", metavar="FILE")] = None,
    as_json: JsonOption = False,
) -> int:
    """Score stored traces again, under any profile, without simulating."""
    from interplan_sumo.batch.run_folder import write_rows
    from interplan_sumo.metrics.score import DEFAULT_PROFILE

    scored = _rescored(folder, profile or DEFAULT_PROFILE)
    if out is not None:
        write_rows(out, scored.rows.values())
    return _report([scored], "json" if as_json else "text")


@app.command()
def compare(
    folder_a: Annotated[Path, typer.Argument(help="A run folder.", metavar="DIR_A")],
    folder_b: Annotated[Path, typer.Argument(help="The run folder to hold against it.", metavar="DIR_B")],
    planner_a: Annotated[str | None, typer.Option(help="Which planner, where DIR_A holds several.")] = None,
    planner_b: Annotated[str | None, typer.Option(help="Which planner, where DIR_B holds several.")] = None,
    profile: Annotated[str | None, typer.Option(help="Score both again under this profile first.")] = None,
    as_json: JsonOption = False,
) -> int:
    """B against A, paired on equal scenario and seed: the mean difference with its interval, and what changed most."""
    from interplan_sumo.batch.run_folder import read_run
    from interplan_sumo.report.compare import compare as compare_runs

    run_a, run_b = (read_run(f) if profile is None else _rescored(f, profile) for f in (folder_a, folder_b))
    found = compare_runs(run_a, run_b, planner_a, planner_b)
    print_comparison(found, as_json=as_json)
    return DONE if found.complete else INCOMPLETE


@app.command()
def doctor(as_json: JsonOption = False) -> int:
    """Versions, native libraries, data files, and a two-second self-test."""
    from dataclasses import asdict

    from interplan_sumo.doctor import examine

    found = examine()
    if as_json:
        print_json({"ok": found.ok, **asdict(found)})
    else:
        for name, value in {**found.versions, **found.machine}.items():
            print(f"{name:>16}  {value}")
        for check in found.checks:
            print(f"{'ok' if check.ok else 'FAILED':>16}  {check.name}: {check.detail}")
    return DONE if found.ok else OUR_FAULT


@scenarios_app.command("list")
def list_scenarios(
    suite: Annotated[str | None, typer.Option(help="NAME==VERSION; default: all suites.")] = None,
    as_json: JsonOption = False,
) -> None:
    """The official scenarios: where each is and what its traffic does."""
    from interplan_sumo.report.listings import scenario_entry
    from interplan_sumo.scenario.suite import find_suite, suites

    chosen = [find_suite(suite)] if suite else list(suites().values())
    scenarios = {s.id: s for one in chosen for s in one.scenarios}
    print_entries([scenario_entry(s) for s in scenarios.values()], as_json=as_json, hide=("hash", "certificate"))


@scenarios_app.command("show")
def show_scenario(
    scenario_id: Annotated[
        str, typer.Argument(help="A scenario id, such as nudge/0.", metavar="ID", autocompletion=_scenario_ids)
    ],
    as_json: JsonOption = False,
) -> None:
    """One scenario: where it is, what stands in the way, what the traffic does."""
    from interplan_sumo.report.listings import scenario_details
    from interplan_sumo.scenario.suite import find_scenario

    details = scenario_details(find_scenario(scenario_id))
    if as_json:
        print_json(details)
    else:
        import yaml

        print(yaml.safe_dump(details, sort_keys=False, allow_unicode=True), end="")


@scenarios_app.command("freeze")
def freeze_suite(
    suite: Annotated[str, typer.Option(help="NAME==VERSION of a suite that is not released yet.")],
) -> None:
    """Record the expert drives and the lock of a suite anew. For maintainers: it changes what scores mean."""
    from interplan_sumo.proving.experts import write_experts
    from interplan_sumo.proving.lock import write_lock
    from interplan_sumo.scenario.suite import find_suite

    chosen = find_suite(suite)
    for path in (write_experts(chosen), write_lock(chosen)):
        print(path)


@planners_app.command("list")
def list_planners(as_json: JsonOption = False) -> None:
    """Registered planners with their options; `run` takes any of them, or module:Class."""
    from interplan_sumo.report.listings import planner_entries

    print_entries(planner_entries(), as_json=as_json)


@planners_app.command("check")
def check_planner(
    name: Annotated[str, typer.Argument(help="As run --planner takes it.", metavar="P", autocompletion=_planner_names)],
    as_json: JsonOption = False,
) -> int:
    """The conformance suite on one planner: what would be a fault in a run, and what is likely a mistake."""
    from dataclasses import asdict

    from interplan_sumo import testing
    from interplan_sumo.planner import load_planner

    with contextlib.redirect_stdout(sys.stderr):  # what the planner prints
        findings = testing.check_planner(load_planner(name))
    errors = sum(finding.severity == "error" for finding in findings)
    if as_json:
        print_json({"planner": name, "ok": not errors, "findings": [asdict(finding) for finding in findings]})
    else:
        for finding in findings:
            print(finding)
        print(f"{name} conforms" if not errors else f"{name} does not conform: {errors} error{'s' * (errors > 1)}")
    return BAD_INPUT if errors else DONE


@maps_app.command("list")
def list_maps(as_json: JsonOption = False) -> None:
    """The shipped maps."""
    from interplan_sumo.report.listings import map_entries

    print_entries(map_entries(), as_json=as_json)


@maps_app.command("check")
def check_map(
    folder: MapArgument,
    source: Annotated[Path | None, typer.Option(help="Compare the network with this map.gpkg.", metavar="FILE")] = None,
    as_json: JsonOption = False,
) -> int:
    """How faithful a map's SUMO network is: deviations, missing and extra ways, lights, broken rules."""
    from interplan_sumo.maps.check import check_map as check
    from interplan_sumo.maps.geopackage import read_map
    from interplan_sumo.maps.store import find_map, load_roads

    files = find_map(folder)
    report = check(files, load_roads(folder) if source is None else read_map(source, files.name))
    if as_json:
        print_json(report.as_json())
    else:
        details = report.as_json()
        problems = details.pop("problems")
        print_entries([{"": key, "value": _in_words(value)} for key, value in details.items()], as_json=False)
        for problem in problems:
            print(f"problem: {problem}")
    return DONE if report.ok else OUR_FAULT


@maps_app.command("convert")
def convert_map(folder: MapArgument) -> None:
    """Build the SUMO network of a map beside it, with the id map that ties the two."""
    from interplan_sumo.maps.store import find_map, load_roads
    from interplan_sumo.maps.to_sumo import convert

    files = find_map(folder)
    convert(load_roads(folder), files.folder)
    print(f"wrote {files.network} and {files.ids}; measure it: interplan-sumo maps check {folder}")


@maps_app.command("render")
def render_map(
    folder: MapArgument,
    picture: Annotated[Path, typer.Argument(help="Its ending says which kind.", metavar="FILE.png")],
    lane_ids: Annotated[bool, typer.Option("--lane-ids", help="Write the id on every lane.")] = False,
) -> None:
    """Draw a map: lanes, directions, connectors, limits, crossings, lights."""
    from interplan_sumo.maps import render
    from interplan_sumo.maps.store import load_roads

    try:
        render.render_map(load_roads(folder), picture, lane_ids=lane_ids)
    except (OSError, ValueError) as error:
        raise InputError(f"cannot write the picture {picture}: {error}") from None
    print(f"wrote {picture}")


def _in_words(value: Any) -> Any:
    """Figures of a report for people: rounded, long lists counted."""
    match value:
        case float():
            return f"{value:.4g}"
        case dict():
            return ", ".join(f"{k} {v:.4g}" for k, v in value.items())
        case list() | tuple():
            return len(value)
        case _:
            return value


def _rescored(folder: Path, profile: str) -> StoredRun:
    """A stored run under another profile; what could not be scored is said on stderr."""
    from interplan_sumo.batch.rescore import rescore
    from interplan_sumo.batch.run_folder import read_run

    scored, problems = rescore(read_run(folder), profile)
    for problem in problems:
        print(f"not scored: {problem}", file=sys.stderr)
    return scored


def _report(runs: Sequence[StoredRun], form: Form, html: Path | None = None, **options: bool) -> int:
    """Print the table of the runs, write the page if one is asked for; the exit code."""
    from interplan_sumo.report.table import make_table

    table = make_table(runs)
    if html is not None:
        write_page(table, html, paper=options.get("paper", False))
    print_table(table, form, **options)
    return DONE if table.complete else INCOMPLETE


if __name__ == "__main__":
    sys.exit(main())
