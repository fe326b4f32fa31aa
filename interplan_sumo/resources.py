"""Where the shipped data lie: the same answer in a checkout and in an installed wheel."""

from __future__ import annotations

import os
from functools import cache
from importlib.resources import files
from pathlib import Path

from interplan_sumo.errors import MapError, VehicleTypeError


@cache
def data_root() -> Path:
    """The folder that holds `nets/` and `routes/`.

    `interplan_sumo/_data` in a wheel, the folder above the package in a checkout.
    Zipped imports are not supported: SUMO reads real files.
    """
    package = Path(os.fspath(files("interplan_sumo")))  # type: ignore[arg-type]
    shipped = package / "_data"
    return shipped if shipped.is_dir() else package.parent


def maps_root() -> Path:
    """The folder of maps, laid out as nuPlan's maps root."""
    root = data_root() / "nets"
    if not root.is_dir():
        raise MapError(f"no maps folder at {root}; reinstall interplan-sumo")
    return root


def routes_root() -> Path:
    """The folder of vehicle-type files."""
    root = data_root() / "routes"
    if not root.is_dir():
        raise VehicleTypeError(f"no vehicle-type folder at {root}; reinstall interplan-sumo")
    return root
