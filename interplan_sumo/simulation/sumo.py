"""The door to libsumo: the only module that imports it. One simulation per process."""

from __future__ import annotations

import os
from math import isfinite
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from interplan_sumo.errors import InputError, TrafficError

# libsumo points PROJ at its own data when it is imported, which would break pyproj and GDAL in the same process.
_proj = {name: os.environ.get(name) for name in ("PROJ_LIB", "PROJ_DATA")}
import libsumo  # noqa: E402

for _name, _value in _proj.items():
    if _value is None:
        os.environ.pop(_name, None)
    else:
        os.environ[_name] = _value

sumo: Any = libsumo
"""libsumo, whose extension module carries no types."""

getters: Any = sumo._libsumo
"""The extension module itself, `vehicle_getSpeed(name)`: the layer around it costs half as much as a getter again."""

DT_S = 0.1
TYPES = "vehicle_types.xml"
"""What SUMO calls the file that it reads vehicle types from."""

_is_open = False


class Commanding:
    """Turns whatever libsumo raises inside into a TrafficError that names the command."""

    __slots__ = ("_details", "_what")

    def __init__(self, what: str, *details: object) -> None:
        """`details` fill the braces of `what`; only if something goes wrong is that worth doing."""
        self._what = what
        self._details = details

    def __enter__(self) -> None:
        """Nothing to prepare."""

    def __exit__(self, _kind: object, error: BaseException | None, _where: object) -> None:
        if isinstance(error, sumo.TraCIException | sumo.FatalTraCIError | TypeError):
            raise TrafficError(f"SUMO failed at {self._what.format(*self._details)}: {error}") from error


def open_simulation(network: Path, types: str) -> None:
    """Start SUMO on a network with vehicle types (XML); TrafficError if it runs already, or does not start."""
    global _is_open
    if _is_open:
        raise TrafficError("SUMO is already running in this process; close the other SumoTraffic first")
    if "," in str(network):
        raise InputError(f"SUMO cannot open {network}: it splits paths at commas; rename the folder or the file")
    command = [
        "sumo", "--net-file", str(network), "--additional-files", TYPES, "--step-length", str(DT_S),
        "--collision.action", "none", "--time-to-teleport", "-1", "--insertion-checks", "none",
        "--lanechange.duration", "3", "--default.speeddev", "0", "--no-step-log", "true",
        "--no-warnings", "true", "--xml-validation", "never", "--xml-validation.net", "never",
    ]  # fmt: skip
    with TemporaryDirectory(prefix="interplan_") as folder, Commanding("start with {}", network.name):
        command[command.index(TYPES)] = str(Path(folder) / TYPES)
        (Path(folder) / TYPES).write_text(types, encoding="utf-8")
        sumo.start(command)
    _is_open = True


def close_simulation() -> None:
    """End what `open_simulation` began."""
    global _is_open
    _is_open = False
    sumo.close()


def finite(what: str, number: float) -> float:
    """A plain float, rounded to 1e-6; libsumo would accept nan and keep it for good."""
    value = round(float(number), 6)
    if not isfinite(value):
        raise TrafficError(f"{what} is not finite: {value}")
    return value
