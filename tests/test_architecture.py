"""The shape of the house: imports point down, and SUMO is known in one module only."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "interplan_sumo"
SHELF = ROOT / "planners"

# Each room and the rooms it may import from. A module of the package's root is a room of its own.
BASE = {"errors", "extras", "interruption", "resources", "registry"}
LAYER_0 = {"world"}
PLANNER = {"planner", "planner_options", "planner_seat", "planner_source", "plan_check"}
LAYER_1 = {"maps", "dynamics", "features", "recordings", "scenario", "families", "tiny_worlds"} | PLANNER
LAYER_2 = {"simulation", "metrics", "policy", "planner_process"}
LAYER_3 = {
    "statistics",
    "verification",
    "batch",
    "report",
    "realism",
    "testing",
    "doctor",
    "dataset",
    "gym",
    "wheel",
    "endurance",
}
MAY_IMPORT: dict[str, set[str]] = {
    "errors": set(),
    "extras": {"errors"},
    "interruption": set(),
    "resources": {"errors"},
    "registry": {"errors"},
    "statistics": BASE,
    "world": BASE,
    "planner": BASE | LAYER_0 | {"planner_options"},
    "planner_options": BASE,
    "plan_check": BASE | LAYER_0,
    "planner_seat": BASE | LAYER_0 | {"planner"},
    "planner_source": BASE | LAYER_0 | {"planner", "planner_options"},
    "dynamics": BASE | LAYER_0,
    "maps": BASE | LAYER_0,
    "recordings": BASE | LAYER_0,
    "scenario": BASE | LAYER_0,
    "families": BASE | LAYER_0 | {"scenario"},
    "features": BASE | LAYER_0 | {"planner"},
    "tiny_worlds": BASE | LAYER_0 | {"planner"},
    "_check_worlds": BASE | LAYER_0 | {"planner", "tiny_worlds"},
    "simulation": BASE | LAYER_0 | LAYER_1,
    "metrics": BASE | LAYER_0 | LAYER_1,
    "policy": BASE | LAYER_0 | LAYER_1,
    "planner_process": BASE | LAYER_0 | PLANNER,
    "testing": BASE | LAYER_0 | LAYER_1 | LAYER_2 | {"_check_worlds"},
    "verification": BASE | LAYER_0 | LAYER_1 | LAYER_2,
    "batch": BASE | LAYER_0 | LAYER_1 | LAYER_2 | {"verification", "testing"},
    "report": BASE | LAYER_0 | LAYER_1 | LAYER_2 | {"batch", "verification", "statistics"},
    "realism": BASE | LAYER_0 | LAYER_1 | LAYER_2 | {"batch", "report"},
    "doctor": BASE | LAYER_0 | LAYER_1 | LAYER_2 | {"batch"},
    "bridge": BASE | LAYER_0 | {"dynamics", "maps", "planner", "planner_options"},
    "dataset": BASE | LAYER_0 | LAYER_1 | LAYER_2 | {"verification", "batch"},
    "gym": BASE | LAYER_0 | LAYER_1 | LAYER_2 | {"batch", "report"},
    "wheel": BASE | LAYER_0 | LAYER_1 | LAYER_2 | {"batch", "report"},
    "endurance": BASE | LAYER_0 | LAYER_1 | LAYER_2 | {"verification", "batch", "report", "statistics"},
    "api": BASE | LAYER_0 | LAYER_1 | LAYER_2 | {"batch", "report"},
    "cli": BASE | LAYER_0 | LAYER_1 | LAYER_2 | LAYER_3,
    "__main__": {"cli"},
    "__init__": {"api", "errors", "maps", "planner", "policy", "scenario", "testing", "world"},  # on demand
}
PLANNERS_MAY_IMPORT = {"world", "dynamics", "features", "planner", "errors", "extras"}
# Packages on the planners' shelf, and which of the others each may import.
SHELF_MAY_IMPORT: dict[str, set[str]] = {
    "interplan_planners": set(),
    "interplan_llm": {"interplan_planners"},
    "interplan_learned": {"interplan_planners"},
    "examples": set(),
}

# Of the checkout only: they make what ships, and nothing that ships knows them or what they are made with.
TOOLS = ROOT / "tools"
ONLY_IN_TOOLS = {"tools", "torch", "transformers", "peft", "onnx", "gguf"}


@cache
def imported(path: Path) -> frozenset[str]:
    """Absolute names of everything a module imports, inside functions too."""
    return frozenset(_imported(path))


def _imported(path: Path) -> Iterator[str]:
    package = path.relative_to(ROOT).with_suffix("").parts[:-1]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package[: len(package) - node.level + 1]) if node.level else ""
            module = ".".join(filter(None, (base, node.module or "")))
            yield module
            if module == "interplan_sumo":
                yield from (f"{module}.{alias.name}" for alias in node.names)


def rooms(path: Path) -> set[str]:
    """Rooms of interplan_sumo that a module imports from; `__version__` is everyone's."""
    names = (name.split(".") for name in imported(path))
    return {name[1] for name in names if name[0] == "interplan_sumo" and len(name) > 1} - {"__version__"}


def room_of(path: Path) -> str:
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


MODULES = sorted(PACKAGE.rglob("*.py"))
SHELVED = sorted(SHELF.rglob("*.py"))


def test_a_module_imports_only_downwards() -> None:
    reached = {path: rooms(path) - {room_of(path)} - MAY_IMPORT[room_of(path)] for path in MODULES}
    assert not {str(path.relative_to(ROOT)): up for path, up in reached.items() if up}


def test_a_planner_of_ours_imports_what_anyone_may() -> None:
    for path in SHELVED:
        package = path.relative_to(SHELF).parts[0]
        assert rooms(path) <= PLANNERS_MAY_IMPORT, path
        others = {name.split(".")[0] for name in imported(path)} & SHELF_MAY_IMPORT.keys() - {package}
        assert others <= SHELF_MAY_IMPORT[package], path


def test_what_ships_needs_nothing_of_the_tools() -> None:
    for path in (*MODULES, *SHELVED):
        assert not {name.split(".")[0] for name in imported(path)} & ONLY_IN_TOOLS, path


def test_the_package_never_imports_its_own_planners() -> None:
    for path in MODULES:
        assert not {name.split(".")[0] for name in imported(path)} & SHELF_MAY_IMPORT.keys(), path


@pytest.mark.parametrize(
    ("library", "allowed"),
    [
        ("libsumo", {"simulation/sumo.py"}),
        ("traci", set()),
        ("nuplan", {f"bridge/nuplan/{name}.py" for name in ("map_api", "objects", "ours", "planner")}),
        ("pickle", set()),
        ("xml.dom", set()),
    ],
)
def test_a_library_is_known_only_where_it_belongs(library: str, allowed: set[str]) -> None:
    knowing = {
        path.relative_to(PACKAGE).as_posix()
        for path in MODULES
        if any(name == library or name.startswith(f"{library}.") for name in imported(path))
    }
    assert knowing <= allowed


def test_every_room_has_a_rule() -> None:
    assert {room_of(path) for path in MODULES} <= set(MAY_IMPORT)


def test_no_module_has_outgrown_a_reader() -> None:
    ours = (*MODULES, *SHELVED, *TOOLS.rglob("*.py"))
    long = {str(p.relative_to(ROOT)): n for p in ours if (n := len(p.read_text().splitlines())) > 450}
    assert not long, f"split these: {long}"


def test_a_public_class_has_a_name_of_its_own() -> None:
    places: dict[str, list[str]] = {}
    for path in MODULES:
        for name in re.findall(r"^class ([A-Za-z]\w*)", path.read_text(encoding="utf-8"), re.MULTILINE):
            places.setdefault(name, []).append(str(path.relative_to(ROOT)))
    assert not {name: found for name, found in places.items() if len(found) > 1}


def test_no_modules_import_one_another_in_a_circle() -> None:
    names = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in MODULES if path.stem != "__init__"
    }
    left = {name: {each for each in imported(path) if each in names} - {name} for name, path in names.items()}
    while ground := [name for name, needs in left.items() if not needs & left.keys()]:
        for name in ground:
            del left[name]
    assert not left, f"these need one another: {sorted(left)}"


def test_test_modules_have_names_of_their_own_for_pytest_collects_no_two_alike() -> None:
    names = [path.name for path in (ROOT / "tests").rglob("test_*.py")]
    assert len(names) == len(set(names))
