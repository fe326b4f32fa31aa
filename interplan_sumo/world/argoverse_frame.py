"""Where Argoverse 2 lies: its maps and recordings measure metres east and north of one origin per city."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pyproj

from interplan_sumo.errors import UnknownNameError


@dataclass(frozen=True, slots=True)
class ArgoverseCity:
    """A city with the origin of its coordinates."""

    code: str
    """As in the names of map files."""
    names: tuple[str, ...]
    """As in the `city` column of recordings, and what else people call it."""
    latitude_deg: float
    longitude_deg: float
    utm_zone: int
    """North of the equator."""

    @property
    def name(self) -> str:
        return self.names[0]


# Codes, origins and zones are those of Argoverse's own tools (av2.geometry.utm).
CITIES = (
    ArgoverseCity("ATX", ("austin",), 30.27464237939507, -97.7404457407424, 14),
    ArgoverseCity("DTW", ("dearborn", "detroit"), 42.29993066912924, -83.17555750783717, 17),
    ArgoverseCity("MIA", ("miami",), 25.77452579915163, -80.19656914449405, 17),
    ArgoverseCity("PAO", ("palo-alto",), 37.416065, -122.13571963362166, 10),
    ArgoverseCity("PIT", ("pittsburgh",), 40.44177902989321, -80.01294377242584, 17),
    ArgoverseCity("WDC", ("washington-dc", "washington"), 38.889377, -77.0355047439081, 18),
)


def find_city(text: str) -> ArgoverseCity:
    """A city by its code or name, in capitals or not; UnknownNameError for any other."""
    wanted = "-".join(re.split(r"[\s_-]+", text.strip().lower()))
    for city in CITIES:
        if wanted in (city.code.lower(), *city.names):
            return city
    raise UnknownNameError("Argoverse city", text[:40], (city.name for city in CITIES))


@lru_cache
def city_frame(city: str) -> tuple[str, tuple[float, float]]:
    """The projected system of a city and the place of its origin in it, metres east and north."""
    found = find_city(city)
    crs = f"EPSG:{32600 + found.utm_zone}"
    to_utm = pyproj.Transformer.from_crs("EPSG:4326", crs, always_xy=True)
    east_m, north_m = to_utm.transform(found.longitude_deg, found.latitude_deg)
    return crs, (float(east_m), float(north_m))


def scenario_city(path: Path) -> str | None:
    """The city that a recording (`scenario_*.parquet`) names; None where it cannot be read or names none we know."""
    try:
        with pq.ParquetFile(path) as file:
            rows = next(file.iter_batches(batch_size=1, columns=["city"]), None)
        return find_city(str(rows.column(0)[0].as_py())).name if rows is not None else None
    except (OSError, ValueError, LookupError, pa.ArrowException, UnknownNameError):
        return None


def argoverse_name(city: str | None, id_: str) -> str:
    """A short name for the map or the recording of a log, fit for a folder: `argoverse2-austin-0a1e6f0a`."""
    parts = ("argoverse2", city or "", re.sub(r"[^a-z0-9]", "", id_.split("-")[0].lower())[:12])
    return "-".join(part for part in parts if part)
