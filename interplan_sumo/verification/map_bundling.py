"""Maps that travel with scenarios: what is not shipped is stored beside their file, cut down to what they need."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Final

import numpy as np

from interplan_sumo.errors import InputError
from interplan_sumo.maps.controls import read_controls
from interplan_sumo.maps.crop import crop
from interplan_sumo.maps.geopackage import read_map
from interplan_sumo.maps.geopackage_writer import write_map
from interplan_sumo.maps.store import MapFiles, copy_map, find_map, is_shipped, place_map
from interplan_sumo.maps.to_sumo import convert
from interplan_sumo.scenario.route import route_centerline
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.roads import Roads

KEPT_M: Final = 400.0
"""Every lane within this distance of a scenario is kept: traffic begins up to 300 m ahead of the ego, and goes on."""
ALONG_M: Final = 100.0
"""A place every so far along the route is one of the scenario's."""
WHOLE_LANES: Final = 400
"""A map with up to this many lanes goes whole."""


def own_maps_root(files: MapFiles) -> Path | None:
    """Where scenarios find a map that is not shipped: the root it lies in. None for a shipped one.

    InputError if its name does not lead back to it, because a shipped map has
    the same one or because the root holds another version.
    """
    if is_shipped(files):
        return None
    root = files.folder.parent.parent
    found = find_map(files.name, root)
    if found.folder.resolve() != files.folder.resolve():
        raise InputError(f"{files.folder} is not found as {files.name} in {root}; lay it out as NAME/VERSION/map.gpkg")
    return root


def carry_map(
    files: MapFiles, roads: Roads, scenarios: Iterable[Scenario], root: Path,
    *, overwrite: bool = False, whole_lanes: int = WHOLE_LANES,
) -> MapFiles:  # fmt: skip
    """Store what the scenarios need of a map in a root; where it lies now, which may be where it was.

    Ids do not change. Equal scenarios on equal maps give equal bytes. A map
    with up to `whole_lanes` lanes goes whole. InputError if another map of this
    name lies there and is not to be overwritten, MapError if it cannot be
    written; cutting one down, or one without a SUMO network, needs netconvert.
    """
    there = MapFiles(files.name, files.version, root / files.name / files.version)
    lies_there = there.folder.resolve() == files.folder.resolve()
    if not (overwrite or lies_there) and (root / files.name).exists():
        raise InputError(f"{root / files.name} exists; name another folder with --out, or give --overwrite")
    if len(roads.lanes) <= whole_lanes or lies_there:
        return _whole(files, root)
    part = crop(roads, [place for each in scenarios for place in places_of(each, roads)], KEPT_M)
    if len(part.lanes) == len(roads.lanes):
        return _whole(files, root)

    def fill(folder: Path) -> None:
        write_map(part, folder / files.gpkg.name)
        read_controls(files.folder).within(part.connectors).write(folder)
        convert(read_map(folder / files.gpkg.name, files.name), folder)

    return place_map(there, root, fill)


def _whole(files: MapFiles, root: Path) -> MapFiles:
    """Copy a map; one that comes as nuPlan has it gets its SUMO network there."""
    there = copy_map(files, root)
    if not there.network.is_file():
        convert(read_map(there.gpkg, there.name), there.folder)
    return there


def places_of(scenario: Scenario, roads: Roads) -> list[tuple[float, float]]:
    """(x, y) of start, goal, all that is staged, and along the route between."""
    line = route_centerline(roads, scenario)
    places = [scenario.start, scenario.goal, *(each.place for each in (*scenario.obstacles, *scenario.vehicles))]
    places += [place for walker in scenario.jaywalkers for place in walker.places]
    poses = [place.pose(roads) for place in places]
    along = line.poses_at(np.arange(0.0, line.length_m, ALONG_M))[:, :2].tolist()
    return [*((pose.x_m, pose.y_m) for pose in poses), *((x_m, y_m) for x_m, y_m in along)]
