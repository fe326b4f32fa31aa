"""Schema: every field of a sample and every channel of a field, for the code, the manifest and the docs.

The ego frame of a sample: origin on the ego's rear axle at the present, x
forward along its heading, y to the left (also where traffic drives on the
left), radians counter-clockwise. It stands still: all times of a sample share
it. Yaws lie in [-pi, pi] but for `YAW_SLACK_RAD`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal

FORMAT: Final = 1
"""Of the fields below; a planner trained on another one cannot use them."""

STEP_S: Final = 0.1
HISTORY_FRAMES: Final = 21
"""2 s and the present, oldest first."""
FUTURE_FRAMES: Final = 80
"""8 s, the present not included."""
AGENTS: Final = 30
STATIC_OBJECTS: Final = 20
LANES: Final = 60
LANE_POINTS: Final = 50
PIECE_M: Final = 50.0
"""Lanes are cut into equal pieces of at most this length; a piece is a polyline of `LANE_POINTS` points."""
AREAS: Final = 20
"""Stop lines, and as many crosswalks."""
LINE_POINTS: Final = 20
ROUTE_POINTS: Final = 120
ROUTE_STEP_M: Final = 1.0
ROUTE_LANES: Final = 10
RADIUS_M: Final = 100.0
"""How far from the origin pieces of the map are looked for: as far as a planner sees."""
LONG_VEHICLE_M: Final = 7.0
"""From this length on a vehicle is a bus or a truck."""
YAW_SLACK_RAD: Final = 1e-3
"""Yaws between -pi and so much more are given as 2 pi more: dead against the ego is +pi, however it was rounded."""

SITUATIONS: Final = (
    "free", "following", "stopping", "red_light", "standing", "starting", "turning", "lane_change",
)  # fmt: skip
"""What a sample may show."""

Group = Literal["seen", "future", "label", "about"]
Frame = Literal["ego", "map", ""]


@dataclass(frozen=True, slots=True)
class Channel:
    """One number of the last axis."""

    name: str
    unit: str
    meaning: str


@dataclass(frozen=True, slots=True)
class Field:
    """One array of a sample. Rows that do not exist are 0, or False."""

    name: str
    group: Group
    """`seen` fields are known to a planner, all others only to who looks back on a drive."""
    shape: tuple[int | None, ...]
    """Of one sample; None is ragged."""
    dtype: str
    frame: Frame
    meaning: str
    channels: tuple[Channel, ...] = ()
    """Of the last axis; none for an array of ids, counts or flags."""


def _pose(what: str) -> tuple[Channel, ...]:
    return (
        Channel("x", "m", f"{what}, forward"),
        Channel("y", "m", f"{what}, to the left"),
        Channel("yaw", "rad", "heading relative to the ego's present one, counter-clockwise"),
    )


_XY = _pose("of a point")[:2]
_VALID = Channel("valid", "0 or 1", "1 where there is such a row")

_EGO_HISTORY = (
    *_pose("of the rear axle"),
    Channel("vx", "m/s", "velocity of the rear axle, along x of the ego frame"),
    Channel("vy", "m/s", "along y of the ego frame"),
    Channel("ax", "m/s2", "acceleration of the rear axle, along x of the ego frame"),
    Channel("ay", "m/s2", "along y of the ego frame"),
    Channel("yaw_rate", "rad/s", "counter-clockwise"),
    Channel("steer", "rad", "tyre angle, left positive"),
    Channel("steer_rate", "rad/s", "of the tyre angle"),
)
_AGENTS = (
    *_pose("of the box centre"),
    Channel("vx", "m/s", "over ground, along x of the ego frame"),
    Channel("vy", "m/s", "along y of the ego frame"),
    Channel("yaw_rate", "rad/s", "from the frame before; where it was not seen then, to the next one; else 0"),
    Channel("length", "m", "of the box"),
    Channel("width", "m", "of the box"),
    Channel("is_car", "0 or 1", f"a vehicle shorter than {LONG_VEHICLE_M:g} m"),
    Channel("is_long_vehicle", "0 or 1", "a longer one: a bus or a truck"),
    Channel("is_pedestrian", "0 or 1", "on foot"),
    Channel("is_bicycle", "0 or 1", "on a bicycle"),
    _VALID,
)
_STATICS = (
    *_pose("of the box centre"),
    Channel("length", "m", "of the box"),
    Channel("width", "m", "of the box"),
    Channel("class", "code", "nuPlan's: 3 cone, 4 barrier, 5 sign of a construction zone, 6 other; 0 is an empty row"),
)
_LANES = (
    *_pose("of a point of the centre line"),
    Channel("half_width", "m", "half the distance between the boundaries there"),
    Channel("limit", "m/s", "speed limit; 13.89, the usual one in towns, where the map knows none"),
    Channel("light_green", "0 or 1", "the light of a connector"),
    Channel("light_yellow", "0 or 1", "the light of a connector"),
    Channel("light_red", "0 or 1", "the light of a connector"),
    Channel("light_none", "0 or 1", "no light, or one that is not known; always so on lanes"),
    Channel("on_route", "0 or 1", "its roadblock belongs to the route"),
    Channel(
        "lane_changes", "count", "fewest lane changes to the goal lane within the route; -1 where no way leads there"
    ),
)

_ORIGIN = (
    Channel("x", "m", "east"),
    Channel("y", "m", "north"),
    Channel("heading", "rad", "counter-clockwise from x"),
)

FIELDS: Final = (
    Field("origin", "seen", (3,), "float64", "map", "rear axle at the present: the origin of the ego frame",
          _ORIGIN),
    Field("ego_history", "seen", (HISTORY_FRAMES, 10), "float32", "ego", "the last 2 s and the present", _EGO_HISTORY),
    Field("ego_history_valid", "seen", (HISTORY_FRAMES,), "bool", "", "False before what the planner was told"),
    Field("agents", "seen", (AGENTS, HISTORY_FRAMES, 13), "float32", "ego",
          "vehicles, pedestrians and bicycles seen now, the nearest first, with what was seen of them before", _AGENTS),
    Field("static_objects", "seen", (STATIC_OBJECTS, 6), "float32", "ego",
          "cones, barriers, signs and other things, the nearest first", _STATICS),
    Field("lanes", "seen", (LANES, LANE_POINTS, 11), "float32", "ego",
          "pieces of lanes and connectors, the nearest first, points equally spaced in driving order", _LANES),
    Field("lanes_valid", "seen", (LANES,), "bool", "", "False for empty rows of `lanes` and of the four fields below"),
    Field("lane_ids", "seen", (LANES,), "int64", "", "the lane or connector; 0 is an empty row"),
    Field("lane_starts", "seen", (LANES,), "float32", "", "m: arc length of the piece's first point on its lane"),
    Field("left_boundaries", "seen", (LANES, LINE_POINTS, 2), "float32", "ego",
          "the left boundary of each piece, in driving order", _XY),
    Field("right_boundaries", "seen", (LANES, LINE_POINTS, 2), "float32", "ego",
          "the right boundary of each piece, in driving order", _XY),
    Field("stop_lines", "seen", (AREAS, LINE_POINTS, 2), "float32", "ego",
          "outlines of stop lines, the nearest first; points equally spaced, counter-clockwise, the first not repeated",
          _XY),
    Field("stop_lines_valid", "seen", (AREAS,), "bool", "", "False for empty rows"),
    Field("crosswalks", "seen", (AREAS, LINE_POINTS, 2), "float32", "ego", "outlines of crosswalks, likewise", _XY),
    Field("crosswalks_valid", "seen", (AREAS,), "bool", "", "False for empty rows"),
    Field("route_centerline", "seen", (ROUTE_POINTS, 3), "float32", "ego",
          "centre lines of the route from beside the rear axle on, every metre, without a lane change",
          _pose("of a point")),
    Field("route_centerline_valid", "seen", (ROUTE_POINTS,), "bool", "", "False beyond its end"),
    Field("route_lanes", "seen", (ROUTE_LANES, LANE_POINTS, 3), "float32", "ego",
          "the pieces of the route's lanes and connectors, the nearest first", _pose("of a point of the centre line")),
    Field("route_lanes_valid", "seen", (ROUTE_LANES,), "bool", "", "False for empty rows"),
    Field("speed_limit", "seen", (), "float32", "",
          "m/s: of the lane in which `route_centerline` begins; 0 without a route"),
    Field("ego_future", "future", (FUTURE_FRAMES, 4), "float32", "ego", "the next 8 s of the ego",
          (*_pose("of the rear axle"), _VALID)),
    Field("agent_futures", "future", (AGENTS, FUTURE_FRAMES, 4), "float32", "ego",
          "the next 8 s of the rows of `agents`", (*_pose("of the box centre"), _VALID)),
    Field("expert_nodes", "label", (FUTURE_FRAMES + 1,), "int32", "",
          "PGP: node of the lane graph under the rear axle, now and at each step; -1 where there is none"),
    Field("expert_edges", "label", (None,), "int32", "",
          "PGP: edges of the lane graph that lead from each node to the next one, in driving order"),
    Field("situation", "about", (), "int8", "",
          f"what happens in it: {', '.join(f'{code} {name}' for code, name in enumerate(SITUATIONS))}"),
    Field("drive", "about", (), "int32", "", "line of drives.jsonl, counted from 0"),
    Field("tick", "about", (), "int32", "", "frame of the drive, 0.1 s each"),
)  # fmt: skip

BY_NAME: Final = {field.name: field for field in FIELDS}
SEEN: Final = tuple(field for field in FIELDS if field.group == "seen")


def channel_index(field: str, channel: str) -> int:
    """Place of a channel on the last axis of a field."""
    return [each.name for each in BY_NAME[field].channels].index(channel)


def as_json() -> list[dict[str, Any]]:
    """All fields as plain data, for the manifest."""
    return [asdict(field) for field in FIELDS]


def as_markdown() -> str:
    """All fields and channels as two tables, for the docs."""
    lines = _table(
        ("field", "group", "shape", "type", "frame", "what"),
        ((f"`{f.name}`", f.group, _shape(f), f.dtype, f.frame or "-", f.meaning) for f in FIELDS),
    )
    with_channels = [f for f in FIELDS if f.channels]
    lines += ["", *_table(
        ("field", "channel", "name", "unit", "what"),
        (
            (f"`{f.name}`", str(i), f"`{c.name}`", c.unit, c.meaning)
            for f in with_channels
            for i, c in enumerate(f.channels)
        ),
    )]  # fmt: skip
    return "\n".join(lines) + "\n"


def _shape(field: Field) -> str:
    return " x ".join("any" if size is None else str(size) for size in field.shape) or "one"


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> list[str]:
    return [f"| {' | '.join(row)} |" for row in (head, ("---",) * len(head), *rows)]
