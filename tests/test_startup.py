"""Start-up: what only asks for help or a list waits for no library that drives, learns, draws or reads tables."""

from __future__ import annotations

import subprocess
import sys

HEAVY = ("torch", "onnxruntime", "scipy", "pandas", "pyarrow", "libsumo", "matplotlib", "gymnasium", "jinja2")
SCRIPT = """
import contextlib, io, sys
from interplan_sumo.cli import main
for command in sys.argv[2:]:
    with contextlib.redirect_stdout(io.StringIO()) as said:
        assert main(command.split()) == 0, command
    assert said.getvalue(), command
    loaded = [name for name in sys.argv[1].split() if name in sys.modules]
    assert not loaded, f"{command} imports {loaded}"
"""


def run(heavy: tuple[str, ...], *commands: str) -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT, " ".join(heavy), *commands], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_help_needs_no_arrays() -> None:
    run(("numpy", "yaml", "shapely", *HEAVY), "--help", "run --help")


def test_lists_need_nothing_that_drives_learns_or_draws() -> None:
    run(("pyproj", *HEAVY), "planners list")
    run(HEAVY, "scenarios list", "maps list", "maps list --json")


def test_a_run_waits_for_neither_sumo_nor_pandas_before_its_workers_start() -> None:
    code = "import sys, interplan_sumo.batch.run; print([m for m in ('libsumo', 'pandas') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"
