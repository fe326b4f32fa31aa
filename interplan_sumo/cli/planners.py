"""Commands about planners: list, check."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from interplan_sumo.cli.completion import planner_names
from interplan_sumo.cli.options import BAD_INPUT, DONE, LOOKS, JsonOption
from interplan_sumo.report.printing import print_entries, print_json

planners_app = typer.Typer(help="Registered planners, and the conformance suite.", **LOOKS)


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

    from interplan_sumo.batch.check_job import checked_planner

    checked = checked_planner(name)
    sys.stderr.write(checked.printed)
    errors = sum(finding.severity == "error" for finding in checked.findings)
    if as_json:
        print_json({"planner": name, "ok": not errors, "findings": [asdict(finding) for finding in checked.findings]})
    else:
        for finding in checked.findings:
            print(finding)
        print(f"{name} conforms" if not errors else f"{name} does not conform: {errors} error{'s' * (errors > 1)}")
    return BAD_INPUT if errors else DONE
