"""`Roads` as the tables that nuPlan's map classes ask for: what a GeoPackage of the map holds, without the file."""

from __future__ import annotations

from math import nan

import geopandas
import numpy as np
import shapely

from interplan_sumo.maps import schema
from interplan_sumo.maps.geopackage_writer import LayerRows, layer_rows
from interplan_sumo.world.geometry import Polyline
from interplan_sumo.world.roads import Roads


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
