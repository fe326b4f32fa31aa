"""Size and speed of the report and of what can be watched: python -m benchmarks.report_page RUN [--scenarios 80]

Fills a report of 80 scenarios and 4 planners with copies of the run's rows, writes
it, and opens it in an installed Chromium (median of five). Then makes a replay, a film,
and a folder for sumo-gui of the run's longest drive. Needs the extras [plots] and [maps].
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import time
from collections.abc import Callable
from itertools import cycle
from pathlib import Path
from tempfile import TemporaryDirectory

from msgspec.structs import replace

from interplan_sumo.batch.records import JobKey, RequestedJobs, Row
from interplan_sumo.batch.run_folder import StoredRun, read_run
from interplan_sumo.batch.stored_drive import StoredDrives
from interplan_sumo.report.film import write_film
from interplan_sumo.report.page.document import page
from interplan_sumo.report.replay.page import write_replay
from interplan_sumo.report.sumo_gui.folder import write_sumo_gui
from interplan_sumo.report.table import make_table

PLANNERS = ("foresight", "pdm_closed", "idm_mobil", "idm")
PER_FAMILY = 10


def filled(run: StoredRun, scenarios: int) -> StoredRun:
    """A run of so many scenarios and four planners, from copies of a run's rows."""
    rows: dict[JobKey, Row] = {}
    source = cycle(run.rows.values())
    families = sorted({row.family for row in run.rows.values()})
    ids = [f"{families[n // PER_FAMILY % len(families)]}/{n % PER_FAMILY}" for n in range(scenarios)]
    for scenario in ids:
        for planner in PLANNERS:
            family = scenario.partition("/")[0]
            row = replace(next(source), scenario_id=scenario, family=family, planner=planner)
            rows[row.key] = row
    return StoredRun(run.path, replace(run.manifest, requests=(RequestedJobs(PLANNERS, tuple(ids), 1),)), rows)


def timed(make: Callable[[], object]) -> float:
    """Seconds that it takes."""
    began = time.perf_counter()
    make()
    return time.perf_counter() - began


def opening_s(path: Path) -> float:
    """Seconds until a page is there and can be filtered, in a browser that runs already; median of five."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        program = shutil.which("chromium") or shutil.which("google-chrome")
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        tab = browser.new_page(viewport={"width": 1440, "height": 900})

        def opened() -> None:
            tab.goto(path.resolve().as_uri())
            tab.locator("#filters").wait_for()

        measured = [timed(opened) for _ in range(5)]
        browser.close()
    return statistics.median(measured)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path)
    parser.add_argument("--scenarios", type=int, default=80)
    given = parser.parse_args()
    run = read_run(given.run)
    stored = StoredDrives(run)
    drive = max((stored.read(row) for row in run.rows.values() if not row.fault), key=lambda each: len(each.trace))
    drive.roads  # noqa: B018 - read before the clock runs
    with TemporaryDirectory() as name:
        folder = Path(name)
        report = folder / "report.html"
        whole = filled(run, given.scenarios)
        seconds = timed(lambda: report.write_text(page(make_table([whole]), [whole]), encoding="utf-8"))
        print(f"page of {len(whole.rows)} drives: {report.stat().st_size / 1e3:.0f} kB, written in {seconds:.2f} s")
        print(f"opened in Chromium: {opening_s(report):.2f} s")
        print(f"drive of {len(drive.trace) * drive.trace.dt_s:.1f} s: {drive.scenario.id}, {drive.row.planner}")
        makers: dict[str, Callable[[Path], object]] = {
            "replay.html": lambda path: write_replay([drive], path),
            "film.mp4": lambda path: write_film([drive], path),
            "film.gif": lambda path: write_film([drive], path),
            "still.png": lambda path: write_film([drive], path),
            "sumo_gui": lambda path: write_sumo_gui(drive, path),
        }
        print("CPU seconds of this process, and size:")
        for what, make in makers.items():
            path = folder / what
            began = time.process_time()
            make(path)
            seconds = time.process_time() - began
            files = [path] if path.is_file() else list(path.iterdir())
            print(f"{what:12} {seconds:5.1f} s {sum(file.stat().st_size for file in files) / 1e3:7.0f} kB")


if __name__ == "__main__":
    main()
