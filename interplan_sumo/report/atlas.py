"""Atlas: where in the parameters of its scenes a planner fails, which of them tell most, and what it nearly solved."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Final

import numpy as np

from interplan_sumo.batch.run_folder import MANIFEST, StoredRun, read_run
from interplan_sumo.errors import InputError, UnknownNameError, check_names
from interplan_sumo.families import named_family
from interplan_sumo.families.scene_space import PLACE, quantiles_apart
from interplan_sumo.verification.generation import PARAMETERS, NotedDraw, read_parameters
from interplan_sumo.verification.hard_folder import TRIED, read_tried_scores
from interplan_sumo.verification.solvers import SOLVED_SCORE
from interplan_sumo.world.geometry import Floats

OFTEN: Final = 0.8
"""Parameters that fewer of the scenes have are no axes."""
ALIKE: Final = 0.9
"""Nor are those that are the same in more of them."""
REACH: Final = 0.12
"""Of an axis: how far a scene says something of others (the deviation of a normal kernel)."""
SHUFFLES: Final = 100
"""Of the scores among the scenes, to know what chance alone would tell."""
MOST_COMPARED: Final = 300
"""Scenes, spread over all, by which axes are chosen."""
FEWEST: Final = 4
"""Scenes from which on axes are chosen."""
MOST_NEAR: Final = 6
"""Pairs of a failed and a solved scene that are told."""
MOST_DIFFERENCES: Final = 4
"""Parameters that are told of a pair."""


@dataclass(frozen=True, slots=True)
class AtlasScene:
    """A scene that the planner drove."""

    id: str
    family: str
    seed: int
    """Of its worst drive."""
    score: float
    """0 to 1, the mean over the seeds."""
    draws: Mapping[str, NotedDraw]
    trace_hash: str = ""
    """Of its worst drive, where it is kept."""

    @property
    def solved(self) -> bool:
        return self.score >= SOLVED_SCORE


def nearness(places: Floats, at: Floats | float) -> Floats:
    """How much scenes at some places of an axis say of another one: 1 at its place, less with the distance."""
    return np.exp(-0.5 * ((places - at) / REACH) ** 2)


@dataclass(frozen=True, slots=True)
class AtlasAxis:
    """A parameter along which scenes lie, 0 to 1."""

    name: str
    options: tuple[str, ...]
    """Of words, by how often they come; none for numbers."""
    low: float
    high: float

    def place(self, value: str) -> float:
        """Of a value; of a word the middle of its share of the axis."""
        if self.options:
            return (self.options.index(value) + 0.5) / len(self.options)
        return (float(value) - self.low) / (self.high - self.low) if self.high > self.low else 0.5

    def alike(self, values: Sequence[str | None]) -> Floats:
        """(N, N), how much each scene says of each other by this parameter alone; nothing of those that lack it."""
        if self.options:
            words = np.array([value or "" for value in values])
            return (words[:, None] == words[None, :]).astype(np.float64)
        places = np.array([np.nan if value is None else self.place(value) for value in values])
        found = nearness(places[:, None], places)
        lacking = np.isnan(places)
        return np.where(lacking[:, None] | lacking[None, :], (lacking[:, None] & lacking[None, :]) * 1.0, found)


@dataclass(frozen=True, slots=True)
class Told:
    """How much of what the planner fails in these parameters tell."""

    names: tuple[str, ...]
    share: float
    """Of the uncertainty whether a scene is solved that its neighbours take away, below 0 where they mislead."""


@dataclass(frozen=True, slots=True)
class NearScenes:
    """A failed scene and the solved one nearest to it."""

    failed: AtlasScene
    solved: AtlasScene
    apart: float
    """The mean difference of their quantiles."""
    differences: tuple[tuple[str, str, str], ...]
    """The parameters that differ most: name, value where it fails, value where it solves."""


@dataclass(frozen=True)
class Atlas:
    """What one planner does in the scenes of one family."""

    planner: str
    family: str
    scenes: tuple[AtlasScene, ...]
    axes: Mapping[str, AtlasAxis]
    shown: tuple[AtlasAxis, AtlasAxis]
    """Those of the picture."""
    told: Told | None
    """By these two; None where all or none of the scenes are solved."""
    by_chance: float | None
    """The share of shuffles in which the best two (or these, if they were asked for) tell as much."""
    alone: tuple[Told, ...]
    """Each parameter, the one that tells most first."""
    near: tuple[NearScenes, ...]
    run: Path | None
    """The run folder; None for what a search tried, of which no drive is kept."""
    source: Path
    """Where the parameters are from."""

    @property
    def solved(self) -> int:
        return sum(scene.solved for scene in self.scenes)


def read_atlas(
    folder: Path,
    parameters: Path | None = None,
    planner: str | None = None,
    family: str | None = None,
    over: Sequence[str] = (),
) -> Atlas:
    """The atlas of a run, or of what a search for hard scenes tried.

    `parameters` is parameters.csv of the scenes of a run, or a folder that has
    it. InputError if there is nothing to show, UnknownNameError for a planner,
    family or parameter that is not there.
    """
    if (folder / MANIFEST).is_file():
        run = read_run(folder)
        if parameters is None:
            raise InputError(f"{folder} does not say what was drawn for its scenes; name the folder with --parameters")
        drawn = _parameters(parameters)
        named = _one(f"planner in {folder}", planner, run.planners)
        scenes = _scenes_of(run, named, drawn)
        if not scenes:
            raise InputError(f"{parameters} has no parameters of any scene that {named} drove in {folder}")
        return atlas(named, scenes, family, over, run=folder, source=parameters)
    tried = folder / TRIED
    if not (tried / PARAMETERS).is_file():
        raise InputError(f"{folder} is neither a run folder nor one of scenarios harden")
    scores, drawn = read_tried_scores(folder), read_parameters(tried / PARAMETERS)
    named = _one(f"planner in {tried}", planner, list(scores))
    found = [
        AtlasScene(id, named_family(id), 0, score, drawn[id]) for id, score in scores[named].items() if id in drawn
    ]
    if not found:
        raise InputError(f"{tried} has no scene that {named} drove")
    return atlas(named, found, family, over, run=None, source=folder)


def _parameters(place: Path) -> dict[str, dict[str, NotedDraw]]:
    if not place.is_dir():
        return read_parameters(place)
    files = [path for path in (place / TRIED / PARAMETERS, place / PARAMETERS) if path.is_file()]
    if not files:
        raise InputError(f"{place} has no {PARAMETERS}; scenarios harden writes it")
    return {id: draws for path in files for id, draws in read_parameters(path).items()}


def _one(what: str, asked: str | None, known: Sequence[str]) -> str:
    """What was asked for, or the first."""
    if asked is not None and asked not in known:
        raise UnknownNameError(what, asked, known)
    if not known:
        raise InputError(f"there is no {what}")
    return asked or known[0]


def _scenes_of(run: StoredRun, planner: str, drawn: Mapping[str, Mapping[str, NotedDraw]]) -> list[AtlasScene]:
    drives: dict[str, list[tuple[float, int, str, str]]] = {}
    for row in run.rows.values():
        if row.planner == planner and row.score is not None and row.scenario_id in drawn:
            about = (row.score, row.seed, row.family, row.trace_hash or "")
            drives.setdefault(row.scenario_id, []).append(about)
    scenes: list[AtlasScene] = []
    for id, found in drives.items():
        _, seed, family, trace_hash = min(found)
        mean = sum(score for score, *_ in found) / len(found)
        scenes.append(AtlasScene(id, family, seed, mean, drawn[id], trace_hash))
    return scenes


def atlas(
    planner: str,
    scenes: Sequence[AtlasScene],
    family: str | None = None,
    over: Sequence[str] = (),
    *,
    run: Path | None,
    source: Path,
) -> Atlas:
    """The atlas of some scenes: of the family that most are of if none is named."""
    families = [name for name, _ in Counter(scene.family for scene in scenes).most_common()]
    of_family = _one("family among the scenes", family, families)
    own = tuple(sorted((scene for scene in scenes if scene.family == of_family), key=lambda scene: scene.id))
    axes = _axes(own)
    if len(axes) < 2:
        raise InputError(f"the scenes of {of_family} have fewer than two parameters that differ; search more of them")
    check_names("parameter that the scenes differ in", over, axes)
    if over and (len(over) != 2 or over[0] == over[1]):
        raise InputError(f"--over {','.join(over)}: name two parameters, such as {','.join([*axes][:2])}")
    names, told, by_chance, alone = _chosen(own, axes, over)
    shown = axes[names[0]], axes[names[1]]
    return Atlas(planner, of_family, own, axes, shown, told, by_chance, alone, _near(own), run, source)


def _axes(scenes: Sequence[AtlasScene]) -> dict[str, AtlasAxis]:
    """The parameters that most scenes have and that are not the same in all."""
    held: dict[str, list[str]] = {}
    for scene in scenes:
        for name, draw in scene.draws.items():
            held.setdefault(name, []).append(draw.value)
    found: dict[str, AtlasAxis] = {}
    for name, values in held.items():
        most_alike = Counter(values).most_common(1)[0][1]
        if name == PLACE or len(values) < OFTEN * len(scenes) or most_alike > ALIKE * len(values):
            continue
        numbers = [number for value in values if (number := _number(value)) is not None]
        if len(numbers) == len(values):
            found[name] = AtlasAxis(name, (), min(numbers), max(numbers))
        else:
            found[name] = AtlasAxis(name, tuple(word for word, _ in Counter(values).most_common()), 0.0, 1.0)
    return found


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _chosen(
    scenes: Sequence[AtlasScene], axes: Mapping[str, AtlasAxis], over: Sequence[str]
) -> tuple[tuple[str, str], Told | None, float | None, tuple[Told, ...]]:
    """The two parameters that tell most, how much, how often chance does as well, and each alone."""
    every = np.linspace(0, len(scenes) - 1, min(len(scenes), MOST_COMPARED)).round().astype(int)
    some = [scenes[row] for row in every]
    solved = np.array([scene.solved for scene in some], dtype=np.float64)
    names = list(axes)
    if len(some) < FEWEST or solved.min() == solved.max():
        first, second = (*over, *names)[:2]
        return (first, second), None, None, ()
    drawn = {name: [each.draws[name].value if name in each.draws else None for each in some] for name in names}
    alike = {name: axes[name].alike(drawn[name]) for name in names}
    pairs = [(over[0], over[1])] if over else list(combinations(names, 2))
    shuffled = np.stack([solved, *(np.random.default_rng(row).permutation(solved) for row in range(SHUFFLES))], axis=1)
    shares = np.stack([told_share(alike[a] * alike[b], shuffled) for a, b in pairs])
    best = int(shares[:, 0].argmax())
    by_chance = float(np.mean(shares[:, 1:].max(axis=0) >= shares[best, 0]))
    alone = [Told((name,), float(told_share(alike[name], solved[:, None])[0])) for name in names]
    ranked = tuple(sorted(alone, key=lambda each: -each.share))
    return pairs[best], Told(pairs[best], float(shares[best, 0])), by_chance, ranked


def told_share(alike: Floats, solved: Floats) -> Floats:
    """(K,), the share of uncertainty that neighbours take away: of N scenes that say so much of each other (N, N) and
    were solved or not (N, K), 1 less the ratio of two logarithmic losses, each scene guessed from the others only."""
    others = alike - np.diag(np.diag(alike))
    many = len(solved)
    usual = (solved.sum(axis=0) - solved + 0.5) / many
    guess = (others @ solved + usual) / (others.sum(axis=1)[:, None] + 1.0)
    before, after = (-np.log(np.where(solved > 0.5, p, 1.0 - p)).mean(axis=0) for p in (usual, guess))
    return 1.0 - after / before


def _near(scenes: Sequence[AtlasScene]) -> tuple[NearScenes, ...]:
    """Each failed scene with the solved one nearest to it, the nearest pairs first."""
    solved = [scene for scene in scenes if scene.solved]
    found: list[NearScenes] = []
    for failed in scenes:
        if failed.solved or not solved:
            continue
        nearest = min(solved, key=lambda scene: _apart(failed, scene))
        found.append(NearScenes(failed, nearest, _apart(failed, nearest), _differences(failed, nearest)))
    return tuple(sorted(found, key=lambda pair: pair.apart)[:MOST_NEAR])


def _apart(one: AtlasScene, other: AtlasScene) -> float:
    return quantiles_apart(*({name: draw.quantile for name, draw in each.draws.items()} for each in (one, other)))


def _differences(failed: AtlasScene, solved: AtlasScene) -> tuple[tuple[str, str, str], ...]:
    """What both have comes first: what only one has follows from it."""
    found: list[tuple[float, str, str, str]] = []
    for name in failed.draws.keys() | solved.draws.keys():
        a, b = failed.draws.get(name), solved.draws.get(name)
        if name == PLACE or (a and b and a.value == b.value):
            continue
        found.append((-abs(a.quantile - b.quantile) if a and b else 1.0, name, _said(a), _said(b)))
    return tuple((name, one, other) for _, name, one, other in sorted(found)[:MOST_DIFFERENCES])


def _said(draw: NotedDraw | None) -> str:
    return "-" if draw is None else value_text(draw.value)


def value_text(value: str) -> str:
    """A value with three digits at most behind the point."""
    number = _number(value)
    return value if number is None else f"{round(number, 2):g}"
