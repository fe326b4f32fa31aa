"""Links of a SUMO network: which lanes each joins and over which it runs, its light, and whom it yields to."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from interplan_sumo.errors import MapError
from interplan_sumo.maps.network_file import FileLane, NetworkFile, read_network_file
from interplan_sumo.maps.signal_program import SignalProgram


@dataclass(frozen=True, slots=True)
class CheckedLink:
    """A connection between two lanes that are not internal, and the internal lanes that it runs over."""

    from_lane: str
    to_lane: str
    via: tuple[str, ...]
    light: tuple[str, int] | None
    """Traffic light and link index."""
    node: str
    link: int
    """Index among the links of the node."""
    state: str
    """SUMO's letter for who goes first without a working light."""


@dataclass(frozen=True, eq=False)
class NetworkSummary:
    """What there is to check in a network."""

    left_hand: bool
    lanes: dict[str, FileLane]
    links: tuple[CheckedLink, ...]
    lights: dict[str, tuple[tuple[float, str], ...]]
    """Traffic light -> phases of (seconds, state)."""
    programs: dict[str, tuple[SignalProgram, ...]]
    """Traffic light -> all its programs, the one that runs last."""
    yields: dict[str, dict[int, frozenset[int]]]
    """Node -> link -> links that it yields to."""
    foes: dict[str, dict[int, frozenset[int]]]
    """Node -> link -> links that it meets."""


def read_network_summary(path: Path) -> NetworkSummary:
    """Of a network file, plain or gzipped; MapError names the file if it is missing or damaged."""
    if not path.exists():
        raise MapError(f"no network at {path}; run `interplan-sumo maps convert {path.parent}`")
    try:
        file = read_network_file(path)
        return _summary(file)
    except (MapError, KeyError, ValueError) as error:
        what = str(error) if isinstance(error, MapError) else f"{type(error).__name__}: {error}"
        raise MapError(
            f"network {path} is damaged ({what}); run `interplan-sumo maps convert {path.parent}` to write it anew"
        ) from error


def _summary(file: NetworkFile) -> NetworkSummary:
    lanes = {lane.id: lane for lane in file.in_order}
    if not lanes:
        raise ValueError("it has no lanes")
    for lane in lanes.values():
        if not len(lane.shape) or lane.length_m is None or lane.speed_mps is None:
            raise ValueError(f"lane {lane.id} lacks its shape, length or speed")
    at = {id(each): (junction.id, link) for junction, links in file.links() for link, each in enumerate(links)}
    links = tuple(
        CheckedLink(each.from_lane, each.to_lane, file.via(each), each.link, *at[id(each)], each.state)
        for each in file.connections
    )
    for link in links:
        # Not by subtracting the keys, which walks through all of them for every link.
        if missing := [id_ for id_ in (link.from_lane, *link.via, link.to_lane) if id_ not in lanes]:
            raise ValueError(f"a connection names lane {min(missing)}, which does not exist")
    all_programs: dict[str, list[SignalProgram]] = {}
    for program in file.programs:
        all_programs.setdefault(program.id, []).append(program.program)
    return NetworkSummary(
        left_hand=file.left_hand,
        lanes=lanes,
        links=links,
        lights={program.id: program.phases for program in file.programs},
        programs={light: tuple(programs) for light, programs in all_programs.items()},
        yields={junction.id: junction.yields for junction in file.junctions},
        foes={junction.id: junction.foes for junction in file.junctions},
    )
