"""A foreign map as its file tells it, before nuPlan's rules are imposed on it.

All coordinates are metres in the projected system `SourceMap.crs`, x east and
y north. Every line of a lane runs with the traffic; "left" is geometrically left.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

import shapely

from interplan_sumo.maps.signal_program import SignalProgram
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.roads import DrivingSide, StopLineKind


@dataclass(frozen=True, slots=True, eq=False)
class SourceLane:
    """A lane for cars as the file has it; lanes may join directly, and overlap where they fork, merge or cross."""

    id: str
    """The file's own."""
    left: Floats
    """(N, 2) left boundary, in the direction of travel."""
    right: Floats
    """(M, 2) right boundary, in the direction of travel."""
    successors: tuple[str, ...] = ()
    """Ids that follow directly; they may lie beyond the file."""
    predecessors: tuple[str, ...] = ()
    left_neighbour: str | None = None
    """The lane of the same direction that adjoins on the left, whether or not one may change to it."""
    right_neighbour: str | None = None
    speed_limit_mps: float | None = None
    """None where the file knows none."""
    in_intersection: bool = False
    """The file says so; where it says nothing, overlaps with other lanes tell."""
    lights_at_start: tuple[str, ...] = ()
    """Traffic lights that one must pass to enter this lane."""
    lights_at_end: tuple[str, ...] = ()
    """Traffic lights that one must pass to leave this lane."""
    sign_at_end: StopLineKind | None = None
    """STOP_SIGN or YIELD for those who leave this lane."""


@dataclass(frozen=True, slots=True, eq=False)
class SourceStopLine:
    """A line (or the middle of a band) at which the traffic of some lanes stops."""

    id: str
    points: Floats
    """(N, 2) across the lanes."""
    kind: StopLineKind
    lane_ids: tuple[str, ...] = ()
    """The lanes at whose end (at whose start, for one inside an intersection) it holds; empty if the file is mute."""


@dataclass(frozen=True, slots=True, eq=False)
class SourceSignal:
    """A controller: lights that share a program."""

    id: str
    """The file's own."""
    lights: tuple[str, ...]
    """Light of each letter in the states of its programs, as lanes name them; empty where it is not for cars."""
    programs: tuple[SignalProgram, ...] = ()
    """The last one runs. Empty where the file names a controller, but knows no program that can be used."""
    tells_who_yields: bool = True
    """Whether "G" means that nobody may cross, and "g" a green with the duty to yield; else both are just green."""
    ways: Mapping[str, frozenset[tuple[str, str]]] = field(default_factory=dict[str, frozenset[tuple[str, str]]])
    """Light -> (from, to), the lanes between which alone it holds, for lights that share the end of a lane."""


@dataclass(frozen=True, slots=True)
class SourceWay:
    """A way through a junction."""

    lanes: tuple[str, ...]
    """The lane that runs through the junction, or the two between which a direct way leads."""
    state: str = ""
    """SUMO's letter for who goes first without a working light (M, m, =, s, w, Z); empty where the file knows none."""


@dataclass(frozen=True, slots=True)
class SourceJunction:
    """Who goes first among some ways, as the file has it."""

    id: str
    """The file's own."""
    kind: str
    """SUMO's type of junction: priority, right_before_left, allway_stop, priority_stop, zipper, traffic_light, ..."""
    ways: tuple[SourceWay, ...]
    yields: frozenset[tuple[int, int]]
    """Pairs of ways, by their places in `ways`, of which the first yields to the second."""
    foes: frozenset[tuple[int, int]] | None = None
    """Pairs, both ways round, whose paths meet; None where the file does not say and geometry decides."""


@dataclass(frozen=True, slots=True, eq=False)
class LeftOut:
    """Something of the file that is no lane for cars, with the reason in words."""

    id: str
    reason: str
    """Such as "bicycle lane"; equal reasons are counted together."""
    polygon: shapely.Polygon | None = None
    """Given where a car may stand on it: it then counts as drivable."""


@dataclass(frozen=True, eq=False)
class SourceMap:
    """One foreign map."""

    name: str
    format: str
    crs: str
    driving_side: DrivingSide
    lanes: Mapping[str, SourceLane]
    stop_lines: tuple[SourceStopLine, ...] = ()
    crosswalks: tuple[shapely.Polygon, ...] = ()
    walkways: tuple[shapely.Polygon, ...] = ()
    carparks: tuple[shapely.Polygon, ...] = ()
    drivable: tuple[shapely.Polygon, ...] = ()
    """Paved areas beyond the lanes, or around them, where the file draws such."""
    left_out: tuple[LeftOut, ...] = ()
    signals: tuple[SourceSignal, ...] = ()
    """Lights of no controller get a program of ours."""
    junctions: tuple[SourceJunction, ...] = ()
    """Ways of no junction, and pairs that none tells of, go by signs and geometry."""
    notes: tuple[str, ...] = ()
    """What else a user should know: assumptions made, data that could not be used. One sentence each."""

    @property
    def reasons(self) -> Counter[str]:
        """How much was left out for each reason."""
        return Counter(item.reason for item in self.left_out)


@dataclass(frozen=True, slots=True)
class SourceCount:
    """How much a second, independent reading of a file finds; keys are the file's own ids."""

    lane_length_m: Mapping[str, float]
    """Every lane for cars, with the length of its middle."""
    links: frozenset[tuple[str, str]]
    """(from, to) of every direct way between two such lanes, both in the file."""
    leaving: int = 0
    """Ways that lead to lanes beyond the file or come from there."""
    crosswalks: int = 0
    left_out: int = 0
    """Lanes of other kinds."""
