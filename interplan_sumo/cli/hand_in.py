"""The commands submit, judge and leaderboard: results that others can believe."""

from __future__ import annotations

import contextlib
import sys
from pathlib import Path
from typing import Annotated

import typer

from interplan_sumo.batch.options import RunOptions
from interplan_sumo.cli.completion import run_folders
from interplan_sumo.cli.options import (
    BAD_INPUT,
    DONE,
    INCOMPLETE,
    OUR_FAULT,
    JsonOption,
    QuietOption,
    take_one_thread,
    takes_run_options,
)
from interplan_sumo.errors import InputError, counted
from interplan_sumo.report.printing import console, print_json, progress

JUDGED_FOLDERS = Path("judged")


def submit(
    folder: Annotated[
        Path, typer.Argument(help="A run folder with all drives of a suite.", metavar="RUN", autocompletion=run_folders)
    ],
    out: Annotated[Path, typer.Option(help="The bundle to write.", metavar="BUNDLE")],
    planner: Annotated[str | None, typer.Option(help="Which planner of the run, if it holds several.")] = None,
    card: Annotated[
        Path | None,
        typer.Option(help="A YAML file with name, authors, link, data, hardware, notes.", metavar="FILE.yaml"),
    ] = None,
    as_json: JsonOption = False,
) -> int:
    """Write a result to hand in: what is claimed, the plans and a card. No code goes in, and no folder of yours."""
    from interplan_sumo.batch.bundle import read_card
    from interplan_sumo.batch.run_folder import read_run
    from interplan_sumo.batch.submit import submit as write

    made = write(read_run(folder), out, planner, None if card is None else read_card(card))
    if as_json:
        told = {"path": str(made.path), "name": made.card.name, "suite": made.suite, "drives": made.drives}
        print_json(told | {"bytes": made.bytes, "sha256": made.sha256})
    else:
        size_mb = made.bytes / 1e6
        print(f"wrote {made.path}: {made.card.name}, {counted(made.drives, 'drive')} of {made.suite}, {size_mb:.1f} MB")
    return DONE


@takes_run_options(
    "workers",
    "scenarios",
    scenarios="The FILE.yaml of a suite that does not ship, as of a hidden split.",
)
def judge(
    bundles: Annotated[list[Path], typer.Argument(help="Bundles, as submit writes them.", metavar="BUNDLE")],
    options: RunOptions,
    out: Annotated[
        Path, typer.Option(help="Each is made a judged run folder in here.", metavar="DIR")
    ] = JUDGED_FOLDERS,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> int:
    """Drive bundles again from their plans, with no planner loaded, score them anew, and say what does not come again.

    Repeating the command goes on. Exit code 2 if one is no bundle, 1 if a drive
    does not come again, 3 if one could not be made.
    """
    take_one_thread()
    from interplan_sumo.batch.judge import Judgement
    from interplan_sumo.batch.judge import judge as judge_bundle
    from interplan_sumo.report.verify_formats import verification_json, verification_text

    found: list[Judgement] = []
    refused = False
    for path in bundles:
        try:
            with progress(quiet=quiet) as watch, contextlib.redirect_stdout(sys.stderr):
                found.append(judge_bundle(path, out, options, watch))
        except InputError as error:
            if len(bundles) == 1:
                raise
            refused = True
            print(f"refused: {' '.join(str(error).split())}", file=sys.stderr)
        except KeyboardInterrupt:
            print("stopped; what was driven is kept: repeat the command", file=sys.stderr)
            return INCOMPLETE
    if as_json:
        about = [{"name": each.judged.card.name, "sha256": each.judged.sha256} for each in found]
        print_json([told | verification_json(each.found) for told, each in zip(about, found, strict=True)])
    else:
        for each in found:
            console().print(verification_text(each.found))
            judged = each.judged
            print(f"{judged.card.name}: {judged.equal} of {judged.drives} as claimed, in {each.found.run.path}")
    if refused:
        return BAD_INPUT
    if any(each.found.run.missing for each in found):
        return INCOMPLETE
    return OUR_FAULT if any(each.judged.others for each in found) else DONE


def leaderboard(
    folders: Annotated[list[Path], typer.Argument(help="Judged run folders, or folders of them.", metavar="DIR")],
    html: Annotated[Path | None, typer.Option(help="Write one self-contained page.", metavar="FILE")] = None,
    replays: Annotated[
        str, typer.Option(help="Beside the page, replays of these drives; N are the worst.", metavar="all|lost|none|N")
    ] = "none",
    as_json: JsonOption = False,
) -> int:
    """The table of judged bundles, best first: scores as they were judged, with what came again and each card."""
    from interplan_sumo.report.leaderboard import make_leaderboard
    from interplan_sumo.report.leaderboard_formats import leaderboard_json, leaderboard_text, write_leaderboard

    if replays != "none" and html is None:
        raise InputError(f"--replays {replays} are made beside a page; give its file as --html")
    board = make_leaderboard(folders)
    if html is not None:
        write_leaderboard(board, html, replays)
    if as_json:
        print_json(leaderboard_json(board))
    else:
        place = console()
        place.print(leaderboard_text(board, width=place.width))
    return DONE if board.table.complete else INCOMPLETE
