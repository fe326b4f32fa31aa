"""Baselines: plain traffic of every shipped vehicle-type file, and of every car-following model as SUMO has it."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.sax.saxutils import quoteattr

from interplan_sumo.errors import TrafficError
from interplan_sumo.realism.features import FeatureSamples, feature_samples
from interplan_sumo.realism.plain_traffic import plain_traffic
from interplan_sumo.realism.views import RecordedView
from interplan_sumo.resources import routes_root
from interplan_sumo.simulation.vehicle_type_effects import car_following_models
from interplan_sumo.simulation.vehicle_types import read_vehicle_types
from interplan_sumo.world.xml_file import root_of


@dataclass(frozen=True, slots=True)
class Baseline:
    """A vehicle-type file whose drivers are simulated."""

    name: str
    file: Path


def is_vehicle_types(path: Path) -> bool:
    """Whether a file is one of vehicle types, by its root."""
    return path.is_file() and root_of(path) in ("additional", "routes")


def shipped_files() -> dict[str, Path]:
    """The vehicle-type files that ship, by name."""
    return {path.stem: path for path in sorted(routes_root().glob("*.xml"))}


@contextmanager
def shipped_baselines() -> Generator[list[Baseline]]:
    """The shipped files, and a type with nothing but its model for each car-following model."""
    shipped = [Baseline(f"{name} (shipped)", path) for name, path in shipped_files().items()]
    with TemporaryDirectory(prefix="interplan_") as folder:
        yield [*shipped, *(_of_model(Path(folder), model) for model in car_following_models())]


def _of_model(folder: Path, model: str) -> Baseline:
    path = folder / f"{model}.xml"
    path.write_text(
        f'<additional><vType id="traffic" carFollowModel={quoteattr(model)} speedDev="0.1"/></additional>\n',
        encoding="utf-8",
    )
    return Baseline(f"{model} (SUMO's defaults)", path)


def simulated_baselines(
    baselines: Sequence[Baseline], views: Sequence[RecordedView], say: Callable[[str], None]
) -> dict[str, FeatureSamples]:
    """The features of the plain traffic of each, seen as recordings see theirs, by name.

    One that SUMO fails with is left out, and `say` is told.

    VehicleTypeError for a file that cannot be used, before anything is simulated.
    """
    types = [read_vehicle_types(each.file) for each in baselines]
    found: dict[str, FeatureSamples] = {}
    for number, (each, drivers) in enumerate(zip(baselines, types, strict=True), start=1):
        say(f"simulating {number} of {len(baselines)}: {each.name}")
        try:
            found[each.name] = feature_samples(plain_traffic(drivers, each.name, views))
        except TrafficError as error:
            say(f"warning: {each.name} is left out: {error}")
    return found
