"""Signals: the state of every connector that a traffic light controls."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.world.geometry import frozen


class SignalStatus(IntEnum):
    """nuPlan's codes."""

    GREEN = 0
    YELLOW = 1
    RED = 2
    UNKNOWN = 3


@dataclass(frozen=True, slots=True, eq=False)
class Signals:
    """Status per light-controlled connector at one instant, rows sorted by connector id."""

    connector_ids: tuple[str, ...]
    status: NDArray[np.int8]  # (N,) SignalStatus

    def __post_init__(self) -> None:
        object.__setattr__(self, "status", frozen(self.status, np.int8))
        if self.status.shape != (len(self.connector_ids),):
            raise ValueError(f"Signals.status has shape {self.status.shape}, expected ({len(self.connector_ids)},)")

    @classmethod
    def none(cls) -> Signals:
        """A map without lights."""
        return cls((), np.zeros(0, dtype=np.int8))

    def __len__(self) -> int:
        return len(self.connector_ids)

    def with_status(self, status: SignalStatus) -> frozenset[str]:
        """The connectors that show `status`."""
        return frozenset(self.connector_ids[row] for row in np.flatnonzero(self.status == status).tolist())
