"""Traffic files: vehicle-type files of a run: changed ones for a sweep, and recorded ones found again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast
from xml.etree.ElementTree import Element, SubElement

from defusedxml.ElementTree import parse, tostring

from interplan_sumo.batch.options import SETTINGS
from interplan_sumo.batch.overrides import Overrides
from interplan_sumo.batch.records import Manifest
from interplan_sumo.batch.run_folder import TRAFFIC
from interplan_sumo.batch.tracks import TRACK
from interplan_sumo.errors import InputError, UnknownNameError, VehicleTypeError
from interplan_sumo.resources import routes_root
from interplan_sumo.simulation.vehicle_type_reader import PARAMETERS, SWERVE
from interplan_sumo.simulation.vehicle_type_schema import model_of_element, vehicle_type_schema
from interplan_sumo.simulation.vehicle_types import read_vehicle_types
from interplan_sumo.world.files import replacing, writing


def sweepable() -> frozenset[str]:
    """What can be changed in a vType."""
    return frozenset(vehicle_type_schema().attributes) - {"id", "refId"} | PARAMETERS.keys() | {SWERVE}


@dataclass(frozen=True, slots=True)
class Edit:
    """One attribute or `interplan.*` parameter of a vehicle-type file, changed."""

    type_id: str | None
    """None changes every vType of the file."""
    key: str
    value: str

    @classmethod
    def of(cls, key: str, value: str) -> Edit:
        """From `KEY` or `TYPE.KEY`; UnknownNameError for a key that no vType has."""
        bare, type_id, keys = key, None, sweepable()
        if key not in keys and not key.startswith("interplan."):
            head, found, tail = key.partition(".interplan.")
            if found:
                type_id, bare = head, f"interplan.{tail}"
            elif "." in key:
                type_id, _, bare = key.rpartition(".")
        if bare not in keys:
            raise UnknownNameError("vType attribute or parameter to sweep", bare, {*keys, *SETTINGS, TRACK})
        if bare == "probability" and type_id is None:
            raise InputError("probability of all vTypes alike changes nothing; name one: --param TYPE.probability=...")
        return cls(type_id, bare, value)

    def reaches(self, element: Element) -> bool:
        """Whether it changes a vType; one that only names another by `refId` has a probability of its own at most."""
        if self.key == "probability":
            return self.type_id in (element.get("id"), element.get("refId"))
        return "id" in element.attrib and self.type_id in (None, element.get("id"))


def changed_text(path: Path, edits: Sequence[Edit]) -> str:
    """A vehicle-type file with its types changed, as XML without the comments; the same text for the same edits.

    VehicleTypeError if the file cannot be used, UnknownNameError for a type that it does not hold.
    """
    read_vehicle_types(path)
    root = cast(Element, parse(path).getroot())
    types = [element.attrib["id"] for element in root.iter("vType") if "id" in element.attrib]
    for edit in edits:
        if edit.type_id is not None and edit.type_id not in types:
            raise UnknownNameError(f"vType in {path.name}", edit.type_id, types)
        if edit.key == "probability" and any("probabilities" in each.attrib for each in root):
            raise InputError(f"{path.name} has its probabilities at the vTypeDistribution; move them to the vTypes")
        for element in filter(edit.reaches, root.iter("vType")):
            _change(element, edit)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{tostring(root, encoding="unicode").rstrip()}\n'


def _change(element: Element, edit: Edit) -> None:
    if not edit.key.startswith("interplan."):
        _unfold(element)
        element.set(edit.key, edit.value)
        return
    held = next((param for param in element.iter("param") if param.get("key") == edit.key), None)
    if held is None:
        held = SubElement(element, "param", {"key": edit.key})
    held.set("value", edit.value)


def _unfold(element: Element) -> None:
    """Have what a nested car-following element says at the vType itself, over which it would win."""
    for nested in [each for each in element if model_of_element(each.tag) is not None]:
        element.attrib.update(nested.attrib, carFollowModel=cast(str, model_of_element(nested.tag)))
        element.extend(nested)
        element.remove(nested)


def changed_name(path: Path, changes: Mapping[str, str]) -> str:
    """What a changed file is called: `mixed+tau=1.5.xml`; SUMO takes a comma for the end of a file's name."""
    return "+".join((path.stem, *(f"{key}={value}" for key, value in changes.items()))) + ".xml"


def write_changed(path: Path, edits: Sequence[Edit], target: Path) -> None:
    """Write a changed vehicle-type file; InputError, and no file, if it cannot be used or written."""
    if "," in str(target.resolve()):
        raise InputError(f"SUMO reads no file with a comma in its path: {target.resolve()}; give another --out")
    text = changed_text(path, edits)
    with writing(target, "give another folder as --out"):
        target.parent.mkdir(parents=True, exist_ok=True)
        with replacing(target) as fresh:
            fresh.write_text(text, encoding="utf-8", newline="\n")
            _check(fresh, path, edits)


def _check(fresh: Path, path: Path, edits: Sequence[Edit]) -> None:
    """InputError if the file at `path` as it was changed into `fresh` cannot be used."""
    try:
        read_vehicle_types(fresh)
    except VehicleTypeError as error:
        wanted = ", ".join(f"{edit.key}={edit.value}" for edit in edits)
        raise InputError(f"{path.name} cannot have {wanted}: {str(error).removeprefix(f'{fresh}, ')}") from None


def recorded_vehicle_types(folder: Path, manifest: Manifest, given: Path | None = None) -> Path | None:
    """The vehicle-type file that a run was given with --traffic; None if it had none.

    A run records its name and hash, and keeps a copy. It is looked for at `given`,
    else there, where the run's command had it, beside the run and among the shipped
    files. InputError if it is not there, or has changed.
    """
    recorded = manifest.overrides.traffic
    if recorded is None:
        if given is not None:
            raise InputError(f"{folder} was not driven with --traffic, so {given} has no part in it; leave it out")
        return None
    name, _, digest = recorded.rpartition(" sha256:")
    places = list(_places(folder, manifest, name)) if given is None else [given]
    for place in places:
        if place.is_file() and (Overrides(vehicle_types=place).canonical().traffic or "").endswith(digest):
            return place
    where = f"{given} is not" if given is not None else f"cannot find {name},"
    raise InputError(
        f"{where} the vehicle-type file that {folder} was driven with (sha256 {digest}...); give it as --traffic"
    )


def _places(folder: Path, manifest: Manifest, name: str) -> Iterator[Path]:
    yield folder / TRAFFIC / name
    for at, word in enumerate(manifest.command):
        if word == "--traffic" and at + 1 < len(manifest.command):
            yield Path(manifest.command[at + 1])
        elif word.startswith("--traffic="):
            yield Path(word.removeprefix("--traffic="))
    for beside in folder.resolve().parents[:2]:
        yield beside / TRAFFIC / name
    yield routes_root() / name
