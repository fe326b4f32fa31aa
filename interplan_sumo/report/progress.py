"""Progress: how a long run goes on, on stderr: a live bar on a terminal, plain lines elsewhere."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable
from typing import Self

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.text import Text

from interplan_sumo.batch.briefs import Brief
from interplan_sumo.batch.records import JobKey, Row
from interplan_sumo.errors import counted
from interplan_sumo.report.failure_reasons import fault_sentence
from interplan_sumo.report.text import drive_name

PLAIN_EVERY_S = 10.0
PLAIN_SHARE = 0.1
"""Of the time that a run takes already: where nobody watches, lines come the more seldom the longer it is."""
FAULTS_TOLD = 5
"""One by one; all of them are counted."""
PLANNERS_TOLD = 4
"""At most so many have their mean score in a line."""
SHARES = (("SUMO", ("simulation", "setup")), ("planner", ("planner",)), ("metrics", ("scoring",)))


class Tally:
    """What is known while a run goes on: counts, rate, mean score, faults and where the time goes."""

    def __init__(self, jobs: int, done: Iterable[tuple[JobKey, Brief]]) -> None:
        self.jobs = jobs
        self.done = 0
        self._scores: dict[str, list[float]] = {}
        """By planner, how many and their sum."""
        self._faults: Counter[str] = Counter()
        self._times_s: Counter[str] = Counter()
        for (_, planner, _), brief in done:
            self._count(planner, brief.score, brief.fault)
        self._before = self.done
        self._began_s = time.monotonic()

    def add(self, row: Row) -> None:
        self._count(row.planner, row.score, None if row.fault is None else row.fault.kind)
        self._times_s.update(row.times_s)

    def _count(self, planner: str, score: float | None, fault: str | None) -> None:
        self.done += 1
        if score is not None:
            held = self._scores.setdefault(planner, [0, 0.0])
            held[0] += 1
            held[1] += score
        if fault:
            self._faults[fault] += 1

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
            parts.append(f"mean score {self._means()}")
        faults = ", ".join(f"{count} {name}" for name, count in sorted(self._faults.items()))
        parts.append(f"faults: {faults or 'none'}")
        total_s = self._times_s["total"]
        if total_s > 0.0:
            shares = [(name, sum(self._times_s[k] for k in keys) / total_s) for name, keys in SHARES]
            parts.append("time: " + ", ".join(f"{name} {share:.0%}" for name, share in shares))
        return "; ".join(parts)

    def _means(self) -> str:
        """Of each planner where there are few, else of all."""
        if len(self._scores) > PLANNERS_TOLD:
            drives, total = (sum(each) for each in zip(*self._scores.values(), strict=True))
            return f"{100 * total / drives:.1f}"
        alone = len(self._scores) == 1
        return ", ".join(f"{'' if alone else f'{name} '}{100 * s / n:.1f}" for name, (n, s) in self._scores.items())


class PlainProgress:
    """One line now and then; for logs."""

    def __init__(self, console: Console, about: str = "") -> None:
        """`about` says at the beginning what is done."""
        self._console = console
        self._about = about
        self._faults = 0
        self._tally = Tally(0, ())
        self._began_s = self._said_s = 0.0
        self._said_done = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        if self._tally.done != self._said_done:
            self._sum_up()

    def begin(self, jobs: int, done: Iterable[tuple[JobKey, Brief]]) -> None:
        self._tally = Tally(jobs, done)
        before = self._said_done = self._tally.done
        self._say(_beginning(self._about, jobs, before))
        self._began_s = self._said_s = time.monotonic()

    def finished(self, row: Row) -> None:
        self._tally.add(row)
        if row.fault:
            self._faults += 1
            if self._faults <= FAULTS_TOLD:
                self._say(_fault(row, self._faults))
        now_s = time.monotonic()
        if now_s - self._said_s >= max(PLAIN_EVERY_S, PLAIN_SHARE * (now_s - self._began_s)):
            self._sum_up()

    def _sum_up(self) -> None:
        tally = self._tally
        self._said_s, self._said_done = time.monotonic(), tally.done
        self._say(f"{tally.done}/{tally.jobs} done, {tally.left} left; {tally.summary}")

    def _say(self, text: str) -> None:
        self._console.print(text, markup=False, highlight=False, soft_wrap=True)


class LiveProgress:
    """A bar that moves, and what is known so far below it; for people."""

    def __init__(self, console: Console, about: str = "") -> None:
        """As `PlainProgress`."""
        self._console = console
        self._about = about
        self._faults = 0
        self._tally: Tally | None = None
        self._bar = Progress(
            BarColumn(bar_width=None),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("{task.description}", markup=False),
            console=console,
            expand=True,
        )
        self._job = self._bar.add_task("starting", total=None)
        self._live = Live(get_renderable=self._shown, console=console, transient=True)

    def _shown(self) -> RenderableType:
        summary = Text(self._tally.summary if self._tally else "reading maps and scenarios", style="dim")
        return Group(self._bar, summary)

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._live.stop()
        if self._tally is not None:
            self._say(f"{self._tally.done}/{self._tally.jobs} done; {self._tally.summary}")

    def begin(self, jobs: int, done: Iterable[tuple[JobKey, Brief]]) -> None:
        tally = self._tally = Tally(jobs, done)
        self._say(_beginning(self._about, jobs, tally.done))
        self._bar.update(self._job, total=jobs, completed=tally.done)

    def finished(self, row: Row) -> None:
        assert self._tally is not None, "a job ended before the run began"
        self._tally.add(row)
        if row.fault:
            self._faults += 1
            if self._faults <= FAULTS_TOLD:
                self._say(_fault(row, self._faults), style="yellow")
        self._bar.update(self._job, completed=self._tally.done, description=f"{self._tally.left} left")

    def _say(self, text: str, style: str | None = None) -> None:
        self._console.print(text, markup=False, highlight=False, style=style)


def _beginning(about: str, jobs: int, before: int) -> str:
    resumed = f", {before} of them done already" if before else ""
    return f"{about}{': ' if about else ''}{counted(jobs, 'job')}{resumed}"


def _fault(row: Row, number: int) -> str:
    more = "; further faults are only counted" if number == FAULTS_TOLD else ""
    return f"{drive_name(row)}: {fault_sentence(row)}{more}"
