"""Track noise: errors of position, speed and heading that last, and frames that are lost, as of a real tracker.

Each is drawn from (scenario, seed), the id of the track and the frame alone: what one track suffers depends neither on
who else is there nor on what the ego does.
"""

from __future__ import annotations

from hashlib import blake2b
from math import exp, pi, radians
from typing import Final

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.geometry import Floats, Ints, wrap_angle

POSITION_M: Final = 0.1
POSITION_PER_M: Final = 0.002
"""Standard deviation of the error in x and in y: the one plus the other for each metre of distance."""
SPEED_MPS: Final = 0.2
HEADING_RAD: Final = radians(1.0)
DROPPED: Final = 0.01
"""Share of the frames in which a track is missing."""
CORRELATION_S: Final = 0.5
"""After this long an error is down to 1/e of what it was."""

_DRAWS = 5  # of a track in a frame
_FIRST_FRAME = -64  # no frame before it is asked for
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIXERS = ((np.uint64(30), np.uint64(0xBF58476D1CE4E5B9)), (np.uint64(27), np.uint64(0x94D049BB133111EB)))


class TrackNoise:
    """The errors of all tracks of one episode; frames are asked for one after the other."""

    def __init__(self, episode: str, dt_s: float) -> None:
        """`episode` names the scenario and the seed."""
        self._episode = episode
        self._kept = exp(-dt_s / CORRELATION_S)
        self._ids: tuple[str, ...] = ()
        self._keys: NDArray[np.uint64] = np.zeros(0, dtype=np.uint64)
        self._errors: Floats = np.zeros((0, 4))
        """(N, 4) of `_ids`: x, y, speed, heading, each with mean 0 and variance 1."""

    def seen(self, frame: int, ids: tuple[str, ...], near: Actors, rows: Ints, eye: tuple[float, float]) -> Actors:
        """What is seen of `near`, actors around the eye, in a frame.

        `ids` are those of all tracks that there are, hidden ones included,
        whose errors go on, and `rows` the places of `near` among them.
        """
        draws = self._advance(frame, ids)[rows]
        errors = self._errors[rows]
        away_m = np.hypot(near.x_m - eye[0], near.y_m - eye[1])
        off_m = POSITION_M + POSITION_PER_M * away_m
        turned = HEADING_RAD * errors[:, 3]
        heading = wrap_angle(near.heading_rad + turned)
        cosine, sine = np.cos(turned), np.sin(turned)
        # What nuPlan calls a static object has no speed that could be wrong.
        faster = np.where(near.kind <= ActorKind.BICYCLE, SPEED_MPS * errors[:, 2], 0.0)
        told = Actors.trusted(
            near.ids,
            near.kind,
            near.x_m + off_m * errors[:, 0],
            near.y_m + off_m * errors[:, 1],
            heading,
            near.length_m,
            near.width_m,
            near.vx_mps * cosine - near.vy_mps * sine + faster * np.cos(heading),
            near.vx_mps * sine + near.vy_mps * cosine + faster * np.sin(heading),
        )
        return told.only(draws >= DROPPED)

    def _advance(self, frame: int, ids: tuple[str, ...]) -> Floats:
        """Bring all errors to a frame; (N,) numbers between 0 and 1 that decide who is dropped in it."""
        kept = np.full(len(ids), self._kept)
        if ids != self._ids:
            kept = self._follow(ids)
        draws = _uniform(self._keys, frame)
        length = np.sqrt(-2.0 * np.log(draws[:, 0:2]))  # Box and Muller's normal numbers, two from two
        angle = 2.0 * pi * draws[:, 2:4]
        fresh = np.concatenate((length * np.cos(angle), length * np.sin(angle)), axis=1)
        self._errors = kept[:, None] * self._errors + np.sqrt(1.0 - kept * kept)[:, None] * fresh
        return draws[:, 4]

    def _follow(self, ids: tuple[str, ...]) -> Floats:
        """Other tracks from now on; (N,) the share of its error that each keeps: none if it is new."""
        before = {name: row for row, name in enumerate(self._ids)}
        rows = np.array([before.get(name, -1) for name in ids], dtype=np.int64)
        known = rows >= 0
        errors, keys = np.zeros((len(ids), 4)), np.zeros(len(ids), dtype=np.uint64)
        errors[known], keys[known] = self._errors[rows[known]], self._keys[rows[known]]
        for row in np.flatnonzero(~known).tolist():
            digest = blake2b(f"{self._episode}#{ids[row]}".encode(), digest_size=8).digest()
            keys[row] = int.from_bytes(digest, "little")
        self._ids, self._errors, self._keys = ids, errors, keys
        return np.where(known, self._kept, 0.0)


def _uniform(keys: NDArray[np.uint64], frame: int) -> Floats:
    """(N, _DRAWS) numbers between 0 and 1 of a frame for each key, both excluded: splitmix64 (Steele et al. 2014)."""
    first = (frame - _FIRST_FRAME) * _DRAWS + 1
    mixed = keys[:, None] + _GOLDEN * np.arange(first, first + _DRAWS, dtype=np.uint64)
    for shift, factor in _MIXERS:
        mixed = (mixed ^ (mixed >> shift)) * factor
    mixed ^= mixed >> np.uint64(31)
    return ((mixed >> np.uint64(11)).astype(np.float64) + 0.5) * 2.0**-53
