"""Tracks of SUMO's own fcd output (`sumo --fcd-output FILE`, plain or gzipped), so that any simulation can be judged.

SUMO writes the middle of a vehicle's front bumper, a person's middle, and angles clockwise from north; who rides in a
vehicle has the place of the vehicle, and is left out. It writes no sizes: those are of the vehicle types, which stand
in a route or additional file.
"""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element

import numpy as np

from interplan_sumo.errors import InputError
from interplan_sumo.realism.tracks import RecordedTraffic, Track, TrackKind, unbroken
from interplan_sumo.world.xml_file import elements, root_of

ROOT: Final = "fcd-export"
LONGEST_STEP_S: Final = 0.3
"""Braking lasts seconds: with longer steps there is no telling how hard it was."""
MOST_VALUES: Final = 200_000_000
"""Numbers held at once; 1.6 GB."""
_FARTHEST_M: Final = 1e8
_PLACE: Final = ("x", "y", "angle", "speed")

SIZES_M: Final[Mapping[str, tuple[float, float]]] = {
    "emergency": (6.5, 2.16), "bus": (12.0, 2.5), "coach": (14.0, 2.6), "delivery": (6.5, 2.16), "truck": (7.1, 2.4),
    "trailer": (16.5, 2.55), "motorcycle": (2.2, 0.9), "moped": (2.1, 0.78), "bicycle": (1.6, 0.65),
    "scooter": (1.2, 0.5), "pedestrian": (0.215, 0.478), "wheelchair": (1.2, 0.72),
}  # fmt: skip
"""Length and width that SUMO 1.28 gives to a vClass, as `vehicletype.getLength` says; all others are PASSENGER_M."""
PASSENGER_M: Final = (5.0, 1.8)
BODIES: Final[Mapping[str, TrackKind]] = {"pedestrian": "pedestrian", "wheelchair": "pedestrian", "bicycle": "bicycle"}
DEFAULTS: Final = {
    "DEFAULT_BIKETYPE": "bicycle", "DEFAULT_PEDTYPE": "pedestrian", "DEFAULT_TAXITYPE": "taxi", "DEFAULT_VEHTYPE": "",
}  # fmt: skip
"""The vClass of SUMO's own types."""


@dataclass(frozen=True, slots=True)
class Body:
    """What a vehicle type says of a body."""

    kind: TrackKind
    length_m: float
    width_m: float


def is_fcd(path: Path) -> bool:
    """Whether a file is fcd output, by its root."""
    return root_of(path) == ROOT


def read_fcd(path: Path, types: Path | None = None) -> RecordedTraffic:
    """The road users of fcd output, with the sizes of a file of vehicle types.

    InputError where one of the files cannot be used: damaged, in longitudes and
    latitudes, without x, y and angle, in steps above `LONGEST_STEP_S`.
    """
    bodies = {name: _default_body(vclass) for name, vclass in DEFAULTS.items()}
    if types is not None:
        bodies |= read_bodies(types)
    seen = _seen(path)
    tables = {key: np.array(numbers, dtype=np.float64).reshape(-1, 5) for key, (_, numbers) in seen.items()}
    if any((table[:, 4] > 1.0).any() for table in tables.values()) and all(map(_crawls, tables.values())):
        raise InputError(f"{path}: its places are longitudes and latitudes; simulate without --fcd-output.geo")
    tracks: list[Track] = []
    for (tag, id_), (type_, _) in seen.items():
        walks = tag == "person"
        body = bodies.get(type_, _default_body("pedestrian" if walks else ""))
        tracks += _tracks(f"person {id_}" if walks else id_, body, tables[tag, id_], front=not walks)
    return RecordedTraffic(path.name, path.name, tuple(tracks))


def _seen(path: Path) -> dict[tuple[str, str], tuple[str, array[float]]]:
    """Of each vehicle and person, by tag and id: its type, and time, x, y, angle and speed after one another."""
    found: dict[tuple[str, str], tuple[str, array[float]]] = {}
    held, times_s = 0, array("d")
    for step in elements(path, ROOT):
        if step.tag != "timestep":
            continue
        time_s = _number(path, step, "time")
        if times_s and time_s <= times_s[-1]:
            raise InputError(f"{path}: timestep {time_s:g} comes after {times_s[-1]:g}; give one simulation's output")
        times_s.append(time_s)
        driven = {_place(element) for element in step if element.tag == "vehicle"}
        for element in step:
            rides = element.tag == "person" and _place(element) in driven
            if element.tag not in ("vehicle", "person") or rides:
                continue
            key = (element.tag, element.get("id", ""))
            if key not in found:
                found[key] = element.get("type", ""), array("d")
            found[key][1].extend((time_s, *(_number(path, element, name) for name in _PLACE)))
            held += 5
        if held > MOST_VALUES:
            raise InputError(f"{path}: too large, it has more than {MOST_VALUES // 5} places; give a part of it")
    if len(times_s) < 2 or not found:
        raise InputError(f"{path}: nobody drives in it; give the fcd output of a simulation with traffic")
    step_s = (times_s[-1] - times_s[0]) / (len(times_s) - 1)
    if step_s > LONGEST_STEP_S:
        raise InputError(f"{path}: its steps last {step_s:.3g} s, too long to tell braking; use --step-length 0.1")
    return found


def _place(element: Element) -> tuple[str | None, ...]:
    """As SUMO writes it: who rides in a vehicle is exactly where that is."""
    return tuple(map(element.get, _PLACE))


def read_bodies(path: Path) -> dict[str, Body]:
    """What the vehicle types of a route or additional file say of bodies, by id; InputError where it cannot be used."""
    found: dict[str, Body] = {}
    for element in elements(path, "additional", "routes"):
        inside = element if element.tag == "vTypeDistribution" else [element]
        for each in inside:
            if each.tag == "vType":
                default = _default_body(each.get("vClass", ""))
                length_m, width_m = (
                    _number(path, each, name) if name in each.attrib else number
                    for name, number in (("length", default.length_m), ("width", default.width_m))
                )
                if not (0.0 < length_m < 40.0 and 0.0 < width_m < 40.0):
                    raise InputError(
                        f"{path}: vType {each.get('id', '')[:40]!r} is {length_m:g} m long, {width_m:g} wide"
                    )
                found[each.get("id", "")] = Body(default.kind, length_m, width_m)
    if not found:
        raise InputError(f"{path}: holds no vType; give the file that the vehicle types are in")
    return found


def _default_body(vclass: str) -> Body:
    return Body(BODIES.get(vclass, "vehicle"), *SIZES_M.get(vclass, PASSENGER_M))


def _number(path: Path, element: Element, name: str) -> float:
    try:
        number = float(element.attrib[name])
    except (KeyError, ValueError):
        number = np.nan
    if not -_FARTHEST_M < number < _FARTHEST_M:
        what = f"{path}: {element.tag} {element.get('id', '')[:40]!r}"
        if name not in element.attrib:
            raise InputError(f"{what} has no {name}; write it with all of SUMO's attributes")
        raise InputError(f"{what} has the {name} {element.attrib[name][:40]!r}, which cannot be used")
    return number


def _crawls(table: np.ndarray) -> bool:
    """Whether somebody gets nowhere near as far as its speeds would take it; true of who stands, too."""
    driven_m = float((table[1:, 4] * np.diff(table[:, 0])).sum())
    moved = float(np.hypot(*np.diff(table[:, 1:3], axis=0).T).sum())
    return moved <= 0.01 * driven_m


def _tracks(id_: str, body: Body, table: np.ndarray, *, front: bool) -> list[Track]:
    """One road user, cut where it was away for long, as one on a parking area or in a vehicle is."""
    time_s, x_m, y_m, angle_deg, speed_mps = table.T
    heading_rad = np.pi / 2.0 - np.radians(angle_deg)
    back_m = body.length_m / 2.0 if front else 0.0
    x_m, y_m = x_m - back_m * np.cos(heading_rad), y_m - back_m * np.sin(heading_rad)
    return [
        Track(
            name, body.kind, time_s[part], x_m[part], y_m[part], heading_rad[part], np.abs(speed_mps[part]),
            body.length_m, body.width_m,
        )
        for name, part in unbroken(id_, time_s)
    ]  # fmt: skip
