"""Scene values: figures of single drives brought to one number per scene, by family, alone or as paired differences."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
DriveKey = tuple[str, int]
"""Scenario id and seed."""


class DriveValue(NamedTuple):
    """A figure of one drive, and the family that its scene is of."""

    family: str
    value: float


DriveValues = Mapping[DriveKey, DriveValue]
"""What one planner got, drive by drive."""


def differences(a: DriveValues, b: DriveValues) -> dict[DriveKey, DriveValue]:
    """b less a on every scene and seed that both have."""
    return {key: DriveValue(of.family, b[key].value - of.value) for key, of in a.items() if key in b}


def mean_over_scenes(drives: DriveValues) -> float | None:
    """The mean over the scenes of the mean over the seeds of each; None without drives."""
    means = [sum(values) / len(values) for _, values in _by_scene(drives).values()]
    return sum(means) / len(means) if means else None


def family_samples(drives: DriveValues) -> list[Floats]:
    """One value per scene, the mean over its seeds, sorted, in an array (K,) per stratum; empty without drives.

    A stratum is a family. The variance within a family of one scene is not
    known: such families are taken together (collapsed strata, Cochran,
    Sampling Techniques, 1977, 5A.12), one alone with the smallest other. A
    collapsed stratum holds the differences between its families, too, so that
    intervals are rather too wide than too narrow.
    """
    families: dict[str, list[float]] = {}
    for family, values in _by_scene(drives).values():
        families.setdefault(family, []).append(sum(values) / len(values))
    return _collapsed([families[name] for name in sorted(families)])


def _by_scene(drives: DriveValues) -> dict[str, tuple[str, list[float]]]:
    """Of each scene its family and a value per seed."""
    found: dict[str, tuple[str, list[float]]] = {}
    for (scene, _), (family, value) in drives.items():
        found.setdefault(scene, (family, []))[1].append(value)
    return found


def _collapsed(families: Iterable[list[float]]) -> list[Floats]:
    several: list[list[float]] = []
    singles: list[float] = []
    for values in families:
        if len(values) > 1:
            several.append(values)
        else:
            singles += values
    if len(singles) == 1 and several:
        smallest = min(several, key=len)
        several[several.index(smallest)] = [*smallest, *singles]
    elif singles:
        several.append(singles)
    return [np.sort(np.array(values, dtype=np.float64)) for values in several]
