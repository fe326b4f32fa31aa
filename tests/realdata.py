"""Real maps and recordings of others, read in place; tests that need them are skipped where they are absent."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

REALDATA = Path(os.environ.get("INTERPLAN_REALDATA", Path(__file__).parents[2] / "shared" / "realdata"))


def real(*parts: str) -> Path:
    """A file or folder of the real data; skips the test where it is absent."""
    path = REALDATA.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"no real data at {path} (INTERPLAN_REALDATA names the folder)")
    return path
