"""Events: what happened in a drive, and when."""

from __future__ import annotations

from typing import Any

from interplan_sumo.batch.stored_drive import StoredDrive
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.lane_crossings import find_crossings
from interplan_sumo.metrics.metric import failure_words
from interplan_sumo.metrics.score import ScoreSheet
from interplan_sumo.report.key_events import FAULT, NOTHING, KeyEvent

Event = dict[str, Any]


def events(
    drive: StoredDrive,
    facts: Facts,
    sheet: ScoreSheet,
    lost: tuple[KeyEvent, ...],
    decided: KeyEvent,
    set_off: list[int | None],
) -> list[Event]:
    """Everything of note in time order: `frame`, `kind`, `text`, and `decides` on the deciding moment.

    Kinds are gate, weight, fault, contact, trigger, lane, light and goal.
    """
    found = [_lost(moment, sheet) for moment in lost]
    found += _contacts(facts, sheet)
    found += [_event(frame, "trigger", "a pedestrian sets off") for frame in set_off if frame is not None]
    found += _lanes(facts)
    for run in sheet.metrics["diagnostics"].detail["red_lights_run"]:
        found.append(_event(_frame(facts, run["time_s"]), "light", "passes a red light"))
    if drive.row.reached_goal:
        found.append(_event(facts.frames - 1, "goal", "passes the goal line"))
    for event in found:
        event["decides"] = event.pop("moment", None) is decided and decided.metric != NOTHING
    return sorted(found, key=lambda event: (event["frame"], not event["decides"]))


def _lost(moment: KeyEvent, sheet: ScoreSheet) -> Event:
    kind = "fault" if moment.metric == FAULT else "gate" if moment.metric in sheet.gates else "weight"
    title = failure_words(moment.metric)
    text = moment.reason if moment.metric == FAULT else f"{title}: {moment.reason}"
    return {**_event(moment.frame, kind, text), "moment": moment}


def _contacts(facts: Facts, sheet: ScoreSheet) -> list[Event]:
    """First contacts with each track, but for the one that the lost gate tells of already."""
    told = False
    found: list[Event] = []
    for contact in facts.collisions:
        who = f"{contact.kind.name.lower().replace('_', ' ')} {contact.track}"
        if contact.at_fault and not told and "no_collision" in sheet.gates:
            told = True
            continue
        whose = "at-fault contact" if contact.at_fault else "contact, not at fault,"
        found.append(_event(contact.frame, "contact", f"{whose} with {who}"))
    return found


def _lanes(facts: Facts) -> list[Event]:
    crossings = find_crossings(facts.roads, facts.body_lanes, facts.trace.ego.time_us)
    return [
        _event(crossing.end, "lane", f"lane change done, begun {crossing.duration_s:.1f} s before")
        for crossing in crossings
        if crossing.success
    ]


def _event(frame: int, kind: str, text: str) -> Event:
    return {"frame": frame, "kind": kind, "text": text}


def _frame(facts: Facts, time_s: float) -> int:
    return int(facts.time_s.searchsorted(time_s - 1e-6))
