"""Makers of tracks that can be worked out by hand."""

from __future__ import annotations

import numpy as np

from interplan_sumo.realism.motion import Motion, motion_of
from interplan_sumo.realism.tracks import Track, TrackKind
from interplan_sumo.world.geometry import Floats

DT_S = 0.1


def track(
    id_: str, x_m: Floats, y_m: Floats | float = 0.0, *, heading_rad: float = 0.0, kind: TrackKind = "vehicle",
    start_s: float = 0.0, length_m: float = 4.0,
) -> Track:  # fmt: skip
    """A vehicle of 4 x 2 m, ten boxes a second."""
    n = len(x_m)
    return Track(
        id=id_,
        kind=kind,
        time_s=start_s + DT_S * np.arange(float(n)),
        x_m=x_m,
        y_m=np.broadcast_to(y_m, (n,)),
        heading_rad=np.full(n, heading_rad),
        speed_mps=np.full(n, np.nan),
        length_m=length_m,
        width_m=2.0,
    )


def steady(id_: str, from_m: float, mps: float, seconds: float = 10.0, y_m: float = 0.0, **also: float) -> Track:
    """A vehicle along x at one speed."""
    return track(id_, from_m + mps * DT_S * np.arange(round(seconds / DT_S) + 1.0), y_m, **also)  # type: ignore[arg-type]


def moved(one: Track) -> Motion:
    found = motion_of(one)
    assert found is not None
    return found
