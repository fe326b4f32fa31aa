"""nuPlan's own map classes over our `Roads`, and the roads behind a map of nuPlan's."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import geopandas
from nuplan.common.maps.nuplan_map.nuplan_map import NuPlanMap
from nuplan.database.maps_db.imapsdb import IMapsDB

from interplan_sumo.bridge.nuplan.layers import vector_layers
from interplan_sumo.errors import MapError, UnknownNameError
from interplan_sumo.maps.store import load_roads, maps
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
