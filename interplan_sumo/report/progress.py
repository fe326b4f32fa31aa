"""Progress: how a long run goes on, on stderr: a live bar on a terminal, plain lines elsewhere."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from types import TracebackType
from typing import Any, Self

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from interplan_sumo.batch.run_folder import Row

PLAIN_EVERY_S = 10.0
SHARES = (("SUMO", ("simulation", "setup")), ("planner", ("planner",)), ("metrics", ("scoring",)))


class Tally:
    """What is known while a run goes on: counts, rate, mean score, faults and where the time goes."""

    def __init__(self, jobs: int, done: Sequence[Row]) -> None:
        self.jobs = jobs
        self.done = len(done)
        self._began_s = time.monotonic()
        self._before = len(done)
        self._scores = [row["score"] for row in done if row["score"] is not None]
        self._faults = Counter(row["fault"]["class"] for row in done if row["fault"])
        self._times_s: Counter[str] = Counter()

    def add(self, row: Row) -> None:
        self.done += 1
        if row["score"] is not None:
            self._scores.append(row["score"])
        if row["fault"]:
            self._faults[row["fault"]["class"]] += 1
        self._times_s.update(row["times_s"])

    @property
    def per_s(self) -> float:
        """Jobs of this session per second."""
        return (self.done - self._before) / max(time.monotonic() - self._began_s, 1e-9)

    @property
    def left(self) -> str:
        """Time to the end at the present rate."""
        if self.done == self._before:
            return "--:--"
        seconds = round((self.jobs - self.done) / self.per_s)
        hours, minutes = seconds // 3600, seconds % 3600 // 60
        return f"{hours}:{minutes:02}:{seconds % 60:02}" if hours else f"{minutes}:{seconds % 60:02}"

    @property
    def summary(self) -> str:
        """Rate, mean score, faults and shares of time in one line."""
        parts = [f"{60 * self.per_s:.1f} jobs/min"]
        if self._scores:
            parts.append(f"mean score {100 * sum(self._scores) / len(self._scores):.1f}")
        faults = ", ".join(f"{count} {name}" for name, count in sorted(self._faults.items()))
        parts.append(f"faults: {faults or 'none'}")
        total_s = self._times_s["total"]
        if total_s > 0.0:
            shares = [(name, sum(self._times_s[k] for k in keys) / total_s) for name, keys in SHARES]
            parts.append("time: " + ", ".join(f"{name} {share:.0%}" for name, share in shares))
        return "; ".join(parts)


class PlainProgress:
    """One line now and then; for logs."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._tally = Tally(0, ())
        self._said_s = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        pass

    def begin(self, jobs: int, done: Sequence[Row]) -> None:
        self._tally = Tally(jobs, done)
        resumed = f", {len(done)} of them done already" if done else ""
        self._say(f"{jobs} jobs{resumed}")

    def finished(self, row: Row) -> None:
        self._tally.add(row)
        if row["fault"]:
            self._say(
                f"{row['scenario_id']}, {row['planner']}, seed {row['seed']}: "
                f"{row['fault']['class']} fault: {row['fault']['message']}"
            )
        now_s = time.monotonic()
        if self._tally.done == self._tally.jobs or now_s - self._said_s >= PLAIN_EVERY_S:
            self._said_s = now_s
            tally = self._tally
            self._say(f"{tally.done}/{tally.jobs} done, {tally.left} left; {tally.summary}")

    def _say(self, text: str) -> None:
        self._console.print(text, markup=False, highlight=False, soft_wrap=True)


class LiveProgress:
    """A bar that moves; for people."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._tally = Tally(0, ())
        self._progress = Progress(
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("{task.fields[left]} left"),
            TextColumn("{task.description}", markup=False),
            console=console,
            transient=True,
        )
        self._bar: Any = None

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._progress.stop()
        if self._bar is not None:
            tally = self._tally
            self._console.print(f"{tally.done}/{tally.jobs} done; {tally.summary}", markup=False, highlight=False)

    def begin(self, jobs: int, done: Sequence[Row]) -> None:
        self._tally = Tally(jobs, done)
        self._bar = self._progress.add_task("starting", total=jobs, completed=len(done), left="--:--")

    def finished(self, row: Row) -> None:
        self._tally.add(row)
        if row["fault"]:
            self._progress.console.print(
                f"{row['scenario_id']}, {row['planner']}, seed {row['seed']}: "
                f"{row['fault']['class']} fault: {row['fault']['message']}",
                markup=False,
                highlight=False,
                style="yellow",
            )
        tally = self._tally
        self._progress.update(self._bar, completed=tally.done, left=tally.left, description=tally.summary)
