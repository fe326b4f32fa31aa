"""Planners of other worlds by a prefix: found without being imported, and clear words where something is missing."""

from __future__ import annotations

import importlib
import sys
from dataclasses import dataclass
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path
from typing import Any

import pytest
from devkit import devkit

from interplan_sumo import planner as planners
from interplan_sumo import registry
from interplan_sumo.bridge.nuplan import scheme
from interplan_sumo.errors import PlannerLoadError, UnknownNameError
from interplan_sumo.planner import find_planner, load_planner


class Kept:
    """A planner that does nothing."""

    def __init__(self, **options: Any) -> None:
        self.options = options

    def start(self, mission: object) -> None: ...

    def plan(self, observation: object) -> None: ...


@dataclass(frozen=True)
class TunedSettings:
    gain: int = 2
    ahead_s: float = 0.5


class Tuned(Kept):
    """Keeps its options in a dataclass."""

    Settings = TunedSettings

    def __init__(self, settings: TunedSettings) -> None:
        self.settings = settings


class ToyScheme:
    """A scheme that knows one target."""

    def find(self, target: str) -> None:
        if target != "module:Known":
            raise PlannerLoadError(f"no toy {target}")

    def factory(self, target: str) -> Any:
        self.find(target)
        return self.make

    def make(self, **options: Any) -> Kept:
        if "bad" in options:
            raise PlannerLoadError("bad is no option of a toy")
        return Kept(**options)


TOYS = ToyScheme()


@pytest.fixture(autouse=True)
def schemes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two registered schemes, whatever is installed."""
    found = [
        EntryPoint("toy", f"{__name__}:TOYS", planners.SCHEMES.group),
        EntryPoint("nuplan", scheme.__name__, planners.SCHEMES.group),
    ]
    monkeypatch.setattr(registry, "entry_points", lambda group: EntryPoints(found))  # noqa: ARG005
    monkeypatch.setattr(planners, "SCHEMES", registry.Registry(planners.SCHEMES.group, "planner scheme"))


@pytest.fixture
def without_devkit(monkeypatch: pytest.MonkeyPatch) -> None:
    """A path on which there is no devkit."""
    for name in [each for each in sys.modules if each.partition(".")[0] == "nuplan"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "path", [each for each in sys.path if not (Path(each or ".") / "nuplan").is_dir()])
    importlib.invalidate_caches()


def test_a_prefix_hands_the_rest_to_its_scheme_and_options_to_what_it_makes() -> None:
    find_planner("toy:module:Known")
    made = load_planner("toy:module:Known?gain=2&offsets=[-1.0, 1.0]")
    assert isinstance(made, Kept)
    assert made.options == {"gain": 2, "offsets": [-1.0, 1.0]}


def test_what_a_scheme_does_not_know_is_said_in_its_own_words() -> None:
    with pytest.raises(PlannerLoadError, match=r"^no toy module:Other$"):
        find_planner("toy:module:Other")
    with pytest.raises(PlannerLoadError, match=r"^bad is no option of a toy$"):
        load_planner("toy:module:Known?bad=1")


@pytest.mark.parametrize("ask", [find_planner, load_planner])
def test_an_unknown_prefix_gets_the_nearest_one(ask: Any) -> None:
    with pytest.raises(UnknownNameError, match=r"no planner scheme named 'nuplam'\. Did you mean 'nuplan'\?"):
        ask("nuplam:module:Class")


def test_one_colon_is_still_a_module_and_a_class() -> None:
    find_planner(f"{__name__}:Kept")
    assert type(load_planner(f"{__name__}:Kept")).__name__ == "Kept"


@pytest.mark.parametrize("ask", [find_planner, load_planner])
@pytest.mark.usefixtures("without_devkit")
def test_without_the_devkit_it_is_said_what_to_put_on_the_path(ask: Any) -> None:
    with pytest.raises(PlannerLoadError, match=r"needs nuPlan's devkit: put a checkout of nuplan-devkit on PYTHONPATH"):
        ask("nuplan:some.module:Class")


def test_a_module_that_is_not_there_is_found_missing_before_anything_is_imported() -> None:
    devkit()
    with pytest.raises(PlannerLoadError, match="there is no module 'nuplan_planners_of_mine'"):
        find_planner("nuplan:nuplan_planners_of_mine:Class")


SIMPLE = "nuplan:nuplan.planning.simulation.planner.simple_planner"


@pytest.mark.parametrize(
    ("spec", "complaint"),
    [
        (f"{SIMPLE}:ComplexPlanner", "has no 'ComplexPlanner'"),
        (f"{SIMPLE}:SimplePlanner?horizon=8", "no option .* named 'horizon'. Did you mean 'horizon_seconds'"),
        (f"{SIMPLE}:SimplePlanner", "could not be built: TypeError: .* missing 3 required"),
        (f"{SIMPLE}:SimplePlanner?config=absent.yaml", "cannot read absent.yaml"),
        ("nuplan:pathlib:Path", "could not be built|no nuPlan planner"),
        (
            "nuplan:nuplan.planning.simulation.planner.log_future_planner:LogFuturePlanner?scenario=1&num_poses=8"
            "&future_time_horizon=8",
            "asks for the scenario",
        ),
    ],
)
@pytest.mark.filterwarnings("ignore")
def test_what_cannot_drive_is_refused_in_one_line(spec: str, complaint: str) -> None:
    devkit()
    with pytest.raises((PlannerLoadError, UnknownNameError), match=complaint) as caught:
        load_planner(spec)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "value"), [("2", 2), ("0.5", 0.5), ("1e-4", 1e-4), ("-2E3", -2000.0), ("true", True), ("e4", "e4")]
)
def test_options_are_numbers_where_people_write_numbers(text: str, value: object, monkeypatch: Any) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    found = load_planner(f"test_planner_schemes:Kept?x={text}")
    assert found.options == {"x": value}  # type: ignore[attr-defined]


def test_options_of_a_planner_with_settings_are_their_fields(monkeypatch: pytest.MonkeyPatch) -> None:
    points = EntryPoints([EntryPoint("tuned", f"{__name__}:Tuned", planners.PLANNERS.group)])
    monkeypatch.setattr(registry, "entry_points", lambda group: points)  # noqa: ARG005
    monkeypatch.setattr(planners, "PLANNERS", registry.Registry(planners.PLANNERS.group, "planner"))
    assert [(info.name, info.parameters) for info in planners.planners()] == [("tuned", {"gain": 2, "ahead_s": 0.5})]
    made = load_planner("tuned?gain=3")
    assert isinstance(made, Tuned)
    assert made.settings == TunedSettings(gain=3, ahead_s=0.5)
    with pytest.raises(UnknownNameError, match=r"no option of planner 'tuned' named 'gian'\. Did you mean 'gain'\?"):
        load_planner("tuned?gian=3")
