"""Collisions: who counts, once, in which class, and whose fault it is."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from interplan_sumo.metrics.collisions import Collision, Contact, Group, bearing_rad
from interplan_sumo.metrics.no_collision import no_collision, nuplan_no_collision, shared_budget
from interplan_sumo.world.actors import ActorKind, Actors
from tests.metrics.staging import drive_at, facts_of
from tests.worlds import cars, straight_road

ROAD = straight_road(lanes=2, length_m=400.0)
FRONT_M = 5.176 / 2
CAR_HALF_M = 4.8 / 2


def collisions(actors: Actors | list[Actors], *, x_m: object = 50.0, y_m: object = 0.0, speed_mps: object = 10.0):
    return facts_of(drive_at(x_m, y_m, speed_mps, actors=actors), ROAD).collisions


def only(found: tuple[Collision, ...]) -> Collision:
    assert len(found) == 1
    return found[0]


def test_boxes_that_touch_collide_and_a_nanometre_more_does_not():
    touching = 50.0 + FRONT_M + CAR_HALF_M
    assert collisions(cars((touching - 1e-9, 0.0, 5.0)))
    assert not collisions(cars((touching + 1e-9, 0.0, 5.0)))


def test_a_static_object_counts_as_standing_whatever_its_velocity():
    cone = cars((54.0, 0.0, 9.0), kind=ActorKind.TRAFFIC_CONE)
    assert only(collisions(cone)).contact is Contact.STOPPED_TRACK


def test_a_contact_with_the_front_edge_is_a_front_collision_even_from_the_side():
    beside_the_nose = 50.0 + FRONT_M + CAR_HALF_M - 0.01
    assert only(collisions(cars((beside_the_nose, -2.0, 5.0)))).contact is Contact.FRONT
    behind_the_nose = 50.0 + FRONT_M - CAR_HALF_M - 0.01
    assert only(collisions(cars((behind_the_nose, -2.0, 5.0)))).contact is Contact.LATERAL


@given(st.floats(-np.pi, np.pi), st.floats(-np.pi, np.pi), st.floats(0.1, 100.0))
def test_bearings_are_those_of_the_angle_between(heading: float, to_rad: float, distance: float):
    there = distance * np.array([[np.cos(to_rad), np.sin(to_rad)]])
    wrapped = abs((to_rad - heading + np.pi) % (2 * np.pi) - np.pi)
    assert bearing_rad(np.zeros((1, 2)), np.array([heading]), there)[0] == pytest.approx(wrapped, abs=1e-9)


def test_a_track_exactly_ahead_has_a_bearing():
    # nuPlan's arc cosine gives no number for some of these
    heading = np.linspace(-3.0, 3.0, 1001)
    ahead = 17.3 * np.column_stack((np.cos(heading), np.sin(heading)))
    assert bearing_rad(np.zeros((1001, 2)), heading, ahead).max() < 1e-12


@pytest.mark.parametrize(
    ("hit", "score"),
    [
        ([], 1.0),
        ([Group.OBJECT], 0.5),
        ([Group.OBJECT, Group.OBJECT], 0.0),
        ([Group.VEHICLE], 0.0),
        ([Group.VRU], 0.0),
        ([Group.OBJECT, Group.VRU], 0.0),
    ],
)
def test_nuplan_forgives_half_of_one_object(hit: list[Group], score: float):
    assert shared_budget(hit) == score


def test_the_strict_gate_forgives_nothing():
    cone = cars((52.7, 0.0), kind=ActorKind.TRAFFIC_CONE, length_m=0.5, width_m=0.5)
    facts = facts_of(drive_at(50.0, actors=cone), ROAD)
    assert nuplan_no_collision(facts).score == 0.5
    result = no_collision(facts)
    assert result.score == 0.0
    assert result.reason == "drove into standing traffic cone car00 at 0.0 s, at 10.0 m/s"


def test_collisions_without_fault_cost_nothing_but_are_reported():
    facts = facts_of(drive_at(50.0, actors=cars((45.5, 0.0, 15.0))), ROAD)
    result = no_collision(facts)
    assert (result.score, result.reason) == (1.0, None)
    assert result.detail["contacts"][0]["contact"] == "rear"
