"""The noise of recorded positions, put on simulated ones: whoever records traffic adds some, SUMO adds none.

No vehicle can shake from one box to the next, so the fourth differences of its positions are noise. They tell the part
of it that is independent from box to box; what a tracker errs for longer cannot be told from driving, and is left out.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from interplan_sumo.realism.motion import MOVING_MPS, motion_of
from interplan_sumo.realism.tracks import RecordedTraffic, Track
from interplan_sumo.world.geometry import Floats

ORDER: Final = 4
GAIN: Final = float(np.sqrt(70.0))
"""Of fourth differences, on noise that is independent from box to box: the root of 1 + 16 + 36 + 16 + 1."""
LEAST_S: Final = 2.0
"""A vehicle that drives for less tells nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class TrackerNoise:
    """How much the positions of recorded vehicles shake."""

    sigma_m: Floats
    """(N, 2) of each recorded vehicle: along its way, and across."""

    @classmethod
    def of(cls, recordings: Iterable[RecordedTraffic]) -> TrackerNoise:
        """Of the vehicles of some recordings that drive."""
        tracks = (track for each in recordings for track in each.tracks if track.kind == "vehicle")
        found = [sigma for track in tracks if (sigma := _sigma_m(track)) is not None]
        return cls(np.array(found).reshape(-1, 2))

    def on(self, traffic: RecordedTraffic) -> RecordedTraffic:
        """Traffic as if it had been recorded: each vehicle shakes as one of the recorded ones does, drawn by name."""
        if not len(self.sigma_m):
            return traffic
        return replace(traffic, tracks=tuple(self._on(track, traffic.name) for track in traffic.tracks))

    def _on(self, track: Track, name: str) -> Track:
        if track.kind != "vehicle":
            return track
        rng = np.random.default_rng(zlib.crc32(f"{name} {track.id}".encode()))
        sigma_m = self.sigma_m[int(rng.integers(len(self.sigma_m)))]
        along_m, across_m = rng.normal(size=(2, len(track.time_s))) * sigma_m[:, None]
        cos, sin = np.cos(track.heading_rad), np.sin(track.heading_rad)
        return replace(
            track, x_m=track.x_m + along_m * cos - across_m * sin, y_m=track.y_m + along_m * sin + across_m * cos
        )


NO_NOISE: Final = TrackerNoise(np.zeros((0, 2)))


def _sigma_m(track: Track) -> tuple[float, float] | None:
    """Along and across the way of a vehicle; None if it does not drive for long enough."""
    motion = motion_of(track)
    if motion is None:
        return None
    rows = len(motion.time_s)
    time_s = motion.time_s[0] + motion.step_s * (np.arange(rows + ORDER) - ORDER // 2)  # differences are central
    x_m, y_m = (np.diff(np.interp(time_s, track.time_s, each), ORDER) / GAIN for each in (track.x_m, track.y_m))
    drives = motion.speed_mps > MOVING_MPS
    if drives.sum() * motion.step_s < LEAST_S:
        return None
    cos, sin = np.cos(motion.heading_rad), np.sin(motion.heading_rad)
    along_m, across_m = x_m * cos + y_m * sin, y_m * cos - x_m * sin
    return float(np.sqrt(np.mean(along_m[drives] ** 2))), float(np.sqrt(np.mean(across_m[drives] ** 2)))
