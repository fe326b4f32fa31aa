"""Versions: what a result depends on besides the user's choices."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

LIBRARIES = {
    "interplan_sumo": "interplan-sumo",
    "sumo": "libsumo",
    "numpy": "numpy",
    "scipy": "scipy",
    "shapely": "shapely",
    "pyarrow": "pyarrow",
}
"""Name in manifests -> distribution."""


def versions() -> dict[str, str]:
    """Package, Python and the libraries that numbers pass through; imports none of them."""
    found = {"python": platform.python_version()}
    for name, distribution in LIBRARIES.items():
        try:
            found[name] = version(distribution)
        except PackageNotFoundError:
            found[name] = "missing"
    return found
