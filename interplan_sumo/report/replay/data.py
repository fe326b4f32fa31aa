"""Data: stored drives as plain data for the page; every field is told here or in the module that makes it.

| field | what |
|---|---|
| scenario | `id`, and `about`: words on the place, the traffic and the people |
| per | parts of a metre, a radian and a unit that the whole numbers count |
| dt_s, frames | seconds between frames; frames of the longest drive |
| turned_rad | map heading that points to the right at first: from the start to the goal |
| extent | x, y of two corners around the drives and the route, centimetres |
| map | `surroundings.map_around` |
| lights | `surroundings.lights` |
| route | `line`, the points from start to goal; `goal`, the line across the lanes there |
| expert | the expert's columns, empty where there is none |
| looks, behaviours | colours of whoever has no type of driver, and of the types of drivers |
| charts | what each chart shows |
| drives | one or two, see `_drive` |

Coordinates, columns and series are encoded as in `numbers`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, Final

import numpy as np

from interplan_sumo.batch.stored_drive import StoredDrive
from interplan_sumo.errors import InputError
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.score import ScoreSheet, score_facts
from interplan_sumo.report import scenario_drawing as drawing
from interplan_sumo.report.failure_reasons import fault_sentence, metric_title
from interplan_sumo.report.key_events import FAULT, KeyEvent, deciding_event, loss_events, replay_events
from interplan_sumo.report.replay import agents_timeline
from interplan_sumo.report.replay.charts import CHARTS, chart_series
from interplan_sumo.report.replay.drawn_scene import DrawnScene
from interplan_sumo.report.road_markings import signal_changes
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.roads import Roads

MOST_DRIVES: Final = 2
"""Side by side on one page."""


def replay_data(drives: Sequence[StoredDrive]) -> dict[str, Any]:
    """One drive, or two of one scenario, as JSON's types; the fields are those of the module's docstring.

    InputError for no drive, for more than `MOST_DRIVES`, for drives of different scenarios and for one without a frame.
    """
    _check(drives)
    first = drives[0]
    roads, scenario = first.roads, first.scenario
    tracks = [np.column_stack((drive.trace.ego.x_m, drive.trace.ego.y_m)) for drive in drives]
    scene = DrawnScene.of(roads, scenario, tracks)
    longest = max(drives, key=lambda drive: len(drive.trace))
    return {
        "scenario": {"id": scenario.id, "about": _about(scenario, roads)},
        "dt_s": round(longest.trace.dt_s, 6),
        "frames": len(longest.trace),
        "expert": agents_timeline.expert(first.expert, longest.trace.ego.time_us, scene.origin),
        "behaviours": drawing.behaviour_colours(_behaviours(drives)),
        "charts": [asdict(chart) for chart in CHARTS],
        "drives": [_drive(drive, scene) for drive in drives],
        **scene.fields,
    }


def _check(drives: Sequence[StoredDrive]) -> None:
    if not 1 <= len(drives) <= MOST_DRIVES:
        raise InputError(f"a replay shows one drive or two side by side, not {len(drives)}; name at most two planners")
    ids = {drive.scenario.hash() for drive in drives}
    if len(ids) > 1:
        raise InputError(
            f"drives of {drives[0].scenario.id} and {drives[1].scenario.id} do not fit on one page; "
            "show two drives of one scenario, or one page for each"
        )
    for drive in drives:
        if not len(drive.trace):
            raise InputError(
                f"{drive.run_folder}: the drive of {drive.row.planner} on {drive.scenario.id}, seed "
                f"{drive.row.seed}, ended before its first frame; there is nothing to replay"
            )


def _drive(drive: StoredDrive, scene: DrawnScene) -> dict[str, Any]:
    """What differs from planner to planner.

    `planner`, `seed`, `profile`, `score` (0 to 100, or None), `fault` (a sentence or
    None), `end` (how it ended, in words), `frames`, `metrics`, `events`,
    `deciding` (frame, metric and reason), `charts`, what is around (`ego`, `agents`,
    `seen`, `plans`, `triggers`) and `signals` (`road_markings.signal_changes`).
    """
    origin, lights = scene.origin, scene.fields["lights"]
    facts = Facts(drive.trace, drive.roads, drive.expert, drive.scenario)
    sheet = score_facts(facts, drive.profile)
    lost = loss_events(facts, sheet, drive.row)
    decided = deciding_event(lost, facts)
    triggers = agents_timeline.triggers(drive, facts.route_line, origin)
    set_off: list[int | None] = [trigger["frame"] for trigger in triggers]
    return {
        "planner": drive.row.planner,
        "seed": drive.row.seed,
        "profile": sheet.profile,
        "score": _score(drive, sheet),
        "fault": fault_sentence(drive.row) if drive.row.fault else None,
        "end": _end(drive),
        "frames": facts.frames,
        "metrics": _metrics(sheet, lost),
        "events": [asdict(event) for event in replay_events(drive, facts, sheet, lost, set_off)],
        "deciding": {"frame": decided.frame, "metric": decided.metric, "reason": decided.reason},
        "charts": chart_series(facts, sheet, scene.drivable),
        "ego": agents_timeline.ego(drive.trace, origin),
        "agents": agents_timeline.agents(drive, origin),
        "seen": agents_timeline.seen(drive.trace, origin),
        "plans": agents_timeline.plans(drive.trace, origin),
        "signals": signal_changes(drive.trace, lights),
        "triggers": triggers,
    }


def _metrics(sheet: ScoreSheet, lost: Sequence[KeyEvent]) -> list[dict[str, Any]]:
    """The judged metrics, gates first.

    `name`, `title`, `weight` (None of a gate), `score`, `reason`, `frame` of the loss.
    """
    frames = {event.metric: event.frame for event in lost if event.metric != FAULT}
    return [
        {
            "name": name,
            "title": metric_title(name),
            "weight": sheet.weights.get(name),
            "score": round(sheet.metrics[name].score or 0.0, 4),
            "reason": sheet.metrics[name].reason if name in frames else None,
            "frame": frames.get(name),
        }
        for name in (*sheet.gates, *sheet.weights)
    ]


def _score(drive: StoredDrive, sheet: ScoreSheet) -> float | None:
    """0 to 100; a planner's fault makes it 0, any other leaves the drive without one."""
    if drive.row.fault:
        return 0.0 if drive.row.fault.kind == "planner" else None
    return round(100.0 * sheet.score, 2)


def _end(drive: StoredDrive) -> str:
    if drive.row.fault:
        return f"{drive.row.fault.kind} fault"
    return "goal line passed" if drive.row.reached_goal else "time over"


def _about(scenario: Scenario, roads: Roads) -> list[str]:
    demand = scenario.traffic
    recorded = len(scenario.replayed)
    people = len(scenario.jaywalkers)
    words = (
        scenario.site(roads),
        f"drives on the {roads.driving_side}",
        f"{recorded} recorded road users" if recorded else f"density {demand.density}",
        "" if demand.oncoming == "none" else f"oncoming {demand.oncoming}",
        "" if scenario.perception == "full" else f"perception {scenario.perception}",
        f"{demand.behaviour} drivers" if scenario.has_traffic and not recorded else "",
        f"{people} jaywalker{'s' if people > 1 else ''}" if people else "",
    )
    return [word for word in words if word]


def _behaviours(drives: Sequence[StoredDrive]) -> set[str]:
    return {str(name) for drive in drives for name in np.unique(drive.trace.actors.behaviour.astype(str))} - {""}
