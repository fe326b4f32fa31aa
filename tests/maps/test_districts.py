"""The four shipped districts: what must hold for every lane, connector and surface of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

import numpy as np
import pytest
import shapely

from interplan_sumo.errors import UnknownNameError
from interplan_sumo.maps.districts import DISTRICTS, bus_stops, draw
from interplan_sumo.maps.districts.draw import draw_plan
from interplan_sumo.maps.rules import schema_problems
from interplan_sumo.world.geometry import Polyline, wrap_angle
from interplan_sumo.world.roads import Area, Intersection, IntersectionKind, LaneLike, Roads, StopLineKind, Turn

NAMES = ("strip", "one_north", "back_bay", "hazelwood")
every_district = pytest.mark.parametrize("name", NAMES)

OVERTAKING_SIGHT_M = 120.0
JAYWALKING_LIMIT_MPS = 50.1 / 3.6


def pieces(roads: Roads) -> list[LaneLike]:
    return [*roads.lanes.values(), *roads.connectors.values()]


def tightest_radius_m(line: Polyline, step_m: float = 2.0) -> float:
    """Radius of the circle through points 2 m apart, the smallest along the line (nuPlan's way)."""
    if line.length_m < 2.0 * step_m + 0.5:
        return np.inf
    arc = np.arange(0.0, line.length_m - 2.0 * step_m, 0.5)
    a, b, c = (line.poses_at(arc + k * step_m)[:, :2] for k in range(3))
    sides = np.hypot(*(b - a).T) * np.hypot(*(c - b).T) * np.hypot(*(c - a).T)
    area = np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2.0
    return float((sides / np.maximum(4.0 * area, 1e-12)).min())


def surfaces(roads: Roads) -> Iterable[Sequence[Area] | Sequence[Intersection]]:
    return (
        roads.crosswalks,
        roads.walkways,
        roads.carparks,
        roads.road_segments,
        roads.generic_drivable_areas,
        roads.intersections,
    )


def oncoming_lane(roads: Roads, lane_id: str) -> str | None:
    """The lane of the other direction that begins right beside a lane, on the side of the oncoming traffic."""
    lane = roads.lanes[lane_id]
    left = 1.0 if roads.driving_side == "right" else -1.0
    pose = lane.centerline.pose_at(lane.centerline.length_m / 2.0, left * 3.6)
    for other in roads.lanes_at(pose.x_m, pose.y_m):
        arc_m, _ = roads.lanes[other].centerline.project_point(pose.x_m, pose.y_m)
        heading = roads.lanes[other].centerline.pose_at(arc_m).heading_rad
        if abs(wrap_angle(heading - pose.heading_rad)) > 2.5:
            return other
    return None


def places(roads: Roads) -> dict[str, list[str]]:
    """Roadblocks, or bus stops, at which each kind of scene finds room."""
    found: dict[str, list[str]] = {
        kind: [] for kind in ("blocked lane", "jaywalker", "nudge", "overtake", "lane change", "merge")
    }
    for block in roads.roadblocks.values():
        if block.is_connector:
            continue
        kerb = roads.lanes[block.lane_ids[-1 if roads.driving_side == "right" else 0]]
        length_m, limit_mps = kerb.centerline.length_m, kerb.speed_limit_mps or 0.0
        two_way = len(block.lane_ids) == 1 and oncoming_lane(roads, kerb.id) is not None
        if length_m >= 100.0 and limit_mps < 20.5:
            found["nudge"].append(block.id)
            if len(block.lane_ids) > 1 or two_way:
                found["blocked lane"].append(block.id)
        if length_m >= OVERTAKING_SIGHT_M and two_way:
            found["overtake"].append(block.id)
        if length_m >= 100.0 and len(block.lane_ids) > 1:
            found["lane change"].append(block.id)
    stops = [roads.lanes[stop.lane_id] for stop in bus_stops(roads.name)]
    found["jaywalker"] = [s.id for s in stops if (s.speed_limit_mps or 99.0) <= JAYWALKING_LIMIT_MPS]
    for area in roads.intersections:
        entries = [c for c in roads.connectors.values() if roads.roadblocks[c.roadblock_id].intersection_id == area.id]
        sources = {roads.lanes[c.from_lane_id].roadblock_id for c in entries}
        if area.kind is IntersectionKind.LANE_MERGE and len(sources) == 2:
            found["merge"].append(area.id)
    return found


# --- nuPlan's rules ------------------------------------------------------------------------------


@every_district
def test_a_district_obeys_every_rule_of_the_schema(name: str) -> None:
    assert schema_problems(draw(name)) == []


@every_district
def test_vertices_of_centre_lines_are_at_most_one_metre_apart(name: str) -> None:
    for lane in pieces(draw(name)):
        assert np.diff(lane.centerline.arc_m).max() <= 1.0, lane.id


@every_district
def test_lanes_and_connectors_meet_end_to_end_without_a_kink(name: str) -> None:
    roads = draw(name)
    for connector in roads.connectors.values():
        before, after = roads.lanes[connector.from_lane_id], roads.lanes[connector.to_lane_id]
        for first, second in ((before.centerline, connector.centerline), (connector.centerline, after.centerline)):
            assert np.hypot(*(first.points[-1] - second.points[0])) < 0.01, connector.id
            kink = wrap_angle(second.segment_heading_rad[0] - first.segment_heading_rad[-1])
            assert abs(np.degrees(kink)) < 1.0, connector.id


@every_district
def test_polygons_of_lanes_and_of_roadblocks_are_disjoint(name: str) -> None:
    roads = draw(name)
    blocks = [block for block in roads.roadblocks.values() if not block.is_connector]
    for items in (list(roads.lanes.values()), blocks):
        shapes = np.array([item.polygon for item in items])
        one, other = shapely.STRtree(shapes).query(shapes, predicate="intersects")
        one, other = one[one < other], other[one < other]
        common_m2 = shapely.area(shapely.intersection(shapes[one], shapes[other]))
        worst = int(np.argmax(common_m2))
        assert common_m2[worst] < 1e-3, (items[one[worst]].id, items[other[worst]].id)


@every_district
def test_all_surfaces_are_valid_single_polygons_with_ids_of_their_own(name: str) -> None:
    roads = draw(name)
    for layer in surfaces(roads):
        assert all(area.polygon.is_valid and area.polygon.geom_type == "Polygon" for area in layer)
        assert len({area.id for area in layer}) == len(layer)
        assert all(int(area.id) > 0 for area in layer)


@every_district
def test_every_lane_and_connector_lies_on_the_drivable_area(name: str) -> None:
    roads = draw(name)
    paved = shapely.buffer(roads.drivable_area, 1e-3)
    shapely.prepare(paved)
    assert [lane.id for lane in pieces(roads) if not shapely.covers(paved, lane.polygon)] == []
    for lane in pieces(roads):
        assert roads.drivable(lane.centerline.points).all(), lane.id


# --- the network ---------------------------------------------------------------------------------


@every_district
def test_every_lane_can_be_reached_from_the_edge_of_the_map_and_leads_back_to_it(name: str) -> None:
    roads = draw(name)
    hull = shapely.union_all([lane.polygon for lane in roads.lanes.values()]).convex_hull
    for ends, follow in (
        ([i for i in roads.lanes if not roads.incoming(i)], roads.outgoing),
        ([i for i in roads.lanes if not roads.outgoing(i)], roads.incoming),
    ):
        for lane_id in ends:
            end = roads.lanes[lane_id].centerline.points[0 if follow == roads.outgoing else -1]
            # Streets end near the edge of the map, never in the middle of it.
            assert shapely.distance(shapely.boundary(hull), shapely.Point(end)) < 140.0, lane_id
        seen, queue = set(ends), list(ends)
        while queue:
            lane_id = queue.pop()
            siblings = roads.roadblocks[roads.lanes[lane_id].roadblock_id].lane_ids
            links = [(link, follow(link)[0]) for link in follow(lane_id)]
            for following in (*siblings, *(lane for _, lane in links)):
                if following not in seen:
                    seen.add(following)
                    queue.append(following)
        assert seen == set(roads.lanes)


@every_district
def test_every_lane_leads_somewhere_unless_its_whole_roadblock_ends(name: str) -> None:
    roads = draw(name)
    for block in roads.roadblocks.values():
        if not block.is_connector:
            assert len({bool(roads.outgoing(lane)) for lane in block.lane_ids}) == 1, block.id


@every_district
def test_lanes_of_a_roadblock_are_listed_from_left_to_right(name: str) -> None:
    roads = draw(name)
    for block in roads.roadblocks.values():
        if block.is_connector:
            continue
        assert [roads.lanes[lane].index for lane in block.lane_ids] == list(range(len(block.lane_ids)))
        for left, right in zip(block.lane_ids, block.lane_ids[1:], strict=False):
            middle = roads.lanes[right].centerline.pose_at(roads.lanes[right].centerline.length_m / 2.0)
            _, offset_m = roads.lanes[left].centerline.project_point(middle.x_m, middle.y_m)
            assert -4.0 < offset_m < -2.9, (left, right)
            assert roads.right_of(left) is roads.lanes[right]


@every_district
def test_oncoming_traffic_is_on_the_side_that_the_driving_side_says(name: str) -> None:
    roads = draw(name)
    single = [b.lane_ids[0] for b in roads.roadblocks.values() if not b.is_connector and len(b.lane_ids) == 1]
    assert sum(oncoming_lane(roads, lane) is not None for lane in single) >= 10


# --- design practice -----------------------------------------------------------------------------


@every_district
def test_lanes_are_between_3_and_3_7_metres_wide(name: str) -> None:
    for lane in draw(name).lanes.values():
        assert 2.99 <= lane.polygon.area / lane.centerline.length_m <= 3.71, lane.id


@every_district
def test_limits_are_those_of_towns_and_only_the_parkway_is_faster(name: str) -> None:
    roads = draw(name)
    for lane in roads.lanes.values():
        assert lane.speed_limit_mps is not None
        kmh = 3.6 * lane.speed_limit_mps
        assert 30.0 <= kmh <= 72.1 or (name == "hazelwood" and lane.id.startswith("10") and kmh < 90.0), lane.id
    for connector in roads.connectors.values():
        assert connector.speed_limit_mps is not None
        ends = (roads.lanes[connector.from_lane_id], roads.lanes[connector.to_lane_id])
        assert 4.1 <= connector.speed_limit_mps <= min(lane.speed_limit_mps or 0.0 for lane in ends)


@every_district
def test_bends_fit_the_limit_and_a_car_can_turn(name: str) -> None:
    for lane in pieces(draw(name)):
        radius_m = tightest_radius_m(lane.centerline)
        assert radius_m > 5.0, lane.id
        assert (lane.speed_limit_mps or 0.0) ** 2 / radius_m < 3.5, lane.id


@every_district
def test_roadblocks_are_of_moderate_length(name: str) -> None:
    lengths = [lane.centerline.length_m for lane in draw(name).lanes.values()]
    assert min(lengths) > 30.0
    assert max(lengths) < 310.0


@every_district
def test_light_controlled_connectors_stop_at_one_line_of_a_traffic_light_at_their_start(name: str) -> None:
    roads = draw(name)
    lit = [connector for connector in roads.connectors.values() if connector.has_traffic_light]
    assert lit
    for connector in lit:
        (line_id,) = connector.stop_line_ids
        line = roads.stop_lines[line_id]
        assert line.kind is StopLineKind.TRAFFIC_LIGHT
        assert line.polygon.intersects(connector.centerline.linestring)
        assert line.polygon.intersects(roads.lanes[connector.from_lane_id].polygon)


@every_district
def test_all_or_none_of_the_connectors_of_an_intersection_are_light_controlled(name: str) -> None:
    roads = draw(name)
    for area in roads.intersections:
        lit = {
            connector.has_traffic_light
            for connector in roads.connectors.values()
            if roads.roadblocks[connector.roadblock_id].intersection_id == area.id
        }
        assert lit == {area.kind is IntersectionKind.TRAFFIC_LIGHT}, area.id


@every_district
def test_connectors_turn_the_way_they_say(name: str) -> None:
    for connector in draw(name).connectors.values():
        bend = wrap_angle(connector.centerline.segment_heading_rad[-1] - connector.centerline.segment_heading_rad[0])
        if connector.turn is Turn.STRAIGHT:
            assert abs(np.degrees(bend)) < 33.0, connector.id
        else:
            assert (bend > 0.0) == (connector.turn is Turn.LEFT), connector.id


@every_district
def test_crosswalks_lie_in_the_intersection_and_clear_of_the_lanes(name: str) -> None:
    roads = draw(name)
    places_ = shapely.union_all([area.polygon for area in roads.intersections])
    lanes_ = shapely.union_all([lane.polygon for lane in roads.lanes.values()])
    assert roads.crosswalks
    for crosswalk in roads.crosswalks:
        assert crosswalk.polygon.intersection(places_).area > 0.97 * crosswalk.polygon.area, crosswalk.id
        assert crosswalk.polygon.intersection(lanes_).area < 0.01, crosswalk.id


@every_district
def test_nobody_drives_on_a_walkway(name: str) -> None:
    roads = draw(name)
    walkways = shapely.union_all([area.polygon for area in roads.walkways])
    assert walkways.intersection(roads.drivable_area).area < 2.0
    assert walkways.area > 2000.0


@every_district
def test_bus_stops_lie_beside_the_kerb_lane_with_room_to_approach(name: str) -> None:
    roads = draw(name)
    extras = shapely.union_all([area.polygon for area in roads.generic_drivable_areas])
    stops = bus_stops(name)
    assert len(stops) >= 5
    for stop in stops:
        lane = roads.lanes[stop.lane_id]
        kerbward = roads.right_of(lane.id) if roads.driving_side == "right" else roads.left_of(lane.id)
        assert kerbward is None
        assert 8.0 <= stop.arc_m <= lane.centerline.length_m - 8.0
        aside_m = (-1.0 if roads.driving_side == "right" else 1.0) * 3.0
        beside = lane.centerline.pose_at(stop.arc_m, aside_m)
        assert shapely.contains_xy(extras, beside.x_m, beside.y_m) == stop.bay, stop


# --- the four together ---------------------------------------------------------------------------


def test_there_are_four_districts_and_one_of_them_drives_on_the_left() -> None:
    assert tuple(DISTRICTS) == NAMES
    assert {name: draw(name).driving_side for name in NAMES} == dict.fromkeys(NAMES, "right") | {"one_north": "left"}
    assert {draw(name).crs for name in NAMES} == {"EPSG:32611", "EPSG:32648", "EPSG:32619", "EPSG:32617"}


def test_each_district_has_lane_kilometres_to_drive_and_all_have_their_share_of_lights() -> None:
    lights = 0
    for name in NAMES:
        roads = draw(name)
        assert sum(lane.centerline.length_m for lane in roads.lanes.values()) > 15_000.0
        # Junctions have short ids of their own; joints are named after their roadblock.
        kinds = Counter(area.kind for area in roads.intersections if len(area.id) < 3)
        lights += kinds[IntersectionKind.TRAFFIC_LIGHT]
        assert kinds[IntersectionKind.TRAFFIC_LIGHT] >= 3
    assert lights >= 12


def test_there_are_enough_different_places_for_every_family_on_both_driving_sides() -> None:
    found = {name: places(draw(name)) for name in NAMES}
    for kind in ("blocked lane", "jaywalker", "nudge", "overtake", "lane change"):
        left = len(set(found["one_north"][kind]))
        right = sum(len(set(found[name][kind])) for name in NAMES if name != "one_north")
        assert left >= 3, kind
        assert right >= 6, kind
    assert len(found["hazelwood"]["merge"]) >= 2
    distinct = {(name, place) for name in NAMES for kind in found[name].values() for place in kind}
    assert len(distinct) >= 60


def test_roads_span_three_to_five_lanes_on_the_strip() -> None:
    roads = draw("strip")
    boulevard = [b for b in roads.roadblocks.values() if b.id.startswith("10") and not b.is_connector]
    assert {3, 4, 5} <= {len(block.lane_ids) for block in boulevard}


@pytest.mark.slow
def test_drawing_twice_gives_the_same_map() -> None:
    plan = DISTRICTS["one_north"]
    one, other = draw_plan(plan), draw_plan(plan)
    assert list(one.lanes) == list(other.lanes)
    assert list(one.connectors) == list(other.connectors)
    for a, b in zip(pieces(one), pieces(other), strict=True):
        assert np.array_equal(a.centerline.points, b.centerline.points)
        assert a.polygon.equals(b.polygon)
    for first, second in zip(surfaces(one), surfaces(other), strict=True):
        assert [(a.id, a.polygon.wkt) for a in first] == [(b.id, b.polygon.wkt) for b in second]


def test_an_unknown_district_is_named_with_the_nearest_known_one() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'hazelwood'"):
        draw("hazlewood")
