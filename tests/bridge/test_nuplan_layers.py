"""`Roads` as tables of nuPlan's: every layer, every column that its classes read, nothing empty that must not be."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("geopandas", reason="needs the extra [nuplan]")

from interplan_sumo.bridge.nuplan.layers import vector_layers
from interplan_sumo.maps import schema
from interplan_sumo.tiny_worlds import junction, straight_road

ROADS = junction()


def test_every_layer_that_nuplan_asks_for_is_there_even_if_empty() -> None:
    layers = vector_layers(straight_road())
    for name, layer in schema.LAYERS.items():
        if layer.geometry in ("Polygon", "LineString"):
            assert {*layer.needed, "fid", "geometry"} <= set(layers[name].columns), name
    assert len(layers[schema.CARPARKS]) == 0


def test_rows_are_found_by_their_id_as_text() -> None:
    lanes = vector_layers(ROADS)[schema.LANES]
    assert set(lanes.index) == set(ROADS.lanes)
    assert list(lanes["fid"]) == list(lanes.index)
    for id_, lane in ROADS.lanes.items():
        row: Any = lanes.loc[id_]
        assert (row.lane_fid, row.lane_group_fid, row.lane_index) == (int(id_), int(lane.roadblock_id), lane.index)
        assert row.geometry.equals(lane.polygon)


def test_a_connector_exits_the_lane_behind_it_and_enters_the_one_ahead() -> None:
    layers = vector_layers(ROADS)
    for id_, connector in ROADS.connectors.items():
        row: Any = layers[schema.CONNECTORS].loc[id_]
        assert (row.exit_lane_fid, row.entry_lane_fid) == (int(connector.from_lane_id), int(connector.to_lane_id))
        assert row.traffic_light_stop_line_fids == ",".join(connector.stop_line_ids)
        shapes = layers[schema.CONNECTOR_POLYGONS]
        (shape,) = shapes.geometry[shapes["lane_connector_fid"] == int(id_)]
        assert shape.equals(connector.polygon)


def test_every_lane_and_connector_has_one_centre_line_with_a_vertex_each_metre() -> None:
    baselines = vector_layers(ROADS)[schema.BASELINES]
    for ids, column in ((ROADS.lanes, "lane_fid"), (ROADS.connectors, "lane_connector_fid")):
        assert sorted(value for value in baselines[column] if value) == sorted(map(int, ids))
    for line in baselines.geometry:
        assert np.hypot(*np.diff(np.asarray(line.coords), axis=0).T).max() <= 1.0 + 1e-3


def test_boundaries_exist_and_neighbours_share_the_line_between_them() -> None:
    layers = vector_layers(straight_road(lanes=2))
    left, right = (layers[schema.LANES].iloc[row] for row in range(2))
    assert left.right_boundary_fid == right.left_boundary_fid
    for lane in (left, right):
        for side in ("left_boundary_fid", "right_boundary_fid"):
            assert str(lane[side]) in layers[schema.BOUNDARIES].index


@pytest.mark.parametrize(("limit_mps", "stored"), [(12.5, 12.5), (None, np.nan)])
def test_an_unknown_limit_is_no_number(limit_mps: float | None, stored: float) -> None:
    lanes = vector_layers(straight_road(limit_mps=limit_mps))[schema.LANES]
    np.testing.assert_equal(lanes["speed_limit_mps"].to_numpy(), [stored] * len(lanes))
