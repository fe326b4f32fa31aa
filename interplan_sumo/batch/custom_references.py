"""Experts of one's own scenarios: certificates beside their file, else the nominal drive; kept in the run folder."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

from interplan_sumo.batch.run_folder import slug
from interplan_sumo.errors import InputError, RunFolderError
from interplan_sumo.maps.store import load_roads
from interplan_sumo.scenario import certificates
from interplan_sumo.scenario.nominal_drive import nominal_drive, reaches_goal
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.files import replacing, writing
from interplan_sumo.world.trace import EgoTrack

_Read = TypeVar("_Read")
FOLDER = "experts"
"""In the run folder."""


def keep_certified(scenarios: Iterable[Scenario], files: Iterable[str], run_folder: Path) -> None:
    """Take over the drives of `certificates.parquet` beside the scenarios' files as their experts.

    Only where the certificate is for exactly this scenario. InputError if the
    certificates cannot be read, RunFolderError if the run folder not be written.
    """
    found = _beside(files, certificates.read_certificates)
    for scenario in scenarios:
        certificate = found.get(scenario.id)
        path = _path(scenario, run_folder)
        if certificate is not None and certificate.summary.scenario_hash == scenario.hash() and not path.is_file():
            _keep(certificate.track, path)


def keep_experts(found: Iterable[Path], run_folder: Path) -> None:
    """Take over experts of other run folders with the same scenarios; RunFolderError if two of one name differ."""
    for path in found:
        place = run_folder / FOLDER / path.name
        with writing(place, kind=RunFolderError):
            content = path.read_bytes()
            if not place.is_file():
                place.parent.mkdir(exist_ok=True)
                with replacing(place) as fresh:
                    fresh.write_bytes(content)
            elif place.read_bytes() != content:
                raise RunFolderError(
                    f"{path} is not the expert that another shard was scored against; run its shard again"
                )


def own_expert(scenario: Scenario, run_folder: Path) -> EgoTrack:
    """The expert drive of a scenario that belongs to no suite; the first call works it out, if there is none.

    Workers may do so at the same time: they get the same drive, and the file
    is put in its place as a whole. InputError if the goal cannot be reached or
    the folder not be written.
    """
    path = _path(scenario, run_folder)
    if path.is_file():
        import pandas as pd  # half a second that only those who read tracks should wait

        try:
            return EgoTrack.from_frame(pd.read_parquet(path), PACIFICA)
        except Exception as error:  # pyarrow has many
            raise InputError(f"cannot read {path}: {error}; delete it, and it is made again") from None
    track = nominal_drive(load_roads(scenario.map, scenario.maps_beside), scenario)
    _keep(track, path)
    return EgoTrack.from_frame(track.to_frame(PACIFICA), PACIFICA)


def reservations(scenarios: Sequence[Scenario], files: Iterable[str]) -> list[str]:
    """What to know of scenarios before they are driven, in lines.

    How many have no certificate, where others have one; and each of these whose
    goal line is out of reach in the time, even at the limit.
    """
    hashes = {id: each.scenario_hash for id, each in _beside(files, certificates.read_summaries).items()}
    bare = [each for each in scenarios if hashes.get(each.id) != each.hash()]
    said: list[str] = []
    if bare and len(bare) < len(scenarios):
        said.append(
            f"{len(bare)} of {len(scenarios)} scenarios have no certificate, such as {bare[0].id}: nobody is known to "
            "solve them; they count all the same"
        )
    for scenario in bare:
        roads = load_roads(scenario.map, scenario.maps_beside)
        if not reaches_goal(roads, scenario, nominal_drive(roads, scenario)):
            said.append(
                f"{scenario.id}: at the limit the goal line takes more than {scenario.duration_s:g} s, so its task is "
                "to come as far as that; move the goal nearer or raise duration_s"
            )
    return said


def _beside(files: Iterable[str], read: Callable[[Path], Mapping[str, _Read]]) -> dict[str, _Read]:
    """What is read of `certificates.parquet` beside the files."""
    found: dict[str, _Read] = {}
    for folder in dict.fromkeys(Path(file).parent for file in files):
        if (folder / certificates.FILE).is_file():
            found |= read(folder / certificates.FILE)
    return found


def _path(scenario: Scenario, run_folder: Path) -> Path:
    return run_folder / FOLDER / f"{slug(scenario.id)}.parquet"


def _keep(track: EgoTrack, path: Path) -> None:
    """Put a drive in its place as a whole."""
    with writing(path, kind=RunFolderError):
        path.parent.mkdir(exist_ok=True)
        with replacing(path) as fresh:
            track.to_frame(PACIFICA).to_parquet(fresh, index=False, compression="zstd")
