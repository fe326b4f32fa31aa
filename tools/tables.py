"""The tables of README and docs, from stored drives: `python -m tools.tables [--take RUN]`, or `make tables`.

A table stands between `<!-- table: NAME -->` and `<!-- end of table -->`, and is what the drives in docs/results
give; nobody types its figures, nor those of the prose (`tools.figures`). `--take` puts the drives of a run folder
there first, each suite in a folder of its own, in place of what the same planners drove before, and without traces
and details that no table needs: `interplan-sumo report docs/results/interplan-1` reads them like any other run.
`--take-hidden` keeps the scores in hard scenes that are not shipped, and nothing that tells of the scenes.
`--take-sweep` keeps what a sweep of tracks or of drivers found, `--take-seeds` the scores of a run with several seeds,
`--take-fresh` those of runs of generated scenes, `--take-kilometres` the segments of `endure`, `--take-parts` the
errors of networks that learned from parts of the data, by their cards.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Final

import msgspec
import numpy as np
from scipy.stats import rankdata

from interplan_sumo.batch.records import Row
from interplan_sumo.batch.run_folder import StoredRun, read_run
from interplan_sumo.planner import split_spec
from interplan_sumo.report.costly import where_points_went
from interplan_sumo.report.paper_comparison import (
    CELLS,
    COUNTERPARTS,
    PUBLISHED_COLUMNS,
    agreement,
    published_figure,
    published_rows,
)
from interplan_sumo.report.table import PAPER_PROFILE, ResultsTable, make_table
from interplan_sumo.report.text import points_text
from interplan_sumo.verification.solvers import SOLVED_SCORE
from tools import foresight
from tools.beside_scenes import kilometres_order, kilometres_suites
from tools.cells import DRIVEN, FAMILIES, RARE, best_first, by_family, cell_text, family_titles, heading, with_interval
from tools.figures import with_figures
from tools.fresh_scenes import fresh, keep_fresh
from tools.hard_scores import (
    DRAWS,
    HARD,
    ROOT,
    both_halves,
    family_scores,
    keep_hidden,
    means,
    panel_scores,
    shown_places,
    shown_scores,
    tau,
    totals,
)
from tools.kept_drives import complete_run, folder_of, take
from tools.kept_seeds import keep_seeds, seeds
from tools.kept_sweeps import behaviours, keep_sweep
from tools.kept_sweeps import tracks as kept_tracks
from tools.kilometres import (
    keep_kilometres,
    kilometres,
    kilometres_braking,
    kilometres_collisions,
    kilometres_pilots,
    kilometres_weights,
)
from tools.language_models import ASKED, HYBRID, adapters, choosers, waypoints
from tools.networks import data_scaling, keep_scaling, networks, plan_times

NAMES: Final[Mapping[str, str]] = {
    "foresight": "`foresight` (ours)", "gameformer": "`gameformer`, learned", "dtpp": "`dtpp`, learned",
    "idm_mobil?published=true": "`idm_mobil`, with the bugs of the published one",
}  # fmt: skip
SHORT: Final = (
    "foresight", "pdm_proposals", "idm_mobil", "pdm_closed", "gameformer", "idm", "idm_mobil?published=true", "dtpp",
)  # fmt: skip
"""Whom README shows: one of each kind."""
TABLE: Final = re.compile(r"<!-- table: ([a-z_]+) -->\n.*?<!-- end of table -->\n", re.DOTALL)


@dataclass(frozen=True)
class Drives:
    """The stored drives, judged by the profile that they were driven for, and by the paper's."""

    run: StoredRun

    @cached_property
    def unaided(self) -> StoredRun:
        """Of those that ask no language model; the others have a table of their own."""
        planners = tuple(name for name in self.run.planners if split_spec(name)[0] != HYBRID)
        return self.run.narrowed(msgspec.structs.replace(self.run.manifest.requests[0], planners=planners))

    @cached_property
    def strict(self) -> ResultsTable:
        return make_table([self.unaided])

    @cached_property
    def judged_by_paper(self) -> StoredRun:
        rows = {key: _judged_by_paper(self.unaided.rows[key]) for key in self.unaided.keys}
        manifest = msgspec.structs.replace(self.unaided.manifest, profile=PAPER_PROFILE)
        return StoredRun(self.run.path, manifest, rows)

    @cached_property
    def by_paper(self) -> ResultsTable:
        return make_table([self.judged_by_paper])


def _judged_by_paper(row: Row) -> Row:
    return row if row.fault else msgspec.structs.replace(row, score=row.beside[PAPER_PROFILE])


def short(drives: Drives) -> list[str]:
    """Scores of a few planners, for README."""
    lines = heading("planner", "interPlan", *family_titles(drives.strict))
    for line in best_first(drives.strict):
        if line.planner in SHORT:
            name = NAMES.get(line.planner, f"`{line.planner}`")
            lines.append(" | ".join((name, *(cell_text(line.cells[key]) for key in (RARE, *FAMILIES)))))
    return lines


def planners(drives: Drives) -> list[str]:
    """All planners, with intervals, shares and the paper's score."""
    lines = heading("planner", "interPlan", "done %", "unsafe %", "by paper", *family_titles(drives.strict))
    for line in best_first(drives.strict):
        cells = (cell_text(line.cells[key]) for key in ("done_share", "unsafe_share", "paper_score", *FAMILIES))
        lines.append(" | ".join((f"`{line.planner}`", with_interval(line.cells[RARE]), *cells)))
    return lines


def paper(drives: Drives) -> list[str]:
    """Ours by the paper's profile, and the published figures of the same methods in brackets."""
    published = _published()
    lines = heading(f"by `{PAPER_PROFILE}`, ours (published)", "total", *family_titles(drives.by_paper))
    for line in best_first(drives.by_paper):
        if line.planner in published:
            row = published[line.planner]
            cells = (f"{cell_text(line.cells[key])} ({published_figure(row, key)})" for key in (RARE, *CELLS))
            lines.append(" | ".join((f"`{line.planner}`", *cells)))
    return lines


def tracks(drives: Drives) -> list[str]:
    """What planners keep of their scores where scenes are made harder."""
    return kept_tracks({line.planner: with_interval(line.cells[RARE]) for line in drives.strict.lines})


def ordinary(drives: Drives) -> list[str]:
    """All planners in ordinary driving: strict, by the paper, and what the paper has for Val14."""
    published, by_paper = _published(), {line.planner: line for line in drives.by_paper.lines}
    lines = heading("planner", "strict", "by paper", "published, Val14")
    for line in best_first(drives.strict, DRIVEN):
        val14 = published_figure(published[line.planner], DRIVEN) if line.planner in published else "-"
        judged = cell_text(by_paper[line.planner].cells[DRIVEN])
        lines.append(" | ".join((f"`{line.planner}`", with_interval(line.cells[DRIVEN]), judged, val14)))
    return lines


def ordinary_order(drives: Drives) -> list[str]:
    """Whether the planners of both tables come in the same order, in a sentence."""
    published, lines = _published(), {line.planner: line for line in drives.by_paper.lines}
    both = [name for name in published if name in lines]
    ours = np.array([lines[name].cells[DRIVEN].value for name in both], dtype=np.float64)
    theirs = np.array([published[name][DRIVEN] for name in both], dtype=np.float64)
    rank = float(np.corrcoef(rankdata(ours), rankdata(theirs))[0, 1])
    apart = float(np.abs(ours - theirs).mean())
    return [
        f"Against the paper's figures for Val14, {len(both)} planners in both: rank correlation {rank:.2f} (Spearman), "
        f"{apart:.0f} points apart on average."
    ]


def _published() -> dict[str, dict[str, str | float | None]]:
    """The paper's rows by the name of our planner of the same method."""
    return {COUNTERPARTS[str(row["planner"])]: row for row in published_rows() if row["planner"] in COUNTERPARTS}


def lost(drives: Drives, key: str) -> list[str]:
    """What took the points that a score lacks, by planner; the best of a column first."""
    by_score = best_first(drives.strict, key)
    columns = where_points_went(by_score)
    lines = heading("planner", "score", *columns)
    for number, line in enumerate(by_score):
        taken = (f"{points[number]:.0f}" for points in columns.values())
        lines.append(" | ".join((f"`{line.planner}`", cell_text(line.cells[key]), *taken)))
    return lines


def learned(rare: Drives, ordinary: Drives) -> list[str]:
    """Both suites by the paper's profile, ours above the published row of the same method."""
    table = make_table([rare.judged_by_paper, ordinary.judged_by_paper])
    titles = {column.key: column.title for column in table.columns}
    keys = PUBLISHED_COLUMNS
    published = _published()
    lines = heading("planner", *(titles[key] for key in keys))
    for line in best_first(table):
        lines.append(" | ".join((f"`{line.planner}`", *(cell_text(line.cells[key]) for key in keys))))
        if row := published.get(line.planner):
            lines.append(" | ".join((f"{row['planner']} (paper)", *(published_figure(row, key) for key in keys))))
    return lines


def near_paper(drives: Drives) -> list[str]:
    """How near that is, in a sentence."""
    near, published = agreement(drives.by_paper), {str(row["planner"]): row for row in published_rows()}
    assert near is not None
    lines = {line.planner: line for line in drives.by_paper.lines}
    scores = np.array([by_family(lines[COUNTERPARTS[name]]) for name in near.planners])
    totals = np.array([published[name][RARE] for name in near.planners], dtype=np.float64)
    rng = np.random.default_rng(0)
    ranks: list[float] = []
    apart: list[float] = []
    before = scores.mean(axis=2)
    for _ in range(DRAWS):
        drawn = rng.integers(scores.shape[2], size=scores.shape[1:])
        cells = np.take_along_axis(scores, drawn[None], axis=2).mean(axis=2)
        ranks.append(float(np.corrcoef(rankdata(cells.mean(axis=1)), rankdata(totals))[0, 1]))
        apart.append(float(np.abs(cells - before).mean()))
        before = cells
    low, high = np.quantile(ranks, (0.025, 0.975))
    return [
        f"{near.sentence()} If our ten scenes of each type are drawn again, 95 % of the correlations lie between "
        f"{low:.2f} and {high:.2f}, and the cells of two draws are {np.mean(apart):.0f} points apart."
    ]


def detectable(drives: Drives) -> list[str]:
    """How large a difference between two planners the table would find."""
    standing = drives.strict.standing
    found = standing.detectable[standing.column]
    middle, least, greatest = (points_text(each) for each in (found.middle, found.least, found.greatest))
    scenes = drives.strict.lines[0].scenarios
    return [
        f"The least difference between two planners that {scenes} scenes can detect (80 % power) is {middle} points, "
        f"of some pairs {least}, of others {greatest}."
    ]


def hard(drives: Drives) -> list[str]:
    """Scores in the hard scenes that are shipped: of the panel, as the suite has them, and of who drove since."""
    shown, panel = shown_scores(drives.run), panel_scores()
    lines = heading("planner", "in the panel", "all", "solves, of 100", *family_titles(drives.strict))
    for name, total in totals(shown, shown_places(drives.run)).items():
        solved = sum(score >= SOLVED_SCORE for scores in shown[name].values() for score in scores)
        cells = (f"{100.0 * float(np.mean(scores)):.0f}" for scores in shown[name].values())
        member = "no" if name not in panel else "an earlier one" if name in drives.run.planners else "yes"
        lines.append(" | ".join((f"`{name}`", member, total, str(solved), *cells)))
    return lines


def halves(drives: Drives) -> list[str]:
    """Scores in the hard scenes that are shipped, and in those that are kept back: these by family, too."""
    shown, hidden = both_halves(drives.run)
    lines = heading("planner", "shipped", "kept back", *family_titles(drives.strict))
    kept_back = totals(hidden)
    for name, total in totals(shown, shown_places(drives.run)).items():
        cells = (f"{100.0 * float(np.mean(scores)):.0f}" for scores in hidden[name].values())
        lines.append(" | ".join((f"`{name}`", total, kept_back[name], *cells)))
    return lines


def halves_order(drives: Drives) -> list[str]:
    """Whether both halves rank the planners alike, in a sentence."""
    shown, hidden = map(family_scores, both_halves(drives.run))
    both = (means(shown), means(hidden))
    rng = np.random.default_rng(0)
    drawn = [tau(means(shown, rng), means(hidden, rng)) for _ in range(DRAWS)]
    low, high = np.nanquantile(drawn, (0.025, 0.975))
    found, apart = tau(*both), 100.0 * float(np.abs(both[0] - both[1]).mean())
    scenes = [sum(scores.shape[1] for scores in families) for families in (shown, hidden)]
    return [
        f"{scenes[0]} scenes that are shipped and {scenes[1]} that are kept back, found with different seeds, rank "
        f"{len(both[0])} planners alike: Kendall's tau {found:.2f} (95 % of those with scenes drawn again: {low:.2f} "
        f"to {high:.2f}); the two scores of a planner are {apart:.0f} points apart."
    ]


SMALL, LARGE, ORDINARY = "interplan==1", "interplan-large==1", "common==1"
TABLES: Final[Mapping[str, tuple[Callable[..., list[str]], tuple[str, ...]]]] = {
    "tracks": (tracks, (SMALL,)),
    "seeds": (seeds, ()),
    "fresh": (lambda rare, large: fresh(rare.strict, large.strict), (SMALL, LARGE)),
    "behaviours": (behaviours, ()),
    "short": (short, (SMALL,)),
    "planners": (planners, (SMALL,)),
    "lost": (lambda rare: lost(rare, RARE), (SMALL,)),
    "detectable": (detectable, (SMALL,)),
    "paper": (paper, (SMALL,)),
    "near_paper": (near_paper, (SMALL,)),
    "large": (planners, (LARGE,)),
    "large_detectable": (detectable, (LARGE,)),
    "large_lost": (lambda large: foresight.lost(large.strict), (LARGE,)),
    "budget": (lambda large: foresight.budget(large.run), (LARGE,)),
    "ordinary": (ordinary, (ORDINARY,)),
    "ordinary_lost": (lambda ordinary: lost(ordinary, DRIVEN), (ORDINARY,)),
    "ordinary_order": (ordinary_order, (ORDINARY,)),
    "learned": (learned, (SMALL, ORDINARY)),
    "networks": (lambda rare, ordinary: networks(rare.by_paper, ordinary.by_paper), (SMALL, ORDINARY)),
    "data_scaling": (data_scaling, ()),
    "plan_times": (plan_times, ()),
    "choosers": (lambda rare: choosers(rare.run), (SMALL,)),
    "waypoints": (lambda asked: waypoints(asked.run), (ASKED,)),
    "adapters": (adapters, ()),
    "hard": (hard, (HARD,)),
    "halves": (halves, (HARD,)),
    "halves_order": (halves_order, (HARD,)),
    "kilometres": (kilometres, ()),
    "kilometres_suites": (lambda rare, ordinary: kilometres_suites(rare.strict, ordinary.strict), (SMALL, ORDINARY)),
    "kilometres_order": (lambda rare, ordinary: kilometres_order(rare.strict, ordinary.strict), (SMALL, ORDINARY)),
    "kilometres_weights": (kilometres_weights, ()),
    "kilometres_pilots": (kilometres_pilots, ()),
    "kilometres_collisions": (kilometres_collisions, ()),
    "kilometres_braking": (kilometres_braking, ()),
}
"""How each is made, and of the drives of which suites; without one, of something else that is kept."""
PAGES: Final = (
    "README.md",
    "docs/benchmark.md",
    "docs/planners.md",
    "docs/learned_planners.md",
    "docs/language_models.md",
    "docs/hard_scenes.md",
    "docs/endurance.md",
)


def stored() -> dict[str, Drives]:
    """The kept drives by suite."""
    return {suite: Drives(read_run(folder_of(suite))) for suite in (SMALL, LARGE, ORDINARY, HARD, ASKED)}


@dataclass(frozen=True)
class Pages:
    """Pages of stored drives."""

    drives: Mapping[str, Drives]
    _made: dict[str, list[str]] = field(default_factory=dict)

    def table(self, name: str) -> list[str]:
        """Its lines. LookupError if there is none of that name."""
        if name not in TABLES:
            raise LookupError(f"no table {name!r}")
        if name not in self._made:
            of, suites = TABLES[name]
            self._made[name] = of(*(self.drives[suite] for suite in suites))
        return self._made[name]

    def written(self, page: str) -> str:
        """The text of a page with its tables and figures made anew."""

        def made(found: re.Match[str]) -> str:
            lines = self.table(found[1])
            body = [f"| {line} |" if " | " in line else f"|{line}|" for line in lines] if len(lines) > 1 else lines
            return "\n".join((f"<!-- table: {found[1]} -->", *body, "<!-- end of table -->", ""))

        return with_figures(TABLE.sub(made, page), self.table)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--take", type=Path, metavar="RUN", help="a run folder whose drives are to be stored first")
    parser.add_argument(
        "--take-hidden", type=Path, nargs=2, metavar=("RUN", "DIR"), help="a run of hard scenes, and what harden wrote"
    )
    parser.add_argument("--take-sweep", type=Path, metavar="DIR", help="a folder of sweep to be stored")
    parser.add_argument("--take-seeds", type=Path, metavar="RUN", help="a run with several seeds, to be stored")
    parser.add_argument(
        "--take-fresh", type=Path, nargs=2, metavar=("DIR", "RUNS"), help="scenes by map, and their runs"
    )
    parser.add_argument("--take-kilometres", type=Path, nargs="+", metavar="DIR", help="folders of endure to be stored")
    parser.add_argument("--take-parts", type=Path, nargs="+", metavar="CARD", help="cards of networks to be stored")
    given = parser.parse_args()
    if given.take is not None:
        take(given.take)
    if given.take_hidden is not None:
        scenes_run, scenes = given.take_hidden
        keep_hidden(complete_run(scenes_run), scenes)
    if given.take_sweep is not None:
        keep_sweep(given.take_sweep)
    if given.take_seeds is not None:
        keep_seeds(given.take_seeds)
    if given.take_fresh is not None:
        keep_fresh(*given.take_fresh)
    if given.take_kilometres is not None:
        keep_kilometres(given.take_kilometres)
    if given.take_parts is not None:
        keep_scaling(given.take_parts)
    pages = Pages(stored())
    for page in PAGES:
        (ROOT / page).write_text(pages.written((ROOT / page).read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
