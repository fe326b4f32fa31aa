"""Driving: all agents at one instant, as those see them who decide what each does."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from interplan_sumo.world.geometry import Floats


@dataclass(frozen=True, slots=True, eq=False)
class AgentSnapshot:
    """All agents at one instant, as they are read from SUMO, in SUMO's frame."""

    names: Sequence[str]
    front_x: Floats  # (N,)
    front_y: Floats  # (N,)
    heading_rad: Floats  # (N,)
    speed_mps: Floats  # (N,)
    turned_rad: Floats  # (N,) since the step before, not wrapped; empty in the first step
    most_turned_rad: float
    """The largest of `turned_rad`, to either side."""
    lanes: Callable[[Sequence[str]], list[str]]
    """The SUMO lanes of agents, '' is nowhere; asked for only when they may have to react."""
    positions_m: Callable[[Sequence[str]], list[float]]
    """Lane positions of the front bumpers of agents."""
