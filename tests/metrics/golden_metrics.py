"""The golden metrics of nuPlan: reads a case, scores it, and pairs every stored value with ours."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from interplan_sumo.maps.geopackage import read_map
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.result import MetricResult
from interplan_sumo.metrics.score import ScoreSheet, score_facts
from interplan_sumo.world.ego import EgoShape
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.signals import Signals
from interplan_sumo.world.trace import ActorTable, EgoTrack, Trace

GOLDEN = Path(os.environ.get("INTERPLAN_GOLDEN", Path(__file__).parents[1] / "golden")) / "nuplan_metrics"
TOLERANCE = 1e-6

Json = dict[str, Any]


def case_folders() -> list[Path]:
    return sorted(path.parent for path in GOLDEN.glob("cases/*/case.json"))


@dataclass(frozen=True)
class Case:
    folder: Path
    about: Json
    expected: Json
    facts: Facts
    sheet: ScoreSheet


@cache
def roads_of(file: str) -> Roads:
    return read_map(GOLDEN / file)


def read_case(folder: Path) -> Case:
    about = json.loads((folder / "case.json").read_text())
    body = about["vehicle"]
    shape = EgoShape(body["length"], body["width"], body["height"], body["wheel_base"], body["rear_axle_to_center"])
    ego = EgoTrack.from_frame(pd.read_csv(folder / "ego.csv.gz"), shape)
    expert = EgoTrack.from_frame(pd.read_csv(folder / "expert.csv.gz"), shape)
    tracks = pd.read_csv(folder / "tracks.csv.gz", dtype={"track_token": str})
    actors = ActorTable.from_frame(tracks, len(ego), keep_order=True)
    trace = Trace(ego, actors, (Signals.none(),) * len(ego), (), np.zeros(0), shape)
    facts = Facts(trace, roads_of(about["map"]["file"]), expert)
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


@dataclass(frozen=True)
class Pair:
    """A stored value beside ours; both (K,) arrays of floats, or anything that is compared by ==."""

    what: str
    expected: Any
    got: Any

    @property
    def difference(self) -> float:
        """Largest absolute difference; infinite if shapes, kinds or exact things differ."""
        if not isinstance(self.expected, np.ndarray):
            return 0.0 if self.expected == self.got else float("inf")
        if self.expected.shape != self.got.shape:
            return float("inf")
        same = (self.expected == self.got) | (np.isnan(self.expected) & np.isnan(self.got))
        if same.all():
            return 0.0
        gap = np.abs(self.expected[~same] - self.got[~same])
        return float("inf") if np.isnan(gap).any() else float(gap.max())


def _floats(value: Any) -> np.ndarray:
    """Numbers of expected.json or of ours; None, which stands for no number, becomes nan."""
    return np.array([np.nan if v is None else float(v) for v in np.atleast_1d(np.asarray(value, dtype=object))])


def pairs(case: Case) -> Iterator[Pair]:
    """Every value of expected.json beside ours: scores, statistics, series, aggregate, intermediates."""
    metrics = case.sheet.metrics
    for name, stored in case.expected["metrics"].items():
        if name in OURS:
            yield Pair(f"{name} score", _floats(stored["score"]), _floats(metrics[OURS[name]].score))
        else:
            yield Pair(f"{name} score", stored["score"], None)
        for statistic in stored["statistics"]:
            metric, get = STATISTICS[statistic["name"]]
            yield Pair(statistic["name"], _floats(statistic["value"]), _floats(get(metrics[metric])))
        if stored["time_series"] is not None:
            ours = metrics["comfort" if name in SIGNALS else OURS.get(name, "drivable_area")]
            series = ours.series[SIGNALS.get(name) or SERIES[name]]
            yield Pair(f"{name} series", _floats(stored["time_series"]["values"]), _floats(series))
    yield Pair("aggregate", _floats(case.expected["aggregate"]["score"]), _floats(case.sheet.score))
    yield Pair("weights", *_weights(case))
    yield from _intermediates(case)


def _weights(case: Case) -> tuple[Any, Any]:
    theirs = case.expected["aggregate"]
    stored = {OURS[n]: w for n, w in theirs["weights"].items() if n in OURS}
    stored |= {OURS[n]: "gate" for n in theirs["multipliers"]}
    return stored, {**case.sheet.weights, **dict.fromkeys(case.sheet.gates, "gate")}


def _intermediates(case: Case) -> Iterator[Pair]:
    stored, facts = case.expected["intermediate"], case.facts
    yield Pair("ego_route", _unrolled(stored["ego_route"], facts.frames, ("ids",)), [(p,) for p in facts.places])
    corners = ("front_left", "rear_left", "rear_right", "front_right")
    yield Pair("corner_route", _unrolled(stored["corner_route"], facts.frames, corners), list(facts.corner_places))
    yield Pair("in_one_lane", _floats(stored["in_one_lane"]), _floats(facts.in_one_lane))
    keys = ("frame", "track_token", "track_type", "collision_class", "at_fault")
    yield Pair(
        "collisions",
        [tuple(c[k] for k in keys) for c in stored["collisions"]],
        [(c.frame, c.track, c.kind.name, c.contact.value, c.at_fault) for c in facts.collisions],
    )
    yield Pair(
        "collision energies",
        _floats([c["energy"] for c in stored["collisions"]]),
        _floats([c.energy_mps for c in facts.collisions]),
    )
    yield Pair(
        "expert_route_blocks",
        [(b["roadblock_id"], b["baseline_of"]) for b in stored["expert_route_blocks"]],
        [(b.roadblock_id, b.lane_id) for b in facts.expert_blocks],
    )


def _unrolled(entries: list[Json], frames: int, keys: tuple[str, ...]) -> list[tuple[tuple[str, ...], ...]]:
    """One tuple of places per frame from run-length coded entries."""
    ends = [entry["from_frame"] for entry in entries[1:]] + [frames]
    places: list[tuple[tuple[str, ...], ...]] = []
    for entry, end in zip(entries, ends, strict=True):
        places += [tuple(tuple(entry[key]) for key in keys)] * (end - entry["from_frame"])
    return places
