"""Versions: what a result depends on besides the user's choices."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version
from typing import Final

from interplan_sumo import __version__

LIBRARIES = {"sumo": "libsumo", "numpy": "numpy", "scipy": "scipy", "shapely": "shapely", "pyarrow": "pyarrow"}
"""Name in manifests -> distribution."""
SCORING: Final = "scoring"
"""Name in manifests of the version of the scoring."""


def versions() -> dict[str, str]:
    """Package, Python and the libraries that numbers pass through; imports none of them."""
    found = {"python": platform.python_version(), "interplan_sumo": __version__}
    for name, distribution in LIBRARIES.items():
        try:
            found[name] = version(distribution)
        except PackageNotFoundError:
            found[name] = "missing"
    return found


def scored_versions() -> dict[str, str]:
    """These, and the version of the scoring: what a row depends on."""
    from interplan_sumo.metrics.score import SCORING_VERSION

    return versions() | {SCORING: str(SCORING_VERSION)}
