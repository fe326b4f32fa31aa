"""Lane changes seen without a map: who ends up a lane's width aside and heads the same way as before.

That tells them on straight stretches only, and also of a recording that says nothing of lanes; a simulation is looked
at in the same way, whatever it knows. On a bend, and where a recording ends in the middle of it, a change is not seen.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from interplan_sumo.realism.motion import Motion
from interplan_sumo.world.geometry import Floats, wrap_angle

ASIDE_M: Final = (2.5, 4.7)
"""Lanes are 2.7 to 4 m wide, and nobody keeps to the middle of them exactly."""
WINDOWS_S: Final = tuple(np.arange(2.0, 10.5, 1.0))
"""The change and what is straight before and after it lie in one of these."""
PARALLEL_RAD: Final = np.radians(2.0)
"""The course at the end is that at the beginning, to within this."""
SETTLED_S, SETTLED_RAD = 0.4, np.radians(1.0)
"""Nor does it turn by more than this in so long after the beginning, and before the end."""
LEAST_MPS: Final = 2.0
"""Slower vehicles park and manoeuvre."""
LEAST_SLANT: Final = 3.0
"""It drives at least so many times as far as it gets aside."""
COURSE_S: Final = 0.5
"""The course at a time is that of so long a way."""
BEGUN: Final = 0.05
"""A change lasts from 5 to 95 % of the way aside."""
FARTHEST_M: Final = 80.0
"""Whoever is farther away is no neighbour."""
BESIDE_M: Final = 1.6
"""A vehicle whose middle is at most so far from the line that the change ends on is in that lane."""
SAME_WAY_RAD: Final = np.radians(30.0)


@dataclass(frozen=True, slots=True)
class SeenLaneChange:
    """One lane change, with the neighbours of its new lane half-way."""

    changer: Motion
    duration_s: float
    lead_gap_s: float | None
    """Bumper to bumper over its own speed; None if nobody is within `FARTHEST_M`."""
    lag_gap_s: float | None
    """Bumper to bumper over the speed of the one behind."""


def lane_changes(motions: Sequence[Motion]) -> list[SeenLaneChange]:
    """Those of all vehicles, by vehicle and time."""
    vehicles = [each for each in motions if each.track.kind == "vehicle"]
    return [change for each in vehicles for change in _of(each, vehicles)]


def _of(motion: Motion, vehicles: Sequence[Motion]) -> Iterator[SeenLaneChange]:
    if not (motion.speed_mps > LEAST_MPS).any():
        return
    half = max(1, round(COURSE_S / 2.0 / motion.step_s))
    place = np.stack([motion.x_m, motion.y_m], axis=1)
    if len(place) < 2 * half + 2:
        return
    ways = place[2 * half :] - place[: -2 * half]
    course_rad = np.arctan2(ways[:, 1], ways[:, 0])  # of row `half` and on
    fast = np.append(0, np.cumsum(motion.speed_mps[half:-half] <= LEAST_MPS))
    middle = place[half:-half]
    windows = [found for window_s in WINDOWS_S for found in _windows(middle, course_rad, fast, window_s, motion.step_s)]
    done = -1
    for first, last in _separate(windows):
        if first < done:
            continue
        done = last
        tangent = _tangent(course_rad[first], course_rad[last])
        aside_m = (middle[first : last + 1] - middle[first]) @ np.array((-tangent[1], tangent[0]))
        share = aside_m / aside_m[-1]
        begins, ends = int(np.argmax(share > BEGUN)), int(np.argmax(share > 1.0 - BEGUN))
        across = half + first + int(np.argmax(share > 0.5))
        line = place[half + last]
        yield SeenLaneChange(motion, (ends - begins) * motion.step_s, *_gaps_s(motion, across, line, tangent, vehicles))


def _windows(
    place: Floats, course_rad: Floats, slow: np.ndarray, window_s: float, step_s: float
) -> list[tuple[int, int, float]]:
    """First and last row of the windows of this length in which a lane is changed, and how far its ends are off."""
    rows = round(window_s / step_s)
    if len(place) <= rows:
        return []
    begin, end = course_rad[:-rows], course_rad[rows:]
    turned_rad = wrap_angle(end - begin)
    along = place[rows:] - place[:-rows]
    mean_rad = begin + turned_rad / 2.0
    cos, sin = np.cos(mean_rad), np.sin(mean_rad)
    ahead_m, aside_m = along[:, 0] * cos + along[:, 1] * sin, np.abs(along[:, 1] * cos - along[:, 0] * sin)
    fits = (
        (np.abs(turned_rad) < PARALLEL_RAD)
        & (aside_m > ASIDE_M[0])
        & (aside_m < ASIDE_M[1])
        & (ahead_m > LEAST_SLANT * aside_m)
        & (slow[rows : len(place)] == slow[: len(place) - rows])
    )
    soon = round(SETTLED_S / step_s)
    fits &= np.abs(wrap_angle(course_rad[soon : soon + len(begin)] - begin)) < SETTLED_RAD
    fits &= np.abs(wrap_angle(course_rad[rows - soon : len(course_rad) - soon] - end)) < SETTLED_RAD
    straight = np.arctan2(along[:, 1], along[:, 0])
    off_rad = np.abs(wrap_angle(begin - straight)) + np.abs(wrap_angle(end - straight))
    fits &= off_rad > np.radians(1.0)  # else it drives straight on along another course than it heads
    return [(int(row), int(row) + rows, float(np.abs(turned_rad[row]))) for row in np.flatnonzero(fits)]


def _separate(windows: Sequence[tuple[int, int, float]]) -> list[tuple[int, int]]:
    """Of windows that overlap the one whose ends are most nearly parallel, by time."""
    chosen: list[tuple[int, int]] = []
    for first, last, _ in sorted(windows, key=lambda each: (each[2], each[0])):
        if all(last <= begin or first >= end for begin, end in chosen):
            chosen.append((first, last))
    return sorted(chosen)


def _tangent(begin_rad: float, end_rad: float) -> Floats:
    mean_rad = begin_rad + wrap_angle(end_rad - begin_rad) / 2.0
    return np.array((np.cos(mean_rad), np.sin(mean_rad)))


def _gaps_s(
    changer: Motion, row: int, line: Floats, tangent: Floats, vehicles: Sequence[Motion]
) -> tuple[float | None, float | None]:
    """Gaps to who is ahead and behind in the lane that the change ends in, when it is half-way."""
    time_s, own = changer.time_s[row], np.array((changer.x_m[row], changer.y_m[row]))
    left = np.array((-tangent[1], tangent[0]))
    lead_s, lag_s = np.inf, np.inf
    nearest_lead, nearest_lag = FARTHEST_M, FARTHEST_M
    for other in vehicles:
        if other is changer or not other.time_s[0] <= time_s <= other.time_s[-1]:
            continue
        at = min(int(np.searchsorted(other.time_s, time_s)), len(other.time_s) - 1)
        place = np.array((other.x_m[at], other.y_m[at]))
        if abs(float((place - line) @ left)) > BESIDE_M:
            continue
        if abs(wrap_angle(other.heading_rad[at] - np.arctan2(tangent[1], tangent[0]))) > SAME_WAY_RAD:
            continue
        ahead_m = float((place - own) @ tangent)
        gap_m = max(abs(ahead_m) - (other.track.length_m + changer.track.length_m) / 2.0, 0.0)
        if ahead_m > 0.0 and gap_m < nearest_lead:
            nearest_lead, lead_s = gap_m, gap_m / float(changer.speed_mps[row])
        elif ahead_m <= 0.0 and gap_m < nearest_lag and other.speed_mps[at] > LEAST_MPS:
            nearest_lag, lag_s = gap_m, gap_m / float(other.speed_mps[at])
    return (lead_s if np.isfinite(lead_s) else None), (lag_s if np.isfinite(lag_s) else None)
