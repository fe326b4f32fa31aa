"""The schema: what it says is what a view gives."""

from __future__ import annotations

import json

import numpy as np
import pytest
from worlds import ego_on, junction, mission, observation, straight_road

from interplan_sumo.features import schema
from interplan_sumo.features.view import EgoView
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.geometry import Pose

ROAD, CROSSING = straight_road(), junction()


@pytest.mark.parametrize(
    ("asked", "seen"),
    [
        (mission(ROAD, ("11",)), observation(ego_on(ROAD, "11", 20.0, 5.0))),
        (mission(CROSSING, ("1", "13", "7")), observation(ego_on(CROSSING, "1", 20.0, 5.0))),
        (Mission(ROAD, (), Pose(0.0, 0.0, 0.0)), observation(ego_on(ROAD, "11", 20.0))),
    ],
    ids=["a road", "a junction", "no route"],
)
def test_a_view_has_every_seen_field_in_its_shape_and_type_and_all_finite(asked: Mission, seen: Observation) -> None:
    arrays = EgoView(asked).arrays(seen)
    assert list(arrays) == [field.name for field in schema.SEEN]
    for field in schema.SEEN:
        assert arrays[field.name].shape == field.shape, field.name
        assert arrays[field.name].dtype == field.dtype, field.name
        assert np.isfinite(arrays[field.name]).all(), field.name


def test_names_are_unique_and_channels_fill_the_last_axis() -> None:
    assert len(schema.BY_NAME) == len(schema.FIELDS)
    for field in schema.FIELDS:
        if field.channels:
            assert field.shape[-1] == len(field.channels), field.name
            assert len({channel.name for channel in field.channels}) == len(field.channels), field.name


def test_the_schema_is_plain_data_and_a_table() -> None:
    assert json.loads(json.dumps(schema.as_json()))[1]["name"] == "ego_history"
    table = schema.as_markdown()
    assert "| `agents` | seen | 30 x 21 x 13 | float32 | ego |" in table
    assert "| `expert_edges` | label | any | int32 | - |" in table


def test_a_world_without_a_route_still_has_lanes_and_no_line_to_follow() -> None:
    arrays = EgoView(Mission(ROAD, (), Pose(0.0, 0.0, 0.0))).arrays(observation(ego_on(ROAD, "11", 20.0)))
    assert arrays["lanes_valid"].any()
    assert not arrays["route_centerline_valid"].any()
    assert not arrays["route_lanes_valid"].any()
    assert arrays["speed_limit"] == 0.0
    on_route, changes = schema.channel_index("lanes", "on_route"), schema.channel_index("lanes", "lane_changes")
    assert (arrays["lanes"][arrays["lanes_valid"]][..., on_route] == 0.0).all()
    assert (arrays["lanes"][arrays["lanes_valid"]][..., changes] == -1.0).all()
