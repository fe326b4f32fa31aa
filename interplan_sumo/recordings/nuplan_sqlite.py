"""nuPlan's `.db` files as SQLite, opened to be read only and held against the schema before anything is asked."""

from __future__ import annotations

import math
import sqlite3
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Literal
from urllib.parse import quote

from interplan_sumo.errors import InputError

TOKEN_BYTES: Final = 8
LARGEST_VALUE_BYTES: Final = 1_000_000
"""Of one value; the longest of nuPlan is the list of a scene's roadblocks."""
_HEADER: Final = b"SQLite format 3\0"
_AT_ONCE: Final = 500
"""Tokens in one question; SQLite takes 999 at the least."""

Kind = Literal["token", "number", "number?", "whole", "text", "text?"]
"""What a column must hold; with a question mark NULL is welcome, too."""

SCHEMA: Final[dict[str, tuple[str, ...]]] = {
    "log": ("token", "logfile", "location", "map_version"),
    "ego_pose": ("token", "x", "y", "qw", "qx", "qy", "qz", "vx", "vy", "epsg"),
    "lidar_pc": ("token", "ego_pose_token", "timestamp"),
    "lidar_box": ("lidar_pc_token", "track_token", "x", "y", "width", "length", "vx", "vy", "yaw"),
    "track": ("token", "category_token"),
    "category": ("token", "name"),
    "scenario_tag": ("lidar_pc_token", "type"),
    "traffic_light_status": ("lidar_pc_token", "lane_connector_id", "status"),
}
"""What is read of nuPlan's tables; they hold more."""


class Database:
    """One file. Use as a context manager. Everything that it holds is checked before it is believed."""

    def __init__(self, path: Path) -> None:
        """InputError if it is no SQLite database, or lacks a table or column of `SCHEMA`."""
        self.path = path
        try:
            with path.open("rb") as file:
                header = file.read(len(_HEADER))
        except OSError as error:
            raise InputError(f"cannot read {path}: {error.strerror or error}") from None
        if header != _HEADER:
            raise InputError(f"{path} is no SQLite database; nuPlan's logs are called <date>_veh-<n>_<from>_<to>.db")
        try:
            # Immutable: no lock, no journal, no file beside it, on read-only disks, too.
            self._connection = sqlite3.connect(f"file:{quote(str(path.resolve()))}?mode=ro&immutable=1", uri=True)
            self._connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST_VALUE_BYTES)
            self._connection.text_factory = lambda data: data.decode("utf-8", "replace")
            self._connection.execute("PRAGMA trusted_schema = OFF")
        except sqlite3.Error as error:
            raise InputError(f"cannot open {path}: {error}") from None
        try:
            self._check_schema()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Database:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        self._connection.close()

    def rows(
        self, table: str, question: str, kinds: Sequence[Kind], values: Sequence[Any] = ()
    ) -> Iterator[tuple[Any, ...]]:
        """The answers to a question; InputError names table, column and row of a value of another kind.

        The columns are named in the question as they are to be named in the error.
        """
        try:
            cursor = self._connection.execute(question, values)
            names = [column[0] for column in cursor.description]
            for number, row in enumerate(cursor, start=1):
                for name, kind, value in zip(names, kinds, row, strict=True):
                    if (wrong := _wrong(value, kind)) is not None:
                        raise InputError(f"{self.path}: {table}: {name} of row {number} is {wrong}")
                yield row
        except (sqlite3.Error, UnicodeDecodeError, OverflowError) as error:  # names in it may be no text
            why = " ".join(str(error).split())[:100]
            raise InputError(f"{self.path}: {table} cannot be read ({why}); the file is damaged") from None

    def rows_of(
        self, table: str, question: str, kinds: Sequence[Kind], tokens: Sequence[bytes]
    ) -> Iterator[tuple[Any, ...]]:
        """The answers for many tokens, which take the place of {tokens} in the question."""
        for begin in range(0, len(tokens), _AT_ONCE):
            part = tokens[begin : begin + _AT_ONCE]
            yield from self.rows(table, question.format(tokens=", ".join("?" * len(part))), kinds, part)

    def _check_schema(self) -> None:
        for table, wanted in SCHEMA.items():
            # A view could ask for anything; nuPlan has none.
            found = [kind for (kind,) in self.rows(
                "sqlite_master", "SELECT type FROM sqlite_master WHERE name = ?", ("text",), (table,)
            )]  # fmt: skip
            if found != ["table"]:
                raise InputError(f"{self.path}: there is no table {table}; it is no log of nuPlan")
            columns = {
                name for (name,) in self.rows(table, f"SELECT name FROM pragma_table_info('{table}')", ("text",))
            }
            missing = [name for name in wanted if name not in columns]
            if missing:
                raise InputError(f"{self.path}: table {table} has no column {missing[0]}; it is no log of nuPlan v1.1")


def _wrong(value: Any, kind: Kind) -> str | None:
    """What is wrong with a value; None if it is of the kind."""
    if value is None:
        return None if kind.endswith("?") else f"NULL, expected {_EXPECTED[kind]}"
    match kind:
        case "token":
            right = isinstance(value, bytes) and len(value) == TOKEN_BYTES
        case "number" | "number?":
            right = isinstance(value, int | float) and math.isfinite(value)
        case "whole":
            right = isinstance(value, int)
        case "text" | "text?":
            right = isinstance(value, str)
    return None if right else f"{_brief(value)}, expected {_EXPECTED[kind]}"


_EXPECTED: Final[dict[str, str]] = {
    "token": f"a blob of {TOKEN_BYTES} bytes",
    "number": "a number",
    "number?": "a number",
    "whole": "a whole number",
    "text": "text",
    "text?": "text",
}


def _brief(value: Any) -> str:
    if isinstance(value, bytes):
        return f"a blob of {len(value)} bytes"
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."
