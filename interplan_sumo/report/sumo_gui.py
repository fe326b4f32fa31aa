"""SUMO's own window on a drive: a folder that opens in sumo-gui and plays what was recorded, frame by frame."""

from __future__ import annotations

import gzip
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from math import cos, sin
from pathlib import Path
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_sumo.batch.stored_drive import StoredDrive
from interplan_sumo.errors import InputError
from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.plain_xml import shape_text
from interplan_sumo.maps.render import ASPHALT, JUNCTION, PAPER
from interplan_sumo.maps.store import MapFiles, find_map
from interplan_sumo.report import scenario_drawing as drawing
from interplan_sumo.report.key_events import deciding_moment
from interplan_sumo.report.sumo_rerun import traffic_at_start, types_of
from interplan_sumo.report.sumo_xml import colour, configuration, document, tag
from interplan_sumo.simulation.agent_kinematics import navigation_deg
from interplan_sumo.simulation.ego_proxy import EGO
from interplan_sumo.simulation.network import NetworkLane, SumoNetwork, read_network
from interplan_sumo.simulation.sumo import DT_S
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.geometry import Floats, box_corners
from interplan_sumo.world.trace import ActorTable

BEFORE_S: Final = 5.0
"""Playback opens so long before the moment that it is about."""
VIEW_M: Final = 80.0
"""Height of the first view."""
WINDOW_SHAPE: Final = 1.6
"""Width by height of a usual window: SUMO's zoom of 100 is the whole network in the window."""
FARTHEST_LANE_M: Final = 60.0
"""Road users are put beside a lane within this distance: SUMO shows nobody who is far from all of them."""
END_M: Final = 0.1
"""Nobody is put nearer to the end of a lane: rounded, the place could lie beyond it."""
GOAL_M: Final = 3.5
"""Length of the line at the goal."""
WRONG_WAY_M: Final = 5.0
"""So much nearer must a lane of the other direction be to be preferred."""
NETWORK: Final = "network.net.xml.gz"
SHAPES: Final = "shapes.add.xml"
TYPES: Final = "types.add.xml"
TRACKS: Final = "tracks.fcd.xml.gz"
VIEW: Final = "view.xml"
PLAYBACK: Final = "playback.sumocfg"
TRAFFIC: Final = "traffic.rou.xml"
RERUN: Final = "rerun.sumocfg"


def write_sumo_gui(drive: StoredDrive, folder: Path, *, at_s: float | None = None) -> Path:
    """Write the folder; the configuration to open: `sumo-gui -c FOLDER/playback.sumocfg`.

    It opens shortly before `at_s`, else before the moment that decided the
    score, and pauses there. Everybody is within a centimetre of the recorded
    place but in their first step, in which SUMO puts them on the middle of a
    lane. Needs SUMO 1.28. InputError if the map has no network, or the folder
    cannot be written. Opens SUMO if the scenario has traffic of its own.
    """
    moment_s = deciding_moment(drive).time_s if at_s is None else at_s
    last_s = (len(drive.trace) - 1) * DT_S
    if not 0.0 <= moment_s <= last_s:
        raise InputError(f"at_s is {moment_s:g}, but the drive has 0 to {last_s:g} s")
    export = _Export.of(drive)
    texts = {
        TYPES: document("additional", export.type_tags()),
        SHAPES: document("additional", export.shape_tags()),
        TRACKS: document("fcd-export", export.track_tags()),
        VIEW: document("viewsettings", export.view_tags(moment_s)),
        PLAYBACK: configuration(_playback(max(0.0, moment_s - BEFORE_S), last_s + DT_S)),
        "README.txt": _readme(drive, moment_s),
    }
    types_file: Path | None = None
    if not drive.scenario.replayed:
        types_file = types_of(drive)
        texts[TRAFFIC] = document("routes", traffic_at_start(drive, types_file))
        texts[RERUN] = configuration(_rerun(types_file.name, drive.scenario.duration_s))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(export.files.network, folder / NETWORK)
        if types_file is not None:
            shutil.copyfile(types_file, folder / types_file.name)
        for name, text in texts.items():
            content = text.encode()
            (folder / name).write_bytes(gzip.compress(content, mtime=0) if name.endswith(".gz") else content)
    except OSError as error:
        raise InputError(f"cannot write {folder}: {error.strerror or error}; give another folder") from None
    return folder / PLAYBACK


_Kind = tuple[ActorKind, str, float, float]
"""What has a type of its own: kind, behaviour, length and width."""


@dataclass(frozen=True, slots=True)
class _Placed:
    """A road user in one frame, in SUMO's frame and beside one of its lanes."""

    name: str
    kind: str
    x_m: float
    """Of the middle of the front bumper."""
    y_m: float
    heading_rad: float
    speed_mps: float
    lane: NetworkLane
    position_m: float

    def at_end_of(self, lane: NetworkLane) -> _Placed:
        """The same at the end of a lane."""
        end = lane.line.pose_at(lane.line.length_m)
        return _Placed(self.name, self.kind, end.x_m, end.y_m, end.heading_rad, 10.0, lane, lane.length_m)

    def tag(self) -> str:
        return tag(
            "vehicle", id=self.name, type=self.kind, x=f"{self.x_m:.3f}", y=f"{self.y_m:.3f}",
            angle=f"{navigation_deg(self.heading_rad):.3f}", speed=f"{self.speed_mps:.3f}", lane=self.lane.id,
            pos=f"{self.position_m:.2f}",
        )  # fmt: skip


# --- playback ------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Export:
    """A drive beside the network that it was driven on."""

    drive: StoredDrive
    files: MapFiles
    network: SumoNetwork
    origin_m: tuple[float, float]
    colours: Mapping[str, str]
    """By behaviour."""
    standing: NDArray[np.bool_]
    """(R,) which rows of the actors belong to what never moves and is nobody's car."""
    types: dict[_Kind, str] = field(default_factory=dict["_Kind", str])
    _edges: dict[str, str] = field(default_factory=dict[str, str])
    """The edge that each road user was put beside last, not counting those inside junctions."""
    _onward: dict[str, frozenset[str]] = field(default_factory=dict[str, "frozenset[str]"])
    """The edges that can be reached from an edge."""

    @classmethod
    def of(cls, drive: StoredDrive) -> _Export:
        files = find_map(drive.scenario.map, drive.scenario.maps_beside)
        actors = drive.trace.actors
        export = cls(
            drive,
            files,
            read_network(files.network),
            NetworkIds.read(files.ids).origin_m,
            drawing.behaviour_colours({str(name) for name in actors.behaviour if name}),
            _standing(actors),
        )
        for row in np.flatnonzero(~export.standing):
            export.types.setdefault(export.kind_of(int(row)), f"type{len(export.types)}")
        return export

    def kind_of(self, row: int) -> _Kind:
        actors = self.drive.trace.actors
        size = round(float(actors.length_m[row]), 2), round(float(actors.width_m[row]), 2)
        return ActorKind(int(actors.kind[row])), str(actors.behaviour[row]), *size

    def type_tags(self) -> Iterator[str]:
        """What everybody looks like. How they drive does not matter: they are moved."""
        shape = self.drive.trace.shape
        yield _vehicle_type(EGO, drawing.EGO, "passenger/sedan", shape.length_m, shape.width_m)
        for (kind, behaviour, length_m, width_m), name in self.types.items():
            paint = self.colours[behaviour] if behaviour else drawing.STANDING
            if kind is ActorKind.PEDESTRIAN:
                yield _vehicle_type(name, drawing.PERSON, "pedestrian", length_m, width_m)
            else:
                yield _vehicle_type(name, paint, _looks(kind, length_m), length_m, width_m)

    def track_tags(self) -> Iterator[str]:
        """Every frame in SUMO's terms: front bumpers, angles clockwise from north, and the lane next to each.

        Whoever has gone is put at the end of the lane, where SUMO takes cars off the road.
        Recorded road users farther than FARTHEST_LANE_M from all lanes are left out.
        """
        trace = self.drive.trace
        actors, ego, moves = trace.actors, trace.ego, ~self.standing
        before: dict[str, _Placed] = {}
        for frame in range(len(trace)):
            rows = actors.rows(frame)
            moving = [row for row in range(rows.start, rows.stop) if moves[row]]
            here = {each.name: each for row in moving if (each := self._placed_actor(row)) is not None}
            pose = float(ego.x_m[frame]), float(ego.y_m[frame]), float(ego.heading_rad[frame])
            driven = self._placed(EGO, EGO, *pose, trace.shape.length_m, max(0.0, float(ego.vx_mps[frame])))
            if driven is None:
                raise InputError(
                    f"{self.drive.scenario.id}: the ego goes farther than {FARTHEST_LANE_M:g} m from all lanes, "
                    "where SUMO shows nobody; replay this drive as a page"
                )
            here[EGO] = driven
            yield f'<timestep time="{frame * DT_S:.2f}">'
            yield from (each.tag() for each in here.values())
            yield from (self._leaving(each).tag() for name, each in before.items() if name not in here)
            yield "</timestep>"
            before = here

    def _leaving(self, each: _Placed) -> _Placed:
        """At the end of the lane, or of the one that the way through a junction leads to."""
        ways = self.network.ways_through(each.lane.id) if each.lane.internal else ()
        return each.at_end_of(self.network.lanes[ways[0].to_lane] if ways else each.lane)

    def _placed_actor(self, row: int) -> _Placed | None:
        actors = self.drive.trace.actors
        pose = float(actors.x_m[row]), float(actors.y_m[row]), float(actors.heading_rad[row])
        speed_mps = float(np.hypot(actors.vx_mps[row], actors.vy_mps[row]))
        kind = self.types[self.kind_of(row)]
        return self._placed(str(actors.ids[row]), kind, *pose, float(actors.length_m[row]), speed_mps)

    def _placed(
        self, name: str, kind: str, x_m: float, y_m: float, heading_rad: float, length_m: float, speed_mps: float
    ) -> _Placed | None:
        """From the middle of a body in the map to the middle of its front bumper in SUMO; None far from all lanes."""
        x_m += length_m / 2.0 * cos(heading_rad) - self.origin_m[0]
        y_m += length_m / 2.0 * sin(heading_rad) - self.origin_m[1]
        beside = self._lane(name, x_m, y_m, heading_rad)
        if beside is None:
            return None
        lane, position_m = beside
        return _Placed(
            name, kind, x_m, y_m, heading_rad, speed_mps, lane, max(0.0, min(position_m, lane.length_m - END_M))
        )

    def _lane(self, name: str, x_m: float, y_m: float, heading_rad: float) -> tuple[NetworkLane, float] | None:
        """The lane beside a front bumper, and the place on it: of its direction if about as near, and on a route.

        SUMO makes a route of the edges of all frames: each must be reachable from the one before.
        """
        before = self._edges.get(name)
        best: tuple[float, NetworkLane, float] | None = None
        for strip, away_m in self.network.strips_around(x_m, y_m, FARTHEST_LANE_M):
            if best is not None and away_m > best[0]:
                break
            lane = strip.lane
            if before is None if lane.internal else not self._leads(before, lane.edge):
                continue
            arc_m, left_m = strip.track.project(x_m, y_m)
            against = cos(strip.track.heading_at(arc_m) - heading_rad) < 0.0
            cost_m = abs(left_m) + (WRONG_WAY_M if against else 0.0)
            if best is None or cost_m < best[0]:
                best = cost_m, lane, strip.start_m + arc_m
        if best is None:
            return None
        if not best[1].internal:
            self._edges[name] = best[1].edge
        return best[1], best[1].position_of(best[2])

    def _leads(self, before: str | None, edge: str) -> bool:
        """Whether one can drive from an edge to another; from nowhere to all."""
        if before is None or before == edge:
            return True
        if before not in self._onward:
            found, open_ends = set[str](), [before]
            while open_ends:
                for lane in self.network.edges[open_ends.pop()]:
                    fresh = {self.network.lanes[link.to_lane].edge for link in self.network.links[lane]} - found
                    found |= fresh
                    open_ends += fresh
            self._onward[before] = frozenset(found)
        return edge in self._onward[before]

    # --- what stands and what is marked --------------------------------------------------------

    def shape_tags(self) -> Iterator[str]:
        """Polygons: what stands around, the crosswalks, the route, the goal line and the way that the ego took."""
        drive, roads = self.drive, self.drive.roads
        track = np.stack((drive.trace.ego.x_m, drive.trace.ego.y_m), axis=1)
        near = shapely.box(*(track.min(axis=0) - 150.0), *(track.max(axis=0) + 150.0))
        for area in roads.crosswalks:
            if area.polygon.intersects(near):
                yield self._polygon(f"crosswalk_{area.id}", shapely.get_coordinates(area.polygon), "#ffffff", 1, 0.5)
        for block in drive.scenario.route:
            outline = shapely.get_coordinates(roads.roadblocks[block].polygon.exterior)
            yield self._polygon(f"route_{block}", outline, drawing.ROUTE, 2, 0.2)
        goal = drive.scenario.goal
        ends = [replace(goal, left_m=goal.left_m + side * GOAL_M / 2.0).pose(roads) for side in (1.0, -1.0)]
        across = np.array([(pose.x_m, pose.y_m) for pose in ends])
        yield self._polygon("goal", across, drawing.GOAL, 4, 1.0, line_m=0.8)
        yield self._polygon("ego_way", track, drawing.EGO, 3, 0.8, line_m=0.25)
        actors, shown = drive.trace.actors, set[str]()
        for row in np.flatnonzero(self.standing):
            name = str(actors.ids[row])
            if name not in shown:
                shown.add(name)
                pose = actors.x_m[row], actors.y_m[row], actors.heading_rad[row]
                (corners,) = box_corners(*pose, actors.length_m[row], actors.width_m[row])
                kind = ActorKind(int(actors.kind[row]))
                paint = drawing.OBSTACLE_COLOURS.get(kind, drawing.STANDING)
                yield self._polygon(f"{kind.name.lower()}_{name}", corners, paint, 5, 1.0)

    def _polygon(
        self, name: str, xy: Floats, fill: str, layer: int, opacity: float, *, line_m: float | None = None
    ) -> str:
        line = {"fill": "0", "lineWidth": f"{line_m:g}"} if line_m is not None else {"fill": "1"}
        shape = shape_text(xy - np.array(self.origin_m))
        return tag("poly", id=name, color=colour(fill, opacity), layer=layer, shape=shape, **line)

    # --- the window ----------------------------------------------------------------------------

    def view_tags(self, moment_s: float) -> Iterator[str]:
        """The ego in the middle, real time, true colours, and a pause at the moment."""
        frame = round(max(0.0, moment_s - BEFORE_S / 2.0) / DT_S)
        x_m = float(self.drive.trace.ego.x_m[frame]) - self.origin_m[0]
        y_m = float(self.drive.trace.ego.y_m[frame]) - self.origin_m[1]
        points = np.concatenate([lane.line.points for lane in self.network.lanes.values()])
        width_m, height_m = np.ptp(points, axis=0).tolist()
        whole_m = max(height_m, width_m / WINDOW_SHAPE)
        yield tag("delay", value=f"{1000 * DT_S:.0f}")
        yield tag("viewport", zoom=f"{100.0 * whole_m / VIEW_M:.1f}", x=f"{x_m:.2f}", y=f"{y_m:.2f}", angle="0")
        yield tag("breakpoint", value=f"{moment_s:.2f}")
        yield '<scheme name="interplan-sumo">'
        yield tag("background", backgroundColor=colour(PAPER), showGrid="0")
        for what, mode, entry in (
            ("edges", "laneEdgeMode", tag("entry", name="road", color=colour(ASPHALT))),
            ("junctions", "junctionMode", tag("entry", color=colour(JUNCTION))),
        ):
            yield tag(what, tag("colorScheme", entry, name="uniform"), **{mode: "0"})
        yield tag("vehicles", vehicleMode="0", vehicleQuality="2", minVehicleSize="1", vehicleExaggeration="1")
        yield "</scheme>"


def _standing(actors: ActorTable) -> NDArray[np.bool_]:
    rows: dict[str, list[int]] = {}
    for row, name in enumerate(actors.ids):
        rows.setdefault(name, []).append(row)
    still = np.zeros(len(actors), dtype=np.bool_)
    for of_one in rows.values():
        places = np.stack((actors.x_m[of_one], actors.y_m[of_one], actors.heading_rad[of_one]))
        still[of_one] = not actors.behaviour[of_one[0]] and bool((np.ptp(places, axis=1) < 1e-6).all())
    return still


def _vehicle_type(name: str, paint: str, looks: str, length_m: float, width_m: float) -> str:
    return tag(
        "vType", id=name, vClass="ignoring", guiShape=looks, length=f"{length_m:g}", width=f"{width_m:g}",
        color=colour(paint), minGap="0", maxSpeed="1000000",
    )  # fmt: skip


def _looks(kind: ActorKind, length_m: float) -> str:
    """SUMO's name for a shape like this."""
    if kind is ActorKind.BICYCLE:
        return "bicycle"
    sizes = ((3.0, "motorcycle"), (6.0, "passenger/sedan"), (10.0, "truck"), (15.0, "bus"))
    return next((looks for up_to_m, looks in sizes if length_m < up_to_m), "truck/semitrailer")


# --- configurations --------------------------------------------------------------------------------

QUIET: Final = {"xml-validation": "never", "xml-validation.net": "never", "xml-validation.routes": "never"}
"""The schemas may not be there, and looking for them warns."""


def _playback(begin_s: float, end_s: float) -> dict[str, object]:
    return {
        "net-file": NETWORK,
        "additional-files": f"{TYPES},{SHAPES}",
        "device.fcd-replay.files": TRACKS,
        "gui-settings-file": VIEW,
        "begin": f"{begin_s:.2f}",
        "end": f"{end_s:.2f}",
        "step-length": f"{DT_S:g}",
        "route-steps": "1000000",  # all tracks at once
        "insertion-checks": "none",
        "collision.action": "none",
        "time-to-teleport": "-1",
        "emergencydecel.warning-threshold": "1000000",
        **QUIET,
        "no-step-log": "true",
    }


def _rerun(types_file: str, end_s: float) -> dict[str, object]:
    """As the benchmark starts SUMO."""
    return {
        "net-file": NETWORK,
        "additional-files": f"{types_file},{SHAPES}",
        "route-files": TRAFFIC,
        "gui-settings-file": VIEW,
        "begin": "0",
        "end": f"{end_s:.2f}",
        "step-length": f"{DT_S:g}",
        "insertion-checks": "none",
        "collision.action": "none",
        "time-to-teleport": "-1",
        "lanechange.duration": "3",
        "default.speeddev": "0",
        **QUIET,
        "no-warnings": "true",
        "no-step-log": "true",
    }


def _readme(drive: StoredDrive, moment_s: float) -> str:
    row = drive.row
    score = "none" if row["score"] is None else f"{100.0 * row['score']:.1f}"
    rerun = (
        ""
        if drive.scenario.replayed
        else f"""
{RERUN:20} the same start, driven on by SUMO alone, the ego too: what SUMO makes of the traffic without
{"":20} the planner and without the benchmark's rules about who reacts to it
{TRAFFIC:20} its vehicles with their routes, lanes, places and speeds; the stopped ones stand for obstacles
"""
    )
    return f"""{drive.scenario.id}, {row["planner"]}, seed {row["seed"]}: score {score}

    sumo-gui -c {PLAYBACK}

Needs SUMO 1.28. The playback begins shortly before t = {moment_s:.1f} s and pauses there; for all of the drive set
`begin` in {PLAYBACK} to 0. Nobody decides anything in it: SUMO's fcd-replay device puts every road user
where the benchmark recorded it, but for the first step of each, on the middle of a lane. Blue is the ego.

{PLAYBACK:20} the recorded drive
{TRACKS:20} where everybody was, every {DT_S:g} s: middle of the front bumper, degrees clockwise from north
{TYPES:20} sizes and colours
{SHAPES:20} what stands around, crosswalks, the route, the goal line and the ego's way
{VIEW:20} zoom, colours and the pause
{NETWORK:20} the network; its coordinates are the map's less its netOffset
{rerun}"""
