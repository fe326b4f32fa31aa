"""Experts of one's own scenarios: certificates beside their file, else a drive made once; kept in the run folder."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import pandas as pd

from interplan_sumo.batch.run_folder import slug
from interplan_sumo.errors import InputError, RunFolderError
from interplan_sumo.scenario import certificates
from interplan_sumo.scenario.certificates import Certificate
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.files import replacing, writing
from interplan_sumo.world.trace import EgoTrack

FOLDER = "experts"
"""In the run folder."""


def keep_certified(scenarios: Iterable[Scenario], files: Iterable[str], run_folder: Path) -> None:
    """Take over the drives of `certificates.parquet` beside the scenarios' files as their experts.

    Only where the certificate is for exactly this scenario. InputError if the
    certificates cannot be read, RunFolderError if the run folder not be written.
    """
    found: dict[str, Certificate] = {}
    for folder in dict.fromkeys(Path(file).parent for file in files):
        if (folder / certificates.FILE).is_file():
            found |= certificates.read_certificates(folder / certificates.FILE)
    for scenario in scenarios:
        certificate = found.get(scenario.id)
        path = _path(scenario, run_folder)
        if certificate is not None and certificate.summary.scenario_hash == scenario.hash() and not path.is_file():
            _keep(certificate.track, path)


def own_expert(scenario: Scenario, run_folder: Path) -> EgoTrack:
    """The expert drive of a scenario that belongs to no suite; the first call drives it, which opens SUMO.

    Workers may drive the same one at the same time: they get the same drive,
    and the file is put in its place as a whole. InputError if the scenario
    cannot be driven or the folder not be written.
    """
    path = _path(scenario, run_folder)
    if path.is_file():
        try:
            return EgoTrack.from_frame(pd.read_parquet(path), PACIFICA)
        except Exception as error:  # pyarrow has many
            raise InputError(f"cannot read {path}: {error}; delete it, and it is driven again") from None
    from interplan_sumo.verification.replay import reference_drive

    track = reference_drive(scenario).ego
    _keep(track, path)
    return EgoTrack.from_frame(track.to_frame(PACIFICA), PACIFICA)


def _path(scenario: Scenario, run_folder: Path) -> Path:
    return run_folder / FOLDER / f"{slug(scenario.id)}.parquet"


def _keep(track: EgoTrack, path: Path) -> None:
    """Put a drive in its place as a whole."""
    with writing(path, kind=RunFolderError):
        path.parent.mkdir(exist_ok=True)
        with replacing(path) as fresh:
            track.to_frame(PACIFICA).to_parquet(fresh, index=False, compression="zstd")
