"""A second opinion: what another program makes of the same file, beside what the importer reads in it."""

from __future__ import annotations

from dataclasses import dataclass

from interplan_sumo.maps.problem import MapProblem


@dataclass(frozen=True, slots=True)
class OpinionPair:
    """A figure as the importer reads it, beside the other program's."""

    ours: float
    theirs: float


@dataclass(frozen=True, slots=True)
class SecondOpinion:
    """What another program finds in a file. Ways through junctions count as links, in its terms."""

    program: str
    lanes: OpinionPair
    lane_km: OpinionPair
    links: OpinionPair
    explanations: tuple[str, ...]
    """Why the two differ, where that is known. One sentence each."""
    problems: tuple[MapProblem, ...]
    """What differs by more than one percent for no reason that is known."""
