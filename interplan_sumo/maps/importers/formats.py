"""Map formats: what reads each, found by entry point.

A package adds one by naming a `MapFormat` in its `pyproject.toml` under
`interplan_sumo.map_formats`; ours stand in our own, in the same way.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from interplan_sumo.maps.importers.opinion import SecondOpinion
from interplan_sumo.maps.importers.source import SourceCount, SourceMap
from interplan_sumo.registry import Registry
from interplan_sumo.world.roads import Roads


@dataclass(frozen=True, slots=True)
class MapFormat:
    """A format of map files."""

    title: str
    """What people call it."""
    pattern: str
    """How the names of its files look, such as "*.osm": so one is found in a folder."""
    read: Callable[[Path], SourceMap | Roads]
    """The map in a file; MapError with one line where it cannot be used. Roads are taken as they are."""
    count: Callable[[Path], SourceCount] | None = None
    """A second, independent reading for `maps check --source`; without one the map is compared with the first."""
    opinion: Callable[[Path], SecondOpinion] | None = None
    """What another program makes of the file, for `maps check --source` to tell."""


MAP_FORMATS = Registry("interplan_sumo.map_formats", "map format", MapFormat)
"""By the name that `maps import --format` takes."""
