"""Mutation testing: small wrong changes to a copy of the code, one at a time, and whether some test notices.

A script of our own: mutmut 3 has no sample and traces the whole suite first, cosmic-ray changes the working tree. The
sample, equally many of each package, is drawn by a hash of each mutant's own words: an edit elsewhere changes nothing.
A mutant runs only the tests that belong to its module, nearest by imports first, until one fails; running out of time
is failing, too. `accepted.toml` lists survivors that no test should notice, with the reason. Not mutated: messages,
annotations, decorators, `strict=` of zip, `<` to `<=`, which floats do not tell apart, and numbers below 1e-3.
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from functools import cache
from itertools import accumulate
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
PACKAGES = ("dynamics", "metrics", "simulation", "verification")
LEAST_KILLED = 0.9
LIMIT_S = 400  # for the tests of one mutant; they take a third of it
FARTHEST = 3  # tests of a module's package belong to it if so many imports lead there; other tests if they import it
OPERATORS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Lt: ast.Gt, ast.LtE: ast.GtE, ast.Gt: ast.Lt, ast.GtE: ast.LtE, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In, ast.Add: ast.Sub, ast.Sub: ast.Add,
    ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Div, ast.Mod: ast.Mult, ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd, ast.And: ast.Or, ast.Or: ast.And,
}  # fmt: skip
PAIRS = {"min": "max", "minimum": "maximum", "argmin": "argmax", "any": "all", "floor": "ceil"}
TWINS = PAIRS | {b: a for a, b in PAIRS.items()}


class Mutant(NamedTuple):
    """One wrong change: the bytes from `start` to `end` of a file become `text`."""

    path: str
    line: int
    start: int
    end: int
    text: str
    words: str  # file, function, what it was and what it is: decides on the sample, and is the key in `accepted.toml`


def changes(node: ast.AST) -> Iterator[ast.AST]:
    """All wrong versions of one expression."""
    wrong = deepcopy(node)
    if isinstance(node, ast.Compare) and isinstance(wrong, ast.Compare):
        for i, operator in enumerate(node.ops):
            wrong.ops[i] = OPERATORS[type(operator)]()  # type: ignore[index]
            yield deepcopy(wrong)
            wrong.ops[i] = operator
    elif isinstance(node, ast.BinOp | ast.BoolOp) and type(node.op) in OPERATORS:
        wrong.op = OPERATORS[type(node.op)]()  # type: ignore[attr-defined]
        yield wrong
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
        yield node.operand
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool | int):
        yield ast.Constant(not node.value if isinstance(node.value, bool) else node.value + 1)
    elif isinstance(node, ast.Constant) and isinstance(node.value, float) and not 0.0 < node.value < 1e-3:
        yield ast.Constant(round(1.5 * node.value, 6) if node.value else 1.0)
    elif isinstance(node, ast.Name) and node.id in TWINS:
        yield ast.Name(TWINS[node.id])
    elif isinstance(node, ast.Attribute) and node.attr in TWINS:
        yield ast.Attribute(node.value, TWINS[node.attr])


def expressions(node: ast.AST, where: str = "") -> Iterator[tuple[str, ast.AST]]:
    """Everything that may be mutated, with the function it stands in."""
    if isinstance(node, ast.Raise | ast.Assert | ast.JoinedStr) or getattr(node, "arg", None) == "strict":
        return
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        where = f"{where}.{node.name}".lstrip(".")
    yield where, node
    for name, value in ast.iter_fields(node):
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and name not in ("annotation", "returns", "decorator_list"):
                yield from expressions(child, where)


def mutants_of(path: Path) -> Iterator[Mutant]:
    """All mutants of a module."""
    source = path.read_bytes()
    starts = [0, *accumulate(map(len, source.splitlines(keepends=True)))]
    for where, node in expressions(ast.parse(source)):
        for wrong in changes(node):
            assert isinstance(node, ast.expr)
            start = starts[node.lineno - 1] + node.col_offset
            end = starts[(node.end_lineno or 0) - 1] + (node.end_col_offset or 0)
            name, text = str(path.relative_to(ROOT)), ast.unparse(wrong)
            words = f"{name} {where}: {ast.unparse(node)} -> {text}"
            yield Mutant(name, node.lineno, start, end, f" ({text}) ", words)


def sample(package: str, size: int) -> list[Mutant]:
    """The mutants of a package whose words have the smallest hashes."""
    keyed: dict[str, Mutant] = {}
    equal: Counter[str] = Counter()
    for path in sorted((ROOT / "interplan_sumo" / package).rglob("*.py")):
        for each in mutants_of(path):
            keyed[hashlib.sha256(f"{each.words} {equal[each.words]}".encode()).hexdigest()] = each
            equal[each.words] += 1
    return [keyed[key] for key in sorted(keyed)[:size]]


@cache
def imports(path: Path) -> frozenset[Path]:
    """The files of ours that a file imports, helpers of the tests included."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.ImportFrom) and node.module:
            names.update((node.module, *(f"{node.module}.{alias.name}" for alias in node.names)))
    stems = (name.replace(".", "/") for name in names)
    files = (folder / f"{stem}.py" for stem in stems for folder in (ROOT, ROOT / "tests", path.parent))
    return frozenset(filter(Path.is_file, files))


@cache
def tests_of(module: str) -> tuple[str, ...]:
    """The tests that belong to a module: its namesake first, then by the number of imports between."""
    target, package = ROOT / module, ROOT / "tests" / Path(module).parts[1]
    ranked: list[tuple[bool, int, int, str]] = []
    folders = [ROOT / "tests" / folder for folder in ("", "scenario", *PACKAGES)]
    for test in (file for folder in folders for file in folder.glob("test_*.py")):
        reached, away, farthest = {test}, 0, FARTHEST if package == test.parent else 1
        while target not in reached and away < farthest:
            reached, away = reached.union(*map(imports, reached)), away + 1
        if target in reached:
            ranked.append((test.stem != f"test_{target.stem}", away, test.stat().st_size, str(test.relative_to(ROOT))))
    return tuple(name for *_, name in sorted(ranked)) or (f"tests/{package.name}",)


def pass_in(tree: Path, tests: tuple[str, ...], *options: str) -> bool:
    """Whether tests pass in a copy of the tree."""
    quick = ("-p", "no:cacheprovider", "-m", "not slow and not nightly")
    command = [sys.executable, "-m", "pytest", "-x", *quick, *options, *tests]
    env = os.environ | {"PYTHONPATH": f"{tree}{os.pathsep}{tree / 'planners'}", "OPENBLAS_NUM_THREADS": "1"}
    out = None if options else subprocess.DEVNULL
    with subprocess.Popen(command, cwd=tree, env=env, stdout=out, start_new_session=True) as run:
        try:
            return run.wait(LIMIT_S) == 0
        except subprocess.TimeoutExpired:
            os.killpg(run.pid, signal.SIGKILL)
    return False


def survives(mutant: Mutant, tree: Path, number: int) -> bool:
    """Whether no test notices a mutant in a copy of the tree, which is put right again."""
    file = tree / mutant.path
    source = file.read_bytes()
    file.write_bytes(source[: mutant.start] + mutant.text.encode() + source[mutant.end :])
    os.utime(file, (number, number))  # compiled files are told apart by whole seconds
    try:
        return pass_in(tree, tests_of(mutant.path))
    finally:
        file.write_bytes(source)


def main() -> int:
    """Print every mutant's fate; 1 if too few were killed."""
    parser = argparse.ArgumentParser("python -m tools.mutants")
    for name, default in (("--workers", 2), ("--each", 50), ("--part", "1/1")):
        parser.add_argument(name, type=type(default), default=default)
    options = parser.parse_args()
    part, parts = map(int, options.part.split("/"))
    chosen = [each for package in PACKAGES for each in sample(package, options.each)][part - 1 :: parts]
    reasons = tomllib.loads(Path(__file__).with_name("accepted.toml").read_text())
    hidden = shutil.ignore_patterns(".*", "runs", "build", "dist", "__pycache__")
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(options.workers) as pool:
        trees = [Path(shutil.copytree(ROOT, Path(folder) / str(n), ignore=hidden)) for n in range(options.workers)]
        everything = tuple({test for each in chosen for test in tests_of(each.path)})
        if not pass_in(trees[0], everything, f"-n{options.workers}"):
            sys.exit(f"the tests fail, or take more than {LIMIT_S} s, without any mutant: mend that first")

        def judge(worker: int) -> Counter[str]:
            fates: Counter[str] = Counter()
            for number, each in enumerate(chosen[worker :: options.workers]):
                alive = survives(each, trees[worker], 10**9 + number)
                fate = "killed" if not alive else "accepted" if each.words in reasons else "survived"
                fates[fate] += 1
                print(f"{fate} {each.path}:{each.line} {each.words.partition(' ')[2]}", flush=True)
            return fates

        fates = sum(pool.map(judge, range(options.workers)), Counter[str]())
    print(f"{fates.total()} mutants: " + ", ".join(f"{number} {word}" for word, number in sorted(fates.items())))
    return int(fates["killed"] < LEAST_KILLED * fates.total())


if __name__ == "__main__":
    sys.exit(main())
