"""XML files that others wrote: plain or gzipped, without entities, and with one clear line for damage."""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, cast
from xml.etree.ElementTree import Element, ParseError

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import iterparse

from interplan_sumo.errors import MapError

_GZIP_MAGIC = b"\x1f\x8b"
LONGEST_PIECE_BYTES = 2**20
"""What may lie between two "<": the parser reads an unfinished tag anew with each chunk, at a quadratic cost."""
QUOTED = 60
"""So many letters of what a damaged file holds are quoted."""
DEEPEST = 100
"""Elements within elements; no format has more than a dozen, and SUMO's own readers slow down with their square."""


def elements(path: Path, *roots: str) -> Generator[Element]:
    """The root element as it opens, then each of its children, complete; the tree lets go of a child after its turn.

    MapError names the file if it is missing or damaged, has another root than one of `roots` (whatever its namespace),
    declares a document type or entities, or goes beyond `DEEPEST` or `LONGEST_PIECE_BYTES`.
    """
    with _damage_named(path), _opened(path) as stream:
        depth, top = 0, None
        for event, element in iterparse(stream, events=("start", "end"), forbid_dtd=True):
            depth += 1 if event == "start" else -1
            if depth > DEEPEST:
                raise MapError(f"{path}: elements lie more than {DEEPEST} deep within each other; look at the file")
            if top is None:
                if local_name(element.tag) not in roots:
                    expected = " or ".join(f"<{root}>" for root in roots)
                    name = local_name(element.tag)[:QUOTED]
                    raise MapError(f"{path}: its root is <{name}>, expected {expected}; give such a file")
                top = element
                yield element
            elif event == "end" and depth == 1:
                yield element
                top.remove(element)


def local_name(tag: str) -> str:
    """The name of an element without its namespace."""
    return tag.rpartition("}")[2]


def root_of(path: Path) -> str | None:
    """The name of the root element; None of what is missing, damaged or no XML."""
    try:
        with _damage_named(path), _opened(path) as stream:
            return next((element.tag for _, element in iterparse(stream, events=("start",), forbid_dtd=True)), None)
    except MapError:
        return None


@contextmanager
def _damage_named(path: Path) -> Generator[None]:
    try:
        yield
    except FileNotFoundError:
        raise MapError(f"no file at {path}; check the path") from None
    except DefusedXmlException as error:
        what = "declares a document type or entities, which are refused"
        raise MapError(f"{path}: {what}; save it again without them") from error
    except (ParseError, EOFError, zlib.error, gzip.BadGzipFile, UnicodeError, LookupError, ValueError) as error:
        raise MapError(f"{path}: the file is damaged ({str(error)[:QUOTED]}); copy or download it again") from error
    except OSError as error:
        raise MapError(f"{path}: the file cannot be read ({error})") from error


def is_zipped(path: Path) -> bool:
    """Whether a file is gzipped, whatever its name."""
    with path.open("rb") as stream:
        return stream.read(len(_GZIP_MAGIC)) == _GZIP_MAGIC


class _ShortPieces:
    """A stream for the parser that ends in a MapError where a tag or a text is too long to be read in good time."""

    def __init__(self, path: Path, stream: IO[bytes]) -> None:
        self._path, self._stream, self._since = path, stream, 0

    def read(self, size: int = -1) -> bytes:
        chunk = self._stream.read(size)
        opened = chunk.rfind(b"<")
        self._since = len(chunk) - opened if opened >= 0 else self._since + len(chunk)
        if self._since > LONGEST_PIECE_BYTES:
            limit = f"more than {LONGEST_PIECE_BYTES // 2**20} MiB long"
            raise MapError(f"{self._path}: a tag or a text is {limit}; split it or look at the file")
        return chunk


@contextmanager
def _opened(path: Path) -> Generator[IO[bytes]]:
    with cast(IO[bytes], gzip.open(path)) if is_zipped(path) else path.open("rb") as stream:
        yield cast(IO[bytes], _ShortPieces(path, stream))
