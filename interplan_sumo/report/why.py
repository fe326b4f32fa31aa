"""Why: one sentence for every zero and for every lost point."""

from __future__ import annotations

from interplan_sumo.batch.run_folder import Row

TITLES = {
    "no_collision": "at-fault collision",
    "drivable_area": "drivable area left",
    "making_progress": "no progress",
    "driving_direction": "wrong direction",
    "obstacle_passed": "obstacle not passed",
    "progress": "little progress",
    "time_to_collision": "close call",
    "lane_changes": "goal lane missed",
    "speed_limit": "too fast",
    "comfort": "uncomfortable",
}


def why_zero(row: Row) -> str | None:
    """The sentence for a fault or for a score of zero: the first gate at zero; None if there is nothing to explain."""
    if row["fault"]:
        return _fault(row)
    if row["score"] != 0.0:
        return None
    for name in row["gates"]:
        if row["metrics"][name]["score"] == 0.0:
            return _sentence(row, name)
    return "every weighted metric is zero"


def lost_points(row: Row) -> list[str]:
    """A sentence for the fault, or for each judged metric below 1, gates first."""
    if row["fault"]:
        return [_fault(row)]
    return [_sentence(row, name) for name in (*row["gates"], *row["weights"]) if row["metrics"][name]["score"] < 1.0]


def _fault(row: Row) -> str:
    return f"{row['fault']['class']} fault: {row['fault']['message']}"


def _sentence(row: Row, name: str) -> str:
    title = TITLES.get(name, name.replace("_", " "))
    reason = row["metrics"][name].get("reason")
    return f"{title}: {reason}" if reason else title
