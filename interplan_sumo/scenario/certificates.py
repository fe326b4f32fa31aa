"""Certificates: stored proofs that scenarios can be solved: a drive for each, which is also its expert.

One file per suite, `certificates.parquet`. A row is a state of a drive:

| column | what |
|---|---|
| scenario_id | text |
| time_us | microseconds since the start |
| x, y, heading | of the rear axle, map frame |
| vx, vy, ax, ay, tire_steering_angle, tire_steering_rate, angular_velocity, angular_acceleration | car frame |
| center_x, center_y | of the box |

These are nuPlan's fields of an ego state. Numbers but the time are integers in
millionths of metre, radian and second, so that a drive is read back as it was
driven, to the last bit. The summaries lie in the file's footer, under the key
`certificates`: a list as JSON.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from interplan_sumo.errors import InputError
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.trace import EGO_COLUMNS, EgoTrack

if TYPE_CHECKING:
    import pandas as pd  # with pyarrow half a second that only those who read certificates should wait

FILE = "certificates.parquet"
COLUMNS = EGO_COLUMNS[1:15]
"""Those of ego.parquet but for the frame and the planner's time."""
UNITS_PER_ONE = 1_000_000
_KEY = b"certificates"


def solvers_in_words(solved_by: Iterable[str] | None) -> str:
    """For people: who solves a scenario, `open` if nobody, nothing if nobody was asked."""
    return "" if solved_by is None else ", ".join(solved_by) or "open"


@dataclass(frozen=True, slots=True)
class Summary:
    """What is proved."""

    scenario_id: str
    scenario_hash: str
    """Of the scenario that was solved; another one has no certificate."""
    score: float
    """With progress counted against the reference distance."""
    reference_distance_m: float
    """How far the reference driver gets along the route, without obstacles and jaywalkers, in the same traffic."""
    distance_m: float
    """How far this drive gets."""
    reached_goal: bool
    """Whether it passes the goal line; it ends there then, else with the last second."""
    trace_hash: str
    """Of the replay under the official traffic."""
    solved_by: tuple[str, ...] | None = None
    """Planners without privileged knowledge that were asked and solve it; none of them: the scene is open; None: nobody
    was asked."""

    @property
    def solved_words(self) -> str:
        """For people: who solves it, `open` if nobody, nothing if nobody was asked."""
        return solvers_in_words(self.solved_by)


@dataclass(frozen=True, eq=False)
class Certificate:
    """A summary and the drive: at most 301 states, fewer where the goal line ends it."""

    summary: Summary
    track: EgoTrack

    def record(self) -> CertificateRecord:
        """Plain data: exact, for other processes."""
        table = _integers(self.track)
        return CertificateRecord(self.summary, {name: table[name].tolist() for name in COLUMNS})

    @classmethod
    def of(cls, record: CertificateRecord) -> Certificate:
        """From what `record` gave."""
        import pandas as pd

        return cls(record.summary, _track(pd.DataFrame(record.states)))


class CertificateRecord(msgspec.Struct, frozen=True):
    """A certificate as JSON has it."""

    summary: Summary
    states: dict[str, list[int]]
    """The columns of the file but for the scenario."""


def write_certificates(path: Path, certificates: Iterable[Certificate]) -> None:
    """Write one file for a suite; equal certificates give equal bytes."""
    import pandas as pd
    import pyarrow as pa
    import pyarrow.parquet as pq

    ordered = sorted(certificates, key=lambda c: c.summary.scenario_id)
    tables = [_integers(c.track).assign(scenario_id=c.summary.scenario_id) for c in ordered]
    rows = pd.concat(tables, ignore_index=True) if tables else pd.DataFrame(columns=["scenario_id", *COLUMNS])
    columns: dict[str, Any] = {"scenario_id": pa.array(rows["scenario_id"].astype(str)).dictionary_encode()}
    columns |= {name: pa.array(rows[name].to_numpy(np.int64)) for name in COLUMNS}
    summaries = json.dumps([asdict(c.summary) for c in ordered], sort_keys=True, separators=(",", ":"))
    table = pa.table(columns).replace_schema_metadata({_KEY: summaries.encode()})
    path.parent.mkdir(parents=True, exist_ok=True)
    options: dict[str, Any] = {
        "use_dictionary": ["scenario_id"]
    }  # numbers that differ from row to row have no use for it
    pq.write_table(table, path, compression="zstd", compression_level=19, **options)


def read_summaries(path: Path) -> dict[str, Summary]:
    """The summaries by scenario id, without the drives; InputError if the file cannot be read."""
    import pyarrow.parquet as pq

    try:
        metadata = pq.read_schema(path).metadata or {}
        return {each.scenario_id: each for each in msgspec.json.decode(metadata[_KEY], type=list[Summary])}
    except Exception as error:
        raise InputError(f"cannot read the certificates at {path}: {error}; reinstall interplan-sumo") from error


def read_certificates(path: Path) -> dict[str, Certificate]:
    """All certificates of a file by scenario id; InputError if it cannot be read."""
    import pyarrow.parquet as pq

    summaries = read_summaries(path)
    try:
        table = pq.read_table(path).to_pandas()
        drives = {str(name): rows for name, rows in table.groupby("scenario_id", observed=True)}
        return {name: Certificate(summary, _track(drives[name])) for name, summary in summaries.items()}
    except Exception as error:
        raise InputError(f"cannot read the certificates at {path}: {error}; reinstall interplan-sumo") from error


def _integers(track: EgoTrack) -> pd.DataFrame:
    """The columns of the file but for the scenario."""
    import pandas as pd

    table = track.to_frame(PACIFICA)
    columns = {"time_us": table["time_us"].to_numpy(np.int64)}
    for name in COLUMNS[1:]:
        columns[name] = np.rint(table[name].to_numpy() * UNITS_PER_ONE).astype(np.int64)
    return pd.DataFrame(columns)


def _track(table: pd.DataFrame) -> EgoTrack:
    """The drive that rows hold, in time order."""
    import pandas as pd

    ordered = table.sort_values("time_us", kind="stable")
    columns: dict[str, Any] = {name: ordered[name].to_numpy(np.int64) / UNITS_PER_ONE for name in COLUMNS[1:]}
    return EgoTrack.from_frame(pd.DataFrame({"time_us": ordered["time_us"].to_numpy(np.int64), **columns}), PACIFICA)
