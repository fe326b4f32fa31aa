"""nuPlan's logs: `NuplanLog` makes a `Recording` of what follows a moment in a `.db` file.

Positions of the ego are those of its rear axle in the file, its velocity is in
its own frame; road users have box centres, and velocities in the map frame.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Final, NoReturn

import numpy as np

from interplan_sumo.errors import InputError, UnknownNameError
from interplan_sumo.recordings.gaps import bridged, gap_notes, pieces
from interplan_sumo.recordings.nuplan_sqlite import TOKEN_BYTES, Database, Kind
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import Floats, Ints
from interplan_sumo.world.recording import RecordedTrack, Recording
from interplan_sumo.world.signals import SignalStatus

STEP_S: Final = 0.1
"""Logs are sampled at 20 Hz, scenarios made of them at 10 Hz."""
PAST_STEPS: Final = 20
"""Of the ego, before a moment: 2 s, as nuPlan's planners see."""
WINDOW_S: Final = 30.0
"""As interPlan's scenarios; nuPlan's own last 15 s."""
LONGEST_S: Final = 600.0
MOST_FRAMES: Final = 200_000
"""Almost three hours; the longest logs last twenty minutes."""
MOST_BOXES: Final = 500_000
"""In one recording; 30 s in dense traffic have 90 000."""
MAX_COORDINATE_M: Final = 1e7
_TOKEN: Final = re.compile(rf"[0-9a-fA-F]{{{2 * TOKEN_BYTES}}}")
MAX_SPEED_MPS: Final = 150.0
MAX_SIZE_M: Final = 100.0

LOCATIONS: Final[dict[str, str]] = {
    "sg-one-north": "EPSG:32648",
    "us-ma-boston": "EPSG:32619",
    "us-nv-las-vegas-strip": "EPSG:32611",
    "us-pa-pittsburgh-hazelwood": "EPSG:32617",
}
"""nuPlan's maps, each with the system that poses on it are in: the UTM zone of the city."""

KINDS: Final[dict[str, ActorKind]] = {
    "vehicle": ActorKind.VEHICLE,
    "pedestrian": ActorKind.PEDESTRIAN,
    "bicycle": ActorKind.BICYCLE,
    "traffic_cone": ActorKind.TRAFFIC_CONE,
    "barrier": ActorKind.BARRIER,
    "czone_sign": ActorKind.CZONE_SIGN,
    "generic_object": ActorKind.GENERIC_OBJECT,
}
"""By category of the file."""
MOVING: Final = frozenset({ActorKind.VEHICLE, ActorKind.PEDESTRIAN, ActorKind.BICYCLE})
_LIGHTS: Final = {status.name.lower(): status for status in SignalStatus}

# fmt: off
_EGO_KINDS: Final[tuple[Kind, ...]] = (
    "token", "number", "number", "number", "number", "number", "number", "number", "number", "number"
)
_BOX_KINDS: Final[tuple[Kind, ...]] = (
    "token", "token", "number", "number", "number", "number", "number", "number?", "number?"
)
# fmt: on

BUS_M: Final = 10.0
TRUCK_M: Final = 6.5
"""A vehicle of this length or more is a truck or a bus, which the file does not tell apart from cars."""
MOTORCYCLE_M: Final = (2.8, 1.2)
"""Length and width under which a vehicle is a motorcycle."""

Seen = tuple[int, float, float, float, float, float, float | None, float | None]
"""Step, x, y, yaw, length, width, vx, vy."""


@dataclass(frozen=True, slots=True)
class LogMoment:
    """One sweep of the lidar, at which a scenario may begin."""

    token: str
    """16 hexadecimal digits, as nuPlan names scenarios."""
    at_s: float
    """Since the log began."""


@dataclass(frozen=True, slots=True)
class _Frame:
    token: bytes
    ego_pose: bytes
    time_us: int


class NuplanLog:
    """A log that is open to be read. Use as a context manager. InputError names file, table and row of what is wrong.

    Sweeps are put in order by their time; the tokens that chain them are not followed.
    """

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        self._database = Database(self.path)
        try:
            self.name, self.location, self.map_name = self._log()
            self._frames = self._read_frames()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> NuplanLog:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        self._database.close()

    # --- moments -------------------------------------------------------------------------------

    def moment(self, token: str) -> LogMoment:
        """The sweep of a token, 16 hexadecimal digits; InputError if the log has none of it."""
        if not _TOKEN.fullmatch(token):
            raise InputError(f"token {token[:40]!r} is none of nuPlan's, expected {2 * TOKEN_BYTES} hexadecimal digits")
        wanted = bytes.fromhex(token)
        for frame in self._frames:
            if frame.token == wanted:
                return self._moment(frame)
        raise InputError(f"{self.path}: there is no lidar_pc {token}; the token belongs to another log")

    def moments_tagged(self, tag: str) -> tuple[LogMoment, ...]:
        """The sweeps at which a scenario of this type was found, by time; UnknownNameError if there is none."""
        question = "SELECT lidar_pc_token, type FROM scenario_tag"
        rows = list(self._database.rows("scenario_tag", question, ("token", "text")))
        tagged = {token for token, name in rows if name == tag}
        found = tuple(self._moment(frame) for frame in self._frames if frame.token in tagged)
        if not found:
            raise UnknownNameError("scenario tag", tag, {name for _, name in rows}, f"(log {self.name})")
        return found

    @property
    def lasts_s(self) -> float:
        """From the first sweep to the last."""
        return self._moment(self._frames[-1]).at_s

    def moment_at(self, at_s: float) -> LogMoment:
        """The sweep nearest to a time since the log began; InputError if that is not within it."""
        if not 0.0 <= at_s <= self.lasts_s:
            raise InputError(
                f"{self.path}: the log lasts from 0 to {self.lasts_s:.1f} s, there is nothing at {at_s:g} s"
            )
        return min(map(self._moment, self._frames), key=lambda moment: abs(moment.at_s - at_s))

    def _moment(self, frame: _Frame) -> LogMoment:
        return LogMoment(frame.token.hex(), (frame.time_us - self._frames[0].time_us) / 1e6)

    # --- the recording -------------------------------------------------------------------------

    def recording(self, moment: LogMoment, duration_s: float = WINDOW_S) -> Recording:
        """What follows a moment, to the end of the log at most, 0.1 s a step. The ego's track bears the token.

        It begins 2 s before, where the log does. Each step is the sweep nearest
        to it. Who is unseen for up to 0.5 s is taken to have gone straight on;
        after longer they go on as "<track token>~2". A track has the median of
        its sizes. Velocities that
        are missing are taken from the positions; things stand still, as in nuPlan.
        """
        if not 0.0 < duration_s <= LONGEST_S:
            raise InputError(f"duration is {duration_s:g} s, expected more than 0 and at most {LONGEST_S:g} s")
        start = PAST_STEPS if moment.at_s > (PAST_STEPS - 0.25) * STEP_S else 0
        steps = self._steps(moment.at_s - start * STEP_S, start + round(duration_s / STEP_S))
        notes: list[str] = []
        crs, ego = self._ego(moment, start, steps, notes)
        steps = {step: frame for step, frame in steps.items() if step >= start}
        tracks = [ego, *self._others(steps, notes)]
        return Recording(
            name=self.name,
            crs=crs,
            step_s=STEP_S,
            tracks=tuple(sorted(tracks, key=lambda track: track.id)),
            ego_id=moment.token,
            notes=tuple(notes),
            start_step=start,
            map_name=self.map_name,
            lights=self._lights(steps, ego.end_step),
        )

    def _steps(self, begin_s: float, last: int) -> dict[int, _Frame]:
        """The sweep of each step from a time of the log on, where there is one."""
        begin_us = self._frames[0].time_us + round(begin_s * 1e6)
        found: dict[int, tuple[float, _Frame]] = {}
        for frame in self._frames:
            at = (frame.time_us - begin_us) / (STEP_S * 1e6)
            step = round(at)
            if 0 <= step <= last and abs(at - step) < found.get(step, (1.0, frame))[0]:
                found[step] = (abs(at - step), frame)
        return {step: frame for step, (_, frame) in sorted(found.items())}

    def _ego(
        self, moment: LogMoment, start: int, steps: dict[int, _Frame], notes: list[str]
    ) -> tuple[str, RecordedTrack]:
        """The system of the poses, and the car that measured, up to where its poses are missing for long."""
        poses = {frame.ego_pose: step for step, frame in steps.items()}
        question = "SELECT token, x, y, qw, qx, qy, qz, vx, vy, epsg FROM ego_pose WHERE token IN ({tokens})"
        seen: dict[int, Seen] = {}
        codes: set[int] = set()
        rows = self._database.rows_of("ego_pose", question, _EGO_KINDS, list(poses))
        for token, x, y, w, i, j, k, vx, vy, epsg in rows:
            if not 0.9 < w * w + i * i + j * j + k * k < 1.1:
                self._fault(f"ego_pose {token.hex()}: qw, qx, qy, qz are no rotation")
            yaw = float(np.arctan2(2.0 * (w * k + i * j), 1.0 - 2.0 * (j * j + k * k)))
            cos, sin, ahead_m = np.cos(yaw), np.sin(yaw), PACIFICA.rear_axle_to_center_m
            size = (PACIFICA.length_m, PACIFICA.width_m)
            codes.add(int(epsg))
            step = poses[token]
            seen[step] = (
                step, x + ahead_m * cos, y + ahead_m * sin, yaw, *size, cos * vx - sin * vy, sin * vx + cos * vy
            )  # fmt: skip
        if start not in seen:
            self._fault(f"lidar_pc {moment.token} has no ego_pose")
        known = sorted(seen)
        found = [known[rows] for _, rows in pieces(moment.token, np.array(known))]
        piece = next(each for each in found if each[0] <= start <= each[-1])
        if piece is not found[-1]:
            notes.append(f"The log has a hole after {(piece[-1] - start) * STEP_S:.1f} s; the recording ends there.")
        ego = self._track(moment.token, ActorKind.VEHICLE, [seen[step] for step in piece], "ego_pose")
        return self._crs(codes, notes), ego

    def _crs(self, codes: set[int], notes: list[str]) -> str:
        if len(codes) > 1:
            self._fault(f"ego_pose: epsg is both {' and '.join(map(str, sorted(codes)[:2]))}")
        said = f"EPSG:{codes.pop()}"
        known = LOCATIONS.get(self.map_name, said)
        if known != said:
            notes.append(f"The log says that its poses are in {said}; those of {self.map_name} are in {known}.")
        return known

    def _others(self, steps: dict[int, _Frame], notes: list[str]) -> Iterator[RecordedTrack]:
        step_of = {frame.token: step for step, frame in steps.items()}
        question = (
            "SELECT lidar_pc_token, track_token, x, y, yaw, length, width, vx, vy FROM lidar_box "
            "WHERE lidar_pc_token IN ({tokens})"
        )
        boxes: dict[bytes, list[Seen]] = {}
        for number, row in enumerate(self._database.rows_of("lidar_box", question, _BOX_KINDS, list(step_of)), start=1):
            if number > MOST_BOXES:
                self._fault(
                    f"lidar_box has more than {MOST_BOXES} rows in {len(steps)} sweeps; take a shorter duration"
                )
            sweep, track, *numbers = row
            boxes.setdefault(track, []).append((step_of[sweep], *numbers))  # type: ignore[arg-type]
        kind_of = self._kinds(list(boxes), notes)
        filled = cut = without = 0
        for token in sorted(boxes):
            rows = sorted(boxes[token], key=lambda row: row[0])
            found = pieces(token.hex(), np.array([row[0] for row in rows]))
            cut += len(found) - 1
            without += sum(None in row for row in rows) if kind_of[token] in MOVING else 0
            for id_, piece in found:
                track = self._track(id_, kind_of[token], rows[piece], "lidar_box")
                filled += len(track.poses) - len(rows[piece])
                yield track
        if without:
            notes.append(f"{without} boxes have no velocity; it is taken from the positions.")
        notes.extend(gap_notes(filled, cut))

    def _kinds(self, tokens: Sequence[bytes], notes: list[str]) -> dict[bytes, ActorKind]:
        """What each track is; a category that is not one of nuPlan's stands for things."""
        question = (
            "SELECT track.token, category.name FROM track JOIN category ON category.token = track.category_token "
            "WHERE track.token IN ({tokens})"
        )
        names: dict[bytes, str] = dict(self._database.rows_of("track", question, ("token", "text"), tokens))  # type: ignore[arg-type]
        for token in tokens:
            if token not in names:
                self._fault(f"lidar_box names track {token.hex()}, which has no row in track, or no category")
        strange = sorted({name for name in names.values() if name not in KINDS})
        if strange:
            notes.append(f"Road users of the unknown category {', '.join(strange[:5])} are taken for things.")
        return {token: KINDS.get(name, ActorKind.GENERIC_OBJECT) for token, name in names.items()}

    def _lights(self, steps: dict[int, _Frame], count: int) -> dict[str, Ints]:
        """The status of each connector by step; a step without a sweep shows what the one before did."""
        step_of = {frame.token: step for step, frame in steps.items() if step < count}
        question = (
            "SELECT lidar_pc_token, lane_connector_id, status FROM traffic_light_status "
            "WHERE lidar_pc_token IN ({tokens})"
        )
        found: dict[str, Ints] = {}
        rows = self._database.rows_of("traffic_light_status", question, ("token", "whole", "text"), list(step_of))
        for token, connector, status in rows:
            shown = found.setdefault(str(connector), np.full(count, SignalStatus.UNKNOWN, dtype=np.int64))
            shown[step_of[token]] = _LIGHTS.get(status.lower(), SignalStatus.UNKNOWN)
        for step in (step for step in range(1, count) if step not in steps):
            for shown in found.values():
                shown[step] = shown[step - 1]
        return dict(sorted(found.items()))

    def _track(self, id_: str, kind: ActorKind, rows: Sequence[Seen], table: str) -> RecordedTrack:
        """One track over consecutive steps, with the missing ones filled in."""
        columns = np.array(rows, dtype=np.float64)  # None becomes NaN
        seen = columns[:, 0]
        if (np.diff(seen) == 0).any():
            self._fault(f"{table}: track {id_} is twice in one sweep")
        if not (np.abs(columns[:, 1:3]) < MAX_COORDINATE_M).all():
            self._fault(f"{table}: x or y of track {id_} lies beyond {MAX_COORDINATE_M:g} m")
        length_m, width_m = (float(size) for size in np.median(columns[:, 4:6], axis=0))
        if not (0.0 < length_m < MAX_SIZE_M and 0.0 < width_m < MAX_SIZE_M):
            self._fault(f"{table}: track {id_} measures {length_m:g} x {width_m:g} m, which nothing does")
        steps, poses = bridged(seen, columns[:, 1:4])
        velocity = np.zeros((len(steps), 2))
        if kind in MOVING:
            velocity = _velocities(columns, steps, poses[:, :2])
        if not (np.hypot(*velocity.T) < MAX_SPEED_MPS).all():
            self._fault(f"{table}: track {id_} moves at more than {MAX_SPEED_MPS:g} m/s")
        return RecordedTrack(
            id=id_,
            kind=kind,
            length_m=length_m,
            width_m=width_m,
            first_step=int(seen[0]),
            poses=poses,
            velocity_mps=velocity,
            model=_model(length_m, width_m) if kind is ActorKind.VEHICLE else "car",
        )

    # --- the file ------------------------------------------------------------------------------

    def _log(self) -> tuple[str, str, str]:
        """Name, location and map of the log."""
        rows = list(self._database.rows("log", "SELECT logfile, location, map_version FROM log", ("text",) * 3))
        if len(rows) != 1:
            self._fault(f"log has {len(rows)} rows, expected one")
        ((name, location, map_name),) = rows
        for what, text in (("logfile", name), ("map_version", map_name)):
            if not re.fullmatch(r"[\w. -]{1,80}", text):
                self._fault(f"log: {what} is {text[:40]!r}, expected a name")
        return name, location, map_name.removesuffix(".gpkg")

    def _read_frames(self) -> list[_Frame]:
        """The sweeps in order of time."""
        question = "SELECT token, ego_pose_token, timestamp FROM lidar_pc ORDER BY timestamp, token"
        frames: list[_Frame] = []
        for row in self._database.rows("lidar_pc", question, ("token", "token", "whole")):
            frames.append(_Frame(*row))
            if len(frames) > MOST_FRAMES:
                self._fault(f"lidar_pc has more than {MOST_FRAMES} rows; it is no log of a drive")
        if not frames:
            self._fault("lidar_pc is empty; there is nothing to make a scene of")
        return frames

    def _fault(self, what: str) -> NoReturn:
        raise InputError(f"{self.path}: {what}")


def _velocities(columns: Floats, steps: Ints, positions: Floats) -> Floats:
    """(K, 2) recorded velocities, those that are missing from the change of place."""
    seen, known = columns[:, 0], np.isfinite(columns[:, 6:]).all(axis=1)
    moved = np.gradient(positions, axis=0) / STEP_S if len(positions) > 1 else np.zeros((1, 2))
    if not known.any():
        return moved
    velocity = np.stack([np.interp(steps, seen[known], columns[known, column]) for column in (6, 7)], axis=1)
    missing = np.isin(steps, seen[~known])
    velocity[missing] = moved[missing]
    return velocity


def _model(length_m: float, width_m: float) -> str:
    if length_m < MOTORCYCLE_M[0] and width_m < MOTORCYCLE_M[1]:
        return "motorcycle"
    return "bus" if length_m >= BUS_M else "truck" if length_m >= TRUCK_M else "car"


def log_files(sources: Iterable[Path]) -> list[Path]:
    """The `.db` files among files and folders, which are looked through to the bottom; InputError if there is none."""
    given = [Path(source) for source in sources]
    found = [file for source in given for file in (sorted(source.rglob("*.db")) if source.is_dir() else [source])]
    if not found:
        raise InputError(f"{', '.join(map(str, given))}: no .db file in there; nuPlan's logs are <name>.db")
    return found


def tokens_held(path: Path, tokens: Sequence[str]) -> set[str]:
    """Those of some tokens whose sweeps a log has; what is no token is in none. InputError as from `NuplanLog`."""
    wanted = [bytes.fromhex(token) for token in tokens if _TOKEN.fullmatch(token)]
    with Database(path) as database:
        question = "SELECT token FROM lidar_pc WHERE token IN ({tokens})"
        return {token.hex() for (token,) in database.rows_of("lidar_pc", question, ("token",), wanted)}
