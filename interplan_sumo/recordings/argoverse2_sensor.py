"""Argoverse 2 sensor logs: `read_argoverse2_sensor_log` makes a `Recording` of the boxes in them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
import pyarrow as pa
from pyarrow import feather

from interplan_sumo.errors import InputError
from interplan_sumo.recordings.formats import RecordingFormat
from interplan_sumo.recordings.gaps import bridged, gap_notes, pieces
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.argoverse_frame import argoverse_name, city_frame, find_city
from interplan_sumo.world.geometry import Floats, Ints, wrap_angle
from interplan_sumo.world.recording import RecordedTrack, Recording

STEP_S: Final = 0.1
"""Boxes are drawn for every sweep of the lidar, ten a second."""
POSES: Final = "city_SE3_egovehicle.feather"
BOXES: Final = "annotations*.feather"
MAPS: Final = "log_map_archive_*.json"
EGO_CATEGORY: Final = "EGO_VEHICLE"
EGO_ID: Final = "ego"
"""Of the car that measured, where the boxes leave it out, as those that are published do."""
EGO_SIZE_M: Final = (4.877, 2.0)
"""Length and width of the Ford Fusion Hybrid that measured, as the boxes of logs that hold it have them."""
REAR_AXLE_TO_CENTER_M: Final = 1.339
"""Of the same car, as py123d has it (`av2_ford_fusion_hybrid`): its frame begins at the rear axle."""
MAX_FILE_BYTES: Final = 500 * 2**20
MAX_ROWS: Final = 5_000_000
MAX_LASTS_S: Final = 3600.0
LARGEST_M: Final = 40.0
_TURNS: Final = ("qw", "qx", "qy", "qz")
_PLACES: Final = ("tx_m", "ty_m")
_HEAVY: Final = {"BUS": "bus", "SCHOOL_BUS": "bus", "ARTICULATED_BUS": "bus", "MOTORCYCLE": "motorcycle"}
_TRUCKS: Final = ("TRUCK", "BOX_TRUCK", "TRUCK_CAB", "LARGE_VEHICLE", "VEHICULAR_TRAILER")
_KINDS: Final = {
    "PEDESTRIAN": ActorKind.PEDESTRIAN, "OFFICIAL_SIGNALER": ActorKind.PEDESTRIAN, "BICYCLIST": ActorKind.BICYCLE,
    "CONSTRUCTION_CONE": ActorKind.TRAFFIC_CONE, "CONSTRUCTION_BARREL": ActorKind.TRAFFIC_CONE,
    "REGULAR_VEHICLE": ActorKind.VEHICLE, "MOTORCYCLIST": ActorKind.VEHICLE, EGO_CATEGORY: ActorKind.VEHICLE,
    **dict.fromkeys((*_HEAVY, *_TRUCKS), ActorKind.VEHICLE), "MOTORCYCLE": ActorKind.GENERIC_OBJECT,
}  # fmt: skip
"""What becomes of a category; of any other: a thing. A motorcycle without a rider is one."""


def read_argoverse2_sensor_log(path: Path) -> Recording:
    """The boxes of a log's folder, in the frame of its map; InputError for a log that cannot be used.

    Boxes of the set lie in the frame of the car that measured; its poses take
    them to the city. That car is a track, too, also where no box is of it.
    Gaps of up to 0.5 s are filled, as for other recordings.
    """
    folder = Path(path) if Path(path).is_dir() else Path(path).parent
    file = Path(path) if Path(path).is_file() else _only(folder, BOXES)
    poses = _table(_only(folder, POSES), ("timestamp_ns",)).drop_duplicates("timestamp_ns").set_index("timestamp_ns")
    boxes = _table(file, ("timestamp_ns", "track_uuid", "category", "length_m", "width_m"))
    lasts_s = (boxes["timestamp_ns"].max() - boxes["timestamp_ns"].min()) / 1e9
    if lasts_s > MAX_LASTS_S:
        raise InputError(f"{folder}: lasts {lasts_s:.0f} s, expected an hour at most")
    boxes, notes = _with_ego(boxes, poses)
    city = _city(folder)
    crs, origin_m = city_frame(city)
    step = np.round((boxes["timestamp_ns"] - boxes["timestamp_ns"].min()).to_numpy() / 1e9 / STEP_S).astype(np.int64)
    found = boxes.assign(step=step, **_in_city(folder, boxes, poses, origin_m))
    found = found.sort_values(["track_uuid", "step"], kind="stable").drop_duplicates(["track_uuid", "step"])
    filled = cut = 0
    tracks: list[RecordedTrack] = []
    for id_, rows in found.groupby("track_uuid", sort=True):
        made = list(_tracks(str(id_), rows))
        tracks += made
        filled += sum(len(each.poses) for each in made) - len(rows)
        cut += len(made) - 1
    ego = found.loc[found["category"] == EGO_CATEGORY, "track_uuid"]
    return Recording(
        name=argoverse_name(city, folder.name),
        crs=crs,
        step_s=STEP_S,
        tracks=tuple(tracks),
        ego_id=str(ego.iloc[0]) if len(ego) else None,
        notes=(*notes, *gap_notes(filled, cut)),
    )


def _with_ego(boxes: pd.DataFrame, poses: pd.DataFrame) -> tuple[pd.DataFrame, list[str]]:
    """The boxes with one of the car that measured, its middle where that lies in its own frame, and what was added.

    Where there is none it is at the pose nearest to each step, from the first of the boxes to the last.
    """
    own = boxes["category"] == EGO_CATEGORY
    if own.any():
        return boxes.assign(tx_m=boxes["tx_m"].mask(own & (boxes["tx_m"] == 0.0), REAR_AXLE_TO_CENTER_M)), []
    first_ns, last_ns = boxes["timestamp_ns"].min(), boxes["timestamp_ns"].max()
    step_ns = round(STEP_S * 1e9)
    times_ns = poses.index.sort_values()
    nearest = times_ns.get_indexer(
        pd.Index(np.arange(first_ns, last_ns + 1, step_ns)), method="nearest", tolerance=step_ns // 2
    )
    added = pd.DataFrame({"timestamp_ns": times_ns[np.unique(nearest[nearest >= 0])]}).assign(
        track_uuid=EGO_ID,
        category=EGO_CATEGORY,
        length_m=EGO_SIZE_M[0],
        width_m=EGO_SIZE_M[1],
        **dict(zip((*_TURNS, *_PLACES), (1.0, 0.0, 0.0, 0.0, REAR_AXLE_TO_CENTER_M, 0.0), strict=True)),
    )
    note = f"The boxes leave out the car that measured; it is the track {EGO_ID}, as its poses tell."
    return pd.concat([boxes, added], ignore_index=True), [note]


def _tracks(id_: str, rows: pd.DataFrame) -> Iterator[RecordedTrack]:
    category = str(rows["category"].iloc[0])
    poses = rows[["x_m", "y_m", "heading_rad"]].to_numpy(np.float64)
    seen: Ints = rows["step"].to_numpy(np.int64)
    for name, part in pieces(id_, seen):
        steps, whole = bridged(seen[part], poses[part])
        moved = np.gradient(whole[:, :2], axis=0) / STEP_S if len(steps) > 1 else np.zeros((1, 2))
        yield RecordedTrack(
            id=name,
            kind=_KINDS.get(category, ActorKind.GENERIC_OBJECT),
            length_m=float(rows["length_m"].median()),
            width_m=float(rows["width_m"].median()),
            first_step=int(steps[0]),
            poses=whole,
            velocity_mps=moved,
            model="motorcycle"
            if category == "MOTORCYCLIST"
            else _HEAVY.get(category, "car")
            if category not in _TRUCKS
            else "truck",
        )


def _in_city(
    folder: Path, boxes: pd.DataFrame, poses: pd.DataFrame, origin_m: tuple[float, float]
) -> dict[str, Floats]:
    """Middles and headings of boxes, taken from the frame of the car to that of the map."""
    missing = ~boxes["timestamp_ns"].isin(poses.index)
    if missing.any():
        raise InputError(f"{folder}: {POSES} has no pose at {boxes.loc[missing, 'timestamp_ns'].iloc[0]} ns")
    car = poses.loc[boxes["timestamp_ns"]]
    turn_rad = _yaw_rad(car)
    x_m, y_m = (boxes[name].to_numpy(np.float64) for name in _PLACES)
    at_m = [car[name].to_numpy(np.float64) + origin for name, origin in zip(_PLACES, origin_m, strict=True)]
    return {
        "x_m": at_m[0] + x_m * np.cos(turn_rad) - y_m * np.sin(turn_rad),
        "y_m": at_m[1] + x_m * np.sin(turn_rad) + y_m * np.cos(turn_rad),
        "heading_rad": np.asarray(wrap_angle(_yaw_rad(boxes) + turn_rad), np.float64),
    }


def _yaw_rad(table: pd.DataFrame) -> Floats:
    w, x, y, z = (table[name].to_numpy(np.float64) for name in _TURNS)
    return np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def _table(path: Path, columns: tuple[str, ...]) -> pd.DataFrame:
    """The columns, poses and places besides, of a feather file; every number is finite, every size one that can be."""
    wanted = [*columns, *_TURNS, *_PLACES]
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise InputError(f"{path}: the file is larger than {MAX_FILE_BYTES >> 20} MB; it is no log")
        table = feather.read_table(path, columns=None, memory_map=False, use_threads=False)
        missing = [name for name in wanted if name not in table.column_names]
        if missing:
            raise InputError(f"{path}: column {missing[0]} is missing; it is no sensor log of Argoverse 2")
        if not 0 < len(table) <= MAX_ROWS:
            raise InputError(f"{path}: has {len(table)} rows, expected 1 to {MAX_ROWS}")
        frame: pd.DataFrame = table.select(wanted).to_pandas()
        numbers = [name for name in wanted if name not in ("track_uuid", "category", "timestamp_ns")]
        frame = frame.astype({"timestamp_ns": np.int64, **dict.fromkeys(numbers, np.float64)})
    except (OSError, pa.ArrowException, ValueError, TypeError) as error:
        raise InputError(f"{path}: cannot be read ({' '.join(str(error).split())[:120]})") from None
    sizes = frame[[name for name in ("length_m", "width_m") if name in columns]].to_numpy(np.float64)
    fine = np.isfinite(frame[numbers].to_numpy(np.float64)).all(axis=1) & ((sizes > 0.0) & (sizes < LARGEST_M)).all(
        axis=1
    )
    if not fine.all():
        raise InputError(f"{path}: row {int(np.argmin(fine))} holds a number that cannot be")
    return frame


def _only(folder: Path, pattern: str) -> Path:
    files = sorted(folder.glob(pattern))
    if not files:
        raise InputError(f"{folder}: holds no {pattern}; a sensor log of Argoverse 2 does")
    if len(files) > 1:
        raise InputError(f"{folder}: holds {', '.join(file.name for file in files)}; name one of them")
    return files[0]


def _city(folder: Path) -> str:
    """The name of the map archive says it: `log_map_archive_<log>____PIT_city_<number>.json`."""
    for file in (*sorted(folder.glob(MAPS)), *sorted((folder / "map").glob(MAPS))):
        code = file.stem.partition("____")[2].partition("_")[0]
        if code:
            return find_city(code).name
    raise InputError(f"{folder}: no {MAPS} in it or in map/ says which city it is in")


def _is_log(path: Path) -> bool:
    folder = path if path.is_dir() else path.parent
    boxes = path.is_dir() or path.match(BOXES)
    return boxes and (folder / POSES).is_file() and any(folder.glob(BOXES))


FORMAT = RecordingFormat("a sensor log of Argoverse 2", _is_log, read_argoverse2_sensor_log, is_folder=True)
