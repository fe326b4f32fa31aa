"""Where the ego is on SUMO's lanes: what its box, and the box swept ahead, cover of each, and where it is heading."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import cos, inf, sin

from interplan_sumo.simulation.anchor import BEND_M, LOCAL_M, Anchor
from interplan_sumo.simulation.lane_polygons import ClipArea, Ring, area_m2, ego_ring, hull
from interplan_sumo.simulation.network import LanePiece, NetworkLane, SumoNetwork
from interplan_sumo.simulation.plain_polyline import PlainPolyline
from interplan_sumo.simulation.reactions import FULLY_MERGED, EgoOnNetwork, LaneCoverage
from interplan_sumo.world.ego import EgoShape, EgoState

APPROACHING_MPS = 0.2
"""Faster than this sideways the ego moves towards the lane on that side."""
APPROACH_S = 3.0
"""A lane that it would not reach within this time it does not move towards: so long people look ahead at a merge."""
_TOUCH = 1e-6  # shares below this are rounding


def coverage_of_one_lane(
    lane: NetworkLane, near_m: float, corners: Ring, velocity_mps: tuple[float, float]
) -> dict[str, LaneCoverage] | None:
    """What a box in SUMO's frame covers if it lies wholly inside one normal lane; None if it does not.

    The quick way for most steps: normal lanes do not overlap, so there is
    nothing else to find. `near_m` is a lane position within a box length.
    """
    if lane.internal:
        return None
    line, here_m, half_m = lane.plain_line, lane.arc_of(near_m), lane.width_m / 2.0
    arcs: list[float] = []
    for x, y in corners:
        arc_m, left_m = line.project(x, y, (here_m - LOCAL_M, here_m + LOCAL_M))
        if abs(left_m) > half_m:
            return None
        arcs.append(arc_m)
    first, last = min(arcs), max(arcs)
    if first <= 0.0 or last >= line.length_m:
        return None
    speed_mps = line.speed_along((first + last) / 2.0, velocity_mps)
    return {lane.id: LaneCoverage(1.0, lane.position_of(first), lane.position_of(last), speed_mps)}


def lane_coverage(
    near: Iterable[LanePiece], area: ClipArea, velocity_mps: tuple[float, float]
) -> dict[str, LaneCoverage]:
    """What an area in SUMO's frame covers of each lane; `velocity_mps` is the ego's, in the same frame.

    `near` are the pieces of lanes that the area may touch; lanes come in their order.
    """
    whole_m2 = abs(area_m2(area.ring))
    coverage: dict[str, LaneCoverage] = {}
    for piece in near:
        line, covered_m2 = piece.plain_line, 0.0
        first, last = inf, -inf
        for part, covered in area.on(piece.convex_parts):
            covered_m2 += abs(area_m2(covered))
            for x, y in covered:
                arc_m = line.arc_on(part.segment, x, y) if part.segment is not None else line.project(x, y)[0]
                first, last = min(first, arc_m), max(last, arc_m)
        share = covered_m2 / whole_m2
        if share <= _TOUCH:
            continue
        lane, before = piece.lane, coverage.get(piece.lane.id)
        start_m, end_m = lane.position_of(piece.start_m + first), lane.position_of(piece.start_m + last)
        if before is None:
            coverage[lane.id] = LaneCoverage(
                share, start_m, end_m, line.speed_along((first + last) / 2.0, velocity_mps)
            )
        else:
            start_m, end_m = min(start_m, before.start_m), max(end_m, before.end_m)
            coverage[lane.id] = LaneCoverage(before.share + share, start_m, end_m, before.speed_mps)
    return coverage


def swept_area(box: Ring, velocity_mps: tuple[float, float], time_s: float) -> Ring:
    """The area that a box covers in `time_s` at constant velocity and heading."""
    if time_s <= 0.0 or velocity_mps == (0.0, 0.0):
        return box
    dx, dy = velocity_mps[0] * time_s, velocity_mps[1] * time_s
    return hull([*box, *((x + dx, y + dy) for x, y in box)])


def _along(line: PlainPolyline, x_m: float, y_m: float) -> float:
    """Arc length of the nearest point of a line, negative before its start."""
    arc_m, _ = line.project(x_m, y_m)
    if arc_m > 0.0:
        return arc_m
    start = line.pose_at(0.0)
    return (x_m - start.x_m) * cos(start.heading_rad) + (y_m - start.y_m) * sin(start.heading_rad)


class EgoLocator:
    """Finds the ego of one shape on one network, whose frame lies at `origin_m` in the map frame."""

    corners: Ring = ()
    """Of the ego's box when it was last located in full, in SUMO's frame."""

    def __init__(self, network: SumoNetwork, origin_m: tuple[float, float], shape: EgoShape) -> None:
        self._network = network
        self._origin = origin_m
        self._shape = shape

    def coverage_of(self, ring: Ring, velocity_mps: tuple[float, float]) -> dict[str, LaneCoverage]:
        """What an area that moves like this covers of each lane."""
        area = ClipArea.of(ring)
        return lane_coverage(self._network.pieces_near(area), area, velocity_mps)

    def _approached(self, ego: EgoState, corners: Ring, covered: Mapping[str, LaneCoverage]) -> dict[str, LaneCoverage]:
        """Lanes that the ego will reach if it goes on as it does, sideways to them, with what it is beside.

        A lane stays approached until the ego is in it: what it covers of it at
        first is a corner of its front. Positions before a lane's start are negative.
        """
        velocity = ego.velocity_mps
        x_m, y_m = ego.x_m - self._origin[0], ego.y_m - self._origin[1]
        found: dict[str, LaneCoverage] = {}
        for name in self.coverage_of(swept_area(corners, velocity, APPROACH_S), velocity):
            lane = self._network.lanes[name]
            line = lane.plain_line
            arc_m, left_m = line.project(x_m, y_m)
            heading_rad = line.heading_at(arc_m)
            left_mps = velocity[1] * cos(heading_rad) - velocity[0] * sin(heading_rad)
            if (
                (name in covered and covered[name].share >= FULLY_MERGED)
                or left_m * left_mps >= 0.0
                or abs(left_mps) <= APPROACHING_MPS
            ):
                continue
            arcs = [_along(line, *corner) for corner in corners]
            begin_m, end_m = lane.position_of(min(arcs)), lane.position_of(max(arcs))
            found[name] = LaneCoverage(0.0, begin_m, end_m, line.speed_along(arc_m, velocity))
        return found

    def _inside(self, ego: EgoState, anchor: Anchor) -> bool | None:
        """Whether the box certainly lies, or does not lie, inside the anchor lane, a normal one, and nowhere else.

        The quickest way, by the place of the front bumper alone; None: it does not tell.
        """
        lane = self._network.lanes[anchor.lane]
        if lane.internal:
            return False
        length_m, half_m, lane_half_m = self._shape.length_m, self._shape.length_m / 2.0, lane.width_m / 2.0
        cosine, sine = cos(ego.heading_rad), sin(ego.heading_rad)
        along_x, along_y = cos(anchor.heading_rad), sin(anchor.heading_rad)
        dx = ego.x_m + half_m * cosine - self._origin[0] - anchor.x_m
        dy = ego.y_m + half_m * sine - self._origin[1] - anchor.y_m
        lateral_m = abs(dy * along_x - dx * along_y)
        if lateral_m + self._shape.width_m / 2.0 * (along_x * cosine + along_y * sine) - BEND_M > lane_half_m:
            return False  # a front corner is out
        turned_m = length_m * abs(along_x * sine - along_y * cosine)
        inside = lateral_m + turned_m + self._shape.width_m / 2.0 + BEND_M < lane_half_m
        return True if inside and length_m + BEND_M < anchor.position_m < lane.length_m - BEND_M else None

    def locate(
        self, ego: EgoState, anchor: Anchor | None, anticipations_s: Sequence[float], *, courteous: bool
    ) -> tuple[EgoOnNetwork, dict[float, Mapping[str, LaneCoverage]]]:
        """The ego on the lanes, and what its swept box covers per anticipation time."""
        velocity = ego.velocity_mps
        lane = anchor.lane if anchor is not None else None
        position_m = anchor.position_m if anchor is not None else 0.0
        corners: Ring = ()
        if anchor is not None and not anticipations_s:
            alone: dict[str, LaneCoverage] | None = None
            inside = self._inside(ego, anchor)
            if inside:
                speed_mps = velocity[0] * cos(anchor.heading_rad) + velocity[1] * sin(anchor.heading_rad)
                alone = {anchor.lane: LaneCoverage(1.0, position_m - self._shape.length_m, position_m, speed_mps)}
            elif inside is None:
                corners, on = ego_ring(ego, self._shape, self._origin), self._network.lanes[anchor.lane]
                alone = coverage_of_one_lane(on, position_m, corners, velocity)
            if alone is not None:
                centre = frozenset((anchor.lane,))
                approached: dict[str, LaneCoverage] = {}
                if courteous:
                    self.corners = corners or ego_ring(ego, self._shape, self._origin)
                    approached = self._approached(ego, self.corners, alone)
                return EgoOnNetwork(
                    alone, centre, lane, position_m, ego.speed_mps, straddles=False, alone=True,
                    approached=approached, braking_mps2=max(0.0, -ego.ax_mps2),
                ), {}  # fmt: skip
        corners = self.corners = corners or ego_ring(ego, self._shape, self._origin)
        area = ClipArea.of(corners)
        near = self._network.pieces_near(area)
        coverage = lane_coverage(near, area, velocity)
        ahead: dict[float, Mapping[str, LaneCoverage]] = {
            time_s: self.coverage_of(swept_area(corners, velocity, time_s), velocity) for time_s in anticipations_s
        }
        own = self._network.continuations(lane) if lane is not None else frozenset[str]()
        inside = sum(part.share for name, part in coverage.items() if name in own)
        x_m, y_m = ego.x_m - self._origin[0], ego.y_m - self._origin[1]
        centre_lanes = frozenset(
            [piece.lane.id for piece in near if piece.lane.id in coverage and piece.holds(x_m, y_m)]
        )
        straddles = inside < FULLY_MERGED
        approached = self._approached(ego, corners, coverage) if courteous else {}
        return EgoOnNetwork(
            coverage, centre_lanes, lane, position_m, ego.speed_mps, straddles, approached=approached,
            braking_mps2=max(0.0, -ego.ax_mps2), in_junction=lane is not None and self._network.lanes[lane].internal,
        ), ahead  # fmt: skip
