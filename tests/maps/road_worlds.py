"""Grid cities of any size: roads with every kind of thing in them, for tests of map files and for benchmarks."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import count

import numpy as np
import shapely

from interplan_sumo.world.geometry import Floats, Polyline
from interplan_sumo.world.roads import (
    Area,
    Connector,
    DrivingSide,
    Intersection,
    IntersectionKind,
    Lane,
    Roadblock,
    Roads,
    StopLine,
    StopLineKind,
    Turn,
)

LANE_WIDTH_M = 3.2
KERB_M = 6.0
"""From the outermost lane to the corner of a junction."""


@dataclass(frozen=True)
class GridPlan:
    """What a grid city looks like: junctions in columns and rows, a two-way road between neighbours."""

    columns: int = 2
    rows: int = 1
    lanes: int = 2
    """Per direction."""
    spacing_m: float = 90.0
    side: DrivingSide = "right"
    crs: str = "EPSG:32611"
    origin_m: tuple[float, float] = (664000.0, 3998000.0)
    rotation_rad: float = 0.0
    limits_mps: tuple[float | None, ...] = (13.89,)
    """Dealt out to lanes and connectors in turn."""
    signals: bool = True
    first_id: int = 1


def grid_city(plan: GridPlan = GridPlan(), name: str = "grid") -> Roads:
    """A city of that plan; coordinates are multiples of 1e-6 m."""
    return _Draft(plan).roads(name)


@dataclass
class _Draft:
    plan: GridPlan
    lanes: dict[str, Lane] = field(default_factory=dict)
    connectors: dict[str, Connector] = field(default_factory=dict)
    blocks: dict[str, Roadblock] = field(default_factory=dict)
    stops: dict[str, StopLine] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._ids = count(self.plan.first_id)
        self._limits = count()
        cos, sin = np.cos(self.plan.rotation_rad), np.sin(self.plan.rotation_rad)
        self._turned = np.array(((cos, sin), (-sin, cos)))

    def roads(self, name: str) -> Roads:
        plan = self.plan
        nodes = [np.array((i, j), dtype=np.float64) for j in range(plan.rows) for i in range(plan.columns)]
        inner = plan.lanes * LANE_WIDTH_M + KERB_M
        arriving: dict[int, list[tuple[Floats, str]]] = {k: [] for k in range(len(nodes))}
        leaving: dict[int, list[tuple[Floats, str]]] = {k: [] for k in range(len(nodes))}
        segments: list[Area] = []
        walkways: list[Area] = []
        for a, start in enumerate(nodes):
            for b, end in enumerate(nodes):
                if abs(start - end).sum() == 1.0:
                    along = end - start
                    block = self._road(start * plan.spacing_m + along * inner, along, plan.spacing_m - 2 * inner)
                    leaving[a].append((along, block))
                    arriving[b].append((along, block))
                    segments.append(Area(self._id(), self.blocks[block].polygon))
                    kerb = start * plan.spacing_m + along * inner
                    side = self._outside() * (plan.lanes * LANE_WIDTH_M + 2.0)
                    walkways.append(Area(self._id(), self._strip(kerb, along, plan.spacing_m - 2 * inner, side, 1.5)))
        intersections: list[Intersection] = []
        crosswalks: list[Area] = []
        for k, node in enumerate(nodes):
            center = node * plan.spacing_m
            corners = np.array(((-inner, -inner), (inner, -inner), (inner, inner), (-inner, inner)))
            kind = IntersectionKind.TRAFFIC_LIGHT if plan.signals else IntersectionKind.STOP_SIGN
            intersections.append(Intersection(self._id(), shapely.Polygon(self._xy(center + corners)), kind))
            for along, block in arriving[k]:
                stop = self._stop_line(center - along * inner, along)
                crosswalks.append(Area(self._id(), self._strip(center - along * inner, along, 3.0, 0.0, 2 * inner - 1)))
                for heading, target in leaving[k]:
                    if not np.array_equal(heading, -along):
                        self._junction_way(along, heading, block, target, stop, intersections[-1].id)
        lot = np.array(((-60.0, -60.0), (-30.0, -60.0), (-30.0, -30.0), (-60.0, -30.0)))
        yard = shapely.Polygon(self._xy(lot - 40.0), [self._xy(lot * 0.5 - 62.5)])
        return Roads(
            name=name,
            crs=plan.crs,
            driving_side=plan.side,
            lanes=self.lanes,
            connectors=self.connectors,
            roadblocks=self.blocks,
            intersections=tuple(intersections),
            stop_lines=self.stops,
            crosswalks=tuple(crosswalks),
            walkways=tuple(walkways),
            carparks=(Area(self._id(), shapely.Polygon(self._xy(lot))),),
            road_segments=tuple(segments),
            generic_drivable_areas=(Area(self._id(), yard),),
        )

    def _id(self) -> str:
        return str(next(self._ids))

    def _limit(self) -> float | None:
        return self.plan.limits_mps[next(self._limits) % len(self.plan.limits_mps)]

    def _xy(self, points: Floats) -> Floats:
        return np.round(points @ self._turned + self.plan.origin_m, 6)

    def _outside(self) -> float:
        """The sign of a lateral offset (left positive) towards the kerb."""
        return -1.0 if self.plan.side == "right" else 1.0

    def _strip(self, start: Floats, along: Floats, length_m: float, left_m: float, width_m: float) -> shapely.Polygon:
        """A rectangle from `start` along a direction, its axis moved to the left."""
        left = np.array((-along[1], along[0]))
        near, far = start + left * (left_m + width_m / 2), start + left * (left_m - width_m / 2)
        ahead = along * length_m
        return shapely.Polygon(self._xy(np.array((far, far + ahead, near + ahead, near))))

    def _road(self, start: Floats, along: Floats, length_m: float) -> str:
        """One direction of a road: its roadblock's id."""
        block, count_ = self._id(), self.plan.lanes
        left = np.array((-along[1], along[0]))
        at = start + along * np.linspace(0.0, length_m, int(np.ceil(length_m)) + 1)[:, None]
        # Line k lies left of lane k; the last one is the right edge of the road.
        first = 0.0 if self.plan.side == "right" else count_ * LANE_WIDTH_M
        lines = [self._xy(at + left * (first - k * LANE_WIDTH_M)) for k in range(count_ + 1)]
        members: list[str] = []
        for k in range(count_):
            lane = Lane(
                id=self._id(),
                roadblock_id=block,
                index=k,
                centerline=Polyline(self._xy(at + left * (first - (k + 0.5) * LANE_WIDTH_M))),
                polygon=shapely.Polygon(np.concatenate((lines[k + 1], lines[k][::-1]))),
                left_boundary=Polyline(lines[k]),
                right_boundary=Polyline(lines[k + 1]),
                speed_limit_mps=self._limit(),
            )
            self.lanes[lane.id] = lane
            members.append(lane.id)
        self.blocks[block] = Roadblock(
            block, shapely.Polygon(np.concatenate((lines[-1], lines[0][::-1]))), tuple(members)
        )
        return block

    def _stop_line(self, at: Floats, along: Floats) -> str:
        width = self.plan.lanes * LANE_WIDTH_M
        kind = StopLineKind.TRAFFIC_LIGHT if self.plan.signals else StopLineKind.STOP_SIGN
        stop = StopLine(self._id(), self._strip(at, along, 0.5, self._outside() * width / 2, width - 0.2), kind)
        self.stops[stop.id] = stop
        return stop.id

    def _junction_way(
        self, along: Floats, heading: Floats, source: str, target: str, stop: str, intersection: str
    ) -> None:
        """The connectors from one road to another: all lanes straight on, the outer one into a turn."""
        cross = along[0] * heading[1] - along[1] * heading[0]
        last = self.plan.lanes - 1
        places = range(self.plan.lanes) if cross == 0 else (0,) if cross > 0 else (last,)
        turn = Turn.STRAIGHT if cross == 0 else Turn.LEFT if cross > 0 else Turn.RIGHT
        block, members = self._id(), list[str]()
        for place in places:
            start = self.lanes[self.blocks[source].lane_ids[place]]
            end = self.lanes[self.blocks[target].lane_ids[place]]
            center, normal = _curve(
                start.centerline.points[-1], along @ self._turned, end.centerline.points[0], heading @ self._turned
            )
            left = np.round(center + normal * LANE_WIDTH_M / 2, 6)
            right = np.round(center - normal * LANE_WIDTH_M / 2, 6)
            connector = Connector(
                id=self._id(),
                roadblock_id=block,
                from_lane_id=start.id,
                to_lane_id=end.id,
                centerline=Polyline(np.round(center, 6)),
                polygon=shapely.Polygon(np.concatenate((right, left[::-1]))),
                left_boundary=Polyline(left),
                right_boundary=Polyline(right),
                speed_limit_mps=self._limit(),
                turn=turn,
                stop_line_ids=(stop,) if self.plan.signals else (),
            )
            self.connectors[connector.id] = connector
            members.append(connector.id)
        corners = np.concatenate([shapely.get_coordinates(self.connectors[i].polygon) for i in members])
        hull = shapely.Polygon(shapely.get_coordinates(shapely.convex_hull(shapely.MultiPoint(corners))))
        self.blocks[block] = Roadblock(block, hull, tuple(members), True, source, target, intersection)


def _curve(start: Floats, along: Floats, end: Floats, heading: Floats) -> tuple[Floats, Floats]:
    """Points of a cubic from one pose to another, less than a metre apart, and the unit normals to their left."""
    chord = float(np.hypot(*(end - start)))
    reach = chord * (0.39 if abs(along @ heading) < 0.5 else 1 / 3)
    control = np.array((start, start + along * reach, end - heading * reach, end))
    t = np.linspace(0.0, 1.0, int(np.ceil(chord * 1.3)) + 1)[:, None]
    weights = np.concatenate(((1 - t) ** 3, 3 * (1 - t) ** 2 * t, 3 * (1 - t) * t**2, t**3), axis=1)
    slope = np.concatenate((-3 * (1 - t) ** 2, 3 * (1 - t) * (1 - 3 * t), 3 * t * (2 - 3 * t), 3 * t**2), axis=1)
    tangent = slope @ control
    tangent /= np.hypot(*tangent.T)[:, None]
    return weights @ control, np.stack((-tangent[:, 1], tangent[:, 0]), axis=1)
