"""Scores in the hard scenes that are shipped and in those that are kept back, and how alike both rank planners."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.stats import kendalltau

from interplan_sumo.batch.run_folder import StoredRun
from interplan_sumo.families import names
from interplan_sumo.scenario.suite import find_suite
from interplan_sumo.statistics.intervals import POINTS, mean_interval
from interplan_sumo.statistics.scene_values import DriveValue, DriveValues
from interplan_sumo.verification.hard_folder import read_scores
from interplan_sumo.world.csv_tables import number_in, read_table, write_table
from interplan_sumo.world.geometry import Floats

ROOT: Final = Path(__file__).resolve().parent.parent
RESULTS: Final = ROOT / "docs/results"
HIDDEN: Final = RESULTS / "interplan-hard-hidden.csv"
"""Scores in hard scenes that are kept back: planner, family and score, and nothing that tells of the scenes."""
HARD: Final = "interplan-hard==1"
DRAWS: Final = 2000

Half = dict[str, dict[str, list[float]]]
"""By planner and family the scores, 0 to 1, of scenes in one order."""


def panel_scores() -> dict[str, dict[str, float]]:
    """What those got against whom the shipped scenes were searched, by planner and scene."""
    return read_scores(find_suite(HARD).folder)


def shown_scores(run: StoredRun) -> Half:
    """Of who drove the shipped scenes, and of those of the panel who have not driven them again since."""
    return _by_family(panel_scores() | _driven(run))


def shown_places(run: StoredRun) -> dict[str, list[str]]:
    """Where the shipped scenes lie, by family, in the order of their scores."""
    sites = {row.scenario_id: row.site for row in run.rows.values()}
    found: dict[str, list[str]] = {}
    for scenario in find_suite(HARD).scenarios:
        found.setdefault(scenario.family, []).append(sites[scenario.id])
    return found


def _by_family(scores: Mapping[str, Mapping[str, float]]) -> Half:
    found: Half = {name: {family: [] for family in names(ordinary=False)} for name in scores}
    for scenario in find_suite(HARD).scenarios:
        for name, by_scene in scores.items():
            found[name][scenario.family].append(by_scene[scenario.id])
    return found


def both_halves(run: StoredRun) -> tuple[Half, Half]:
    """Shipped and kept back, of who drove both, in the families that both have; the panel's where it has not since."""
    shown = shown_scores(run)
    hidden: Half = {}
    for row in read_table(HIDDEN, ("planner", "family", "score")):
        hidden.setdefault(row["planner"], {}).setdefault(row["family"], []).append(number_in(row["score"], HIDDEN))
    both = sorted(shown.keys() & hidden.keys())
    common = [family for family in names(ordinary=False) if all(family in hidden[name] for name in both)]
    shown, hidden = ({name: {family: of[name][family] for family in common} for name in both} for of in (shown, hidden))
    return shown, hidden


def keep_hidden(run: StoredRun, scenes: Path) -> None:
    """Store the scores in scenes that are not shipped: of a run, else of the panel that `harden` left in a folder."""
    families = {row.scenario_id: row.family for row in run.rows.values()}
    scores = read_scores(scenes) | _driven(run)
    order = sorted(families, key=lambda scene: (families[scene], scene))
    rows = [(name, families[scene], f"{scores[name][scene]:.4f}") for name in sorted(scores) for scene in order]
    write_table(HIDDEN, ("planner", "family", "score"), rows)


def _driven(run: StoredRun) -> dict[str, dict[str, float]]:
    """What a run has, by planner and scene."""
    scores: dict[str, dict[str, float]] = {}
    for row in run.rows.values():
        scores.setdefault(row.planner, {})[row.scenario_id] = row.score or 0.0
    return scores


def family_scores(half: Half) -> list[Floats]:
    """Of each family the scores, (P, S)."""
    return [np.array([of[family] for of in half.values()]) for family in next(iter(half.values()))]


def means(families: Sequence[Floats], rng: np.random.Generator | None = None) -> Floats:
    """Of each planner, families alike; with scenes drawn again if there is a generator, the same for all."""
    if rng is not None:
        families = [drawn_again(scores, rng) for scores in families]
    return np.mean([scores.mean(axis=1) for scores in families], axis=0)


def drawn_again(scores: Floats, rng: np.random.Generator) -> Floats:
    """Scores of planners in scenes, (P, S), in as many scenes drawn with replacement, the same for all planners."""
    return scores[:, rng.integers(scores.shape[1], size=scores.shape[1])]


def totals(half: Half, places: Mapping[str, Sequence[str]] | None = None) -> dict[str, str]:
    """By planner, the best first, the mean and between what 95 % lie, 0 to 100; `places` of the scenes by family."""
    every = 100.0 * means(family_scores(half))
    names = [*half]
    order = np.argsort(-every, kind="stable").tolist()
    return {names[at]: f"{every[at]:.0f}{_between(half[names[at]], places or {})}" for at in order}


def _between(of: Mapping[str, Sequence[float]], places: Mapping[str, Sequence[str]]) -> str:
    """The interval of the mean over families alike: scores weigh more where a family has few."""
    scenes = sum(map(len, of.values()))
    drives: DriveValues = {
        (f"{family}/{number}", 0): DriveValue(
            family, 100.0 * score * scenes / len(of) / len(scores), places[family][number] if places else ""
        )
        for family, scores in of.items()
        for number, score in enumerate(scores)
    }
    interval = mean_interval(drives, POINTS)
    return "" if interval is None else f" [{interval[0]:.0f}, {interval[1]:.0f}]"


def tau(one: Floats, other: Floats) -> float:
    """Kendall's, of two scores of the same planners."""
    found: Any = kendalltau(one, other)
    return float(found.statistic)
