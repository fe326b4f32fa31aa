"""How much does `foresight` owe to its constants? python -m benchmarks.foresight_sensitivity FOLDER... --out DIR

    interplan-sumo scenarios generate --map strip --family all --count 4 --seed 100000 --out scenes/strip

FOLDER has scenes on training seeds, from 100,000 on, made like that; those near a scene of a suite are left out. Every
number that a constant of the planner's modules is made of is a factor. In each drive a third of them is a fifth larger,
a third a fifth smaller, drawn anew for each scene and pair; the second drive of a pair is the first one's mirror image.
Half the difference within a pair then has no scene in it and no effect but the linear ones, all of which are told from
all pairs at once (a foldover design: Box, Hunter and Hunter, Statistics for Experimenters, 2005, 6). What the mean of
all pairs lacks to the drives as they are is what they cost together, either way.

Of some hundred effects the largest is large by chance. How far the true ones spread is what the estimates' variance has
beyond that of their errors, and each is drawn towards zero by as much as that says (empirical Bayes: Efron and Morris,
JASA 70, 1975). The same command goes on where it was stopped.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from types import ModuleType

import numpy as np
import pandas as pd
from scipy.stats import chi2

import interplan_planners.foresight
import interplan_sumo
from interplan_sumo.maps.store import load_roads
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.scenario import certificates
from interplan_sumo.scenario.files import read_scenarios, write_scenarios
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.geometry import Floats, Pose
from interplan_sumo.world.trajectory import Trajectory
from tools.tune_llm.scenes import near_official

BY = 0.2
PACKAGE = interplan_planners.foresight.__name__
SHOWN = 5
CONFIDENCE_Z = 1.96


# --- the factors ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Source:
    """A module of the planner as text, and its factors: where in it each number of a constant stands."""

    module: ModuleType
    text: str
    names: tuple[str, ...]

    @classmethod
    def of(cls, name: str) -> Source:
        module = importlib.import_module(name)
        text = Path(str(module.__file__)).read_text(encoding="utf-8")
        counts: dict[str, int] = {}
        names: list[str] = []
        for constant, _ in _numbers(ast.parse(text)):
            counts[constant] = counts.get(constant, 0) + 1
            names.append(f"{name.rpartition('.')[2]}.{constant}[{counts[constant]}]")
        return cls(module, text, tuple(names))

    def run(self, factors: Sequence[float]) -> None:
        """Make the module anew, with each number multiplied."""
        tree = ast.parse(self.text)
        for (_, number), factor in zip(_numbers(tree), factors, strict=True):
            number.value = float(number.value) * factor  # type: ignore[arg-type]
        exec(compile(tree, str(self.module.__file__), "exec"), self.module.__dict__)


def _numbers(tree: ast.Module) -> Iterator[tuple[str, ast.Constant]]:
    """Every number with a point in it, but zero, of what is assigned to a name in capitals; whole ones are counts."""
    for statement in tree.body:
        for name, assigned in _assigned(statement):
            if name.lstrip("_").isupper() and name not in FIXED:
                for node in ast.walk(assigned):
                    if isinstance(node, ast.Constant) and isinstance(node.value, float) and node.value:
                        yield name, node


def _assigned(statement: ast.stmt) -> Iterator[tuple[str, ast.expr]]:
    if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name) and statement.value is not None:
        yield statement.target.id, statement.value
    if not isinstance(statement, ast.Assign):
        return
    target, value = statement.targets[0], statement.value
    if isinstance(target, ast.Name):
        yield target.id, value
    elif isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
        yield from (
            (name.id, each) for name, each in zip(target.elts, value.elts, strict=True) if isinstance(name, ast.Name)
        )


FIXED = frozenset({
    "STEP_S", "PAST_STEP_S", "SPACING_M", "CHECKED_S", "TRACKED_AHEAD_S",  # grids that arrays are laid out by
    "FREE", "NOBODY_M", "EMERGENCY_MPS2",  # what stands for no bound, or for the car's own
    "_GAP_SHARES", "_ACCELERATION_SHARES",  # which quantiles stand for all
})  # fmt: skip
OTHER_BUDGET = "foreseen"
"""A module that has its say on the small budget only."""


def sources() -> tuple[Source, ...]:
    """The planner's modules, each after those that it needs."""
    folder = Path(str(interplan_planners.foresight.__file__)).parent
    ordered: list[str] = []

    def add(name: str) -> None:
        if name in ordered:
            return
        tree = ast.parse((folder / f"{name}.py").read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(f"{PACKAGE}."):
                add(str(node.module).rpartition(".")[2])
        ordered.append(name)

    for path in sorted(folder.glob("[a-z]*.py")):
        add(path.stem)
    ordered.remove(OTHER_BUDGET)
    return tuple(Source.of(f"{PACKAGE}.{name}") for name in ordered)


def factor_names() -> tuple[str, ...]:
    return tuple(name for source in sources() for name in source.names)


def levels(route: tuple[str, ...], goal: Pose, pair: int, names: Sequence[str]) -> Floats:
    """(F,) -1, 0 or 1 of each factor in the first drive of a scene's pair; another factor more changes no other's."""
    place = f"{' '.join(route)} {goal.x_m:.2f} {goal.y_m:.2f} {pair}"
    drawn = (sha256(f"{place} {name}".encode()).digest() for name in names)
    return np.array([int.from_bytes(digest[:4]) % 3 - 1.0 for digest in drawn])


class Perturbed:
    """`foresight` with constants that are off; with `pair` -1 as it is."""

    def __init__(self, pair: int = -1, mirrored: bool = False) -> None:
        self.pair, self.sign = pair, -1.0 if mirrored else 1.0
        self.sources = sources()

    def start(self, mission: Mission) -> None:
        names = [name for source in self.sources for name in source.names]
        drawn = np.zeros(len(names)) if self.pair < 0 else levels(mission.route, mission.goal, self.pair, names)
        left = iter((1.0 + self.sign * BY * drawn).tolist())
        for source in self.sources:
            source.run([next(left) for _ in source.names])
        self._planner = importlib.import_module(f"{PACKAGE}.planner").ForesightPlanner()
        self._planner.start(mission)

    def plan(self, observation: Observation) -> Trajectory:
        return self._planner.plan(observation)


# --- what came of it -----------------------------------------------------------------------------


def effects(scores: Floats, drawn: Floats) -> tuple[Floats, Floats]:
    """(F,) what a fifth more of each factor does to the mean score, and the standard errors; a fifth less the contrary.

    From the scores (P, 2) of pairs and the levels (P, F) of their first drives, by least squares.
    """
    half = (scores[:, 0] - scores[:, 1]) / 2.0
    inverse = np.linalg.pinv(drawn.T @ drawn)
    found = inverse @ drawn.T @ half
    left = half - drawn @ found
    variance = float(left @ left) / max(len(half) - drawn.shape[1], 1)
    return found, np.sqrt(variance * np.diag(inverse))


def spread(estimates: Floats, errors: Floats) -> tuple[float, float]:
    """The standard deviation of true effects about 0, and what it is at most (95 %).

    Estimates over their errors have a variance of 1 and the square of that over the errors'.
    """
    ratios, error = (estimates / errors) ** 2, float(np.sqrt(np.mean(errors**2)))

    def beyond_errors(ratio: float) -> float:
        return error * float(np.sqrt(max(ratio - 1.0, 0.0)))

    return beyond_errors(ratios.mean()), beyond_errors(ratios.sum() / chi2.ppf(0.05, len(ratios)))


@dataclass(frozen=True, eq=False)
class Answers:
    """Scores of pairs: (P, 2), their first drives' levels (P, F), and the scene's score as it is (P,), in points."""

    scores: Floats
    drawn: Floats
    as_it_is: Floats

    @classmethod
    def of(cls, scenes: Sequence[Scenario], rows: pd.DataFrame, pairs: int, names: Sequence[str]) -> Answers:
        points = rows.pivot_table(index="scenario_id", columns="planner", values="score") * 100.0
        scores, drawn, as_it_is = [], [], []
        for scene in scenes:
            roads = load_roads(scene.map, scene.maps_beside)
            for pair in range(pairs):
                scores.append([points.loc[scene.id, _planner(pair, mirrored)] for mirrored in (False, True)])
                drawn.append(levels(scene.route, scene.goal.pose(roads), pair, names))
                as_it_is.append(points.loc[scene.id, _planner(-1, False)])
        return cls(np.array(scores), np.array(drawn), np.array(as_it_is))


def _planner(pair: int, mirrored: bool) -> str:
    return f"benchmarks.foresight_sensitivity:Perturbed?pair={pair}&mirrored={str(mirrored).lower()}"


def driven(folders: Sequence[Path], out: Path, pairs: int, workers: int | None) -> tuple[list[Scenario], pd.DataFrame]:
    """The certified scenes of the folders that are away from all suites, driven; ValueError if a planner failed."""
    found: list[Scenario] = []
    rows: list[pd.DataFrame] = []
    planners = [_planner(-1, False), *(_planner(k, mirrored) for k in range(pairs) for mirrored in (False, True))]
    for folder in folders:
        proved = certificates.read_certificates(folder / certificates.FILE)
        scenes = [scene for scene in read_scenarios(folder / "scenarios.yaml") if scene.id in proved]
        scenes = [scene for scene in scenes if near_official(scene) is None]
        here = out / folder.name
        here.mkdir(parents=True, exist_ok=True)
        write_scenarios(scenes, here / "scenarios.yaml")
        shutil.copyfile(folder / certificates.FILE, here / certificates.FILE)
        rows.append(interplan_sumo.run(planners, scenarios=here / "scenarios.yaml", out=here / "run", workers=workers))
        found += scenes
    every = pd.concat(rows)
    failed = every[every["fault"].notna()]
    if len(failed):
        raise ValueError(f"{len(failed)} drives failed, the first with {failed['fault_message'].iloc[0]!r}")
    return found, every


def told(factors: Sequence[str], answers: Answers) -> str:
    """What the constants do, in Markdown."""
    found, errors = effects(answers.scores, answers.drawn)
    usual, most = spread(found, errors)
    kept = usual**2 / (usual**2 + errors**2)
    lines = [
        f"{len(factors)} numbers, {answers.scores.size} drives; as it is {answers.as_it_is.mean():.1f} points, with "
        f"two thirds of them off at once {answers.scores.mean():.1f}.",
        f"Standard error of an effect: {np.median(errors):.1f} points. True effects spread by {usual:.1f}, at most "
        f"{most:.1f}.",
        "",
        "| constant | a fifth more, as estimated | of that, after drawing in |",
        "|---|---|---|",
    ]
    for k in np.argsort(-np.abs(kept * found), kind="stable")[:SHOWN].tolist():
        more = f"{found[k]:+.1f} +- {CONFIDENCE_Z * errors[k]:.1f}"
        lines.append(f"| `{factors[k]}` | {more} | {kept[k] * found[k]:+.1f} |")
    return "\n".join(lines)


def main() -> None:
    """Drive, and print what the constants do."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+", help="with scenarios.yaml and certificates.parquet")
    parser.add_argument("--pairs", type=int, default=4, help="of drives of each scene")
    parser.add_argument("--workers", type=int, default=None)
    parser.add_argument("--out", type=Path, required=True, help="a folder for the runs")
    given = parser.parse_args()
    factors = factor_names()
    scenes, rows = driven(given.folders, given.out, given.pairs, given.workers)
    print(told(factors, Answers.of(scenes, rows, given.pairs, factors)))


if __name__ == "__main__":
    main()
