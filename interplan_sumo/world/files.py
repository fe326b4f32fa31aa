"""Files as wholes: put in their place when they are complete, and told apart by their hash."""

from __future__ import annotations

import hashlib
import os
import secrets
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from interplan_sumo.errors import InputError

PART: Final = ".part-"
"""Names of files and folders that are being written begin so; a process that was killed may leave one behind."""
OTHER_FOLDER: Final = "give another folder as --out"
"""The way out where a folder cannot be written."""


@contextmanager
def replacing(path: Path) -> Generator[Path]:
    """A new name beside `path` to write a file to, which takes the place of `path` where the block ends.

    There is always either the old file or the new one, also after a power cut
    and with several writers at once; if the block raises, the old one stays.
    """
    fresh = path.with_name(f"{PART}{secrets.token_hex(8)}")
    try:
        yield fresh
        with fresh.open("rb+") as file:
            os.fsync(file.fileno())
        os.replace(fresh, path)
    finally:
        fresh.unlink(missing_ok=True)
    if os.name == "posix":
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


@contextmanager
def writing(what: object, way_out: str = "", kind: type[InputError] = InputError) -> Generator[None]:
    """Inside the block what the system refuses becomes one line: what cannot be written, why, and a way out."""
    try:
        yield
    except OSError as error:
        hint = f"; {way_out}" if way_out else ""
        raise kind(f"cannot write {what}: {error.strerror or error}{hint}") from None


def check_place(path: Path, way_out: str) -> None:
    """InputError if no file can be written at `path` for want of a folder, before long work whose result goes there."""
    if path.is_dir():
        raise InputError(f"cannot write {path}: it is a folder; {way_out}")
    if not path.parent.is_dir():
        raise InputError(f"cannot write {path}: there is no such folder; {way_out}")


def file_hash(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
