"""Open-loop errors of plans on samples that training did not see, and those of constant velocity beside them."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from interplan_learned.driving import POSES, STEP_S
from interplan_sumo.features import schema
from interplan_sumo.features.schema import channel_index
from interplan_sumo.world.geometry import Floats, wrap_angle

HORIZONS_S: Final = (3.0, 5.0, 8.0)
_EVERY: Final = round(STEP_S / schema.STEP_S)
_VX, _VY = channel_index("ego_history", "vx"), channel_index("ego_history", "vy")


def wanted_poses(future: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """(B, POSES, 3) where the ego of `ego_future` (B, 80, 4) was at the times of a plan, and (B, POSES) if it was."""
    there = future[:, _EVERY - 1 :: _EVERY][:, :POSES]
    return there[..., :3], there[..., 3] > 0.5


def constant_velocity(history: NDArray[Any]) -> Floats:
    """(B, POSES, 3) plans that keep the present velocity and heading of `ego_history` (B, 21, 10)."""
    ahead_s = STEP_S * np.arange(1, POSES + 1)
    velocity = np.asarray(history[:, -1, (_VX, _VY)], dtype=np.float64)
    return np.concatenate((velocity[:, None] * ahead_s[:, None], np.zeros((len(history), POSES, 1))), axis=-1)


def plan_errors(poses: NDArray[Any], future: NDArray[Any]) -> dict[str, float]:
    """Errors of plans (B, POSES, 3) against `ego_future` (B, 80, 4).

    `ade_<h>_s` is the mean distance over the first h seconds, `fde_<h>_s` that
    at h seconds (m), `heading_<h>_s` the mean heading error (rad), each over the
    samples with so much future; `ade` is the mean distance over all steps there are.
    """
    wanted, valid = wanted_poses(future)
    off_m = np.hypot(poses[..., 0] - wanted[..., 0], poses[..., 1] - wanted[..., 1])
    turned_rad = np.abs(wrap_angle(np.asarray(poses[..., 2] - wanted[..., 2], dtype=np.float64)))
    found = {"ade": _mean(off_m[valid])}
    for horizon_s in HORIZONS_S:
        steps = round(horizon_s / STEP_S)
        whole = valid[:, steps - 1]
        found |= {
            f"ade_{horizon_s:g}_s": _mean(off_m[whole, :steps]),
            f"fde_{horizon_s:g}_s": _mean(off_m[whole, steps - 1]),
            f"heading_{horizon_s:g}_s": _mean(turned_rad[whole, :steps]),
        }
    return found


def _mean(values: NDArray[Any]) -> float:
    return round(float(np.mean(values, dtype=np.float64)), 4) if values.size else float("nan")
