"""nuPlan logs for tests: small databases in nuPlan's schema, of cars that go straight at one speed."""

from __future__ import annotations

import math
import sqlite3
from collections.abc import Generator, Iterable, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

from interplan_sumo.maps.geopackage_writer import write_map
from interplan_sumo.maps.store import write_maps_manifest
from interplan_sumo.tiny_worlds import junction

FRAME_US = 50_000
"""20 Hz."""
BEGIN_US = 1_620_857_932_951_227
MAP = "tiny-town"
EPSG = 32632
"""Of the tiny worlds."""
ROADS = junction(arm_m=150.0)
X_M, Y_M = (float(value) for value in ROADS["1"].centerline.points[0])
"""Where lane 1 begins, which leads straight on over connector 13 to lane 7."""

TABLES = {
    "log": "token BLOB PRIMARY KEY, vehicle_name VARCHAR, date VARCHAR, timestamp INTEGER, logfile VARCHAR, "
    "location VARCHAR, map_version VARCHAR",
    "ego_pose": "token BLOB PRIMARY KEY, timestamp INTEGER, x FLOAT, y FLOAT, z FLOAT, qw FLOAT, qx FLOAT, qy FLOAT, "
    "qz FLOAT, vx FLOAT, vy FLOAT, vz FLOAT, acceleration_x FLOAT, acceleration_y FLOAT, acceleration_z FLOAT, "
    "angular_rate_x FLOAT, angular_rate_y FLOAT, angular_rate_z FLOAT, epsg INTEGER, log_token BLOB",
    "lidar": "token BLOB PRIMARY KEY, log_token BLOB, channel VARCHAR, model VARCHAR, translation BLOB, rotation BLOB",
    "lidar_pc": "token BLOB PRIMARY KEY, next_token BLOB, prev_token BLOB, ego_pose_token BLOB, lidar_token BLOB, "
    "scene_token BLOB, filename VARCHAR, timestamp INTEGER",
    "lidar_box": "token BLOB PRIMARY KEY, lidar_pc_token BLOB, track_token BLOB, next_token BLOB, prev_token BLOB, "
    "x FLOAT, y FLOAT, z FLOAT, width FLOAT, length FLOAT, height FLOAT, vx FLOAT, vy FLOAT, vz FLOAT, yaw FLOAT, "
    "confidence FLOAT",
    "track": "token BLOB PRIMARY KEY, category_token BLOB, width FLOAT, length FLOAT, height FLOAT",
    "category": "token BLOB PRIMARY KEY, name VARCHAR, description VARCHAR",
    "scene": "token BLOB PRIMARY KEY, log_token BLOB, name VARCHAR, goal_ego_pose_token BLOB, roadblock_ids VARCHAR",
    "scenario_tag": "token BLOB PRIMARY KEY, lidar_pc_token BLOB, type VARCHAR, agent_track_token BLOB",
    "traffic_light_status": "token BLOB PRIMARY KEY, lidar_pc_token BLOB, lane_connector_id INTEGER, status VARCHAR",
}
"""nuPlan v1.1."""
CATEGORIES = ("vehicle", "bicycle", "pedestrian", "traffic_cone", "barrier", "czone_sign", "generic_object")
LOG, LIDAR, SCENE = b"log00000", b"lidar000", b"scene000"


@dataclass(frozen=True)
class Goes:
    """Somebody who goes straight from a place at one speed."""

    x_m: float
    y_m: float
    heading_rad: float = 0.0
    speed_mps: float = 0.0
    category: str = "vehicle"
    size_m: tuple[float, float] = (4.6, 1.85)
    frames: Sequence[int] | None = None
    """None: all."""

    def at(self, frame: int) -> tuple[float, float]:
        gone_m = self.speed_mps * frame * FRAME_US / 1e6
        return self.x_m + gone_m * math.cos(self.heading_rad), self.y_m + gone_m * math.sin(self.heading_rad)

    @property
    def velocity_mps(self) -> tuple[float, float]:
        return self.speed_mps * math.cos(self.heading_rad), self.speed_mps * math.sin(self.heading_rad)


def maps_root(folder: Path, *names: str) -> Path:
    """nuPlan's maps as a user has them: without SUMO networks."""
    for name in names or (MAP,):
        there = folder / "maps" / name / "9.1.1"
        there.mkdir(parents=True)
        write_map(ROADS, there / "map.gpkg")
    write_maps_manifest(folder / "maps")
    return folder / "maps"


def token(kind: str, number: int) -> bytes:
    """8 bytes that say what they stand for."""
    return kind[:2].encode() + number.to_bytes(6, "big")


def sweep(frame: int) -> str:
    """The token of a sweep, as nuPlan names scenarios."""
    return token("pc", frame).hex()


def track_id(number: int) -> str:
    return token("tr", number).hex()


def write_log(
    path: Path,
    ego: Goes,
    others: Iterable[Goes] = (),
    *,
    frames: int = 401,
    lights: Mapping[int, Mapping[int, str]] | None = None,
    tags: Mapping[int, str] | None = None,
    map_name: str = MAP,
    missing: Iterable[int] = (),
    change: Iterable[str] = (),
) -> Path:
    """A log. `ego` is at its rear axle; `lights` are connector -> frame -> status, `missing` frames without a sweep.

    `change` are statements that spoil it.
    """
    gone = set(missing)
    seen = [frame for frame in range(frames) if frame not in gone]
    with new_log(path, map_name) as tables:
        insert(tables, "scene", [(SCENE, LOG, "scene-001", token("ep", seen[-1]), "1 13 7")])
        insert(tables, "ego_pose", [_pose(ego, frame) for frame in seen])
        insert(tables, "lidar_pc", [_sweep(frame, frames) for frame in seen])
        for number, other in enumerate(others):
            kind = CATEGORIES.index(other.category)
            length_m, width_m = other.size_m
            insert(tables, "track", [(token("tr", number), token("ca", kind), width_m, length_m, 1.5)])
            there = [frame for frame in (other.frames or range(frames)) if frame not in gone]
            insert(tables, "lidar_box", [_box(number, other, frame) for frame in there])
        rows = [(c, f, s) for c, by_frame in (lights or {}).items() for f, s in by_frame.items()]
        insert(
            tables,
            "traffic_light_status",
            [
                (token("tl", i), token("pc", frame), connector, status)
                for i, (connector, frame, status) in enumerate(rows)
            ],
        )
        tagged = enumerate((tags or {}).items())
        insert(tables, "scenario_tag", [(token("st", i), token("pc", f), name, None) for i, (f, name) in tagged])
        for statement in change:
            tables.execute(statement)
    return path


@contextmanager
def new_log(path: Path, map_name: str) -> Generator[sqlite3.Connection]:
    """A database with nuPlan's tables, and what every log has in them."""
    with closing(sqlite3.connect(path)) as tables:
        for name, columns in TABLES.items():
            tables.execute(f"CREATE TABLE {name} ({columns})")
        insert(tables, "log", [(LOG, "veh-1", "2021-05-12", BEGIN_US, path.stem, "tiny", map_name)])
        insert(tables, "lidar", [(LIDAR, LOG, "MergedPointCloud", "", b"", b"")])
        insert(tables, "category", [(token("ca", i), name, "") for i, name in enumerate(CATEGORIES)])
        yield tables
        tables.commit()


def insert(tables: sqlite3.Connection, table: str, rows: Sequence[tuple[object, ...]]) -> None:
    if rows:
        tables.executemany(f"INSERT INTO {table} VALUES ({', '.join('?' * len(rows[0]))})", rows)


def _pose(ego: Goes, frame: int) -> tuple[object, ...]:
    half = ego.heading_rad / 2.0
    turned = (math.cos(half), 0.0, 0.0, math.sin(half))
    still = (0.0,) * 6
    velocity = (ego.speed_mps, 0.0, 0.0)  # in the frame of the car
    return (token("ep", frame), _time_us(frame), *ego.at(frame), 0.0, *turned, *velocity, *still, EPSG, LOG)


def _sweep(frame: int, frames: int) -> tuple[object, ...]:
    after = token("pc", frame + 1) if frame + 1 < frames else None
    before = token("pc", frame - 1) if frame else None
    return (token("pc", frame), after, before, token("ep", frame), LIDAR, SCENE, f"{frame}.pcd", _time_us(frame))


def _box(number: int, other: Goes, frame: int) -> tuple[object, ...]:
    (length_m, width_m), (vx, vy) = other.size_m, other.velocity_mps
    own = token("lb", number * 100_000 + frame)
    return (
        own, token("pc", frame), token("tr", number), None, None,
        *other.at(frame), 0.0, width_m, length_m, 1.5, vx, vy, 0.0, other.heading_rad, 1.0,
    )  # fmt: skip


def _time_us(frame: int) -> int:
    """Times jitter by less than a tenth of a millisecond, as nuPlan's do."""
    return BEGIN_US + frame * FRAME_US + (37 * frame) % 90
