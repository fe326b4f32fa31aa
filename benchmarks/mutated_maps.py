"""Thousands of damaged map files of every format: a valid map or one line each, within 2 s of CPU and 1 GB.

    python -m benchmarks.mutated_maps [--count 10000] [--format sumo ...] [--real FOLDER] [--keep FOLDER]

Each mutant of a small map is imported and checked, SUMO network included, in a
child process of its own. What ends in a traceback, in a map that breaks
nuPlan's rules, or beyond the limits is a fault: its line names the seed that
makes it again (`--first SEED --count 1`), and --keep stores the file.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shlex
import shutil
import sys
import traceback
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from interplan_sumo.errors import InputError
from interplan_sumo.maps.check import check_map
from interplan_sumo.maps.geopackage import read_map
from interplan_sumo.maps.importers.importing import check_source, import_map
from interplan_sumo.maps.rules import schema_problems
from tests.maps.mutations import bases, mutant

CPU_S = 2.0
MEMORY_BYTES = 2**30
_BASE_CPU_S = 1.0
"""Real files that take longer as they are make no base."""
_HARD_CPU_S, _HARD_MEMORY_BYTES = 30, 6 * 2**30


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of one file."""

    kind: str
    """valid, refused, or a fault: invalid, traceback, several lines, killed, slow, large."""
    said: str
    cpu_s: float
    """Of the process and of netconvert."""
    peak_bytes: int
    """The largest of the processes."""

    @property
    def is_fault(self) -> bool:
        return self.kind not in ("valid", "refused")


def outcome(path: Path, format: str, folder: Path) -> Outcome:
    """Import and check a file in a child process; one that is slow gets a second chance, for so may the machine be."""
    first = _outcome(path, format, folder)
    return first if first.kind != "slow" else min(first, _outcome(path, format, folder), key=lambda each: each.cpu_s)


def _outcome(path: Path, format: str, folder: Path) -> Outcome:
    reads, writes = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reads)
        status = 1
        try:
            resource.setrlimit(resource.RLIMIT_CPU, (_HARD_CPU_S, _HARD_CPU_S))
            resource.setrlimit(resource.RLIMIT_AS, (_HARD_MEMORY_BYTES, _HARD_MEMORY_BYTES))
            kind, said = _tried(path, format, folder)
            os.write(writes, json.dumps((kind, said[:1500] + said[-1500:] if len(said) > 3000 else said)).encode())
            status = 0
        finally:
            os._exit(status)
    os.close(writes)
    with os.fdopen(reads, "rb") as pipe:
        answer = pipe.read()
    _, status, used = os.wait4(child, 0)
    shutil.rmtree(folder, ignore_errors=True)
    try:
        kind, said = json.loads(answer)
    except ValueError:  # it was killed before it could answer, or while it did
        kind, said = "killed", f"status {status}"
    cpu_s, peak = used.ru_utime + used.ru_stime, used.ru_maxrss * 1024
    if kind in ("valid", "refused") and (cpu_s > CPU_S or peak > MEMORY_BYTES):
        kind, said = "slow" if cpu_s > CPU_S else "large", f"{kind}: {said}"
    return Outcome(kind, said, cpu_s, peak)


def _tried(path: Path, format: str, folder: Path) -> tuple[str, str]:
    try:
        files, record = import_map(path, format, folder)
        roads = read_map(files.gpkg, files.name)
        if problems := schema_problems(roads):
            return "invalid", "; ".join(map(str, problems[:3]))
        report = check_map(files, roads)
        said = ", ".join(sorted({problem.kind for problem in report.problems}))
        if format != "nuplan":
            check_source(files, roads, record, path)
    except InputError as error:
        return "refused" if "\n" not in str(error) and len(str(error)) < 500 else "several lines", str(error)
    except BaseException:
        return "traceback", traceback.format_exc()
    return "valid", said


def repeat_command(seed: int, formats: Sequence[str], real: Path | None) -> str:
    """What makes the file of a seed again: it depends on the formats and on the files that there are."""
    words = ["python", "-m", "benchmarks.mutated_maps", "--first", str(seed), "--count", "1"]
    words += [word for format in formats for word in ("--format", format)]
    return shlex.join([*words, *(("--real", str(real)) if real else ())])


def main() -> None:
    parser = argparse.ArgumentParser(description="Damaged map files of every format.")
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--format", action="append", help="only this one; may be given several times")
    parser.add_argument("--real", type=Path, help="a folder of real files, by format")
    parser.add_argument("--keep", type=Path, help="a folder for the files that are faults")
    options = parser.parse_args()
    counts: Counter[tuple[str, str]] = Counter()
    slowest: dict[str, float] = {}
    largest: dict[str, int] = {}
    with TemporaryDirectory() as temporary:
        found = bases(Path(temporary, "bases"), options.real)
        unfit: set[Path] = set()
        for format, files in found.items():
            _tried(files[0], format, Path(temporary, "warm", format))  # loads the modules, for all children
            for base in files:
                used = outcome(base, format, Path(temporary, "made"))
                if used.kind != "valid" or used.cpu_s > _BASE_CPU_S:
                    unfit.add(base)
                    print(f"no base: {base.name}, {used.kind} in {used.cpu_s:.1f} s")
        formats = sorted(options.format or found)
        if unfit.issuperset(base for format in formats for base in found[format]):
            sys.exit("no file is quick enough on this machine to be a base; its cores are busy, or slow")
        for seed in range(options.first, options.first + options.count):
            format, rng = formats[seed % len(formats)], np.random.default_rng(seed)
            base = found[format][int(rng.integers(len(found[format])))]
            if base in unfit:
                continue
            path = Path(temporary, base.name)
            how = mutant(base, path, rng)
            got = outcome(path, format, Path(temporary, "made"))
            counts[format, got.kind] += 1
            slowest[format] = max(slowest.get(format, 0.0), got.cpu_s)
            largest[format] = max(largest.get(format, 0), got.peak_bytes)
            if got.is_fault:
                size = f"{got.cpu_s:.1f} s, {got.peak_bytes / 2**20:.0f} MiB"
                print(f"--- seed {seed}: {format} {base.name}, {how}: {got.kind}, {size}\n{got.said}", flush=True)
                print(f"    again: {repeat_command(seed, formats, options.real)}")
                if options.keep:
                    options.keep.mkdir(parents=True, exist_ok=True)
                    shutil.copyfile(path, options.keep / f"{seed}-{format}-{base.name}")
    print(f"{'format':<12}{'files':>7}{'valid':>7}{'refused':>9}{'faults':>8}{'most CPU s':>12}{'most MiB':>10}")
    faults = 0
    for format in formats:
        kinds = {kind: number for (name, kind), number in counts.items() if name == format}
        valid, refused = kinds.pop("valid", 0), kinds.pop("refused", 0)
        wrong = sum(kinds.values())
        faults += wrong
        most = f"{slowest.get(format, 0.0):>12.2f}{largest.get(format, 0) / 2**20:>10.0f}"
        print(f"{format:<12}{valid + refused + wrong:>7}{valid:>7}{refused:>9}{wrong:>8}{most}")
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
