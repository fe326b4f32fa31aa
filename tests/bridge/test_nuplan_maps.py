"""nuPlan's own map classes on our maps: on the shipped files, and on roads without a file."""

from __future__ import annotations

import os
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
import pytest
import shapely
from devkit import devkit

from interplan_sumo.maps import schema
from interplan_sumo.maps.store import load_roads, maps
from interplan_sumo.tiny_worlds import junction
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.roads import Roads

pytestmark = pytest.mark.filterwarnings("ignore")

DISTRICTS = tuple(maps())
POINTS = int(os.environ.get("INTERPLAN_NUPLAN_POINTS", "40"))
"""Per district; 2,500 make ten thousand, which takes some minutes: the devkit looks through a layer row by row."""


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """The devkit's own loader on the shipped files; its maps by name."""
    database = devkit("nuplan.database.maps_db.gpkg_mapsdb")
    nuplan_map = devkit("nuplan.common.maps.nuplan_map.nuplan_map")
    root = tmp_path_factory.mktemp("maps")  # it writes lock files into its root
    for file in maps().values():
        (root / file.name).symlink_to(file.folder.parent)
    shipped = next(iter(maps().values())).folder.parents[1]
    (root / "nuplan-maps-v1.0.json").write_bytes((shipped / "nuplan-maps-v1.0.json").read_bytes())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(database, "MAP_LOCATIONS", set(DISTRICTS))  # it opens these, by name, before any is asked for
        opened = database.GPKGMapsDB(map_version="nuplan-maps-v1.0", map_root=str(root))
        yield cache(lambda name: nuplan_map.NuPlanMap(opened, name))


@pytest.fixture(scope="module")
def layers() -> Any:
    return devkit("nuplan.common.maps.maps_datatypes").SemanticMapLayer


def places(roads: Roads, count: int) -> Floats:
    """(count, 2) points on and around the roads."""
    rng = np.random.default_rng(20260101)
    lines = [lane.centerline for lane in (*roads.lanes.values(), *roads.connectors.values())]
    chosen = rng.integers(len(lines), size=count)
    on = np.array([lines[row].poses_at(rng.uniform(0.0, lines[row].length_m))[0, :2] for row in chosen])
    return on + rng.normal(scale=6.0, size=(count, 2))


def counted(roads: Roads) -> dict[str, int]:
    """How many rows our roads have for each layer of the file."""
    blocks = [block.is_connector for block in roads.roadblocks.values()]
    return {
        schema.LANES: len(roads.lanes),
        schema.CONNECTORS: len(roads.connectors),
        schema.CONNECTOR_POLYGONS: len(roads.connectors),
        schema.BASELINES: len(roads.lanes) + len(roads.connectors),
        schema.ROADBLOCKS: len(blocks) - sum(blocks),
        schema.ROADBLOCK_CONNECTORS: sum(blocks),
        schema.INTERSECTIONS: len(roads.intersections),
        schema.STOP_LINES: len(roads.stop_lines),
        schema.CROSSWALKS: len(roads.crosswalks),
        schema.WALKWAYS: len(roads.walkways),
        schema.CARPARKS: len(roads.carparks),
        schema.ROAD_SEGMENTS: len(roads.road_segments),
        schema.GENERIC_DRIVABLE_AREAS: len(roads.generic_drivable_areas),
    }


@pytest.mark.parametrize("name", DISTRICTS)
def test_the_devkit_opens_every_layer_of_a_shipped_map_and_counts_what_we_count(opened: Any, name: str) -> None:
    map_, roads = opened(name), load_roads(name)
    map_.initialize_all_layers()
    for layer, count in counted(roads).items():
        assert len(map_._load_vector_map_layer(layer)) == count, layer
    assert len(map_._load_vector_map_layer(schema.BOUNDARIES)) > 0


@pytest.mark.parametrize("name", DISTRICTS)
@pytest.mark.parametrize("source", ["file", "roads"])
def test_the_devkit_finds_at_any_place_what_we_find(opened: Any, layers: Any, name: str, source: str) -> None:
    roads = load_roads(name)
    map_ = opened(name) if source == "file" else devkit("interplan_sumo.bridge.nuplan.map_api").map_api(roads)
    point_2d = devkit("nuplan.common.actor_state.state_representation").Point2D
    points = places(roads, POINTS)
    drivable, away_m = roads.drivable(points), roads.distance_to_drivable_m(points)
    for row, (x_m, y_m) in enumerate(points.tolist()):
        point = point_2d(x_m, y_m)

        def ids(layer: Any, point: Any = point) -> set[str]:
            return {each.id for each in map_.get_all_map_objects(point, layer)}

        assert ids(layers.LANE) == set(roads.lanes_at(x_m, y_m))
        assert ids(layers.LANE_CONNECTOR) == set(roads.connectors_at(x_m, y_m))
        assert map_.is_in_layer(point, layers.INTERSECTION) == roads.in_intersection(x_m, y_m)
        assert map_.is_in_layer(point, layers.DRIVABLE_AREA) == drivable[row]
        to_drivable_m = map_.get_distances_matrix_to_nearest_map_object([point], layers.DRIVABLE_AREA)[0]
        assert to_drivable_m == pytest.approx(away_m[row], abs=1e-5)
        lane, lane_m = map_.get_distance_to_nearest_map_object(point, layers.LANE)
        ours_m = shapely.distance(shapely.Point(x_m, y_m), [each.polygon for each in roads.lanes.values()])
        assert lane_m == pytest.approx(ours_m.min(), abs=1e-5)
        assert shapely.distance(roads.lanes[lane].polygon, shapely.Point(x_m, y_m)) == pytest.approx(lane_m, abs=1e-5)


@pytest.mark.parametrize("name", DISTRICTS)
@pytest.mark.parametrize("source", ["file", "roads"])
def test_lanes_lead_where_ours_lead(opened: Any, layers: Any, name: str, source: str) -> None:
    roads = load_roads(name)
    map_ = opened(name) if source == "file" else devkit("interplan_sumo.bridge.nuplan.map_api").map_api(roads)
    for id_ in list(roads.lanes)[::7]:
        lane, own = map_.get_map_object(id_, layers.LANE), roads.lanes[id_]
        assert {each.id for each in lane.outgoing_edges} == set(roads.outgoing(id_))
        assert {each.id for each in lane.incoming_edges} == set(roads.incoming(id_))
        assert lane.get_roadblock_id() == own.roadblock_id
        assert lane.speed_limit_mps == own.speed_limit_mps
        assert lane.baseline_path.length == pytest.approx(own.centerline.length_m, abs=1e-5)
        left, right = lane.adjacent_edges
        assert [each and each.id for each in (left, right)] == [
            each and each.id for each in (roads.left_of(id_), roads.right_of(id_))
        ]
    for id_ in list(roads.connectors)[::7]:
        connector, own = map_.get_map_object(id_, layers.LANE_CONNECTOR), roads.connectors[id_]
        assert [each.id for each in connector.outgoing_edges] == [own.to_lane_id]
        assert connector.has_traffic_lights() == own.has_traffic_light
        assert {each.id for each in connector.stop_lines} <= set(own.stop_line_ids)
        start, end = connector.left_boundary.linestring, own.left_boundary.linestring
        assert start.hausdorff_distance(end) < 1e-5
    for id_, block in list(roads.roadblocks.items())[::7]:
        layer = layers.ROADBLOCK_CONNECTOR if block.is_connector else layers.ROADBLOCK
        found = map_.get_map_object(id_, layer)
        assert {each.id for each in found.interior_edges} == set(block.lane_ids)
        assert {each.id for each in found.outgoing_edges} == set(roads.outgoing_roadblocks(id_))


def test_roads_without_a_file_open_too_and_what_is_absent_is_none(layers: Any) -> None:
    api = devkit("interplan_sumo.bridge.nuplan.map_api")
    roads = junction()
    map_ = api.map_api(roads)
    assert map_ is api.map_api(roads)
    map_.initialize_all_layers()
    assert map_._get_roadblock("999") is None
    assert map_._get_roadblock_connector("999") is None
    middle = roads.intersections[0].polygon.centroid
    point = devkit("nuplan.common.actor_state.state_representation").Point2D(middle.x, middle.y)
    assert map_.get_one_map_object(point, layers.INTERSECTION).id == roads.intersections[0].id
