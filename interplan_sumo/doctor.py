"""Doctor: is everything here that a run needs, and does two seconds of driving work?"""

from __future__ import annotations

import importlib
import platform
import re
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import metadata

from interplan_sumo.batch.processes import available_cores
from interplan_sumo.batch.versions import versions

NATIVE = ("numpy", "scipy.signal", "shapely", "pyarrow.parquet", "pyproj", "interplan_sumo.simulation.sumo")
NAME = "interplan-sumo"
SELF_TEST_S = 2.0


@dataclass(frozen=True, slots=True)
class DoctorCheck:
    """One thing that was looked at."""

    name: str
    ok: bool
    detail: str


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """What the doctor found."""

    versions: dict[str, str]
    machine: dict[str, str | int]
    checks: tuple[DoctorCheck, ...]

    @property
    def ok(self) -> bool:
        return all(check.ok for check in self.checks)


def examine() -> Diagnosis:
    """Import every native library, read every shipped file, drive a little."""
    checks = [
        _check(f"library {name.split('.')[0] if 'sumo' not in name else 'libsumo'}", _import, name) for name in NATIVE
    ]
    checks += [_check("maps", _read_maps), _check("vehicle types", _read_vehicle_types), _check("suites", _read_suites)]
    checks += [_check("planners", _load_recommended), _check("self-test", _drive_a_little)]
    checks += [DoctorCheck(f"extra [{name}]", True, _extra(name)) for name in _extras()]
    machine: dict[str, str | int] = {
        "platform": platform.platform(),
        "platform class": platform_class(),
        "python": sys.executable,
        "cores": available_cores(),
    }
    return Diagnosis(versions(), machine, tuple(checks))


def platform_class() -> str:
    """What must be equal, beside all versions, for traces to have equal hashes: arithmetic differs between them."""
    return f"{sys.platform}-{platform.machine().lower()}"


def _check(name: str, look: Callable[..., str], *arguments: str) -> DoctorCheck:
    try:
        return DoctorCheck(name, True, look(*arguments))
    except Exception as error:
        return DoctorCheck(name, False, f"{type(error).__name__}: {error}")


def _import(name: str) -> str:
    began_s = time.perf_counter()
    importlib.import_module(name)
    return f"imported in {time.perf_counter() - began_s:.2f} s"


def _read_maps() -> str:
    from interplan_sumo.maps.store import find_map, load_roads, maps
    from interplan_sumo.simulation.network import read_network

    for name in maps():
        load_roads(name)
        read_network(find_map(name).network)
    return f"{len(maps())} read: {', '.join(maps())}"


def _read_vehicle_types() -> str:
    from interplan_sumo.resources import routes_root
    from interplan_sumo.simulation.vehicle_types import read_vehicle_types

    files = sorted(routes_root().glob("*.xml"))
    for file in files:
        read_vehicle_types(file)
    return f"{len(files)} read: {', '.join(file.stem for file in files)}"


def _read_suites() -> str:
    from interplan_sumo.maps.store import load_roads
    from interplan_sumo.scenario.suite import expert, suites

    for suite in suites().values():
        for scenario in suite.scenarios:
            scenario.check(load_roads(scenario.map))
            expert(scenario)
    return ", ".join(f"{key}: {len(suite.scenarios)} scenarios" for key, suite in suites().items())


def _load_recommended() -> str:
    from interplan_sumo.planner import PLANNERS, RECOMMENDED, load_planner

    load_planner(RECOMMENDED)
    return f"{len(PLANNERS)} registered, {RECOMMENDED} recommended"


def _drive_a_little() -> str:
    """Two simulated seconds of the recommended planner through SUMO, scored."""
    from interplan_sumo.maps.store import load_roads
    from interplan_sumo.metrics.score import score
    from interplan_sumo.planner import RECOMMENDED, load_planner
    from interplan_sumo.scenario.suite import DEFAULT_SUITE, expert, find_suite
    from interplan_sumo.simulation.episode import drive

    whole = find_suite(DEFAULT_SUITE).scenarios[0]
    began_s = time.perf_counter()
    episode = drive(replace(whole, duration_s=SELF_TEST_S), load_planner(RECOMMENDED))
    if episode.fault is not None or episode.trace is None:
        raise RuntimeError(episode.fault.message if episode.fault else "nothing was recorded")
    score(episode.trace, load_roads(whole.map), expert(whole), whole)
    took_s = time.perf_counter() - began_s
    return f"{SELF_TEST_S:g} s of {whole.id} driven and scored in {took_s:.2f} s"


def _extras() -> list[str]:
    """Those that the package declares; none in a bare checkout."""
    try:
        return metadata.metadata(NAME).get_all("Provides-Extra") or []
    except metadata.PackageNotFoundError:
        return []


def _extra(name: str) -> str:
    """Whether it is installed; a missing one is told, and is no fault."""
    missing = [wanted for wanted in sorted(_wanted(name)) if not _is_installed(wanted)]
    return f"not installed ({', '.join(missing)}); pip install '{NAME}[{name}]'" if missing else "installed"


def _wanted(extra: str) -> set[str]:
    """The distributions that an extra asks for, those of extras that it includes among them."""
    found: set[str] = set()
    for line in metadata.requires(NAME) or ():
        wanted, _, marker = line.partition(";")
        name = re.match(r"[\w.-]+", wanted)
        if name is None or not re.search(rf"extra == [\"']{re.escape(extra)}[\"']", marker):
            continue
        if name[0] != NAME:
            found.add(name[0])
            continue
        for inner in re.findall(r"[\w-]+", wanted.partition("[")[2].partition("]")[0]):
            found |= _wanted(inner)
    return found


def _is_installed(distribution: str) -> bool:
    try:
        metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return False
    return True
