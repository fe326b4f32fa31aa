"""Commands: parsing and printing only; the work is in the library.

Exit codes: 0 done; 1 a fault of ours or of SUMO; 2 bad input; 3 the run is incomplete.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import sys
from collections.abc import Iterable, Sequence
from functools import cache
from typing import Annotated, Any

import typer

from interplan_sumo.cli import runs
from interplan_sumo.cli.atlas import atlas
from interplan_sumo.cli.audit import audit
from interplan_sumo.cli.certify import certify
from interplan_sumo.cli.completion import BashWords
from interplan_sumo.cli.dataset import dataset_app
from interplan_sumo.cli.drive import drive
from interplan_sumo.cli.endure import endure
from interplan_sumo.cli.examples import explain
from interplan_sumo.cli.export import export
from interplan_sumo.cli.generate import generate
from interplan_sumo.cli.hand_in import judge, leaderboard, submit
from interplan_sumo.cli.harden import harden
from interplan_sumo.cli.llm import llm_app
from interplan_sumo.cli.maps import maps_app
from interplan_sumo.cli.options import BAD_INPUT, DONE, LOOKS, OUR_FAULT, JsonOption, naming
from interplan_sumo.cli.planners import planners_app
from interplan_sumo.cli.rates import rates
from interplan_sumo.cli.recorded import format_names, import_recorded
from interplan_sumo.cli.replay import replay
from interplan_sumo.cli.scenarios import scenarios_app
from interplan_sumo.cli.sweep import sweep
from interplan_sumo.cli.traffic import traffic_app
from interplan_sumo.cli.verify import verify
from interplan_sumo.errors import InputError, InterplanError, clean_line
from interplan_sumo.interruption import terminated_like_interrupted
from interplan_sumo.report.printing import print_json

app = typer.Typer(name="interplan-sumo", rich_markup_mode="rich", **LOOKS)
app.add_typer(runs.app)
app.command()(sweep)
app.command()(endure)
app.command()(rates)
app.command()(verify)
app.command()(submit)
app.command()(judge)
app.command()(leaderboard)
app.command()(export)
app.command()(replay)
app.command()(atlas)
app.command()(drive)
app.add_typer(dataset_app, name="dataset")
app.add_typer(scenarios_app, name="scenarios")
scenarios_app.command("certify")(certify)
scenarios_app.command("generate")(generate)
scenarios_app.command("harden")(harden)
scenarios_app.command("import", cls=naming("format", format_names))(import_recorded)
scenarios_app.command("audit")(audit)
app.add_typer(planners_app, name="planners")
app.add_typer(maps_app, name="maps")
app.add_typer(llm_app, name="llm")
app.add_typer(traffic_app, name="traffic")


_UsageError: type[Exception] = next(kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "ClickException")


LONGEST_LINE = 1500
WANTS = {
    errno.EMFILE: "allow more open files (ulimit -n)",
    errno.ENFILE: "close some programs, for the system's table of open files is full",
    errno.ENOSPC: "free some space where the output goes",
    errno.EDQUOT: "free some space where the output goes",
    errno.ENOMEM: "free some memory",
    errno.EAGAIN: "allow more processes (ulimit -u)",
}
"""What a command that the system refuses something needs."""


@cache
def command_line() -> Any:
    """All commands, put together once: that takes longer than most of them take to refuse a word."""
    command = typer.main.get_command(app)
    explain(command)
    return command


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; its exit code. The one place where errors become a line on stderr."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    _open_standard_streams()
    if (bash := BashWords.of_environment()) is not None:
        return _complete_in_bash(bash)
    if os.getcwd() not in sys.path:  # planners of the folder one works in; last, so that nothing there hides a library
        sys.path.append(os.getcwd())
    try:
        _refuse_undecodable([*given, os.getcwd()])
        with terminated_like_interrupted():
            code = command_line()(args=given, prog_name="interplan-sumo", standalone_mode=False, obj=given)
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
        _forget_output()
        return DONE
    except OSError as error:
        if error.errno not in WANTS:
            raise
        _forget_output()
        where = f" ({error.filename})" if error.filename else ""
        return _failed(f"{error.strerror}{where}: {WANTS[error.errno]}, and repeat the command", BAD_INPUT)


def _refuse_undecodable(names: Iterable[str]) -> None:
    """InputError for what is no text in the encoding of this system: Parquet has no files of such names."""
    for name in names:
        try:
            name.encode()
        except UnicodeEncodeError:
            encoding = sys.getfilesystemencoding()
            way_out = "give it another name" if encoding == "utf-8" else "give it another name, or set PYTHONUTF8=1"
            said = f"'{clean_line(name)}' is no text in the encoding of this system ({encoding})"
            raise InputError(f"{said}; {way_out}") from None


def _complete_in_bash(words: BashWords) -> int:
    """Print what the shell offers for the last of the words."""
    words.tell()
    offered = io.StringIO()
    with contextlib.redirect_stdout(offered), contextlib.suppress(SystemExit):
        command_line()(args=[], prog_name="interplan-sumo", standalone_mode=False)
    print(words.answer(offered.getvalue()))
    return DONE


def _open_standard_streams() -> None:
    """Give a command whose streams are closed others, before a file takes their numbers and is printed to."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest free number, which is this one
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "r" if number == 0 else "w"))  # noqa: SIM115 (until the process ends)
    if isinstance(sys.stdout, io.TextIOWrapper):  # a terminal may know fewer characters than a table has
        sys.stdout.reconfigure(errors="backslashreplace")


def _forget_output() -> None:
    """What could not be written is not tried again when the process ends."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _failed(message: str, code: int) -> int:
    """One line, however long a file's own words in it are: their middle goes, the way out at the end stays."""
    line = " ".join(message.split())
    if len(line) > LONGEST_LINE:
        line = f"{line[: LONGEST_LINE // 2]} ... {line[-LONGEST_LINE // 2 :]}"
    print(f"error: {line}", file=sys.stderr)
    return code


def _command(arguments: Sequence[str]) -> str:
    """The commands that were named before something went wrong: `scenarios list `."""
    groups = {g.name: g.typer_instance for g in app.registered_groups if g.name and g.typer_instance}
    words, here = "", app
    for word in arguments:
        commands = [*here.registered_commands, *(runs.app.registered_commands if here is app else ())]
        names = {c.name or getattr(c.callback, "__name__", "") for c in commands}
        if word not in names and not (here is app and word in groups):
            break
        words += f"{word} "
        here = groups.get(word, typer.Typer()) if here is app else typer.Typer()
    return words


def _version(asked: bool) -> None:
    if asked:
        from interplan_sumo import __version__

        print(f"interplan-sumo {__version__}")
        raise typer.Exit


@app.callback()
def interplan_sumo(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and leave.")
    ] = False,
) -> None:
    """Can a motion planner cope with rare, interactive traffic? A closed-loop benchmark on SUMO."""


@app.command()
def doctor(as_json: JsonOption = False) -> int:
    """Versions, native libraries, data files, a two-second self-test."""
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
