"""Augmentation of arrays of the schema: starts beside the driven line, agents and pasts that are missing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.dataset.columns import Columns
from interplan_sumo.features.schema import BY_NAME, FUTURE_FRAMES, HISTORY_FRAMES, ROUTE_STEP_M, STEP_S
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import Floats, Ints, wrap_angle

_MASKS: Final = {"left_boundaries": "lanes_valid", "right_boundaries": "lanes_valid"}
"""Fields whose empty rows another field's flags tell."""
_PAIRS: Final = (("x", "y"), ("vx", "vy"), ("ax", "ay"))
_LEAST_MPS: Final = 2.0
"""Slower egos are not moved: a car does not get beside its line without driving."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Perturbation:
    """How far beside the driven line a drive may start, uniformly up to these."""

    share: float = 0.5
    """Of the samples."""
    forward_m: float = 1.0
    left_m: float = 1.0
    turned_rad: float = 0.3
    rejoin_s: float = 3.0
    """After so long the ego is back on the line that was driven."""


def augmented(
    columns: Columns,
    rng: np.random.Generator,
    *,
    perturbation: Perturbation | None = None,
    agents_dropped: float | None = None,
    past_dropped: float | None = None,
) -> Columns:
    """Samples with what is given of these: starts elsewhere, a share that loses agents, a share that knows no past."""
    if perturbation is not None:
        columns = perturbed_start(columns, rng, perturbation)
    if agents_dropped is not None:
        columns = without_agents(columns, rng, agents_dropped)
    return columns if past_dropped is None else without_past(columns, rng, past_dropped)


def perturbed_start(columns: Columns, rng: np.random.Generator, how: Perturbation) -> Columns:
    """Samples (their `ego_history` and `ego_future` among them) in which some egos are elsewhere than they were.

    The ego leaves the driven line smoothly over the past 2 s, so that it is
    beside and turned against it at the present, and smoothly comes back within
    `rejoin_s`: poses, velocities and accelerations of the past and poses of the
    future are those of one drive. All other fields in the ego frame are put into
    its new one. Egos slower than 2 m/s stay, and turns grow no steeper than
    1 m/s to the side would make them at that speed.
    """
    history, future = columns["ego_history"], columns["ego_future"]
    moved = np.flatnonzero(
        (rng.random(len(history)) < how.share)
        & (np.hypot(history[:, -1, 3], history[:, -1, 4]) >= _LEAST_MPS)
        & columns["ego_history_valid"][:, 0]
    )
    draws = rng.uniform(-1.0, 1.0, (len(history), 3))[moved] * (how.forward_m, how.left_m, how.turned_rad)
    if not moved.size:
        return columns
    past, ahead, poses = _bent(history[moved].astype(np.float64), future[moved].astype(np.float64), draws, how.rejoin_s)
    changed = {name: values.copy() if _in_ego_frame(name) else values for name, values in columns.items()}
    changed["ego_history"][moved], changed["ego_future"][moved] = past, ahead
    if "route_centerline" in changed:
        changed["route_centerline"][moved] = _begun_beside(changed["route_centerline"][moved], poses)
    if "origin" in changed:
        changed["origin"] = _origins(changed["origin"], moved, poses)
    for name in changed:
        if _in_ego_frame(name):
            changed[name][moved] = _reframed(name, changed, moved, poses)
    return changed


def without_agents(columns: Columns, rng: np.random.Generator, share: float = 0.5, rate: float = 0.5) -> Columns:
    """Samples of which some (`share`) lose some (`rate`) of their agents, and the futures of these."""
    rows = columns["agents"].shape[:2]
    lost = (rng.random(rows) < rate) & (rng.random(rows[0]) < share)[:, None]
    hidden = {name: columns[name].copy() for name in ("agents", "agent_futures") if name in columns}
    for values in hidden.values():
        values[lost[:, : values.shape[1]]] = 0.0
    return {**columns, **hidden}


def without_past(columns: Columns, rng: np.random.Generator, share: float = 0.2) -> Columns:
    """Samples of which some (`share`) know only the present of the ego."""
    lost = rng.random(len(columns["ego_history"])) < share
    hidden = {name: columns[name].copy() for name in ("ego_history", "ego_history_valid")}
    for values in hidden.values():
        values[lost, :-1] = 0
    return {**columns, **hidden}


# --- the ego's own drive -------------------------------------------------------------------------


def _bent(history: Floats, future: Floats, draws: Floats, rejoin_s: float) -> tuple[Floats, Floats, Floats]:
    """History (K, 21, 10), future (K, 80, 4) and present poses (K, 3) of egos off by draws (K, 3), old ego frame."""
    before_s = STEP_S * np.arange(1 - HISTORY_FRAMES, 1, dtype=np.float64)
    after_s = STEP_S * np.arange(1, FUTURE_FRAMES + 1, dtype=np.float64)
    time_s: Floats = np.concatenate((before_s, after_s))
    speed = np.hypot(history[:, -1, 3], history[:, -1, 4])
    slope = np.clip(speed * np.sin(draws[:, 2]), -2.0, 2.0)
    off, rate, bend = _offsets(time_s, draws[:, :2], np.stack((np.zeros(len(draws)), slope), axis=1), rejoin_s)
    yaw = np.concatenate((history[..., 2], future[..., 2]), axis=1)
    forward, left = _axes(yaw)
    shift = off[..., :1] * forward + off[..., 1:] * left
    quick = np.concatenate((np.hypot(history[..., 3], history[..., 4]), _speeds(history, future)), axis=1)
    turned = np.arctan2(rate[..., 1], np.maximum(quick + rate[..., 0], _LEAST_MPS))
    now = len(before_s)
    past, ahead = history.copy(), future.copy()
    for values, part in ((past, slice(None, now)), (ahead, slice(now, None))):
        values[..., :2] += shift[:, part]
        values[..., 2] = wrap_angle(values[..., 2] + turned[:, part])
    past[..., 3:5] += rate[:, :now, :1] * forward[:, :now] + rate[:, :now, 1:] * left[:, :now]
    past[..., 5:7] += bend[:, :now, :1] * forward[:, :now] + bend[:, :now, 1:] * left[:, :now]
    more = np.gradient(turned[:, :now], STEP_S, axis=1)
    past[..., 7] += more
    past[..., 8] += PACIFICA.wheelbase_m * more / np.maximum(quick[:, :now], _LEAST_MPS)
    past[..., 9] = np.gradient(past[..., 8], STEP_S, axis=1)
    poses = past[:, -1, :3].copy()
    ahead *= ahead[..., 3:]
    return past, ahead, poses


def _offsets(time_s: Floats, now_m: Floats, slope_mps: Floats, rejoin_s: float) -> tuple[Floats, Floats, Floats]:
    """Offsets (K, T, 2), their rates and accelerations: quintics from 0 to `now_m` with `slope_mps` and back to 0."""
    past_s = -float(time_s[0])
    found = [np.zeros((len(now_m), len(time_s), 2)) for _ in range(3)]
    for span_s, rows, direction in (
        (past_s, time_s <= 0.0, -1.0),
        (rejoin_s, (time_s > 0.0) & (time_s < rejoin_s), 1.0),
    ):
        u = np.abs(time_s[rows])[None, :, None] / span_s
        value, slope = now_m[:, None], direction * slope_mps[:, None] * span_s
        found[0][:, rows] = value * (1 - u**3 * (10 - 15 * u + 6 * u**2)) + slope * (u - 6 * u**3 + 8 * u**4 - 3 * u**5)
        found[1][:, rows] = (direction / span_s) * (
            value * (-30 * u**2 + 60 * u**3 - 30 * u**4) + slope * (1 - 18 * u**2 + 32 * u**3 - 15 * u**4)
        )
        found[2][:, rows] = (
            value * (-60 * u + 180 * u**2 - 120 * u**3) + slope * (-36 * u + 96 * u**2 - 60 * u**3)
        ) / span_s**2
    return found[0], found[1], found[2]


def _speeds(history: Floats, future: Floats) -> Floats:
    """(K, 80) speeds of the future, from its steps; 0 where it has ended."""
    path = np.concatenate((history[:, -1:, :2], future[..., :2]), axis=1)
    steps = np.diff(path, axis=1)
    return np.hypot(steps[..., 0], steps[..., 1]) / STEP_S * future[..., 3]


def _axes(yaw: Floats) -> tuple[Floats, Floats]:
    c, s = np.cos(yaw), np.sin(yaw)
    return np.stack((c, s), axis=-1), np.stack((-s, c), axis=-1)


# --- everything around it ------------------------------------------------------------------------


def _begun_beside(line: NDArray[Any], poses: Floats) -> Floats:
    """Lines (K, 120, 3) with a pose every metre, begun anew beside poses (K, 3) near their first one."""
    line = line.astype(np.float64)
    away = poses[:, :2] - line[:, 0, :2]
    along_m = away[:, 0] * np.cos(line[:, 0, 2]) + away[:, 1] * np.sin(line[:, 0, 2])
    arc_m = np.arange(line.shape[1]) + along_m[:, None] / ROUTE_STEP_M
    first = np.clip(np.floor(arc_m).astype(np.int64), 0, line.shape[1] - 2)
    one, other = (np.take_along_axis(line, rows[..., None], axis=1) for rows in (first, first + 1))
    step = other - one
    step[..., 2] = wrap_angle(step[..., 2])
    return one + (arc_m - first)[..., None] * step


def _origins(origin: NDArray[Any], rows: Ints, poses: Floats) -> NDArray[Any]:
    """`origin` (B, 3) with some rows moved to poses (K, 3) of their old ego frames."""
    moved = origin.copy()
    forward, left = _axes(origin[rows, 2])
    moved[rows, :2] += poses[:, :1] * forward + poses[:, 1:2] * left
    moved[rows, 2] = wrap_angle(moved[rows, 2] + poses[:, 2])
    return moved


def _in_ego_frame(name: str) -> bool:
    return name in BY_NAME and BY_NAME[name].frame == "ego"


def _reframed(name: str, columns: Columns, rows: Ints, poses: Floats) -> NDArray[Any]:
    """Some rows of a field in ego frames at `poses` (K, 3) of the old ones; empty rows stay 0."""
    values = columns[name][rows].astype(np.float64)
    channels = [each.name for each in BY_NAME[name].channels]
    around = (len(rows),) + (1,) * (values.ndim - 2)
    c, s = np.cos(poses[:, 2]).reshape(around), np.sin(poses[:, 2]).reshape(around)
    made = values.copy()
    for one, other in _PAIRS:
        if one in channels:
            i, j = channels.index(one), channels.index(other)
            at = poses if one == "x" else np.zeros_like(poses)
            x, y = values[..., i] - at[:, 0].reshape(around), values[..., j] - at[:, 1].reshape(around)
            made[..., i], made[..., j] = c * x + s * y, c * y - s * x
    if "yaw" in channels:
        yaw = channels.index("yaw")
        made[..., yaw] = wrap_angle(values[..., yaw] - poses[:, 2].reshape(around))
    return made * _filled(name, columns, rows, values)


def _filled(name: str, columns: Columns, rows: Ints, values: Floats) -> NDArray[Any]:
    """1 where a row of a field exists, else 0; with axes to multiply by."""
    channels = [each.name for each in BY_NAME[name].channels]
    if "valid" in channels:
        return values[..., channels.index("valid"), None]
    if "class" in channels:
        return values[..., channels.index("class"), None] > 0.0
    mask = _MASKS.get(name, f"{name}_valid")
    if mask not in columns:
        raise KeyError(f"a recipe that keeps {name} and perturbs starts must keep {mask}, too")
    flags = columns[mask][rows]
    return flags.reshape(*flags.shape, *(1,) * (values.ndim - flags.ndim))
