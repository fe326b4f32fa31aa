"""Commands about what there is: scenarios and planners."""

from __future__ import annotations

import contextlib
import sys
from typing import Annotated

import typer

from interplan_sumo.cli.options import BAD_INPUT, DONE, LOOKS, JsonOption, planner_names, scenario_ids
from interplan_sumo.report.printing import print_entries, print_json

scenarios_app = typer.Typer(help="The official scenarios.", **LOOKS)
planners_app = typer.Typer(help="Registered planners, and the conformance suite.", **LOOKS)


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
        str, typer.Argument(help="A scenario id, such as nudge/0.", metavar="ID", autocompletion=scenario_ids)
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
    name: Annotated[str, typer.Argument(help="As run --planner takes it.", metavar="P", autocompletion=planner_names)],
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
