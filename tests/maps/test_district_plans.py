"""Road plans: what the vocabulary means on the ground, and how mistakes in a plan are told."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from interplan_sumo.maps.districts.draw import draw_plan
from interplan_sumo.maps.districts.geometry import alignment
from interplan_sumo.maps.districts.plan import BusStop, Plan, PlannedApproach, PlannedJunction, Road, RoadSection, lanes
from interplan_sumo.world.roads import Turn


def crossroads(**changes: object) -> Plan:
    """Two streets of 400 m that cross in the middle, a pocket on one approach."""
    street = lanes(1, 50, width_m=3.5)
    junction = PlannedJunction(
        1, "the crossing", (0, 0), ("main", "side"), "signal", approaches={"main-": PlannedApproach(inner_pockets=1)}
    )
    plan = Plan(
        "crossroads",
        "EPSG:32632",
        (500000.0, 5300000.0),
        "right",
        roads=(
            Road(10, "main", ((-200, 0), (200, 0)), (RoadSection(0, street, street),)),
            Road(20, "side", ((0, -200), (0, 200)), (RoadSection(0, street, street),)),
        ),
        junctions=(junction,),
    )
    return replace(plan, **changes)  # type: ignore[arg-type]


def test_editing_one_road_leaves_the_ids_of_the_others_alone() -> None:
    plan = crossroads()
    edited = replace(plan, roads=(replace(plan.roads[0], max_block_m=60.0), plan.roads[1]))
    before, after = draw_plan(plan), draw_plan(edited)
    assert len(after.lanes) > len(before.lanes)
    assert {i for i in before.lanes if i.startswith("20")} == {i for i in after.lanes if i.startswith("20")}
    assert {i for i in before.stop_lines if i.startswith("20")} == {i for i in after.stop_lines if i.startswith("20")}


def test_a_pocket_lane_turns_and_the_lane_beside_it_goes_straight_on() -> None:
    roads = draw_plan(crossroads())
    (pocket_line,) = (line for line in roads.stop_lines if line == "101021")
    turns = {c.turn for c in roads.connectors.values() if c.stop_line_ids == (pocket_line,)}
    assert turns == {Turn.LEFT}
    assert {roads.connectors[c].turn for c in roads.outgoing("101021")} == {Turn.STRAIGHT, Turn.RIGHT}


def test_the_same_plan_on_the_left_is_its_mirror_image() -> None:
    plan = crossroads(junctions=(PlannedJunction(1, "the crossing", (0, 0), ("main", "side"), "signal"),))
    right, left = draw_plan(plan), draw_plan(replace(plan, driving_side="left"))
    for roads, across_m in ((right, -1.75), (left, 1.75)):
        start = roads.lanes["101010"].centerline.points[0]
        assert start[1] - 5300000.0 == pytest.approx(across_m)
    turns = [Counter(c.turn for c in roads.connectors.values()) for roads in (right, left)]
    assert turns[0] == turns[1] == Counter({Turn.STRAIGHT: 4, Turn.LEFT: 4, Turn.RIGHT: 4})


def test_a_junction_with_a_closed_median_cuts_only_the_near_carriageway() -> None:
    divided = lanes(2, 50, width_m=3.5, median_m=5.0)
    street = lanes(1, 50, width_m=3.5)
    roads = draw_plan(
        crossroads(
            roads=(
                Road(10, "main", ((-200, 0), (200, 0)), (RoadSection(0, divided, divided),)),
                Road(20, "side", ((0, -200), (0, 0)), (RoadSection(0, street, street),)),
            ),
            junctions=(PlannedJunction(1, "the side street", (0, 0), ("main", "side"), "stop", carriageway="forward"),),
        )
    )
    assert {block for block in roads.roadblocks if block.startswith("102") and len(block) == 5} == {"10201", "10202"}
    assert {c.turn for c in roads.connectors.values() if c.from_lane_id.startswith("20")} == {Turn.RIGHT}
    assert not roads.drivable([(500000.0, 5300000.0)])[0]


def test_a_bend_that_does_not_fit_is_named() -> None:
    with pytest.raises(ValueError, match=r"needs .* m more"):
        alignment(((0, 0), (50, 0, 100), (50, 50)))


def test_an_alignment_bends_with_the_wanted_radius_and_ends_where_it_should() -> None:
    axis = alignment(((0, 0), (100, 0, 40, 15), (100, 100)))
    assert axis.pose(axis.length_m).x_m == pytest.approx(100.0, abs=1e-9)
    assert axis.pose(axis.length_m).y_m == pytest.approx(100.0, abs=1e-9)
    assert np.abs(axis.curvature_per_m(axis.grid_m)).max() == pytest.approx(1.0 / 40.0)


def test_a_pocket_that_leads_nowhere_is_named() -> None:
    street = lanes(1, 50, width_m=3.5)
    with pytest.raises(ValueError, match="a lane of main- leads nowhere"):
        draw_plan(
            crossroads(
                roads=(
                    Road(10, "main", ((-200, 0), (200, 0)), (RoadSection(0, street, street),)),
                    Road(20, "side", ((0, -200), (0, 0)), (RoadSection(0, street, street),)),
                )
            )
        )


def test_a_bus_stop_in_a_junction_is_named() -> None:
    plan = crossroads()
    main = replace(plan.roads[0], bus_stops=(BusStop("forward", 200.0),))
    with pytest.raises(ValueError, match=r"main: the bus stop at 200\.0 m does not fit"):
        draw_plan(replace(plan, roads=(main, plan.roads[1])))


def test_an_approach_of_an_arm_that_does_not_exist_is_named() -> None:
    wrong = PlannedJunction(
        1, "the crossing", (0, 0), ("main", "side"), "signal", approaches={"mian-": PlannedApproach()}
    )
    with pytest.raises(ValueError, match="has no arm mian-"):
        draw_plan(crossroads(junctions=(wrong,)))
