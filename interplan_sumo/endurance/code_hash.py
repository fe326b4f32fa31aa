"""Code hash: which code segments were driven with, so that kilometres of other code are not put beside them."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Final

DRIVES: Final = ("dynamics", "endurance", "metrics", "plan_check", "scenario", "simulation", "world")
"""Packages and modules that a segment passes through from its draw to its record."""
TELLS: Final = frozenset(
    {
        "cell_regression", "code_hash", "drawings", "formats", "gathered", "looks", "page", "plot", "rate_sample",
        "rates", "remote_segments", "report", "stop_rule",
    }
)  # fmt: skip
"""Modules of `endurance` that only tell what has been driven."""


def code_files() -> list[Path]:
    """What of this package decides what happens in a segment."""
    root = Path(str(files("interplan_sumo")))
    return [
        path
        for package in DRIVES
        for path in (sorted((root / package).rglob("*.py")) or [root / f"{package}.py"])
        if not (package == "endurance" and path.stem in TELLS)
    ] + [root / "endurance" / "saturation.json"]


@lru_cache(maxsize=1)
def code_hash() -> str:
    """SHA-256 of these files, by their names and contents."""
    root, digest = Path(str(files("interplan_sumo"))), hashlib.sha256()
    for path in code_files():
        content = path.read_bytes()
        digest.update(f"{path.relative_to(root).as_posix()} {len(content)}\n".encode())
        digest.update(content)
    return digest.hexdigest()
