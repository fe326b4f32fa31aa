"""Roads to a SUMO network: `convert` writes the network and its id map."""

from __future__ import annotations

import gzip
import io
from pathlib import Path

from interplan_sumo.errors import MapError
from interplan_sumo.maps.netconvert import network
from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.network_plan import network_plan
from interplan_sumo.maps.network_postprocess import finish, network_text
from interplan_sumo.maps.plain_xml import plain_files
from interplan_sumo.world.roads import Roads

NETWORK_FILE = "map.net.xml.gz"
IDS_FILE = "ids.json"


def convert(roads: Roads, folder: Path) -> NetworkIds:
    """Write map.net.xml.gz and ids.json into `folder` (made if needed) and return the id map.

    Equal roads give equal bytes. Needs netconvert (the [maps] extra); MapError
    carries its message if it refuses the map.
    """
    if not roads.lanes:
        raise MapError(f"map {roads.name} has no lanes; a network needs at least one")
    plan = network_plan(roads)
    root = network(plain_files(plan), left_hand=roads.driving_side == "left")
    ids = finish(plan, root)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / NETWORK_FILE).write_bytes(_packed(network_text(root)))
    ids.write(folder / IDS_FILE)
    return ids


def _packed(text: str) -> bytes:
    """gzip without file name and time stamp."""
    buffer = io.BytesIO()
    with gzip.GzipFile(filename="", mode="wb", fileobj=buffer, compresslevel=9, mtime=0) as stream:
        stream.write(text.encode("utf-8"))
    return buffer.getvalue()
