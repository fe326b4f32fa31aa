"""Replayed traffic: road users that follow recorded tracks whatever the ego does, as in nuPlan's non-reactive mode."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from interplan_sumo.scenario.recorded_parts import REPLAYED, ReplayedTrack
from interplan_sumo.simulation.lights import LoggedLights
from interplan_sumo.simulation.traffic import TrafficState
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import Floats

BEHAVIOUR = "replayed"
VEHICLE_HEIGHT_M = 1.5
"""A car's: recordings tell none."""


@dataclass(frozen=True, slots=True, eq=False)
class _Known:
    """A track under the id that others see."""

    id: str
    track: ReplayedTrack
    rows: Floats
    """(K, 8) in the order of the columns of Actors."""


class ReplayedTraffic:
    """Traffic from recorded tracks, 0.1 s a step, and what stands around. Needs no SUMO.

    Connectors have a state where their lights were recorded, too.
    """

    def __init__(
        self,
        tracks: Sequence[ReplayedTrack],
        ids: Sequence[str],
        standing: Actors,
        lights: LoggedLights | None = None,
        heights_m: Mapping[str, float] | None = None,
    ) -> None:
        """`ids` are those of the tracks as others see them; `standing` are the obstacles, `heights_m` theirs."""
        self._known = [_known(id, track) for id, track in zip(ids, tracks, strict=True)]
        self._standing = standing
        self._lights = lights or LoggedLights(())
        self._step = 0
        vehicles = [id for id, track in zip(ids, tracks, strict=True) if track.kind == "vehicle"]
        self.heights_m = dict(heights_m or {}) | dict.fromkeys(vehicles, VEHICLE_HEIGHT_M)

    def __enter__(self) -> ReplayedTraffic:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def behaviours(self) -> Mapping[str, str]:
        return {each.id: BEHAVIOUR for each in self._known}

    def observe(self) -> TrafficState:
        here = [each for each in self._known if each.track.first_step <= self._step < each.track.end_step]
        still = self._standing
        ids = [*(each.id for each in here), *still.ids]
        columns = (
            still.kind, still.x_m, still.y_m, still.heading_rad,
            still.length_m, still.width_m, still.vx_mps, still.vy_mps,
        )  # fmt: skip
        rows = np.array([each.rows[self._step - each.track.first_step] for each in here]).reshape(-1, len(columns))
        table = np.concatenate((rows, np.stack(columns, axis=1)))
        order = sorted(range(len(ids)), key=ids.__getitem__)
        kind, *others = table[order].T
        actors = Actors(tuple(ids[row] for row in order), kind.astype(np.int8), *others)
        return TrafficState(actors, self._lights.signals(self._step))

    def react(self, ego: EgoState) -> None:
        """Nobody reacts."""

    def place_ego(self, ego: EgoState) -> None:
        """Nobody looks."""

    def advance(self) -> None:
        self._step += 1

    def close(self) -> None:
        """Nothing is open."""


def _known(id: str, track: ReplayedTrack) -> _Known:
    steps = len(track.x_m)
    kind, length_m, width_m = (np.full(steps, v) for v in (REPLAYED[track.kind], track.length_m, track.width_m))
    rows = (kind, track.x_m, track.y_m, track.heading_rad, length_m, width_m, track.vx_mps, track.vy_mps)
    return _Known(id, track, np.stack([np.asarray(row, dtype=np.float64) for row in rows], axis=1))
