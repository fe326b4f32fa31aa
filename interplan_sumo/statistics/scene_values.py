"""Scene values: figures of single drives brought to one number per scene, by family, alone or as paired differences."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
DriveKey = tuple[str, int]
"""Scenario id and seed."""


class DriveValue(NamedTuple):
    """A figure of one drive, and the family that its scene is of."""

    family: str
    value: float
    place: str = ""
    """Where the scene is, by any name; empty for one that has a place to itself."""


DriveValues = Mapping[DriveKey, DriveValue]
"""What one planner got, drive by drive."""


def differences(a: DriveValues, b: DriveValues) -> dict[DriveKey, DriveValue]:
    """b less a on every scene and seed that both have."""
    return {key: of._replace(value=b[key].value - of.value) for key, of in a.items() if key in b}


def mean_over_scenes(drives: DriveValues) -> float | None:
    """The mean over the scenes of the mean over the seeds of each; None without drives."""
    means = [sum(values) / len(values) for _, values in _by_scene(drives).values()]
    return sum(means) / len(means) if means else None


class Stratum(NamedTuple):
    """Places that are drawn again together."""

    values: Floats
    """One per place, sorted; their mean is that of the scenes."""
    scenes: int


def strata(drives: DriveValues) -> list[Stratum]:
    """The scenes of each family by their places, with one value per place; empty without drives.

    Scenes of one place are alike and are drawn together. Families that lie at
    the same places, as lane changes in three densities do, are one stratum: two
    are if more than half of the places of either are the other's. The
    variance within a stratum of one place is not known: such strata are taken
    together (collapsed strata, Cochran, Sampling Techniques, 1977, 5A.12), one
    alone with the smallest other. A collapsed stratum holds the differences
    between its families, too, so that intervals are rather too wide than too
    narrow.
    """
    families: dict[str, _Places] = {}
    for scene, (of, values) in _by_scene(drives).items():
        place = (True, of.place) if of.place else (False, scene)
        families.setdefault(of.family, {}).setdefault(place, []).append(sum(values) / len(values))
    return [_stratum(places) for places in _collapsed(_at_equal_places(families[name] for name in sorted(families)))]


_Places: TypeAlias = dict[tuple[bool, str], list[float]]
"""The values of the scenes of each place."""


def _by_scene(drives: DriveValues) -> dict[str, tuple[DriveValue, list[float]]]:
    """Of each scene one of its drives, and a value per seed."""
    found: dict[str, tuple[DriveValue, list[float]]] = {}
    for (scene, _), drive in drives.items():
        found.setdefault(scene, (drive, []))[1].append(drive.value)
    return found


def _at_equal_places(families: Iterable[_Places]) -> list[_Places]:
    found: list[_Places] = []
    for family in families:
        alike = (each for each in found if 2 * len(each.keys() & family.keys()) > min(len(each), len(family)))
        other = next(alike, None)
        if other is None:
            found.append(family)
        else:
            _put_together(other, family)
    return found


def _collapsed(found: Iterable[_Places]) -> list[_Places]:
    several: list[_Places] = []
    singles: list[_Places] = []
    for places in found:
        (several if len(places) > 1 else singles).append(places)
    if len(singles) == 1 and several:
        _put_together(min(several, key=len), singles[0])
    elif singles:
        several.append({})
        for places in singles:
            _put_together(several[-1], places)
    return several


def _put_together(places: _Places, others: _Places) -> None:
    for place, values in others.items():
        places.setdefault(place, []).extend(values)


def _stratum(places: _Places) -> Stratum:
    """With the mean of each place; where some have more scenes, what a place adds to the mean, to first order."""
    sums, scenes = (np.array([of(values) for values in places.values()], dtype=np.float64) for of in (sum, len))
    values = sums / scenes
    if np.ptp(scenes) > 0.0:
        mean = sums.sum() / scenes.sum()
        values = mean + (values - mean) * scenes / scenes.mean()
    return Stratum(np.sort(values), int(scenes.sum()))
