"""Baselines: standard scenes driven with every shipped vehicle-type file, and with every car-following model of SUMO's.

The scenes are lane changes of the suite at three densities, at lights and on the open road, with the reference IDM
planner as the ego: traffic as planners meet it. Who is in them at the start, and where, is the same for all files.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final
from xml.sax.saxutils import quoteattr

from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.run import run
from interplan_sumo.errors import InputError, VehicleTypeError
from interplan_sumo.realism.features import FeatureSamples, feature_samples
from interplan_sumo.realism.sources import TrafficSource
from interplan_sumo.resources import routes_root
from interplan_sumo.simulation.vehicle_type_effects import car_following_models
from interplan_sumo.simulation.vehicle_types import read_vehicle_types
from interplan_sumo.world.files import file_hash, writing
from interplan_sumo.world.xml_file import root_of

SCENES: Final = tuple(f"lane_change_{density}/{number}" for density in ("ltd", "mtd", "htd") for number in (0, 3, 6))
PLANNER: Final = "idm"
MODELS: Final = "models"
"""Below the folder of the baselines: a vehicle-type file for each car-following model."""


@dataclass(frozen=True, slots=True)
class Baseline:
    """A vehicle-type file that the standard scenes are driven with."""

    name: str
    file: Path


def baselines(folder: Path) -> list[Baseline]:
    """The shipped files, and the models, whose files are written below `folder`; InputError if they cannot be."""
    shipped = [Baseline(f"{path.stem} (shipped)", path) for path in sorted(routes_root().glob("*.xml"))]
    place = folder / MODELS
    with writing(place, "give another folder as --baselines"):
        place.mkdir(parents=True, exist_ok=True)
        models = [Baseline(f"{model} (SUMO's defaults)", _of_model(place, model)) for model in car_following_models()]
    return [*shipped, *(each for each in models if _usable(each.file))]


def _of_model(place: Path, model: str) -> Path:
    """A file with one type that has nothing but its model."""
    path = place / f"{model}.xml"
    text = f'<additional><vType id="traffic" carFollowModel={quoteattr(model)}/></additional>\n'
    if not path.is_file() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")
    return path


def _usable(file: Path) -> bool:
    try:
        read_vehicle_types(file)
    except VehicleTypeError:
        return False
    return True


def drive_baselines(
    chosen: Sequence[Baseline], folder: Path, workers: int | str | None, say: Callable[[str], None]
) -> dict[str, FeatureSamples]:
    """The features of each, by name; one with which SUMO fails in every scene is left out, and `say` is told."""
    found: dict[str, FeatureSamples] = {}
    for number, each in enumerate(chosen, start=1):
        say(f"driving {number} of {len(chosen)}: {each.name}")
        source = drive_baseline(each, folder, workers)
        if source is None:
            say(f"warning: {each.name} is left out: SUMO fails with it in every scene")
        else:
            found[each.name] = feature_samples(source.parts())
    return found


def drive_baseline(
    baseline: Baseline, folder: Path, workers: int | str | None = None, scenes: Sequence[str] = SCENES
) -> TrafficSource | None:
    """Drive the standard scenes with a file; None where each of the drives ended in a fault of SUMO's.

    The run folder, named after the file and what is in it, lies below `folder`. What it holds already is not driven
    again. VehicleTypeError for a file that cannot be used.
    """
    read_vehicle_types(baseline.file)
    out = folder / f"{baseline.file.stem}-{file_hash(baseline.file)[:8]}"
    options = RunOptions(planners=(PLANNER,), scenarios=tuple(scenes), traffic=baseline.file, out=out, workers=workers)
    left_traces = any(row.trace is not None for row in run(options).rows.values())
    return TrafficSource(baseline.name, out) if left_traces else None


def is_vehicle_types(path: Path) -> bool:
    """Whether a file is one of vehicle types, by its root."""
    return path.is_file() and root_of(path) == "additional"


@contextmanager
def drives_folder(kept: Path | None) -> Generator[Path]:
    """Where baselines are driven: in a folder that is kept, else in one for the while; InputError for a file."""
    if kept is None:
        with TemporaryDirectory(prefix="interplan_") as folder:
            yield Path(folder)
    elif kept.exists() and not kept.is_dir():
        raise InputError(f"{kept} is a file; give a folder as --baselines, which may be new")
    else:
        yield kept
