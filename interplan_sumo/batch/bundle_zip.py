"""Bundle zip: a zip archive of a few kinds of small files, the same bytes for the same contents, read with suspicion.

Nothing is unpacked by its name: a reader asks for names that it knows, and gets no more bytes than it allows.
"""

from __future__ import annotations

import contextlib
import zipfile
from collections.abc import Generator, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from interplan_sumo.errors import InputError, clean_line
from interplan_sumo.world.files import replacing, writing

MOST_BYTES: Final = 1 << 30
"""Of an archive."""
MOST_UNPACKED: Final = 4 << 30
"""Of all its files together."""
MOST_FILES: Final = 60_000
_END: Final = b"PK\5\6"
_END_BYTES: Final = 22
_END_64: Final = b"PK\6\7"
_END_64_BYTES: Final = 20
_MOST_DIRECTORY: Final = 32 << 20
_DATE: Final = (1980, 1, 1, 0, 0, 0)
_ENCRYPTED: Final = 1
_KNOWN: Final = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)


def write_zip(path: Path, files: Iterable[tuple[str, bytes]]) -> None:
    """Write an archive in place of what was there; the same names and contents give the same bytes.

    InputError if it cannot be written, or would be larger than what is read.
    """
    too_large = InputError(f"{path} would be larger than what is taken; hand in fewer seeds")
    with writing(path, "give another file as --out"), replacing(path) as fresh:
        with zipfile.ZipFile(fresh, "w") as archive:
            total = 0
            for number, (name, content) in enumerate(files, start=1):
                about = zipfile.ZipInfo(name, _DATE)
                about.compress_type = zipfile.ZIP_DEFLATED
                about.create_system = 3
                about.external_attr = 0o644 << 16
                total += len(content)
                if number > MOST_FILES or total > MOST_UNPACKED or archive.start_dir > MOST_BYTES:
                    raise too_large
                archive.writestr(about, content, compresslevel=6)
        if fresh.stat().st_size > MOST_BYTES:
            raise too_large


@dataclass(frozen=True, slots=True)
class ZipFiles:
    """The files of an archive, as its directory names them."""

    path: Path
    _archive: zipfile.ZipFile
    _held: dict[str, zipfile.ZipInfo]

    @property
    def names(self) -> frozenset[str]:
        return frozenset(self._held)

    def read(self, name: str, most_bytes: int) -> bytes:
        """A file's content; InputError if it is not there, damaged or larger than that."""
        about = self._held.get(name)
        if about is None:
            raise InputError(f"{self.path} is no whole bundle: {name} is missing")
        if about.file_size > most_bytes:
            raise InputError(f"{self.path}: {name} has {about.file_size} bytes, at most {most_bytes} are taken")
        with _blamed(self.path), self._archive.open(about) as file:
            return file.read(most_bytes)  # no more than its directory says, and that with the right checksum


@contextlib.contextmanager
def open_zip(path: Path) -> Generator[ZipFiles]:
    """An archive, if its directory is one that can be trusted with memory; InputError otherwise, in one line."""
    with _blamed(path):
        _check_directory(path)
        archive = zipfile.ZipFile(path)
    with archive:
        held: dict[str, zipfile.ZipInfo] = {}
        for about in archive.infolist():
            shown = clean_line(about.filename, 100)
            parts = about.filename.replace("\\", "/").split("/")
            if ".." in parts or not parts[0] or ":" in parts[0] or "\\" in about.filename:
                raise InputError(f"{path} is no bundle: {shown!r} would lie outside of it")
            if about.filename in held:
                raise InputError(f"{path} is no bundle: {shown!r} is in it twice")
            if about.flag_bits & _ENCRYPTED or about.compress_type not in _KNOWN:
                raise InputError(f"{path} is no bundle: {shown!r} is packed in another way")
            held[about.filename] = about
        total = sum(about.file_size for about in held.values())
        if total > MOST_UNPACKED:
            raise InputError(f"{path} would unpack to {total / 2**30:.1f} GiB, at most {MOST_UNPACKED >> 30} are taken")
        yield ZipFiles(path, archive, held)


def _check_directory(path: Path) -> None:
    """Look at the end of the archive before a library does: what that says of its directory is read into memory."""
    size = path.stat().st_size
    if not path.is_file() or size < _END_BYTES:
        raise zipfile.BadZipFile("there is no archive")
    if size > MOST_BYTES:
        raise zipfile.BadZipFile(f"it has {size / 2**30:.1f} GiB, at most {MOST_BYTES >> 30} are taken")
    with path.open("rb") as file:
        file.seek(max(0, size - _END_BYTES - _END_64_BYTES))
        tail = file.read()
    end = tail[-_END_BYTES:]
    if end[:4] != _END or end[-2:] != b"\0\0" or tail[:-_END_BYTES].startswith(_END_64):
        raise zipfile.BadZipFile("it does not end as a bundle does")
    files, directory_bytes = int.from_bytes(end[10:12], "little"), int.from_bytes(end[12:16], "little")
    if files > MOST_FILES or directory_bytes > _MOST_DIRECTORY:
        raise zipfile.BadZipFile(f"it holds {files} files, at most {MOST_FILES} are taken")


@contextlib.contextmanager
def _blamed(path: Path) -> Generator[None]:
    """Whatever a file holds instead of an archive becomes an InputError that names it."""
    try:
        yield
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    except Exception as error:  # zipfile and zlib have many
        raise InputError(f"{path} is no bundle: {clean_line(str(error), 200)}") from None
