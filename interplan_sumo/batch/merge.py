"""Merge: the shards of one run become the folder that one machine would have made of all its drives."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Final

from msgspec import structs

from interplan_sumo.batch import custom_references
from interplan_sumo.batch.drive_job import place_trace
from interplan_sumo.batch.jobs import ScenarioSource, own_maps
from interplan_sumo.batch.records import JobKey, Manifest, Row, Shard
from interplan_sumo.batch.run import RunProgress
from interplan_sumo.batch.run_folder import OWN_SCENARIOS, RunFolder, StoredRun, read_run, trace_place
from interplan_sumo.batch.same_benchmark import run_difference
from interplan_sumo.batch.traffic_files import recorded_vehicle_types
from interplan_sumo.batch.verified import keep_verified, verified_rows
from interplan_sumo.errors import RunFolderError, clean_line
from interplan_sumo.metrics.profile import stored_profile
from interplan_sumo.planner_source import changed_files

TRACE_FILES: Final = ("ego.parquet", "actors.parquet", "signals.parquet", "plans.parquet", "scenario.json")
SEEN: Final = "seen.parquet"
"""Only where the perception was not full."""


def merge(
    folders: Iterable[Path], out: Path, watch: RunProgress | None = None, command: Sequence[str] = ()
) -> StoredRun:
    """Join all shards of a run; what `out` holds already is not copied again, so the same call goes on.

    Rows come in the order in which they were asked for, each with its trace.
    RunFolderError for a shard that is missing, not finished, there twice or of
    another run, and for a row that is none of its shard's.
    """
    shards = _all_shards([read_run(folder) for folder in folders])
    held = {key: shard for shard in shards for key in _finished(shard)}
    first = shards[0]
    manifest = structs.replace(
        first.manifest,
        shard=None,
        command=tuple(clean_line(word) for word in command),
        created=min(shard.manifest.created for shard in shards),
        platform="; ".join(sorted({shard.manifest.platform for shard in shards})),
    )
    with RunFolder(out, manifest) as folder:
        _keep_what_they_share(shards, folder)
        keys = manifest.keys
        if watch is not None:
            watch.begin(len(keys), folder.kept(set(keys)))
        for key in keys:
            if key not in folder.done:
                row = folder.append(_taken(held[key], key, out))
                if watch is not None:
                    watch.finished(row)
    if verified := [each for shard in shards for each in verified_rows(shard).values()]:
        keep_verified(out, verified, ())
    return read_run(out)


def _all_shards(runs: Sequence[StoredRun]) -> list[StoredRun]:
    """All shards of one run, by their numbers; RunFolderError if these are not that."""
    found: dict[Shard, StoredRun] = {}
    for run in runs:
        shard = run.manifest.shard
        if shard is None:
            raise RunFolderError(f"{run.path} is no shard: it was run without --shard; leave it out")
        if (why := _is_of_another_run(run.manifest, runs[0].manifest)) is not None:
            raise RunFolderError(f"{run.path} is no shard of the run of {runs[0].path}: {why}; merge them apart")
        if shard in found:
            raise RunFolderError(f"{found[shard].path} and {run.path} are both shard {shard}; leave one of them out")
        found[shard] = run
    if not found:
        raise RunFolderError("no shard given; name the folders of all shards of a run")
    count = next(iter(found)).count
    every = [Shard(number, count) for number in range(1, count + 1)]
    if missing := [str(shard) for shard in every if shard not in found]:
        more = f" and {len(missing) - 10} more" if len(missing) > 10 else ""
        raise RunFolderError(
            f"there is no folder of shard {', '.join(missing[:10])}{more}; run what is missing and name all {count}"
        )
    return [found[shard] for shard in every]


def _is_of_another_run(this: Manifest, first: Manifest) -> str | None:
    """Why two shards are not of one run; None if they are."""
    if (parted := run_difference(first, this)) is not None:
        name, then, now = parted
        return f"it has {name} {now}, that has {then}"
    if this.requests != first.requests:
        return "other drives were asked for"
    counts = [manifest.shard.count for manifest in (this, first) if manifest.shard is not None]
    if counts[0] != counts[1]:
        return f"it is one of {counts[0]} shards, that one of {counts[1]}"
    for name in {**this.planners, **first.planners}:
        mine, other = this.planners.get(name), first.planners.get(name)
        if mine is None or other is None or mine.hash != other.hash:
            files = changed_files(*({} if each is None else each.files for each in (other, mine)))
            return f"planner {name!r} is another one: {files[0] if files else 'its options'} differs"
    return None


def _finished(shard: StoredRun) -> list[JobKey]:
    """The jobs of a shard, all with a row; RunFolderError if one has none, or there is a row of none of them."""
    keys = shard.manifest.keys
    left = [key for key in keys if key not in shard.briefs]
    if left:
        raise RunFolderError(
            f"{shard.path} is not finished: {len(left)} of its {len(keys)} drives are missing; "
            f"repeat the command of shard {shard.manifest.shard} on it"
        )
    if strangers := shard.briefs.keys() - set(keys):
        scenario, planner, seed = min(strangers)
        raise RunFolderError(
            f"{shard.path} holds a row of {scenario}, {planner}, seed {seed}, which is no drive of shard "
            f"{shard.manifest.shard}; run the shard into a new folder"
        )
    return keys


def _taken(shard: StoredRun, key: JobKey, out: Path) -> Row:
    """A row of a shard, its trace copied to its place."""
    row = shard.rows[key]
    told = _own_versions(row, shard.manifest)
    if told is not None:
        raise RunFolderError(
            f"{shard.path / 'results.jsonl'}: the row of {key[0]}, {key[1]}, seed {key[2]} has another {told} than its "
            "manifest.json; delete the line and repeat the shard's command"
        )
    if row.trace is not None:
        source = shard.path / row.trace
        place_trace(out, row.trace, lambda fresh: _copy_trace(source, fresh, seen=row.perception != "full"))
    return row


def _own_versions(row: Row, manifest: Manifest) -> str | None:
    """What a row says otherwise than the manifest of its folder."""
    planner = manifest.planners.get(row.planner)
    wanted = {
        "trace": None if row.trace is None else trace_place(row.key),
        "versions": manifest.versions,
        "traffic_version": manifest.traffic_version,
        "overrides": manifest.overrides,
        "planner_hash": row.planner_hash if planner is None else planner.hash,
    }
    return next((name for name, value in wanted.items() if getattr(row, name) != value), None)


def _copy_trace(source: Path, fresh: Path, *, seen: bool) -> None:
    for name in (*TRACE_FILES, *((SEEN,) if seen else ())):
        file = source / name
        if file.is_symlink() or not file.is_file():
            raise RunFolderError(f"{file} is missing; bring the shard's whole folder, or repeat its command")
        shutil.copyfile(file, fresh / name)


def _keep_what_they_share(shards: Sequence[StoredRun], folder: RunFolder) -> None:
    """Profile, vehicle types and scenarios of the user's, with maps and experts."""
    first = shards[0]
    folder.keep_profile(stored_profile(first.manifest.profile, first.path))
    vehicle_types = recorded_vehicle_types(first.path, first.manifest)
    if vehicle_types is not None:
        folder.keep_vehicle_types(vehicle_types)
    own = first.path / OWN_SCENARIOS
    if own.is_file():
        source = ScenarioSource.of(None, (str(own),))
        if source.hash != first.manifest.suite_hash:
            raise RunFolderError(f"{own} or its maps are not those that the shard was run with; run it again")
        folder.keep_scenarios(source.scenarios, own_maps(source.scenarios))
        custom_references.keep_experts(_experts(shards), folder.path)


def _experts(shards: Iterable[StoredRun]) -> Iterator[Path]:
    return (path for shard in shards for path in sorted((shard.path / custom_references.FOLDER).glob("*.parquet")))
