"""nuPlan's own map classes over the layers of our `Roads`, and the roads behind a map of nuPlan's."""

# pyright: reportMissingImports=false, reportUntypedBaseClass=false
# The devkit has no types and is not among the dependencies.

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import lru_cache
from math import nan
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import shapely
from nuplan.common.maps.nuplan_map.nuplan_map import NuPlanMap
from nuplan.database.maps_db.imapsdb import IMapsDB

from interplan_sumo.errors import MapError, UnknownNameError
from interplan_sumo.maps import schema
from interplan_sumo.maps.geopackage_writer import LayerRows, layer_rows
from interplan_sumo.maps.store import load_roads, maps
from interplan_sumo.world.geometry import Polyline
from interplan_sumo.world.roads import Roads

MAPS_ROOT_VARIABLE = "NUPLAN_MAPS_ROOT"
"""Where nuPlan's devkit itself looks for its maps."""


class RoadsMapsDb(IMapsDB):
    """nuPlan's maps database with one map in it, whatever its name: no files, no locks, no raster layers."""

    def __init__(self, roads: Roads) -> None:
        self.roads = roads
        self._layers = vector_layers(roads)

    def load_vector_layer(self, location: str, layer_name: str) -> geopandas.GeoDataFrame:
        if layer_name not in self._layers:
            raise MapError(f"map {location} has no layer {layer_name}; known: {', '.join(self._layers)}")
        return self._layers[layer_name]

    def vector_layer_names(self, location: str) -> Sequence[str]:  # noqa: ARG002 (there is one map)
        return tuple(self._layers)

    def load_layer(self, location: str, layer_name: str) -> Any:
        raise MapError(f"map {location} has no raster layer {layer_name}: it is drawn in vectors only")

    def layer_names(self, location: str) -> Sequence[str]:  # noqa: ARG002 (there is one map)
        return ()

    def get_map_version(self) -> str:
        return ""

    def get_version(self, location: str) -> str:  # noqa: ARG002 (there is one map)
        return ""

    def purge_cache(self) -> None:
        """Nothing is cached."""


@lru_cache(maxsize=8)
def map_api(roads: Roads) -> NuPlanMap:
    """nuPlan's map of these roads, made once for the last few maps; MapError if an id of theirs is no number."""
    try:
        return NuPlanMap(RoadsMapsDb(roads), roads.name)
    except ValueError as error:
        raise MapError(f"map {roads.name} has an id that nuPlan's map classes cannot hold: {error}") from error


def roads_behind(map_: Any, maps_root: Path | None = None) -> Roads:
    """The roads of a map of nuPlan's: those it was made from, or those of its GeoPackage in the maps root.

    `maps_root` is by default what the variable NUPLAN_MAPS_ROOT names. MapError
    or UnknownNameError where the map is not found there.
    """
    database = getattr(map_, "_maps_db", None)
    if isinstance(database, RoadsMapsDb):
        return database.roads
    named = maps_root or os.environ.get(MAPS_ROOT_VARIABLE)
    if not named:
        raise MapError(
            f"where is map {map_.map_name}? Set {MAPS_ROOT_VARIABLE} to nuPlan's maps root, or give maps_root"
        )
    root = Path(named)
    known = maps(root)
    if map_.map_name not in known:
        raise UnknownNameError("map", map_.map_name, known, f"Looked in {root}, {MAPS_ROOT_VARIABLE} names another.")
    return load_roads(known[map_.map_name].folder)


def vector_layers(roads: Roads) -> dict[str, geopandas.GeoDataFrame]:
    """Every layer that nuPlan's map classes query, by its name in the GeoPackage; empty ones too.

    As nuPlan's own loader hands them over: in the order of their ids and
    indexed by the id as text, the id again in column `fid`, geometries in the
    projected system. Columns are those that its classes read; an unknown limit
    is not a number, a reference to nothing 0. Centre lines have a vertex at
    least every metre.
    """
    layers = layer_rows(roads)
    layers[schema.BASELINES].shapes = [_dense(line) for line in layers[schema.BASELINES].shapes]
    return {
        name: _table(layer, layers[name], roads.crs)
        for name, layer in schema.LAYERS.items()
        if layer.geometry in ("Polygon", "LineString")
    }


def _table(layer: schema.Layer, rows: LayerRows, crs: str) -> geopandas.GeoDataFrame:
    order = np.argsort(rows.ids, kind="stable").tolist()
    ids = [str(rows.ids[row]) for row in order]
    columns = {
        name: [_known(rows.columns[name][row], name) for row in order] for name in (*layer.needed, *layer.helpful)
    }
    shapes = [rows.shapes[row] for row in order]
    return geopandas.GeoDataFrame({**columns, "fid": ids}, index=ids, geometry=shapes, crs=crs)


def _known(value: schema.Value | None, column: str) -> schema.Value:
    return value if value is not None else nan if column == "speed_limit_mps" else 0


def _dense(line: shapely.Geometry) -> shapely.Geometry:
    drawn = Polyline(shapely.get_coordinates(line))
    if np.diff(drawn.arc_m).max() > schema.MAX_SPACING_M + 1e-3:  # a written grid may stretch it by a hair
        return drawn.resampled(schema.MAX_SPACING_M).linestring
    return line
