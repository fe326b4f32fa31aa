"""Folder lock: one process at a time writes a run folder."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Final

from interplan_sumo.errors import RunFolderError

HELD: Final = (errno.EWOULDBLOCK, errno.EAGAIN, errno.EACCES, errno.EDEADLK)
"""Errors of a lock that somebody holds; others are of a file system that has no locks, for one."""


class FolderLock:
    """An exclusive lock that the system releases when its process ends, however it ends."""

    def __init__(self, path: Path) -> None:
        self._handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            _lock(self._handle)
        except OSError as error:
            if error.errno not in HELD:
                os.close(self._handle)
                raise
            owner = os.read(self._handle, 100).decode(errors="replace").strip()
            os.close(self._handle)
            raise RunFolderError(
                f"{path.parent} is in use by another run{f' (process {owner})' if owner else ''}; "
                "wait for it or give another folder as --out"
            ) from None
        os.ftruncate(self._handle, 0)
        os.write(self._handle, f"{os.getpid()}\n".encode())

    def release(self) -> None:
        """Give it back; the file stays, for deleting it could free a lock that somebody else just took."""
        if self._handle >= 0:
            os.close(self._handle)
            self._handle = -1


def _lock(handle: int) -> None:
    if os.name == "posix":
        import fcntl

        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    else:
        import msvcrt

        os.lseek(handle, 1 << 20, os.SEEK_SET)  # a byte beyond the text, so that others can read the process id
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
        os.lseek(handle, 0, os.SEEK_SET)
