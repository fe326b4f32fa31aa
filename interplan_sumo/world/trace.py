"""Trace: the record of one episode, in memory and as Parquet files.

| file | a row is | columns |
|---|---|---|
| ego.parquet | a frame | frame, time_us, x, y, heading (rear axle), vx, vy, ax, ay (rear axle, car frame), tire_steering_angle, tire_steering_rate, angular_velocity, angular_acceleration, center_x, center_y, plan_wall_s |
| actors.parquet | an actor in a frame | frame, track_token, type, x, y, heading, length, width (box centre), vx, vy (map frame), behaviour, ax_without_ego |
| signals.parquet | a connector in a frame | frame, lane_connector_id, status |
| seen.parquet | an actor as the planner saw it in a frame | as actors.parquet, without the last two; only where the scenario's perception is not `full`. The first frame is -20: what the planner was told of the time before the start |
| plans.parquet | a pose of the plan of a frame | frame, time_s, x, y, heading (box centre), as they were driven, to the bit |

Metres, radians, seconds, integer microseconds. `behaviour` is for analysis;
planners never see it. `ax_without_ego` is the acceleration (m/s2) that a
vehicle's own SUMO model would have chosen in the step before without the ego,
where it braked and the ego was a reason, else empty; left out where nobody has
a model, as in recordings. It follows from the states and is not hashed, nor is
`plan_wall_s`, which is a measurement.
"""

from __future__ import annotations

import hashlib
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.errors import InputError
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import PACIFICA, EgoShape, EgoState
from interplan_sumo.world.geometry import Floats, Ints, box_corners, frozen
from interplan_sumo.world.plans import PLAN_COLUMNS, plan_table, plans_of
from interplan_sumo.world.signals import Signals, SignalStatus
from interplan_sumo.world.trajectory import Trajectory

if TYPE_CHECKING:
    import pandas as pd  # half a second that only those who read or write traces should wait

EGO_COLUMNS = (
    "frame", "time_us", "x", "y", "heading", "vx", "vy", "ax", "ay", "tire_steering_angle", "tire_steering_rate",
    "angular_velocity", "angular_acceleration", "center_x", "center_y", "plan_wall_s",
)  # fmt: skip
ACTOR_COLUMNS = ("frame", "track_token", "type", "x", "y", "heading", "length", "width", "vx", "vy", "behaviour")
SEEN_COLUMNS = ACTOR_COLUMNS[:-1]
WITHOUT_EGO = "ax_without_ego"
SIGNAL_COLUMNS = ("frame", "lane_connector_id", "status")
PLANS_FILE = "plans.parquet"
SEEN_BEFORE = 20
"""Frames before the first that `Trace.seen` holds: as many as a planner looks back."""
_NOT_HASHED = frozenset({"plan_wall_s", WITHOUT_EGO})


@dataclass(frozen=True, eq=False)
class EgoTrack:
    """Ego states over time as arrays (N,): centre pose in the map frame, rear-axle dynamics in the car frame."""

    time_us: Ints
    x_m: Floats
    y_m: Floats
    heading_rad: Floats
    vx_mps: Floats
    vy_mps: Floats
    ax_mps2: Floats
    ay_mps2: Floats
    tire_angle_rad: Floats
    tire_rate_radps: Floats
    yaw_rate_radps: Floats
    yaw_acceleration_radps2: Floats

    def __post_init__(self) -> None:
        for column in fields(self):
            dtype = np.int64 if column.name == "time_us" else np.float64
            array = frozen(getattr(self, column.name), dtype)
            if array.shape != np.shape(self.time_us):
                raise ValueError(f"EgoTrack.{column.name} has shape {array.shape}, expected {np.shape(self.time_us)}")
            object.__setattr__(self, column.name, array)

    @classmethod
    def of(cls, states: Sequence[EgoState]) -> EgoTrack:
        """A track from states in time order."""
        names = [c.name for c in fields(cls)[1:]]
        columns = {name: np.array([getattr(s, name) for s in states], dtype=np.float64) for name in names}
        return cls(np.array([round(s.time_s * 1e6) for s in states], dtype=np.int64), **columns)

    def __len__(self) -> int:
        return len(self.time_us)

    def state(self, frame: int) -> EgoState:
        """One frame as a state."""
        names = [c.name for c in fields(self)[1:]]
        return EgoState(float(self.time_us[frame]) * 1e-6, *(float(getattr(self, n)[frame]) for n in names))

    def rear_axle(self, shape: EgoShape) -> tuple[Floats, Floats]:
        """x and y (N,) of the rear axle."""
        d = shape.rear_axle_to_center_m
        return self.x_m - d * np.cos(self.heading_rad), self.y_m - d * np.sin(self.heading_rad)

    def corners(self, shape: EgoShape) -> Floats:
        """(N, 4, 2) box corners: front left, rear left, rear right, front right."""
        return box_corners(self.x_m, self.y_m, self.heading_rad, shape.length_m, shape.width_m)

    def to_frame(self, shape: EgoShape) -> pd.DataFrame:
        """A table with the columns of ego.parquet but for plan_wall_s."""
        import pandas as pd

        rear_x, rear_y = self.rear_axle(shape)
        values = (
            np.arange(len(self)), self.time_us, rear_x, rear_y, self.heading_rad, self.vx_mps, self.vy_mps, self.ax_mps2,
            self.ay_mps2, self.tire_angle_rad, self.tire_rate_radps, self.yaw_rate_radps, self.yaw_acceleration_radps2,
            self.x_m, self.y_m,
        )  # fmt: skip
        return pd.DataFrame(dict(zip(EGO_COLUMNS, values, strict=False)))

    @classmethod
    def from_frame(cls, table: pd.DataFrame, shape: EgoShape) -> EgoTrack:
        """From a table with nuPlan's ego columns; the centre is derived where center_x, center_y are missing."""
        heading = table["heading"].to_numpy(np.float64)
        if "center_x" in table:
            x_m, y_m = table["center_x"].to_numpy(np.float64), table["center_y"].to_numpy(np.float64)
        else:
            d = shape.rear_axle_to_center_m
            x_m = table["x"].to_numpy(np.float64) + d * np.cos(heading)
            y_m = table["y"].to_numpy(np.float64) + d * np.sin(heading)
        rest = [table[name].to_numpy(np.float64) for name in EGO_COLUMNS[5:13]]
        return cls(table["time_us"].to_numpy(np.int64), x_m, y_m, heading, *rest)


@dataclass(frozen=True, eq=False)
class ActorTable:
    """All actors of all frames, one row per actor and frame, ordered by frame and then by id."""

    frame: Ints  # (R,)
    ids: NDArray[np.object_]  # (R,) str
    kind: NDArray[np.int8]  # (R,) ActorKind
    x_m: Floats
    y_m: Floats
    heading_rad: Floats
    length_m: Floats
    width_m: Floats
    vx_mps: Floats
    vy_mps: Floats
    behaviour: NDArray[np.object_]  # (R,) str, '' where none
    starts: Ints
    """(N + 1,) rows of frame k are starts[k] to starts[k + 1]."""
    ax_without_ego: Floats | None = None
    """(R,) m/s2: what a vehicle would have chosen in the step before without the ego; not a number where it was not
    asked. None where nobody has a model to ask."""

    @classmethod
    def of(
        cls,
        frames: Sequence[Actors],
        behaviour: dict[str, str] | None = None,
        without_ego: Sequence[Mapping[str, float]] | None = None,
    ) -> ActorTable:
        """A table from one `Actors` per frame; `without_ego` are the accelerations per frame, by id."""
        behaviours = behaviour or {}
        counts = np.array([len(a) for a in frames], dtype=np.int64)
        ids = [i for a in frames for i in a.ids]

        def column(name: str, dtype: Any = np.float64) -> NDArray[Any]:
            parts = [getattr(a, name) for a in frames]
            return np.concatenate(parts) if parts else np.zeros(0, dtype=dtype)

        return cls(
            frame=np.repeat(np.arange(len(frames)), counts),
            ids=np.array(ids, dtype=object),
            kind=column("kind", np.int8),
            x_m=column("x_m"),
            y_m=column("y_m"),
            heading_rad=column("heading_rad"),
            length_m=column("length_m"),
            width_m=column("width_m"),
            vx_mps=column("vx_mps"),
            vy_mps=column("vy_mps"),
            behaviour=np.array([behaviours.get(i, "") for i in ids], dtype=object),
            starts=np.concatenate(([0], np.cumsum(counts))),
            ax_without_ego=None if without_ego is None else _asked(frames, without_ego),
        )

    def __len__(self) -> int:
        return len(self.frame)

    def rows(self, frame: int) -> slice:
        """The rows of one frame."""
        return slice(int(self.starts[frame]), int(self.starts[frame + 1]))

    def at(self, frame: int) -> Actors:
        """One frame as `Actors`."""
        rows = self.rows(frame)
        names = ("kind", "x_m", "y_m", "heading_rad", "length_m", "width_m", "vx_mps", "vy_mps")
        return Actors(tuple(self.ids[rows]), *(getattr(self, n)[rows] for n in names))

    def to_frame(self) -> pd.DataFrame:
        """A table with the columns of actors.parquet."""
        import pandas as pd

        kinds = np.array([k.name for k in ActorKind], dtype=object)
        values = (
            self.frame, self.ids, kinds[self.kind], self.x_m, self.y_m, self.heading_rad, self.length_m, self.width_m,
            self.vx_mps, self.vy_mps, self.behaviour,
        )  # fmt: skip
        table = pd.DataFrame(dict(zip(ACTOR_COLUMNS, values, strict=True)))
        return table if self.ax_without_ego is None else table.assign(**{WITHOUT_EGO: self.ax_without_ego})

    @classmethod
    def from_frame(cls, table: pd.DataFrame, frames: int, *, keep_order: bool = False) -> ActorTable:
        """From a table with the columns of actors.parquet; rows of a frame are sorted by id unless `keep_order`."""
        if not keep_order:
            table = table.sort_values(["frame", "track_token"], kind="stable")
        frame = table["frame"].to_numpy(np.int64)
        code = {k.name: int(k) for k in ActorKind}
        none = np.full(len(table), "", dtype=object)

        def column(name: str) -> Floats:
            return table[name].to_numpy(np.float64)

        return cls(
            frame=frame,
            ids=table["track_token"].astype(str).to_numpy(object),
            kind=np.array([code[t] for t in table["type"]], dtype=np.int8),
            x_m=column("x"),
            y_m=column("y"),
            heading_rad=column("heading"),
            length_m=column("length"),
            width_m=column("width"),
            vx_mps=column("vx"),
            vy_mps=column("vy"),
            behaviour=table["behaviour"].astype(str).to_numpy(object) if "behaviour" in table else none,
            starts=np.searchsorted(frame, np.arange(frames + 1)),
            ax_without_ego=column(WITHOUT_EGO) if WITHOUT_EGO in table else None,
        )


def _asked(frames: Sequence[Actors], without_ego: Sequence[Mapping[str, float]]) -> Floats:
    """(R,) the values of each frame, by id, on the rows of their actors."""
    values = [np.full(len(actors), np.nan) for actors in frames]
    for actors, column, asked in zip(frames, values, without_ego, strict=True):
        for id, acceleration in asked.items():
            column[actors.ids.index(id)] = acceleration
    return np.concatenate(values) if values else np.zeros(0)


@dataclass(frozen=True, eq=False)
class Trace:
    """The record of one episode: N frames, 0.1 s apart."""

    ego: EgoTrack
    actors: ActorTable
    signals: tuple[Signals, ...]
    """One per frame."""
    plans: tuple[Trajectory, ...]
    """One per planner call: as many as frames, or one less if the last plan was refused."""
    plan_wall_s: Floats
    """(P,) wall-clock seconds of each planner call."""
    shape: EgoShape = PACIFICA
    seen: ActorTable | None = None
    """What the planner saw where its perception was not `full`: as many frames, after `SEEN_BEFORE` before the first.

    Ask `seen_at`.
    """

    def __len__(self) -> int:
        return len(self.ego)

    @property
    def dt_s(self) -> float:
        """Mean step."""
        time_us = self.ego.time_us
        return float(time_us[-1] - time_us[0]) * 1e-6 / (len(time_us) - 1) if len(time_us) > 1 else 0.1

    def seen_at(self, frame: int) -> Actors:
        """What the planner saw in a frame, from -`SEEN_BEFORE` on; ValueError if that was not kept."""
        if self.seen is None:
            raise ValueError("perception was full: what the planner saw follows from the actors")
        return self.seen.at(frame + SEEN_BEFORE)

    def tables(self) -> dict[str, pd.DataFrame]:
        """The tables by file stem, columns in documented order; `seen`, where there is one, comes last."""
        import pandas as pd

        ego = self.ego.to_frame(self.shape)
        wall = np.full(len(ego), np.nan)
        wall[: len(self.plan_wall_s)] = self.plan_wall_s[: len(ego)]
        ego["plan_wall_s"] = wall
        status = np.array([s.name for s in SignalStatus], dtype=object)
        signals = pd.DataFrame(
            {
                "frame": np.repeat(np.arange(len(self.signals)), [len(s) for s in self.signals]).astype(np.int64),
                "lane_connector_id": np.array([c for s in self.signals for c in s.connector_ids], dtype=object),
                "status": status[np.concatenate([s.status for s in self.signals] or [np.zeros(0, np.int8)])],
            }
        )
        tables = {"ego": ego, "actors": self.actors.to_frame(), "signals": signals, "plans": plan_table(self.plans)}
        if self.seen is not None:
            seen = self.seen.to_frame()[list(SEEN_COLUMNS)]
            tables["seen"] = seen.assign(frame=seen["frame"] - SEEN_BEFORE)
        return tables

    def hash(self) -> str:
        """SHA-256 over all states, equal for equal runs.

        Numbers enter as little-endian int64 of round(value * 1e6), texts as
        UTF-8; table by table, column by column in documented order.
        """
        digest = hashlib.sha256()
        for name, table in self.tables().items():
            digest.update(f"{name}:{len(table)}\n".encode())
            for column in table.columns:
                if column in _NOT_HASHED:
                    continue
                values = table[column].to_numpy()
                if values.dtype == object or values.dtype.kind not in "iuf":
                    digest.update("\0".join(map(str, values)).encode())
                elif values.dtype.kind == "f":
                    digest.update(np.round(values * 1e6).astype("<i8").tobytes())
                else:
                    digest.update(values.astype("<i8").tobytes())
        return digest.hexdigest()

    def write(self, folder: Path) -> None:
        """Write the Parquet files into `folder`, which is made if needed."""
        folder.mkdir(parents=True, exist_ok=True)
        for name, table in self.tables().items():
            for text in ("track_token", "type", "behaviour", "lane_connector_id", "status"):
                if text in table:
                    table[text] = table[text].astype("category")
            table.to_parquet(folder / f"{name}.parquet", index=False, compression="zstd")

    @classmethod
    def read(cls, folder: Path, shape: EgoShape = PACIFICA) -> Trace:
        """Read what `write` wrote; InputError names a file that is missing, damaged, foreign or of another version."""
        ego_table = _read_table(folder, "ego", EGO_COLUMNS)
        actor_rows = _read_table(folder, "actors", ACTOR_COLUMNS)
        signal_rows = _read_table(folder, "signals", SIGNAL_COLUMNS)
        frames = len(ego_table)
        with _blamed(folder, "ego"):
            ego = EgoTrack.from_frame(ego_table, shape)
            wall = ego_table["plan_wall_s"].to_numpy(np.float64)
        with _blamed(folder, "actors"):
            actors = ActorTable.from_frame(actor_rows, frames)
        with _blamed(folder, "signals"):
            code = {s.name: int(s) for s in SignalStatus}
            split = np.searchsorted(signal_rows["frame"].to_numpy(), np.arange(frames + 1))
            connectors = signal_rows["lane_connector_id"].astype(str).to_numpy(object)
            status = np.array([code[s] for s in signal_rows["status"]], dtype=np.int8)
            signals = tuple(Signals(tuple(connectors[a:b]), status[a:b]) for a, b in pairwise(split))
        plans = read_plans(folder)
        seen = None
        if (folder / "seen.parquet").exists():
            seen_rows = _read_table(folder, "seen", SEEN_COLUMNS)
            with _blamed(folder, "seen"):
                since_start = seen_rows.assign(frame=seen_rows["frame"] + SEEN_BEFORE)
                seen = ActorTable.from_frame(since_start, frames + SEEN_BEFORE)
        return cls(ego, actors, signals, plans, wall[np.isfinite(wall)], shape, seen)


def read_plans(folder: Path) -> tuple[Trajectory, ...]:
    """The plans of a trace alone, frame by frame; InputError as from `Trace.read`."""
    rows = _read_table(folder, "plans", PLAN_COLUMNS)
    with _blamed(folder, "plans"):
        return plans_of(rows)


def write_plans(plans: Sequence[Trajectory], folder: Path) -> None:
    """Write the plans of a trace alone."""
    folder.mkdir(parents=True, exist_ok=True)
    plan_table(plans).to_parquet(folder / PLANS_FILE, index=False, compression="zstd")


def _read_table(folder: Path, name: str, columns: Sequence[str]) -> pd.DataFrame:
    import pandas as pd

    with _blamed(folder, name):
        table = pd.read_parquet(folder / f"{name}.parquet")
        absent = [column for column in columns if column not in table]
        if absent:
            raise ValueError(f"no trace of this version, it lacks the columns {', '.join(absent)}")
    return table


@contextmanager
def _blamed(folder: Path, name: str) -> Generator[None]:
    """Whatever a file holds instead of a table of a trace becomes an InputError that names it."""
    try:
        yield
    except Exception as error:
        said = f"unknown value {error}" if isinstance(error, KeyError) else str(error)
        raise InputError(f"cannot read {folder / name}.parquet: {said}; run the job again to write it anew") from error
