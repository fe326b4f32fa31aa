"""Driven: a run, or the shards of one, as a table needs it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from interplan_sumo.batch.briefs import Brief
from interplan_sumo.batch.records import JobKey, Row, keys_of
from interplan_sumo.batch.run_folder import StoredRun
from interplan_sumo.batch.same_benchmark import benchmark_of
from interplan_sumo.batch.verified import verified_rows
from interplan_sumo.errors import RunFolderError
from interplan_sumo.families import find_family, named_family


@dataclass(frozen=True, slots=True)
class DrivenRun:
    """A run as a table needs it, gone over once."""

    parts: tuple[StoredRun, ...]
    """The run, or shards of it."""
    briefs: Mapping[JobKey, Brief]
    keys: Mapping[str, Sequence[JobKey]]
    """What was asked for, by planner."""
    ordinary: bool
    """Whether it is of ordinary driving only."""
    verified: frozenset[JobKey]
    """Rows that came again from their plans."""

    @property
    def run(self) -> StoredRun:
        """The one that stands for all its parts."""
        return self.parts[0]

    @property
    def shards(self) -> str | None:
        """The shards that these are, in words; None for all drives that were asked for."""
        found = sorted(each.number for part in self.parts if (each := part.manifest.shard) is not None)
        whole = self.run.manifest.shard
        if whole is None or len(found) == whole.count:
            return None
        return f"{self.run.path.name} is shard {', '.join(map(str, found))} of {whole.count}"

    def rows_with(self, key: JobKey) -> Mapping[JobKey, Row]:
        """Those of the part that did a job."""
        if len(self.parts) == 1:
            return self.parts[0].rows
        return next(part.rows for part in self.parts if key in part.briefs)

    @classmethod
    def of(cls, parts: tuple[StoredRun, ...]) -> DrivenRun:
        briefs = parts[0].briefs if len(parts) == 1 else {k: v for part in parts for k, v in part.briefs.items()}
        one = dict(zip(briefs, briefs, strict=True))  # equal keys as one object: there are many
        keys: dict[str, list[JobKey]] = {}
        ordinary = True
        for key in _asked(parts):
            keys.setdefault(key[1], []).append(one.get(key, key))
            ordinary = ordinary and find_family(family_of(key, briefs)).ordinary
        noted = [verified_rows(part).items() for part in parts]
        verified = frozenset(key for rows in noted for key, each in rows if each.means == "plans")
        return cls(parts, briefs, keys, ordinary and bool(keys), verified)


def together(runs: Iterable[StoredRun]) -> list[DrivenRun]:
    """Shards of one run side by side, every other run alone; RunFolderError if a shard is there twice."""
    found: dict[object, list[StoredRun]] = {}
    for number, run in enumerate(runs):
        held = run.manifest
        if held.shard is None:
            found[number] = [run]
            continue
        planners = tuple((name, each.hash) for name, each in held.planners.items())
        others = found.setdefault((*benchmark_of(held), held.requests, planners, held.shard.count), [])
        for other in others:
            if other.manifest.shard == held.shard:
                raise RunFolderError(f"{other.path} and {run.path} are both shard {held.shard}; leave one of them out")
        others.append(run)
    return [DrivenRun.of(tuple(parts)) for parts in found.values()]


def _asked(parts: Sequence[StoredRun]) -> list[JobKey]:
    """The jobs of all parts, in the order of the whole run."""
    if len(parts) == 1:
        return parts[0].keys
    asked = {key for part in parts for key in part.keys}
    return [key for key in keys_of(parts[0].manifest.requests) if key in asked]


def family_of(key: JobKey, briefs: Mapping[JobKey, Brief]) -> str:
    """A scenario that has no row yet has no family on file: it is that by which it is called."""
    return briefs[key].family if key in briefs else named_family(key[0])
