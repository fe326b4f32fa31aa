"""SUMO's own window on a drive: a folder that opens in sumo-gui and plays what was recorded, frame by frame."""

from __future__ import annotations

import gzip
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from interplan_sumo.batch.stored_drive import StoredDrive
from interplan_sumo.errors import InputError
from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.render import ASPHALT, JUNCTION, PAPER
from interplan_sumo.maps.store import find_map
from interplan_sumo.report.key_events import deciding_moment
from interplan_sumo.report.replay.agents_timeline import standing_rows
from interplan_sumo.report.sumo_gui.rerun import traffic_at_start, types_of
from interplan_sumo.report.sumo_gui.shapes import shape_tags
from interplan_sumo.report.sumo_gui.tracks import Tracks
from interplan_sumo.report.sumo_gui.xml import colour, configuration, document, tag
from interplan_sumo.simulation.network import SumoNetwork, read_network
from interplan_sumo.simulation.sumo import DT_S
from interplan_sumo.world.files import writing

BEFORE_S: Final = 5.0
"""Playback opens so long before the moment that it is about."""
VIEW_M: Final = 80.0
"""Height of the first view."""
WINDOW_SHAPE: Final = 1.6
"""Width by height of a usual window: SUMO's zoom of 100 is the whole network in the window."""
NETWORK: Final = "network.net.xml.gz"
SHAPES: Final = "shapes.add.xml"
TYPES: Final = "types.add.xml"
TRACKS: Final = "tracks.fcd.xml.gz"
VIEW: Final = "view.xml"
PLAYBACK: Final = "playback.sumocfg"
TRAFFIC: Final = "traffic.rou.xml"
RERUN: Final = "rerun.sumocfg"
LIGHTS: Final = "lights.add.xml"


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
    files = find_map(drive.scenario.map, drive.scenario.maps_beside)
    network, origin_m = read_network(files.network), NetworkIds.read(files.ids).origin_m
    standing = standing_rows(drive.trace.actors)
    tracks = Tracks.of(drive, network, origin_m, standing)
    texts = {
        TYPES: document("additional", tracks.type_tags()),
        SHAPES: document("additional", shape_tags(drive, origin_m, standing)),
        TRACKS: document("fcd-export", tracks.track_tags()),
        VIEW: document("viewsettings", _view_tags(drive, network, origin_m, moment_s)),
        PLAYBACK: configuration(_playback(max(0.0, moment_s - BEFORE_S), last_s + DT_S)),
        "README.txt": _readme(drive, moment_s),
    }
    if not drive.scenario.replayed:
        types_file = types_of(drive)
        elements, lights, texts[types_file.name] = traffic_at_start(drive, types_file)
        texts[LIGHTS] = document("additional", lights)
        texts[TRAFFIC] = document("routes", elements)
        texts[RERUN] = configuration(_rerun(types_file.name, drive.scenario.duration_s))
    with writing(folder, "give another folder"):
        folder.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(files.network, folder / NETWORK)
        for name, text in texts.items():
            content = text.encode()
            (folder / name).write_bytes(gzip.compress(content, mtime=0) if name.endswith(".gz") else content)
    return folder / PLAYBACK


def _view_tags(
    drive: StoredDrive, network: SumoNetwork, origin_m: tuple[float, float], moment_s: float
) -> Iterator[str]:
    """The ego in the middle, real time, true colours, and a pause at the moment."""
    frame = round(max(0.0, moment_s - BEFORE_S / 2.0) / DT_S)
    x_m = float(drive.trace.ego.x_m[frame]) - origin_m[0]
    y_m = float(drive.trace.ego.y_m[frame]) - origin_m[1]
    points = np.concatenate([lane.line.points for lane in network.lanes.values()])
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


# --- configurations --------------------------------------------------------------------------------

COMMON: Final = {
    "net-file": NETWORK,
    "gui-settings-file": VIEW,
    "step-length": f"{DT_S:g}",
    "insertion-checks": "none",
    "collision.action": "none",
    "time-to-teleport": "-1",
    "no-step-log": "true",
    # the schemas may not be there, and looking for them warns
    **dict.fromkeys(("xml-validation", "xml-validation.net", "xml-validation.routes"), "never"),
}


def _playback(begin_s: float, end_s: float) -> dict[str, str]:
    return COMMON | {
        "additional-files": f"{TYPES},{SHAPES}",
        "device.fcd-replay.files": TRACKS,
        "begin": f"{begin_s:.2f}",
        "end": f"{end_s:.2f}",
        "route-steps": "1000000",  # all tracks at once
        "emergencydecel.warning-threshold": "1000000",
    }


def _rerun(types_file: str, end_s: float) -> dict[str, str]:
    """As the benchmark starts SUMO."""
    return COMMON | {
        "additional-files": f"{types_file},{LIGHTS},{SHAPES}",
        "route-files": TRAFFIC,
        "begin": "0",
        "end": f"{end_s:.2f}",
        "lanechange.duration": "3",
        "default.speeddev": "0",
        "no-warnings": "true",
    }


def _readme(drive: StoredDrive, moment_s: float) -> str:
    row = drive.row
    score = "none" if row.score is None else f"{100.0 * row.score:.1f}"
    rerun = (
        ""
        if drive.scenario.replayed
        else f"""
{RERUN:20} the same start, driven on by SUMO alone, the ego too: what SUMO makes of the traffic without
{"":20} the planner and without the benchmark's rules about who reacts to it
{TRAFFIC:20} its vehicles with their routes, lanes, places and speeds; the stopped ones stand for obstacles
{LIGHTS:20} where the programs of the lights begin
"""
    )
    return f"""{drive.scenario.id}, {row.planner}, seed {row.seed}: score {score}

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
