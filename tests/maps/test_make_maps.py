"""What road plans leave to rules: junctions where roads meet and who has priority, pockets, driveways, roundabouts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import yaml

from interplan_sumo.maps.junctions import Sign, lane_signs
from interplan_sumo.maps.rules import schema_problems
from interplan_sumo.world.geometry import wrap_angle
from interplan_sumo.world.roads import Roads
from tools.make_maps.draw import draw_plan
from tools.make_maps.plan import Plan
from tools.make_maps.reading import read_plan
from tools.map_yardsticks import yardsticks

STREET = {"lanes": 1, "limit_kmh": 30, "width_m": 3.4}
DUAL = {"lanes": 2, "limit_kmh": 50, "width_m": 3.4, "median_m": 4.2}
WEST_EAST = [[-150, 0], [150, 0]]
SOUTH_NORTH = [[0, -150], [0, 150]]
NORTH = [[0, 2], [0, 150]]
POCKET = {"inner_pockets": 1, "storage_m": 30, "taper_m": 20}


def planned(folder: Path, *roads: dict[str, Any], side: str = "right", **more: Any) -> Plan:
    """The plan of these roads, numbered from 10, streets unless they say otherwise."""
    whole = [{"number": 10 + k, "name": f"road_{k}", "both": STREET, **road} for k, road in enumerate(roads)]
    frame = {"crs": "EPSG:32611", "origin_m": [500000, 4000000], "driving_side": side, "carriageways": {}}
    file = folder / "tiny.yaml"
    file.write_text(yaml.safe_dump({**frame, "roads": whole, **more}))
    return read_plan(file)


def drawn(plan: Plan) -> Roads:
    """The plan on the ground, which must keep nuPlan's rules."""
    roads = draw_plan(plan)
    assert schema_problems(roads) == []
    return roads


@pytest.mark.parametrize(
    ("ranks", "second", "control"),
    [
        (("avenue", "avenue"), NORTH, "signal"),
        (("boulevard", "street"), SOUTH_NORTH, "signal"),
        (("boulevard", "street"), NORTH, "stop"),
        (("avenue", "street"), SOUTH_NORTH, "stop"),
        (("street", "street"), SOUTH_NORTH, "all_way_stop"),
        (("street", "street"), NORTH, "none"),
        (("avenue", "alley"), SOUTH_NORTH, "none"),
    ],
)
def test_the_ranks_of_roads_say_how_their_junction_is_controlled(
    ranks: tuple[str, str], second: list[list[float]], control: str, tmp_path: Path
) -> None:
    (junction,) = planned(
        tmp_path, {"points": second, "rank": ranks[1]}, {"points": WEST_EAST, "rank": ranks[0]}
    ).junctions
    assert (junction.number, junction.control) == (1011, control)
    assert ranks[0] == ranks[1] or junction.roads == ("road_1", "road_0")


def test_a_plan_overrules_the_ranks_and_only_what_it_names(tmp_path: Path) -> None:
    exception = {"roads": ["road_0", "road_1"], "control": "all_way_stop"}
    (junction,) = planned(tmp_path, {"points": WEST_EAST}, {"points": NORTH}, junctions=[exception]).junctions
    assert (junction.number, junction.control) == (1011, "all_way_stop")
    assert junction.crosswalks == ("road_0-", "road_0+", "road_1+")


def test_the_street_that_ends_stops_and_the_other_does_not(tmp_path: Path) -> None:
    roads = drawn(planned(tmp_path, {"points": WEST_EAST, "rank": "avenue"}, {"points": NORTH}))
    signs = lane_signs(roads)
    assert {lane[:2] for lane in signs} == {"11"}
    assert set(signs.values()) == {Sign.STOP}


def test_roads_that_end_too_far_away_or_are_motorways_do_not_meet(tmp_path: Path) -> None:
    far = planned(tmp_path, {"points": WEST_EAST}, {"points": [[0, 15], [0, 150]]})
    motorway = planned(tmp_path, {"points": WEST_EAST, "rank": "motorway"}, {"points": NORTH})
    assert far.junctions == motorway.junctions == ()


@pytest.mark.parametrize(("rank", "open"), [("street", False), ("avenue", True)])
def test_streets_leave_a_median_closed_and_avenues_break_it(rank: str, open: bool, tmp_path: Path) -> None:
    dual = {"points": [[-200, 0], [200, 0]], "both": DUAL, "rank": "boulevard"}
    roads = drawn(planned(tmp_path, dual, {"points": NORTH, "rank": rank}))
    ways = {(b.from_id or "", b.to_id or "") for b in roads.roadblocks.values() if b.is_connector}
    across = [way for way in ways if way[0].startswith("101") and way[1].startswith("11")]
    assert bool(across) == open  # eastbound traffic would turn left over the westbound carriageway
    assert any(way[0].startswith("102") and way[1].startswith("11") for way in ways)


def test_pockets_are_where_one_turns_across_the_oncoming_traffic_at_a_light(tmp_path: Path) -> None:
    avenues = {"rank": "avenue", "pocket": POCKET}
    (junction,) = planned(tmp_path, {"points": WEST_EAST, **avenues}, {"points": NORTH, **avenues}).junctions
    assert set(junction.approaches or ()) == {"road_0-", "road_1+"}  # from the east one turns right only


def test_an_offset_pair_of_streets_is_two_junctions_with_a_lane_between(tmp_path: Path) -> None:
    south = {"points": [[32, -150], [32, -2]]}
    roads = drawn(planned(tmp_path, {"points": WEST_EAST}, {"points": NORTH}, south))
    between = [lane.centerline.length_m for lane in roads.lanes.values() if lane.centerline.length_m < 20.0]
    assert yardsticks(roads).branching == 2
    assert len(between) == 2
    assert min(between) > 6.0


def test_skewed_streets_meet_with_rounded_corners(tmp_path: Path) -> None:
    roads = drawn(planned(tmp_path, {"points": WEST_EAST}, {"points": [[-90, -120], [90, 120]]}))
    (place,) = roads.intersections
    assert place.polygon.area > 1.2 * 16.0**2
    assert yardsticks(roads).connectors_per_exit_lane == 3.0


def test_joints_and_crossings_are_no_intersections_but_paved(tmp_path: Path) -> None:
    wide = {**STREET, "lanes": 2}
    sections = [{"forward": STREET, "backward": STREET}, {"from_m": 200, "forward": wide, "backward": wide}]
    roads = drawn(planned(tmp_path, {"points": WEST_EAST, "sections": sections, "crossings": [{"at_m": 80}]}))
    assert roads.intersections == ()
    assert len(roads.crosswalks) == 1
    for lane in (*roads.lanes.values(), *roads.connectors.values()):
        assert roads.drivable(lane.centerline.points[1:-1]).all()


# --- driveways -----------------------------------------------------------------------------------


def with_driveways(folder: Path, both: dict[str, Any], **rule: Any) -> Plan:
    driveways = [{"side": "forward", "every_m": 40, "park_m": [20, 16], **rule}]
    road = {"points": [[-200, 0], [200, 0]], "both": both, "rank": "avenue", "driveways": driveways}
    return planned(folder, road, {"points": NORTH, "rank": "avenue"}, driveway={**STREET, "limit_kmh": 16})


def test_driveways_come_every_so_often_and_leave_room_to_junctions_and_ends(tmp_path: Path) -> None:
    plan = with_driveways(tmp_path, STREET)
    stations = [road.number - 100_000 for road in plan.roads if road.rank == "driveway"]
    assert stations == [32, 72, 112, 152, 232, 272, 312, 352]  # none at 192: there the other road comes in
    roads = drawn(plan)
    assert len(roads.carparks) == len(stations)
    assert yardsticks(roads).branching == len(stations) + 1


def test_a_driveway_of_a_dual_carriageway_is_reached_from_its_side_only(tmp_path: Path) -> None:
    roads = drawn(with_driveways(tmp_path, DUAL, to_m=40.0))
    ways = [b for b in roads.roadblocks.values() if b.is_connector and "100032" in (b.from_id or "") + (b.to_id or "")]
    assert {(b.from_id or "")[:3] for b in ways} == {"101", "100"}
    assert not any((b.to_id or "").startswith("102") for b in ways)


def test_a_driveway_without_room_for_its_car_park_is_left_out(tmp_path: Path) -> None:
    behind = {"points": [[-200, -38], [200, -38]]}
    rule = {"side": "forward", "every_m": 40, "length_m": 18, "park_m": [20, 40]}
    road = {"points": [[-200, 0], [200, 0]], "driveways": [rule]}
    free = planned(tmp_path, road, {"points": [[-200, -90], [200, -90]]}, driveway=STREET)
    tight = planned(tmp_path, road, behind, driveway=STREET)
    assert {r.end_park_m for r in free.roads if r.rank == "driveway"} == {(20.0, 40.0)}
    assert [r for r in tight.roads if r.rank == "driveway"] == []


def test_driveways_need_to_be_told_what_they_are_like(tmp_path: Path) -> None:
    road = {"points": WEST_EAST, "driveways": [{"side": "forward", "every_m": 40}]}
    with pytest.raises(ValueError, match="driveway"):
        planned(tmp_path, road)


# --- roundabouts ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("side", "turn"), [("right", 1.0), ("left", -1.0)])
def test_one_drives_around_a_roundabout_and_yields_at_its_entries(side: str, turn: float, tmp_path: Path) -> None:
    legs = [{"points": [[150 * x, 150 * y], [0, 0]], "rank": "avenue"} for x, y in ((-1, 0), (0.2, 1), (1, -0.3))]
    ring = {
        "name": "circle", "number": 90, "at": [0, 0], "radius_m": 20,
        "ring": {**STREET, "one_way": True}, "roads": ["road_0", "road_1", "road_2"],
    }  # fmt: skip
    roads = drawn(planned(tmp_path, *legs, side=side, roundabouts=[ring]))
    assert [area.id for area in roads.intersections] == ["900101", "900102", "900103"]
    signs = lane_signs(roads)
    for lane in roads.lanes.values():
        if not roads.outgoing(lane.id):
            continue
        if lane.id.startswith("90"):
            heading = lane.centerline.segment_heading_rad
            assert turn * wrap_angle(heading[-1] - heading[0]) > 0.0
            assert lane.id not in signs
            assert len(roads.outgoing(lane.id)) == 2
    entries = [lane for lane in signs if not lane.startswith("90")]
    assert len(entries) == 3
    assert {signs[lane] for lane in entries} == {Sign.YIELD}
    middle = shapely.Point(500000, 4000000)
    assert roads.distance_to_drivable_m([middle.x, middle.y])[0] > 15.0  # its island is no road
    assert np.isfinite(yardsticks(roads).smallest_radius_m[0])
