"""Gaps in recorded tracks: short ones are bridged along a straight line, a long one cuts a track in two."""

from __future__ import annotations

from typing import Final

import numpy as np

from interplan_sumo.world.geometry import Floats, Ints, wrap_angle

MAX_BRIDGED_STEPS: Final = 5
"""Whoever is unseen for so many steps or fewer is taken to have gone straight on; beyond, it becomes another track."""


def pieces(id_: str, steps: Ints) -> list[tuple[str, slice]]:
    """The tracks of a road user seen at some steps, in order: an id for each ("id", "id~2", ...) and its rows."""
    ends = np.flatnonzero(np.diff(steps) > MAX_BRIDGED_STEPS + 1) + 1
    bounds = [0, *ends.tolist(), len(steps)]
    return [
        (id_ if row == 0 else f"{id_}~{row + 1}", slice(bounds[row], bounds[row + 1])) for row in range(len(bounds) - 1)
    ]


def bridged(seen: Ints | Floats, poses: Floats) -> tuple[Ints, Floats]:
    """All steps from the first seen to the last, and the poses (N, 3) at them."""
    steps = np.arange(int(seen[0]), int(seen[-1]) + 1)
    x, y, heading = (np.interp(steps, seen, column) for column in (*poses[:, :2].T, np.unwrap(poses[:, 2])))
    return steps, np.stack((x, y, wrap_angle(heading)), axis=1)


def gap_notes(filled: int, cut: int) -> list[str]:
    """What to say of so many filled steps and cut tracks."""
    notes = [f"{filled} steps at which a road user was not seen were filled along a straight line."] if filled else []
    return [*notes, *([f"{cut} tracks were cut where a road user was not seen for long."] if cut else [])]
