"""The layers and columns of nuPlan's GeoPackage maps, as a table that the reader and the writer share."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

Geometry = Literal["Polygon", "LineString", "Point"]
Value = int | float | bool | str

LANES = "lanes_polygons"
CONNECTORS = "lane_connectors"
CONNECTOR_POLYGONS = "gen_lane_connectors_scaled_width_polygons"
BASELINES = "baseline_paths"
BOUNDARIES = "boundaries"
ROADBLOCKS = "lane_groups_polygons"
ROADBLOCK_CONNECTORS = "lane_group_connectors"
INTERSECTIONS = "intersections"
STOP_LINES = "stop_polygons"
CROSSWALKS = "crosswalks"
WALKWAYS = "walkways"
CARPARKS = "carpark_areas"
GENERIC_DRIVABLE_AREAS = "generic_drivable_areas"
ROAD_SEGMENTS = "road_segments"
TRAFFIC_LIGHTS = "traffic_lights"
DUBINS_NODES = "dubins_nodes"
META = "meta"

PROJECTED_CRS_KEY = "projectedCoordSystem"
GEOGRAPHIC_CRS_KEY = "geographicCoordSystem"
DRIVING_SIDE_KEY = "drivingSide"
"""Ours, not nuPlan's: "left" or "right"; nuPlan's classes skip keys that they do not know."""
GRID_KEY = "coordinateGridMetres"
"""Ours: projected coordinates are multiples of this, so that a reader can undo the rounding of longitudes."""

STORED_CRS = "EPSG:4326"
MAX_SPACING_M = 1.0
"""Vertices of a baseline: planners take headings from the nearest one."""
MAX_JOINT_GAP_M = 0.3
"""Lane and connector ends further apart than this are not joined by nuPlan's vector features."""


@dataclass(frozen=True, slots=True)
class Layer:
    """One table: its geometry (None for a plain table), its columns with a filler each, and what a reader needs.

    The fillers stand where nuPlan never looks; their Python type is the type of
    the column. Columns are in the order in which they are written.
    """

    geometry: Geometry | None
    columns: MappingProxyType[str, Value]
    needed: tuple[str, ...] = ()
    """Columns without which the layer cannot be read."""
    helpful: tuple[str, ...] = ()
    """Columns that are read where they exist."""
    required: bool = True
    """Whether nuPlan's lane, roadblock or drivable-area queries fail without the table."""
    areas: bool = False
    """Whether nothing refers to its rows, so that a geometry of several parts may become several rows."""


def _layer(
    geometry: Geometry | None,
    *needed: str,
    helpful: tuple[str, ...] = (),
    required: bool = True,
    areas: bool = False,
    **columns: Value,
) -> Layer:
    return Layer(geometry, MappingProxyType(columns), needed, helpful, required, areas)


# Names and types as in the published maps (facts from nuPlan's map classes and from files that they open).
# Boundary, edge and reflector numbers that nobody reads are 0, creators and free lists are ''.
LAYERS: MappingProxyType[str, Layer] = MappingProxyType(
    {
        BASELINES: _layer(
            "LineString", "lane_fid", "lane_connector_fid",
            path_type_fid=0, creator_id="", lane_fid=0.0, lane_connector_fid=0.0, dubins_node_fids="",
        ),
        BOUNDARIES: _layer(
            "LineString", boundary_segment_fids="", has_reflectors=False, boundary_type_fid=0, creator_id="",
        ),
        LANES: _layer(
            "Polygon",
            "lane_fid", "lane_group_fid", "lane_index", "left_boundary_fid", "right_boundary_fid", "speed_limit_mps",
            lane_fid=0, lane_group_fid=0, lane_index=0, creator_id="", name="", road_type_fid=0, lane_type_fid=0,
            width=0, left_offset=0.0, right_offset=0.0, min_speed=0.0, max_speed=0.0, stops=0, left_boundary_fid=0,
            right_boundary_fid=0, speed_limit_mps=0.0, left_has_reflectors=False, right_has_reflectors=False,
            from_edge_fid=0, to_edge_fid=0,
        ),
        CONNECTORS: _layer(
            "LineString",
            "exit_lane_fid", "entry_lane_fid", "lane_group_connector_fid", "traffic_light_stop_line_fids",
            "speed_limit_mps", helpful=("turn_type_fid",),
            exit_lane_group_fid=0, exit_lane_fid=0, entry_lane_group_fid=0, entry_lane_fid=0,
            lane_group_connector_fid=0, intersection_fid=0, turn_type_fid=0, bulb_fids="",
            traffic_light_stop_line_fids="", overlap=0, creator_id="", reflector_side_fid=0,
            left_has_reflectors=False, right_has_reflectors=False, speed_limit_mps=0.0,
        ),
        ROADBLOCKS: _layer(
            "Polygon", creator_id="", left_boundary_fid=0, right_boundary_fid=0, from_edge_fid=0, to_edge_fid=0,
        ),
        ROADBLOCK_CONNECTORS: _layer(
            "Polygon", "intersection_fid", "from_lane_group_fid", "to_lane_group_fid",
            intersection_fid=0, from_lane_group_fid=0, to_lane_group_fid=0, creator_id="", from_edge_fid=0,
            to_edge_fid=0, left_boundary_fid=0, right_boundary_fid=0,
        ),
        CONNECTOR_POLYGONS: _layer(
            "Polygon", "lane_connector_fid", "left_boundary_fid", "right_boundary_fid",
            baseline_path_fid=0, lane_connector_fid=0, from_edge_fid=0, to_edge_fid=0, left_boundary_fid=0,
            right_boundary_fid=0,
        ),
        INTERSECTIONS: _layer(
            "Polygon", helpful=("intersection_type_fid",), creator_id="", intersection_type_fid=0, is_mini=False,
        ),
        STOP_LINES: _layer(
            "Polygon",
            "stop_polygon_type_fid",
            stop_polygon_type_fid=5, lane_group_fid=0, lane_fids="", lane_connector_fids="", traffic_light_fids="",
            crosswalk_fids="", precedence_area_fids="", creator_id="",
        ),
        CROSSWALKS: _layer(
            "Polygon", required=False, areas=True, intersection_fids="", lane_fids="", is_marked=True, creator_id="",
        ),
        WALKWAYS: _layer("Polygon", required=False, areas=True, creator_id=""),
        CARPARKS: _layer("Polygon", areas=True, heading=0.0, creator_id=""),
        GENERIC_DRIVABLE_AREAS: _layer("Polygon", areas=True, creator_id=""),
        ROAD_SEGMENTS: _layer("Polygon", areas=True, lane_group_fids=""),
        TRAFFIC_LIGHTS: _layer("Point", required=False, ori_mean_yaw=0.0, light_face_type_fid=0.0),
        DUBINS_NODES: _layer("Point", required=False, radius=0.0, heading=0.0, creator_id=""),
        META: _layer(None, "key", "value", key="", value=""),
    }
)  # fmt: skip
