"""Kept kilometres under the code of today: `python -m tools.renewed_kilometres OUT --planners idm --kinds door`.

Kilometres of other code are refused, and most changes of code touch few of them: one to how a rare event goes those
in which it began, one to a planner those of this planner. `--kinds` names the rare events whose segments are driven
again into the folder OUT, beside the others as they are kept. Of these a sample of each planner is driven again
before: it has to be the same, frame for frame, or nothing is taken to be untouched. The same command goes on with
what was interrupted; `python -m tools.tables --take-kilometres OUT` keeps it, if it is of all planners.
"""

from __future__ import annotations

import argparse
import random
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

import msgspec

from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.records import PlannerRecord, decode, encode
from interplan_sumo.endurance.code_hash import code_hash
from interplan_sumo.endurance.event_folder import open_event_folder
from interplan_sumo.endurance.kilometres import (
    ABOUT,
    EVENTS,
    SEGMENTS,
    AboutEndure,
    EndureOptions,
    SegmentPlan,
    driven_segments,
    read_segments,
)
from interplan_sumo.endurance.records import SegmentRecord, TrafficCell
from interplan_sumo.planner_source import PlannerSource
from interplan_sumo.world.files import replacing
from tools.kilometres import KEPT, Key, key_of

ABOUT_RENEWAL: Final = "renewal.json"


def sampled(segments: Sequence[SegmentRecord], count: int) -> set[Key]:
    """So many segments of each planner, drawn at random, always the same."""
    found: set[Key] = set()
    for planner in dict.fromkeys(each.planner for each in segments):
        mine = sorted(key_of(each) for each in segments if each.planner == planner)
        found.update(random.Random(planner).sample(mine, min(count, len(mine))))
    return found


class Renewal(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a folder was begun for, and under which code."""

    planners: list[str]
    kinds: list[str]
    sample: int
    code: str


def begin(out: Path, renewal: Renewal) -> None:
    """A folder of `endure` for the code of today, new or begun before by this command. SystemExit for others."""
    if out.exists():
        path = out / ABOUT_RENEWAL
        if not path.is_file() or decode(path.read_bytes(), Renewal) != renewal:
            raise SystemExit(f"{out} is of another command or of other code; give a new folder")
        write(out, read_segments(out))  # without what a kill has torn
        return
    about = decode((KEPT / ABOUT).read_bytes(), AboutEndure)
    hashes = {planner: PlannerSource.of(planner).hash for planner in renewal.planners}
    out.mkdir(parents=True)
    (out / ABOUT).write_bytes(encode(msgspec.structs.replace(about, code=renewal.code, planners=hashes)) + b"\n")
    write(out, ())
    (out / ABOUT_RENEWAL).write_bytes(encode(renewal) + b"\n")


def write(out: Path, segments: Iterable[SegmentRecord]) -> None:
    """Put segments in place of what a folder holds."""
    with replacing(out / SEGMENTS) as fresh:
        fresh.write_bytes(b"".join(encode(each) + b"\n" for each in segments))


def place(out: Path, staying: Iterable[SegmentRecord]) -> None:
    """Put kept segments beside those that a folder holds, as if the code of today had driven them."""
    held = {key_of(each): each for each in read_segments(out)}
    hashes = decode((out / ABOUT).read_bytes(), AboutEndure).planners
    renewed = {key_of(each): msgspec.structs.replace(each, planner_hash=hashes[each.planner]) for each in staying}
    write(out, (renewed | held).values())


def drive_missing(out: Path, kept: Sequence[SegmentRecord], run: RunOptions) -> None:
    """Drive what the folder lacks of these segments."""
    about = decode((out / ABOUT).read_bytes(), AboutEndure)
    done = {key_of(each) for each in read_segments(out)}
    missing: dict[tuple[str, TrafficCell, int], set[int]] = {}
    for each in kept:
        if key_of(each) not in done:
            missing.setdefault((each.planner, each.cell, each.seed), set()).add(each.index)
    for (planner, cell, seed), numbers in missing.items():
        options = EndureOptions(
            planner, cell.map, 1.0, out, density=cell.density, behaviour=cell.drivers, seed=seed,
            naive_share=about.naive_share, segment_m=about.segment_m, run=run,
        )  # fmt: skip
        open_event_folder(out / EVENTS, {planner: PlannerRecord(about.planners[planner], {})})
        jobs = [job for job in SegmentPlan(options, {}).missing(max(numbers) + 1) if job.index in numbers]
        for record in driven_segments(jobs, options):
            with (out / SEGMENTS).open("ab") as file:
                file.write(encode(record) + b"\n")


def changed(kept: Iterable[SegmentRecord], now: Iterable[SegmentRecord], sample: set[Key]) -> list[Key]:
    """Those of a sample that did not come again as they were, or not at all."""
    hashes = {key_of(each): each.trace_hash for each in now}
    return [key for each in kept if (key := key_of(each)) in sample and hashes.get(key) != each.trace_hash]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, metavar="OUT", help="a folder, new or of the same command")
    parser.add_argument("--planners", nargs="+", required=True, help="whose kilometres; the others are left out")
    parser.add_argument("--kinds", nargs="*", default=[], help="rare events whose segments are driven again")
    parser.add_argument("--sample", type=int, default=20, help="of each planner, which must come again as they are")
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    kept = [each for each in read_segments(KEPT) if each.planner in given.planners]
    kinds = frozenset(given.kinds)
    untouched = [each for each in kept if kinds.isdisjoint(event.kind for event in each.rare_events)]
    sample = sampled(untouched, given.sample)
    begin(given.out, Renewal(sorted(given.planners), sorted(kinds), given.sample, code_hash()))
    run = RunOptions(workers=given.workers)
    drive_missing(given.out, [each for each in untouched if key_of(each) in sample], run)
    if others := changed(untouched, read_segments(given.out), sample):
        raise SystemExit(f"{len(others)} of {len(sample)} segments did not come again as they were: {others[0]}")
    place(given.out, untouched)
    drive_missing(given.out, kept, run)
    print(f"{len(kept) - len(untouched)} of {len(kept)} segments driven anew; {len(sample)} others came as they were")


if __name__ == "__main__":
    main()
