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

from interplan_sumo.maps.geopackage import read_map
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.metric import MetricResult
from interplan_sumo.metrics.score import ScoreSheet, score_facts
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

SIGNALS = {
    "ego_jerk": "jerk_mps3",
    "ego_lat_acceleration": "lateral_acceleration_mps2",
    "ego_lon_acceleration": "longitudinal_acceleration_mps2",
    "ego_lon_jerk": "longitudinal_jerk_mps3",
    "ego_yaw_acceleration": "yaw_acceleration_radps2",
    "ego_yaw_rate": "yaw_rate_radps",
}
OURS = {
    "ego_progress_along_expert_route": "progress",
    "drivable_area_compliance": "drivable_area",
    "no_ego_at_fault_collisions": "no_collision",
    "time_to_collision_within_bound": "time_to_collision",
    "speed_limit_compliance": "speed_limit",
    "ego_is_comfortable": "comfort",
    "ego_is_making_progress": "making_progress",
    "driving_direction_compliance": "driving_direction",
}
SERIES = {
    "ego_progress_along_expert_route": "gained_m",
    "corners_in_drivable_area": "corners_inside",
    "time_to_collision_within_bound": "time_to_collision_s",
    "speed_limit_compliance": "overspeed_mps",
    "driving_direction_compliance": "progress_in_window_m",
}


def _detail(*path: str) -> Callable[[MetricResult], Any]:
    def get(result: MetricResult) -> Any:
        value: Any = result.detail
        for key in path:
            value = value[key]
        return value

    return get


def _full(result: MetricResult) -> bool:
    return result.score == 1.0


STATISTICS: Mapping[str, tuple[str, Callable[[MetricResult], Any]]] = {
    "number_of_ego_lane_change": ("lane_crossings", _detail("count")),
    "max_ego_lane_change_duration": ("lane_crossings", _detail("longest_s")),
    "avg_ego_lane_change_duration": ("lane_crossings", _detail("mean_s")),
    "ratio_of_failed_ego_lane_change": ("lane_crossings", _detail("failed_share")),
    "ego_lane_change_fail_rate_below_threshold": ("lane_crossings", _detail("failed_share_within")),
    "expert_total_progress_along_route": ("progress", _detail("expert_m")),
    "ego_total_progress_along_route": ("progress", _detail("ego_m")),
    "ego_expert_progress_along_route_ratio": ("progress", _detail("ratio")),
    "drivable_area_compliance": ("drivable_area", _full),
    "corners_in_drivable_area": ("drivable_area", _detail("all_corners_inside")),
    "no_ego_at_fault_collisions": ("no_collision", _full),
    "number_of_all_at_fault_collisions": ("no_collision", _detail("at_fault")),
    **{
        f"number_of_at_fault_collisions_with_{theirs}": ("no_collision", _detail("at_fault_with", ours))
        for theirs, ours in (("VRUs", "vru"), ("vehicles", "vehicle"), ("objects", "object"))
    },
    **{
        f"{which}_collision_energy_with_{theirs}": ("no_collision", _detail("energy_mps", ours, which))
        for theirs, ours in (("VRUs", "vru"), ("vehicles", "vehicle"), ("objects", "object"))
        for which in ("max", "min", "mean")
    },
    "min_time_to_collision": ("time_to_collision", _detail("least_s")),
    "time_to_collision_within_bound": ("time_to_collision", _full),
    "speed_limit_compliance": ("speed_limit", lambda result: result.detail["violations"] == 0),
    "number_of_violations_of_speed_limit_compliance": ("speed_limit", _detail("violations")),
    **{
        f"{which}_violation_of_speed_limit_compliance": ("speed_limit", _detail(f"{which}_mps"))
        for which in ("max", "min", "mean")
    },
    "ego_is_comfortable": ("comfort", _full),
    "ego_is_making_progress": ("making_progress", _full),
    "driving_direction_compliance_score": ("driving_direction", lambda result: result.score),
    "min_progress_along_driving_direction_in_1_second_interval": ("driving_direction", _detail("lowest_progress_m")),
    **{
        f"{theirs}_{name}{ending}": ("comfort", _detail(signal, ours))
        for name, signal in SIGNALS.items()
        for theirs, ours, ending in (
            ("max", "max", ""),
            ("min", "min", ""),
            ("avg", "mean", ""),
            ("p90", "p90", ""),
            ("abs", "within", "_within_bounds"),
        )
    },
}


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
    if name not in STATISTICS:
        return None
    metric, get = STATISTICS[name]
    try:
        return floats(get(metrics[metric]))
    except KeyError:  # no collision with such a group, no signal in so short a drive
        return None


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
