"""The golden metrics of nuPlan: reads a case, scores it, and pairs every stored value with ours."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from interplan_sumo.batch.records import MetricRecord
from interplan_sumo.maps.geopackage import read_map
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.metric import MetricResult
from interplan_sumo.metrics.profile import find_profile
from interplan_sumo.metrics.score import ScoreSheet, score_facts
from interplan_sumo.report.nuboard import EXPORTED
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import PACIFICA, EgoShape
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.signals import Signals
from interplan_sumo.world.trace import ActorTable, EgoTrack, Trace
from tests import golden_values
from tests.golden_values import Pair, floats

GOLDEN = golden_values.GOLDEN / "nuplan_metrics"

Json = dict[str, Any]


def case_folders(golden: Path = GOLDEN) -> list[Path]:
    return sorted(path.parent for path in golden.glob("cases/*/case.json"))


@dataclass(frozen=True)
class Case:
    folder: Path
    about: Json
    expected: Json
    facts: Facts
    sheet: ScoreSheet


@cache
def roads_of(file: Path) -> Roads:
    return read_map(file)


def read_case(folder: Path) -> Case:
    """Read and score a case; without tracks.csv.gz nobody else is on the road."""
    about = json.loads((folder / "case.json").read_text())
    body = about["vehicle"]
    height_m = body.get("height", PACIFICA.height_m)
    shape = EgoShape(body["length"], body["width"], height_m, body["wheel_base"], body["rear_axle_to_center"])
    ego = EgoTrack.from_frame(pd.read_csv(folder / "ego.csv.gz"), shape)
    expert = EgoTrack.from_frame(pd.read_csv(folder / "expert.csv.gz"), shape)
    actors = ActorTable.of([Actors.none()] * len(ego))
    if (folder / "tracks.csv.gz").exists():
        tracks = pd.read_csv(folder / "tracks.csv.gz", dtype={"track_token": str})
        actors = ActorTable.from_frame(tracks, len(ego), keep_order=True)
    trace = Trace(ego, actors, (Signals.none(),) * len(ego), (), np.zeros(0), shape)
    facts = Facts(trace, roads_of(folder.parents[1] / about["map"]["file"]), expert)
    expected = json.loads((folder / "expected.json").read_text())
    return Case(folder, about, expected, facts, score_facts(facts, "nuplan"))


# --- nuPlan's names and ours ---------------------------------------------------------------------

LEVELS = ("max", "min", "mean")
SIGNALS = {
    "ego_jerk": "jerk_mps3",
    "ego_lat_acceleration": "lateral_acceleration_mps2",
    "ego_lon_acceleration": "longitudinal_acceleration_mps2",
    "ego_lon_jerk": "longitudinal_jerk_mps3",
    "ego_yaw_acceleration": "yaw_acceleration_radps2",
    "ego_yaw_rate": "yaw_rate_radps",
}
OURS = {
    each.name: each.source
    for each in EXPORTED
    if each.has_score and each.source in {term.name for term in find_profile("nuplan").terms}
}
SERIES = {
    "ego_progress_along_expert_route": "gained_m",
    "corners_in_drivable_area": "corners_inside",
    "time_to_collision_within_bound": "time_to_collision_s",
    "speed_limit_compliance": "overspeed_mps",
    "driving_direction_compliance": "progress_in_window_m",
}
EXPORTED_STATISTICS = {each.name: (metric.source, each.value) for metric in EXPORTED for each in metric.statistics}
MORE_STATISTICS: Mapping[str, tuple[str, ...]] = {
    "max_ego_lane_change_duration": ("lane_crossings", "longest_s"),
    "avg_ego_lane_change_duration": ("lane_crossings", "mean_s"),
    "ratio_of_failed_ego_lane_change": ("lane_crossings", "failed_share"),
    **{f"{which}_violation_of_speed_limit_compliance": ("speed_limit", f"{which}_mps") for which in LEVELS},
    **{
        f"{which}_collision_energy_with_{theirs}": ("no_collision", "energy_mps", ours, which)
        for theirs, ours in (("VRUs", "vru"), ("vehicles", "vehicle"), ("objects", "object"))
        for which in LEVELS
    },
}
"""What nuBoard's files leave out: the metric, and where in its detail the figure stands."""


# --- comparing -----------------------------------------------------------------------------------


def pairs(case: Case) -> Iterator[Pair]:
    """Every value of expected.json beside ours: scores, statistics, series, aggregate, intermediates.

    Where we have no such value the difference is infinite.
    """
    metrics = case.sheet.metrics
    for name, stored in case.expected["metrics"].items():
        if name in OURS:
            yield Pair(f"{name} score", floats(stored["score"]), floats(metrics[OURS[name]].score))
        else:
            yield Pair(f"{name} score", stored["score"], None)
        for statistic in stored["statistics"]:
            yield Pair(statistic["name"], floats(statistic["value"]), _statistic(metrics, statistic["name"]))
        if stored.get("time_series") is not None:
            yield Pair(f"{name} series", floats(stored["time_series"]["values"]), _series(metrics, name))
    if "aggregate" in case.expected:
        yield Pair("aggregate", floats(case.expected["aggregate"]["score"]), floats(case.sheet.score))
        yield Pair("weights", *_weights(case))
    known = _intermediates(case.facts)
    for name, stored in case.expected.get("intermediate", {}).items():
        read, ours = known.get(name, (lambda value: value, None))
        yield Pair(name, read(stored), ours)
    if collisions := case.expected.get("intermediate", {}).get("collisions"):
        ours = floats([c.energy_mps for c in case.facts.collisions])
        yield Pair("collision energies", floats([c["energy"] for c in collisions]), ours)


def _statistic(metrics: Mapping[str, MetricResult], name: str) -> np.ndarray | None:
    if name in EXPORTED_STATISTICS:
        metric, value = EXPORTED_STATISTICS[name]
        found = metrics[metric]
        figure = value(MetricRecord(found.score, dict(found.detail), found.reason))
        return None if figure is None else floats(figure)
    metric, *path = MORE_STATISTICS.get(name, ("no_collision", "no such figure"))
    figure: Any = metrics[metric].detail
    for key in path:
        if key not in figure:  # no collision with such a group
            return None
        figure = figure[key]
    return floats(figure)


def _series(metrics: Mapping[str, MetricResult], name: str) -> np.ndarray | None:
    metric, series = ("comfort", SIGNALS[name]) if name in SIGNALS else (OURS.get(name, "drivable_area"), None)
    found = metrics[metric].series.get(series or SERIES.get(name, ""))
    return None if found is None else floats(found)


def _weights(case: Case) -> tuple[Any, Any]:
    theirs = case.expected["aggregate"]
    stored = {OURS[n]: w for n, w in theirs["weights"].items() if n in OURS}
    stored |= {OURS.get(n, n): "gate" for n in theirs["multipliers"]}
    return stored, {**case.sheet.weights, **dict.fromkeys(case.sheet.gates, "gate")}


def _intermediates(facts: Facts) -> dict[str, tuple[Callable[[Any], Any], Any]]:
    """How to read what is stored, and ours."""
    corners = ("front_left", "rear_left", "rear_right", "front_right")
    keys = ("frame", "track_token", "track_type", "collision_class", "at_fault")
    contacts = [(c.frame, c.track, c.kind.name, c.contact.value, c.at_fault) for c in facts.collisions]
    blocks = [(b.roadblock_id, b.lane_id) for b in facts.expert_blocks]
    return {
        "ego_route": (lambda stored: _unrolled(stored, facts.frames, ("ids",)), [(p,) for p in facts.places]),
        "corner_route": (lambda stored: _unrolled(stored, facts.frames, corners), list(facts.corner_places)),
        "in_one_lane": (floats, floats(facts.in_one_lane)),
        "collisions": (lambda stored: [tuple(c[k] for k in keys) for c in stored], contacts),
        "expert_route_blocks": (lambda stored: [(b["roadblock_id"], b["baseline_of"]) for b in stored], blocks),
    }


def _unrolled(entries: list[Json], frames: int, keys: tuple[str, ...]) -> list[tuple[tuple[str, ...], ...]]:
    """One tuple of places per frame from run-length coded entries."""
    ends = [entry["from_frame"] for entry in entries[1:]] + [frames]
    places: list[tuple[tuple[str, ...], ...]] = []
    for entry, end in zip(entries, ends, strict=True):
        places += [tuple(tuple(entry[key]) for key in keys)] * (end - entry["from_frame"])
    return places
