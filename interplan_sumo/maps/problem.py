"""What can be wrong with a map: a rule broken, or a way in which its network or its import differs from it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

ProblemKind = Literal[
    "id", "membership", "shape", "line", "joint", "overlap",  # rules of nuPlan's schema
    "missing", "extra", "driving_side", "deviation", "limit", "broken_link", "light",  # against network or file
    "length", "count", "another_file", "signal", "right_of_way", "street", "second_opinion",  # against the file only
]  # fmt: skip


@dataclass(frozen=True, slots=True)
class MapProblem:
    """One problem, told of one thing."""

    kind: ProblemKind
    layer: str
    """Layer of the GeoPackage; else "network" or "light" of SUMO, or "file", "lane" or "link" of what was imported."""
    id: str
    """Within the layer."""
    message: str
    """What is wrong with it, without its name."""

    def __str__(self) -> str:
        id_ = self.id if self.id.isprintable() and len(self.id) <= 80 else repr(self.id[:80])
        return f"{self.layer} {id_}: {self.message}"
