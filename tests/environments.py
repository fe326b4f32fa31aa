"""What processes that tests start are told."""

from __future__ import annotations

import os
import sys
from pathlib import Path


def environment(*first: Path, **settings: str) -> dict[str, str]:
    """Of a process that finds the modules that this one does, after those in the folders `first`."""
    path = os.pathsep.join([*map(str, first), *filter(None, sys.path)])
    return {**os.environ, "PYTHONPATH": path, **settings}
