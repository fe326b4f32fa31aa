"""Collisions of a drive: the first contact with each track, its class, and whether the ego is at fault.

Rules and limits are nuPlan's (devkit 1.2.2). One difference on purpose: nuPlan
takes the bearing of a track as the arc cosine of a rounded dot product, which
is not a number for some tracks exactly dead ahead; here it is an arc tangent,
which always is.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.geometry import Floats, Ints, box_corners, penetration_m
from interplan_sumo.world.trace import ActorTable

STOPPED_MPS = 0.05
"""At this speed or below, ego and tracks count as stopped."""
BEHIND_RAD = np.deg2rad(150.0)
"""A track is behind if its bearing from the rear axle exceeds this."""
AHEAD_RAD = np.deg2rad(30.0)
"""A track is ahead if its bearing from the rear axle is below this."""


class Contact(Enum):
    """How ego and track touched first."""

    STOPPED_EGO = "stopped_ego"
    STOPPED_TRACK = "stopped_track"
    FRONT = "front"
    REAR = "rear"
    LATERAL = "lateral"


class Group(Enum):
    """Who was hit, in the groups that share a budget of collisions."""

    VRU = "vru"
    VEHICLE = "vehicle"
    OBJECT = "object"

    @classmethod
    def of(cls, kind: ActorKind) -> Group:
        if kind == ActorKind.VEHICLE:
            return cls.VEHICLE
        return cls.VRU if kind.is_agent else cls.OBJECT


@dataclass(frozen=True, slots=True)
class Collision:
    """The first contact with one track."""

    frame: int
    row: int
    """Row of the actor table."""
    track: str
    kind: ActorKind
    contact: Contact
    at_fault: bool
    energy_mps: float
    """Half the relative speed of the two: the ego's change of speed at equal masses."""

    @property
    def group(self) -> Group:
        return Group.of(self.kind)

    def as_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "frame": self.frame,
            "track": self.track,
            "kind": self.kind.name,
            "contact": self.contact.value,
            "at_fault": self.at_fault,
            "energy_mps": self.energy_mps,
        }


def bearing_rad(from_xy: Floats, heading_rad: Floats, to_xy: Floats) -> Floats:
    """(K,) unsigned angle, 0 to pi, between a heading and the direction to a point; all arguments row by row."""
    x, y = (to_xy - from_xy).T
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    return np.arctan2(np.abs(cos * y - sin * x), cos * x + sin * y)


def rows_in_contact(ego_corners: Floats, actors: ActorTable) -> Ints:
    """Rows of the actor table whose box touches or overlaps the ego's box (N, 4, 2) of the same frame."""
    centre = ego_corners.mean(axis=1)
    radius = np.hypot(*(ego_corners[:, 0] - centre).T)
    gap = np.hypot(actors.x_m - centre[actors.frame, 0], actors.y_m - centre[actors.frame, 1])
    reach = radius[actors.frame] + np.hypot(actors.length_m, actors.width_m) / 2
    near = np.flatnonzero(gap <= reach)
    boxes = box_corners(*(getattr(actors, c)[near] for c in ("x_m", "y_m", "heading_rad", "length_m", "width_m")))
    return near[penetration_m(ego_corners[actors.frame[near]], boxes) >= 0.0]


def first_of_each_track(rows: Ints, actors: ActorTable) -> Ints:
    """The first of these rows (in frame order) for each track."""
    first: dict[str, int] = {}
    for row in rows.tolist():
        first.setdefault(str(actors.ids[row]), row)
    return np.array(list(first.values()), dtype=np.int64)


def energy_mps(ego_speed_mps: Floats, track_speed_mps: Floats, between_rad: Floats) -> Floats:
    """Change of the ego's speed in a collision of equal masses, from both speeds and the angle between headings."""
    squares = ego_speed_mps**2 + track_speed_mps**2
    return 0.5 * np.sqrt(np.maximum(0.0, squares - 2.0 * ego_speed_mps * track_speed_mps * np.cos(between_rad)))


def find_collisions(
    ego_corners: Floats,
    ego_rear_axle: Floats,
    ego_heading_rad: Floats,
    ego_speed_mps: Floats,
    in_one_lane: NDArray[np.bool_],
    actors: ActorTable,
) -> tuple[Collision, ...]:
    """The first contact with each track, in the order of the table; ego arrays are per frame."""
    rows = first_of_each_track(rows_in_contact(ego_corners, actors), actors)
    frame = actors.frame[rows]
    position = np.column_stack((actors.x_m[rows], actors.y_m[rows]))
    behind = bearing_rad(ego_rear_axle[frame], ego_heading_rad[frame], position) > BEHIND_RAD
    boxes = box_corners(*(getattr(actors, c)[rows] for c in ("x_m", "y_m", "heading_rad", "length_m", "width_m")))
    front_edges = shapely.linestrings(ego_corners[frame][:, (0, 3)])
    at_front = np.atleast_1d(shapely.intersects(front_edges, shapely.polygons(boxes)))
    ego_speed = ego_speed_mps[frame]
    track_speed = np.hypot(actors.vx_mps[rows], actors.vy_mps[rows])
    energy = energy_mps(ego_speed, track_speed, ego_heading_rad[frame] - actors.heading_rad[rows])

    found: list[Collision] = []
    for i, row in enumerate(rows.tolist()):
        kind = ActorKind(int(actors.kind[row]))
        if ego_speed[i] <= STOPPED_MPS:
            contact = Contact.STOPPED_EGO
        elif not kind.is_agent or track_speed[i] <= STOPPED_MPS:
            contact = Contact.STOPPED_TRACK
        elif behind[i]:
            contact = Contact.REAR
        elif at_front[i]:
            contact = Contact.FRONT
        else:
            contact = Contact.LATERAL
        at_fault = contact in (Contact.STOPPED_TRACK, Contact.FRONT) or (
            contact is Contact.LATERAL and not bool(in_one_lane[frame[i]])
        )
        found.append(Collision(int(frame[i]), row, str(actors.ids[row]), kind, contact, at_fault, float(energy[i])))
    return tuple(found)
