"""Roads to a SUMO network by way of plain XML and netconvert: `convert` writes the network and its id map."""

from __future__ import annotations

import gzip
import io
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from subprocess import CompletedProcess
from tempfile import TemporaryDirectory
from xml.etree.ElementTree import Element

from defusedxml.ElementTree import ParseError
from defusedxml.ElementTree import parse as parse_xml

from interplan_sumo.errors import MapError
from interplan_sumo.maps.controls import read_controls
from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.network_plan import network_plan
from interplan_sumo.maps.network_postprocess import finish, network_text
from interplan_sumo.maps.plain_xml import plain_files
from interplan_sumo.world.roads import Roads

NETWORK_FILE = "map.net.xml.gz"
IDS_FILE = "ids.json"
_NETCONVERT_OPTIONS = (
    "--offset.disable-normalization",
    "--no-turnarounds",
    "--precision=3",
    "--xml-validation=never",
    "--check-lane-foes.all",
    "--aggregate-warnings=5",
)


def convert(roads: Roads, folder: Path) -> NetworkIds:
    """Write map.net.xml.gz and ids.json into `folder` (made if needed) and return the id map.

    What lies there as `controls.json`, signal programs and right of way, holds
    in the network. Equal maps give equal bytes. Needs netconvert (the [maps]
    extra); MapError carries its message if it refuses the map.
    """
    if not roads.lanes:
        raise MapError(f"map {roads.name} has no lanes; a network needs at least one")
    plan = network_plan(roads, read_controls(folder))
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


def sumo_home() -> Path:
    """Where the eclipse-sumo wheel lies; MapError with the way out if it is not installed."""
    spec = find_spec("sumo")
    if spec is None or not spec.submodule_search_locations:
        raise MapError(
            "netconvert is not installed, and building a network needs it: pip install 'interplan-sumo[maps]'"
        )
    return Path(next(iter(spec.submodule_search_locations)))


def program_path(name: str) -> Path:
    """One of SUMO's programs ("netconvert", "sumo"); MapError if it is not installed."""
    path = sumo_home() / "bin" / (f"{name}.exe" if sys.platform == "win32" else name)
    if not path.is_file():
        raise MapError(f"no {name} in {path.parent}: pip install --force-reinstall 'interplan-sumo[maps]'")
    return path


def network(plain: Mapping[str, str], left_hand: bool) -> Element:
    """The root element of the network that netconvert makes of plain XML.

    `plain` maps the option of each kind of file ("node-files", "edge-files",
    "connection-files", "tllogic-files") to its text. MapError carries
    netconvert's own message.
    """
    with TemporaryDirectory(prefix="interplan-net-") as folder:
        options = [*_NETCONVERT_OPTIONS, "--output-file=net.xml"]
        for option, text in plain.items():
            Path(folder, f"{option}.xml").write_text(text, encoding="utf-8")
            options.append(f"--{option}={option}.xml")
        if left_hand:
            options.append("--lefthand")
        try:
            done = netconvert(options, folder)
        except OSError as error:
            raise MapError(f"netconvert does not run: {error}") from error
        if done.returncode != 0:
            raise MapError(f"netconvert refused the map: {netconvert_message(done.stderr)}")
        try:
            root = parse_xml(Path(folder, "net.xml")).getroot()
        except (OSError, ParseError) as error:
            raise MapError(f"netconvert wrote a network that cannot be read: {error}") from error
    assert root is not None
    return root


def netconvert(options: Sequence[str], folder: str, *, longest_s: float | None = None) -> CompletedProcess[str]:
    """What netconvert says with these options in a folder; MapError if it is not installed.

    OSError if it does not run, TimeoutExpired if it does for longer.
    """
    return subprocess.run(
        [str(program_path("netconvert")), *options],
        cwd=folder, env={**os.environ, "SUMO_HOME": str(sumo_home())}, timeout=longest_s,
        capture_output=True, encoding="utf-8", errors="replace", check=False,
    )  # fmt: skip


def netconvert_message(text: str) -> str:
    """The errors among what netconvert said."""
    lines = [line.removeprefix("Error: ").strip() for line in text.splitlines() if line.startswith("Error")]
    return "; ".join(lines[:5]) or text.strip()[-300:] or "no message"
