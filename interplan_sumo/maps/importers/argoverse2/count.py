"""Counts of an Argoverse 2 map, from the bare file."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from interplan_sumo.errors import MapError
from interplan_sumo.maps.importers.source import SourceCount


def count_argoverse2(path: Path) -> SourceCount:
    """What a `log_map_archive_*.json` (or the folder that holds one) has.

    A lane is as long as the mean of its two boundaries. A link counts once,
    whichever of its two lanes names it. MapError if the file has another form.
    """
    path = Path(path)
    try:
        (file,) = path.glob("log_map_archive_*.json") if path.is_dir() else (path,)
        with file.open(encoding="utf-8") as text:
            content = json.load(text)
        segments = list(content["lane_segments"].values())
        return _count(segments, len(content["pedestrian_crossings"]))
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError, OverflowError) as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:120]
        raise MapError(f"{path}: the lanes of this file cannot be counted ({reason})") from error


def _count(segments: Sequence[Mapping[str, Any]], crosswalks: int) -> SourceCount:
    kinds = {str(segment["id"]): segment["lane_type"] for segment in segments}
    links = {(str(s["id"]), str(other)) for s in segments for other in s["successors"]}
    links |= {(str(other), str(s["id"])) for s in segments for other in s["predecessors"]}
    for_cars = [[kinds.get(end) == "VEHICLE" for end in link] for link in links]
    known = [[end in kinds for end in link] for link in links]
    return SourceCount(
        lane_length_m={
            str(s["id"]): (_length_m(s["left_lane_boundary"]) + _length_m(s["right_lane_boundary"])) / 2.0
            for s in segments
            if s["lane_type"] == "VEHICLE"
        },
        links=frozenset(link for link, ends in zip(links, for_cars, strict=True) if all(ends)),
        leaving=sum(any(car) and not all(inside) for car, inside in zip(for_cars, known, strict=True)),
        crosswalks=crosswalks,
        left_out=sum(kind != "VEHICLE" for kind in kinds.values()),
    )


def _length_m(points: Sequence[Mapping[str, float]]) -> float:
    """Length of a line in the plane."""
    plane = np.array([complex(point["x"], point["y"]) for point in points])
    return float(np.abs(np.diff(plane)).sum())
