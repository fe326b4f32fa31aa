"""Planning problem: where one may drive and who else does; and its answer, a speed profile: when to be where."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.verification.corridor import FrenetCorridor
from interplan_sumo.verification.drivable_paths import DrivablePath
from interplan_sumo.verification.observed_traffic import ObservedTraffic
from interplan_sumo.world.geometry import Floats

STEP_FRAMES: Final = 10
"""The knots of a speed profile are 1 s apart."""


@dataclass(frozen=True, slots=True, eq=False)
class PlanningProblem:
    """Where one may drive, and where everybody else will be."""

    corridor: FrenetCorridor
    paths: tuple[DrivablePath, ...]
    """One per lane path of the corridor."""
    others: ObservedTraffic
    red: Mapping[str, NDArray[np.bool_]]
    """(F,) per connector with a light: in which frames it must not be entered."""
    frames: int
    """The drive has to be over by this frame."""


@dataclass(frozen=True, slots=True)
class Margins:
    """How much room is kept."""

    front_m: float = 1.5
    front_s: float = 1.2
    """To whoever is ahead, on top: this time at the closing speed. The metric asks for more than 0.95 s."""
    rear_m: float = 1.5
    rear_s: float = 1.0
    """To whoever is behind in a lane that the ego enters: this time at the closing speed on top."""
    rear_headway_s: float = 0.7
    """And this time at its own speed: it brakes for a gap that is shorter than it likes."""
    comfort_s: float = 1.0
    """To whoever is ahead, where it costs nothing: this time at the own speed on top."""


@dataclass(frozen=True, slots=True)
class Pace:
    """How lively one drives."""

    first_push: int
    """Most acceleration and braking in the first second, in 0.5 m/s2: comfort is judged from the first frame on. Above
    3 the jerk that the metric sees in it, 2.1 to 2.5 times as many m/s3, is beyond its bound of 4.13."""
    changes: tuple[tuple[float, float, int], ...]
    """Speeds from and to (m/s), and how many seconds a lane change takes at them."""


CALM: Final = Pace(2, ((5.0, np.inf, 4), (2.5, 5.0, 5)))
FIRM: Final = Pace(3, CALM.changes)
QUICK: Final = Pace(3, ((9.0, np.inf, 3), (5.0, 9.0, 4), (2.5, 5.0, 5)))
"""With lane changes as quick as comfort allows. They come near whoever is two lanes over, if one goes straight on."""


@dataclass(frozen=True, slots=True)
class ProfileStart:
    """Where and when a speed profile begins."""

    frame: int
    arc_m: float
    speed_mps: float
    path: int


@dataclass(frozen=True, slots=True)
class TimeGate:
    """When the ego has to pass a place: in step number `step`, counted from 0."""

    arc_m: float
    step: int


@dataclass(frozen=True, slots=True)
class PathChange:
    """A lane change: the arcs where it begins and ends."""

    from_m: float
    to_m: float
    path: int
    """The new one."""


@dataclass(frozen=True, slots=True, eq=False)
class SpeedProfile:
    """Where to be when: knots 1 s apart, constant acceleration between them."""

    frame: int
    """Of the first knot."""
    arc_m: Floats  # (K,)
    speed_mps: Floats  # (K,)
    path: int
    """On which it begins."""
    changes: tuple[PathChange, ...]
    cost: float
    """What the search found the least of: seconds lost, and discomfort."""
    to_goal: bool
    """Whether it gets to the goal."""
