"""Hard folder: what a search for hard scenes found, as a folder that `run` accepts.

| file | what |
|---|---|
| scenarios.yaml, certificates.parquet | the scenes, and a drive for each that proves it solvable |
| hard.csv | of each its difficulty, plausibility, who solves it, and the panel's scores |
| parameters.csv | of each what was drawn for it |
| tried/ | all scenes that the panel drove, whatever came of it, with their parameters and scores.csv of who drove |
| rejected.csv | scenes that were not taken, with the check that they failed |
| search.json | what was asked for: `hard_asked` |
| candidates/ | what is known of scenes, so that the search goes on where it was stopped |
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from interplan_sumo.scenario import certificates
from interplan_sumo.scenario.certificates import Certificate
from interplan_sumo.scenario.difficulty import HARD
from interplan_sumo.scenario.files import write_scenarios
from interplan_sumo.verification.generation import PARAMETERS, REJECTED, SCENARIOS, write_parameters
from interplan_sumo.verification.hard_search import HardScene, HardSearch
from interplan_sumo.world.csv_tables import number_in, read_table, write_table
from interplan_sumo.world.files import OTHER_FOLDER, writing

TRIED: Final = "tried"
SCORES: Final = "scores.csv"
CANDIDATES: Final = "candidates"
ABOUT: Final = ("scenario_id", "difficulty", "mean_score", "plausibility", "solved_by")
"""The columns of hard.csv before the scores of the panel."""


def write_hard(searches: Sequence[HardSearch], folder: Path, *, kept_back: Path | None = None) -> None:
    """Write what searches against one panel found; certificates to `kept_back` if given. InputError if it cannot be."""
    panel = searches[0].options.panel
    taken = [each for search in searches for each in sorted(search.taken, key=lambda scene: scene.id)]
    judged = [each for search in searches for each in search.judged]
    proved = [Certificate.of(each.verdict.certificate) for each in taken if each.verdict.certificate is not None]
    tried = [scene for scene in judged if scene.verdict.scores]
    with writing(folder, OTHER_FOLDER):
        (folder / TRIED).mkdir(parents=True, exist_ok=True)
        write_scenarios([each.drawn.scenario for each in taken], folder / SCENARIOS)
        write_scenarios([each.drawn.scenario for each in tried], folder / TRIED / SCENARIOS)
    with writing(kept_back or folder, "give another file as --secret-seed" if kept_back else OTHER_FOLDER):
        certificates.write_certificates(kept_back or folder / certificates.FILE, proved)
    for there, scenes in ((folder, taken), (folder / TRIED, tried)):
        write_parameters(there / PARAMETERS, ((each.id, each.drawn.draws) for each in scenes))
    write_table(folder / TRIED / SCORES, ("scenario_id", *panel), [_scores(scene, panel) for scene in tried])
    write_table(folder / HARD, (*ABOUT, *panel), [_row(scene, panel) for scene in taken])
    ids = {scene.id for scene in taken}
    others = [scene for scene in judged if scene.id not in ids]
    rows = [(each.verdict.stage or "not needed", each.id, each.verdict.reason) for each in others]
    write_table(folder / REJECTED, ("stage", "scenario_id", "reason"), rows)


def _row(scene: HardScene, panel: tuple[str, ...]) -> tuple[object, ...]:
    verdict, proved = scene.verdict, scene.verdict.certificate
    solved_by = " ".join(proved.summary.solved_by or ()) if proved is not None else ""
    scores = _scores(scene, panel)[1:]
    hard = f"{verdict.difficulty:.2f}", f"{verdict.mean_score:.4f}", f"{scene.plausibility:.3f}"
    return (scene.id, *hard, solved_by, *scores)


def _scores(scene: HardScene, panel: tuple[str, ...]) -> tuple[str, ...]:
    """The id, and what each of the panel got; nothing for those who did not drive."""
    scores = scene.verdict.scores
    return scene.id, *(f"{scores[name]:.4f}" if name in scores else "" for name in panel)


def read_scores(folder: Path) -> dict[str, dict[str, float]]:
    """By planner of the panel, then scene, what it gets in the scenes of a folder; InputError if it cannot be read."""
    return _scores_in(folder / HARD, ABOUT)


def read_tried_scores(folder: Path) -> dict[str, dict[str, float]]:
    """The same in all scenes that a search tried, of those who drove."""
    return _scores_in(folder / TRIED / SCORES, ABOUT[:1])


def _scores_in(path: Path, about: Sequence[str]) -> dict[str, dict[str, float]]:
    """Every column of a table but those about a scene, by scene."""
    found: dict[str, dict[str, float]] = {}
    for row in read_table(path, about):
        for name in (each for each in row if each not in about):
            held = found.setdefault(name, {})
            held |= {row["scenario_id"]: number_in(row[name], path)} if row[name] else {}
    return found
