"""Run folder: everything a run leaves behind, in an order that no kill can spoil.

| file | what |
|---|---|
| manifest.json | what was asked for and with which versions; replaced as a whole |
| results.jsonl | one line per finished job, appended and synced by the one parent that holds `lock` |
| results/ | a flat copy of it in Parquet, made from it now and then and at the end |
| traces/<scenario>/<planner>/seed<k>/ | four Parquet files and scenario.json, renamed into place when complete |
| redo.json | only until all have driven whose drives were to be done again: their hashes |
| traffic/, profile.yaml | only for a run with a vehicle-type file or scoring profile of the user's: that |
| scenarios.yaml, experts/ | only for one's own scenarios: these, and the drives that progress is measured against |
| maps/ | only for one's own scenarios: the maps that came along with them |

A folder name is the id or planner with every run of other characters than
letters, digits, dot and hyphen as one `_`, at most 60 of them, a hyphen, and the first
sixteen hexadecimal digits of the SHA-256 of the unchanged text: readable, and
never two things in one folder.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import re
import shutil
from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final, Self

from msgspec import json, structs

from interplan_sumo.batch.briefs import Brief
from interplan_sumo.batch.folder_lock import FolderLock
from interplan_sumo.batch.pieces import keep_pieces
from interplan_sumo.batch.records import (
    FORMAT,
    JobKey,
    Manifest,
    ManifestFormat,
    PlannerRecord,
    RecordError,
    RequestedJobs,
    Row,
    decode,
    encode,
    keys_of,
)
from interplan_sumo.batch.redo import Redo
from interplan_sumo.batch.results import (
    LINES_AT_ONCE,
    RESULTS,
    StoredRows,
    briefs_of,
    read_briefs,
    storable,
    write_lines,
)
from interplan_sumo.batch.same_benchmark import run_difference
from interplan_sumo.errors import InputError, RunFolderError
from interplan_sumo.maps.store import MapFiles, copy_map
from interplan_sumo.metrics.profile import Profile, keep_profile
from interplan_sumo.planner_source import changed_files
from interplan_sumo.scenario.files import MAPS, scenario_text
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.files import PART, replacing

MANIFEST = "manifest.json"
OWN_SCENARIOS = "scenarios.yaml"
TRAFFIC = "traffic"
"""Holds a vehicle-type file; so it does beside the run folders of a sweep."""
STAYING = ("lock", "traces")
"""What a folder may hold that is no run folder yet."""
_BINARY: Final[int] = getattr(os, "O_BINARY", 0)
"""Windows else writes other line ends than it is given."""


def slug(text: str) -> str:
    """A folder name for an id or a planner, as the module's docstring says."""
    readable = re.sub(r"[^A-Za-z0-9.-]+", "_", text)[:60].strip("._") or "_"
    return f"{readable}-{hashlib.sha256(text.encode()).hexdigest()[:16]}"


def trace_place(key: JobKey) -> str:
    """Where the trace of a job lies, relative to the run folder."""
    scenario, planner, seed = key
    return f"traces/{slug(scenario)}/{slug(planner)}/seed{seed}"


@dataclass(frozen=True, slots=True)
class StoredRun:
    """A run folder as it was read."""

    path: Path
    manifest: Manifest
    rows: Mapping[JobKey, Row]
    """By job, the latest of each; those of a folder are read when they are asked for."""

    @property
    def keys(self) -> list[JobKey]:
        """Every job that was asked for."""
        return self.manifest.keys

    @property
    def planners(self) -> list[str]:
        """Those that it was asked for, in order."""
        return list(dict.fromkeys(planner for request in self.manifest.requests for planner in request.planners))

    @property
    def missing(self) -> list[JobKey]:
        """Jobs without a score: not done yet, or ended in a fault that is not the planner's."""
        briefs = self.briefs
        return [key for key in self.keys if key not in briefs or briefs[key].score is None]

    @property
    def briefs(self) -> Mapping[JobKey, Brief]:
        """What tables need of each row."""
        return briefs_of(self.rows)

    def narrowed(self, request: RequestedJobs) -> StoredRun:
        """The same as if nothing but this had been asked for."""
        keys = keys_of([request])
        rows = self.rows
        only = rows.only(keys) if isinstance(rows, StoredRows) else {key: rows[key] for key in keys if key in rows}
        return StoredRun(self.path, structs.replace(self.manifest, requests=(request,)), only)


def read_run(path: Path) -> StoredRun:
    """Read a run folder, also one that is being written; RunFolderError names what is missing or damaged."""
    manifest = _read_manifest(path)
    if manifest is None:
        raise RunFolderError(f"{path} is not a run folder: it has no manifest.json")
    return StoredRun(path, manifest, StoredRows.read(path))


class RunFolder:
    """A run folder open for writing; use as a context manager. One process at a time: others are refused."""

    def __init__(self, path: Path, wanted: Manifest, redo: Container[str] = ()) -> None:
        """What `same_benchmark.BENCHMARK` names must agree with what the folder holds; the requests are added to it.

        So must the planners, but for those to `redo`: their rows are taken away. Raises RunFolderError:
        in use, unwritable, foreign, or of another benchmark or planner (naming the difference).
        """
        self.path = path
        self._redo = Redo(path, redo)
        self._results = -1
        self._not_in_pieces = 0
        self._appended = False
        self._take_back: Callable[[], object] = self._take_back_files
        if not path.exists():
            self._take_back = partial(shutil.rmtree, path, ignore_errors=True)
        elif (path / MANIFEST).exists():
            self._take_back = lambda: None
        try:
            path.mkdir(parents=True, exist_ok=True)
            _refuse_strangers(path)
            self._lock = FolderLock(path / "lock")
        except OSError as error:
            raise _unwritable(path, error) from None
        try:
            self.manifest = self._agree(wanted)
            for left in path.glob(f"{PART}*"):
                left.unlink()
            for left in path.glob(f"traces/{PART}*"):
                shutil.rmtree(left, ignore_errors=True)
            self.done = self._open_results(wanted.keys)
            """Jobs that have a row; the rows themselves are on the disk only."""
        except OSError as error:
            self.close()
            raise _unwritable(path, error) from None
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        try:
            if kind is None:
                self._keep_pieces()
                self._redo.strike_out(self.manifest)
        finally:
            self.close()
        if kind is not None and issubclass(kind, InputError) and not self._appended:
            self._take_back()  # what cannot be driven leaves no folder, and asks for nothing in one that was there

    def close(self) -> None:
        if self._results >= 0:
            os.close(self._results)
            self._results = -1
        self._lock.release()

    def _take_back_files(self) -> None:
        """Leave the folder as empty as it was: strangers were refused."""
        for each in self.path.iterdir():
            if each.name not in STAYING:
                shutil.rmtree(each, ignore_errors=True) if each.is_dir() else each.unlink(missing_ok=True)

    def keep_scenarios(self, scenarios: Iterable[Scenario], maps: Iterable[MapFiles] = ()) -> None:
        """Keep scenarios that no suite holds and the maps that came along with them.

        So the folder can be scored again without the user's files. MapError if a map cannot be copied.
        """
        for files in maps:
            if not (self.path / MAPS / files.name).is_dir():  # the same one, by the hash of the benchmark
                copy_map(files, self.path / MAPS)
        try:
            with replacing(self.path / OWN_SCENARIOS) as fresh:
                fresh.write_bytes("---\n".join(map(scenario_text, scenarios)).encode())
        except OSError as error:
            raise _unwritable(self.path, error) from None

    def keep_profile(self, profile: Profile) -> None:
        """Keep a profile of the user's, so that drives can be scored by it again without its file."""
        try:
            keep_profile(profile, self.path)
        except OSError as error:
            raise _unwritable(self.path, error) from None

    def keep_vehicle_types(self, path: Path) -> None:
        """Keep the user's vehicle-type file, so that the drives can be made again without it."""
        place = self.path / TRAFFIC / path.name  # under its name: what drivers are called begins with it
        try:
            place.parent.mkdir(exist_ok=True)
            with replacing(place) as fresh:
                fresh.write_bytes(path.read_bytes())
        except OSError as error:
            raise _unwritable(self.path, error) from None

    def append(self, row: Row) -> Row:
        """Write one finished job and wait until it is on the disk; the row as it is there.

        One that could not be read again is a fault. RunFolderError if it cannot
        be written, or the file is no longer there; what was there before stays.
        """
        row, line = storable(row)
        size = self._size()
        if size and self._last_byte(size) != b"\n":
            line = b"\n" + line  # after what somebody else wrote: that line is damaged, this one is not
        try:
            written = os.write(self._results, line)
            if written != len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            os.fsync(self._results)
        except OSError as error:
            with contextlib.suppress(OSError):
                os.ftruncate(self._results, size)
            raise _unwritable(self.path, error) from None
        self._appended = True
        self.done.add(row.key)
        self._not_in_pieces += 1
        if self._not_in_pieces == LINES_AT_ONCE:
            self._keep_pieces()
        return row

    def _last_byte(self, size: int) -> bytes:
        os.lseek(self._results, size - 1, os.SEEK_SET)  # what is written goes to the end all the same
        return os.read(self._results, 1)

    def _size(self) -> int:
        """Of the file with the rows; RunFolderError if it is no longer in its place."""
        held, path = os.fstat(self._results), self.path / RESULTS
        with contextlib.suppress(OSError):
            if os.path.samestat(held, path.stat()):
                return held.st_size
        raise RunFolderError(f"{path} was deleted or replaced while the run wrote to it; repeat the command")

    def kept(self, keys: Container[JobKey]) -> Iterator[tuple[JobKey, Brief]]:
        """Those of these jobs that are done, and their briefs, read one by one."""
        return ((key, brief) for _, key, brief in read_briefs(self.path / RESULTS) if key in keys)

    def _keep_pieces(self) -> None:
        try:
            keep_pieces(self.path)
        except OSError as error:
            raise _unwritable(self.path, error) from None
        self._not_in_pieces = 0

    def _agree(self, wanted: Manifest) -> Manifest:
        """The manifest with the requests added; writes it where it is new or grew."""
        held = _read_manifest(self.path)
        if held is None:
            return self._write_manifest(wanted)
        if (parted := run_difference(held, wanted)) is not None:
            name, then, now = parted
            raise RunFolderError(
                f"{self.path} holds a run with {name} {then}, this one has {now}; give another folder as --out"
            )
        for each in (held.shard, wanted.shard):
            if each is not None and (held.shard, held.requests) != (wanted.shard, wanted.requests):
                raise RunFolderError(
                    f"{self.path} holds {held.part}, this is {wanted.part}; each has a folder of its own: "
                    "give another one as --out"
                )
        common = [name for name in wanted.planners if name in held.planners]
        changed = [name for name in common if held.planners[name].hash != wanted.planners[name].hash]
        with_rows = {key[1] for _, key, _ in read_briefs(self.path / RESULTS)} if changed else set[str]()
        for name in changed:
            if name in with_rows and name not in self._redo:
                _refuse_planner(self.path, name, held.planners[name], wanted.planners[name])
        self._redo.take_away_rows(wanted)  # before the manifest says that there is another version
        new = () if set(wanted.keys) <= set(held.keys) else wanted.requests
        agreed = structs.replace(held, requests=(*held.requests, *new), planners={**held.planners, **wanted.planners})
        return held if agreed == held else self._write_manifest(agreed)

    def _write_manifest(self, manifest: Manifest) -> Manifest:
        path = self.path / MANIFEST
        if path.exists():
            self._take_back = partial(path.write_bytes, path.read_bytes())
        with replacing(path) as file:
            file.write_bytes(json.format(encode(manifest), indent=2) + b"\n")
        return manifest

    def _open_results(self, wanted: Iterable[JobKey]) -> set[JobKey]:
        """Open results.jsonl for appending, without a torn last line and without the rows that are to be done again."""
        path = self.path / RESULTS
        again = set(wanted)
        last: dict[JobKey, tuple[int, bool]] = {}  # the number of the last row of each job, and whether it stays
        whole_bytes = 0
        number = -1
        for number, (line, key, brief) in enumerate(read_briefs(path)):
            last[key] = (number, brief.score is not None or key not in again)
            whole_bytes += len(line)
        stay = {number for number, stays in last.values() if stays}
        if len(stay) != number + 1:
            write_lines(path, (line for number, (line, *_) in enumerate(read_briefs(path)) if number in stay))
            whole_bytes = path.stat().st_size
        self._results = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | _BINARY, 0o644)
        os.ftruncate(self._results, whole_bytes)
        os.fsync(self._results)
        return {key for key, (_, stays) in last.items() if stays}


def _refuse_strangers(path: Path) -> None:
    """RunFolderError for a folder that holds something else; nothing is written into it."""
    names = sorted(each.name for each in path.iterdir())
    strangers = [name for name in names if name not in STAYING and not name.startswith(PART)]
    if strangers and MANIFEST not in names:
        raise RunFolderError(
            f"{path} holds {strangers[0]!r} and no manifest.json, so it is no run folder; "
            "give an empty or a new folder as --out"
        )


def _refuse_planner(path: Path, name: str, then: PlannerRecord, now: PlannerRecord) -> None:
    files = changed_files(then.files, now.files)
    more = f" and {len(files) - 1} more" if len(files) > 1 else ""
    raise RunFolderError(
        f"{path} holds drives of planner {name!r} from before {files[0] if files else 'its options'}{more} changed; "
        f"--redo {name!r} drives them again, another --out keeps both"
    )


def _read_manifest(path: Path) -> Manifest | None:
    file = path / MANIFEST
    try:
        text = file.read_bytes()
        held = decode(text, ManifestFormat).format
        if held != FORMAT:
            raise RunFolderError(
                f"{file} has format {held}, this version reads {FORMAT}; read it with the version that wrote it"
            )
        return decode(text, Manifest)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise RunFolderError(f"cannot read {file}: {error.strerror}") from None
    except RecordError as error:
        raise RunFolderError(f"{file} is damaged ({error}); give another folder") from None


def is_full(error: OSError) -> bool:
    """Whether a disk, or what the user may have of it, is used up."""
    return error.errno in (errno.ENOSPC, errno.EDQUOT)


def _unwritable(path: Path, error: OSError) -> RunFolderError:
    if is_full(error):
        return RunFolderError(
            f"no space left to write {path}; what is there is intact: free some space and repeat the command"
        )
    return RunFolderError(f"cannot write the run folder {path}: {error.strerror or error}; give another one as --out")


def place_folder(fresh: Path, final: Path) -> None:
    """Move a complete folder to its place, over what an interrupted run may have left there."""
    if final.exists():
        shutil.rmtree(final)
    final.parent.mkdir(parents=True, exist_ok=True)
    os.rename(fresh, final)
