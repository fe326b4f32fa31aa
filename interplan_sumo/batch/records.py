"""Records: what a run writes down, as declared types; whatever is read is checked against them once, as it is read.

The names on disk are those of the fields, but `class` for `Fault.kind` and `version` for `scoring_version` of rows.
Numbers are finite: the encoder writes null for one that is not, and the decoder takes null only where it may be.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, Self, TypeVar

import msgspec
from msgspec import Meta, Struct, structs

from interplan_sumo.batch.versions import SCORING
from interplan_sumo.errors import InputError, InterplanError, clean_line, counted

if TYPE_CHECKING:
    from interplan_sumo.metrics.score import ScoreSheet

FORMAT = 1
"""Of manifests."""
MOST_TEXT = 4000
"""Characters of a message, a traceback or a text that are kept."""

T = TypeVar("T")

Score = Annotated[float, Meta(ge=0.0, le=1.0)]
MOST_SEEDS: Final = 10_000
"""Of one request."""
Seed = Annotated[int, Meta(ge=0, lt=MOST_SEEDS)]
Count = Annotated[int, Meta(ge=0, lt=2**53)]
MOST_SECONDS: Final = 1e9
Seconds = Annotated[float, Meta(ge=0.0, le=MOST_SECONDS)]
Weight = Annotated[float, Meta(ge=0.0, le=1e6)]
FaultClass = Literal["planner", "traffic", "timeout", "harness"]
JobKey = tuple[str, str, int]
"""Scenario id, planner as it was asked for, seed."""


class RecordError(InterplanError):
    """Text that is no record of the wanted type; says which field is not as declared."""


class Fault(Struct, frozen=True):
    """Why a job has no ordinary result; the message is one clean line, whoever wrote it."""

    kind: FaultClass = msgspec.field(name="class")
    message: str

    def __post_init__(self) -> None:
        structs.force_setattr(self, "message", clean_line(self.message))


class MetricRecord(Struct, frozen=True):
    """What a metric said of one drive."""

    score: Score | None
    """None where it informs only, or could not be judged."""
    detail: dict[str, Any]
    """Figures behind the score: plain numbers, texts, lists and dicts."""
    reason: str | None
    """One sentence where points are lost."""


class AppliedOverrides(Struct, frozen=True, omit_defaults=True):
    """What was changed in the official scenarios; nothing by default."""

    density: Literal["low", "medium", "high"] | None = None
    behaviour: str | None = None
    perception: str | None = None
    traffic: str | None = None
    """Name and hash of a vehicle-type file: `mine.xml sha256:0123456789abcdef`."""

    def __bool__(self) -> bool:
        return bool(self.texts())

    def texts(self) -> dict[str, str]:
        """Those that there are, by name."""
        found = {name: getattr(self, name) for name in self.__struct_fields__}
        return {name: value for name, value in found.items() if value is not None}


class ModelUse(Struct, frozen=True):
    """What a planner that asks a language model reports of it, besides what it likes."""

    queries: Count | None = None
    fallbacks: dict[str, Count] = {}
    """How often a question had no usable answer, by the reason."""


class ScoreRecord(Struct, frozen=True):
    """What the metrics made of one drive."""

    score: Score
    profile: str
    scoring_version: int = msgspec.field(name="version")
    gates: tuple[str, ...]
    weights: dict[str, Weight]
    metrics: dict[str, MetricRecord]
    done: bool | None
    unsafe: bool | None
    beside: dict[str, Score]

    @classmethod
    def of(cls, sheet: ScoreSheet) -> Self:
        from interplan_sumo.metrics.metric import plain  # not for every worker that starts

        return cls(
            plain(sheet.score),
            sheet.profile,
            sheet.version,
            tuple(sheet.gates),
            dict(sheet.weights),
            {
                name: MetricRecord(plain(each.score), plain(each.detail), each.reason)
                for name, each in sheet.metrics.items()
            },
            sheet.done,
            sheet.unsafe,
            {name: plain(value) for name, value in sheet.beside.items()},
        )


class WorkerAnswer(Struct, frozen=True, omit_defaults=True):
    """What a worker says to its parent: that it is ready, that it cannot go on, or how a task ended."""

    ready: bool = False
    killed_from_outside: bool = False
    """Whether the fault, or that a group cannot be opened, may be the doing of somebody else, who ended a process."""
    input_error: str | None = None
    """Why its group cannot be opened or a task not be done, whoever tries."""
    ends_run: bool = False
    """Whether that is no task's doing: the group is not any more what it was, or the machine has no room for it."""
    value: dict[str, Any] = {}
    """What the task gave."""
    fault: Fault | None = None
    traceback: str = ""
    """Of a fault of ours."""


class DriveAnswer(Struct, frozen=True, kw_only=True):
    """What a worker says of a drive, besides the fault that it may have ended with."""

    reached_goal: bool = False
    trace_hash: str | None = None
    trace: str | None = None
    """Where it lies, relative to the run folder."""
    sheet: ScoreRecord | None = None
    times_s: dict[str, Seconds] = {}
    planner_report: dict[str, Any] | None = None


class Row(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A line of results.jsonl: what came of one job."""

    scenario_id: str
    family: str
    planner: str
    seed: Seed
    score: Score | None
    """None after a fault that is not the planner's."""
    metrics: dict[str, MetricRecord]
    gates: tuple[str, ...]
    """Metrics that multiply the score."""
    weights: dict[str, Weight]
    """Metrics in the weighted mean."""
    fault: Fault | None
    official: bool
    """Whether it is an official scenario, driven as it is, and at once."""
    overrides: AppliedOverrides
    perception: str
    """What the planner saw: `full`, or how it was worse than that."""
    trace_hash: str | None
    times_s: dict[str, Seconds]
    """Wall clock by phase, and `total`."""
    versions: dict[str, str]
    traffic_version: int
    reached_goal: bool
    isolated: bool
    """Whether the planner ran in a process of its own, apart from simulation and scoring."""
    planner_hash: str | None
    """Over its source files, options and weights; None for an object that only the calling process knew."""
    site: str
    scenario_hash: str
    trace: str | None
    """Where it lies, relative to the run folder."""
    done: bool | None = None
    """Whether the task was done; None where the profile does not judge it, or there was a fault."""
    unsafe: bool | None = None
    """Whether a gate of safety took points; None as for `done`."""
    beside: dict[str, Score] = {}
    """Scores by other profiles that are told beside this one."""
    profile: str | None = None
    """Of a row that was scored again, as `scoring_version`."""
    scoring_version: int | None = msgspec.field(name="version", default=None)
    planner_report: dict[str, Any] | None = None
    """What the planner said of the drive itself."""
    traceback: str = ""
    """Of a fault of ours."""
    printed: str = ""
    """The end of what the worker printed, after a fault."""
    tries: Annotated[int, Meta(ge=1)] = 1
    """How often it was begun: a process was killed, by somebody else or by the planner that thought better of it."""

    def __post_init__(self) -> None:
        for name in (*self.gates, *self.weights):
            if name not in self.metrics or self.metrics[name].score is None:
                raise ValueError(f"{name} is among gates or weights and has no score")
        if self.score is None and self.fault is None:
            raise ValueError("there is neither a score nor a fault")

    @property
    def judged(self) -> dict[str, float]:
        """Scores of the metrics that make the score, gates first."""
        return {name: self.metrics[name].score or 0.0 for name in (*self.gates, *self.weights)}

    def rescored(self, sheet: ScoreRecord) -> Row:
        """The row with another score."""
        return structs.replace(self, **structs.asdict(sheet))

    @property
    def key(self) -> JobKey:
        return (self.scenario_id, self.planner, self.seed)


class RequestedJobs(Struct, frozen=True):
    """Every planner on every scenario with the seeds 0 to N-1."""

    planners: tuple[str, ...]
    scenarios: tuple[str, ...]
    """Ids."""
    seeds: Annotated[int, Meta(ge=1, le=MOST_SEEDS)]


class Shard(Struct, frozen=True):
    """One of the equal parts that a run is split into, for machines that know nothing of each other."""

    number: Annotated[int, Meta(ge=1)]
    count: int
    """Of all shards."""

    def __post_init__(self) -> None:
        if self.number > self.count:
            raise ValueError(f"shard {self.number} of {self.count}")

    @classmethod
    def parse(cls, text: str) -> Self:
        """From `I/N`; InputError for anything else."""
        parts = text.split("/")
        if len(parts) == 2 and all(each.isascii() and each.isdigit() and len(each) < 10 for each in parts):
            number, count = map(int, parts)
            if 1 <= number <= count:
                return cls(number, count)
        raise InputError(f"--shard {text!r} is none; give I/N, such as 1/4 to 4/4 for four machines")

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    def of(self, things: Sequence[T]) -> Sequence[T]:
        """Its part: every N-th of all, so that each shard has of everything."""
        return things[self.number - 1 :: self.count]


class PlannerRecord(Struct, frozen=True):
    """The planner that drove: what `planner_source` has of it."""

    hash: str
    files: dict[str, str]


class ManifestFormat(Struct):
    """The first that is read of a manifest."""

    format: int


class Manifest(Struct, frozen=True, kw_only=True):
    """What a run folder says about itself: what was asked for, and with which versions."""

    format: Literal[1] = FORMAT
    suite: str
    suite_hash: str
    profile: str
    overrides: AppliedOverrides
    versions: dict[str, str]
    traffic_version: int
    command: tuple[str, ...]
    created: str
    platform: str
    plan_limit_s: Seconds | None
    """None for no limit."""
    requests: tuple[RequestedJobs, ...]
    shard: Shard | None = None
    """The part of what was asked for that this folder holds; None for all of it."""
    planners: dict[str, PlannerRecord] = {}
    """The one version of each planner that the folder holds drives of, by the name that it was asked for."""

    @property
    def scoring_version(self) -> str | None:
        """Of its scores; None where it does not say."""
        return self.versions.get(SCORING)

    @property
    def keys(self) -> list[JobKey]:
        """The jobs that are asked for, each once."""
        keys = keys_of(self.requests)
        return keys if self.shard is None else [*self.shard.of(keys)]

    @property
    def part(self) -> str:
        """Which part of what was asked for it is, in words."""
        drives = counted(len(keys_of(self.requests)), "drive")
        return f"a run of {drives}" if self.shard is None else f"shard {self.shard} of a run of {drives}"


def keys_of(requests: Iterable[RequestedJobs]) -> list[JobKey]:
    """The jobs that requests ask for, each once."""
    found = {
        (scenario, planner, seed): None
        for request in requests
        for planner in request.planners
        for scenario in request.scenarios
        for seed in range(request.seeds)
    }
    return list(found)


_rows = msgspec.json.Decoder(Row)


def row_of(line: bytes) -> Row:
    """A line of results.jsonl; RecordError if it is none."""
    return decoded(_rows, line)


def decode(text: bytes, kind: type[T]) -> T:
    """JSON as a record of a type; RecordError if it is none."""
    return decoded(msgspec.json.Decoder(kind), text)


def decoded(decoder: msgspec.json.Decoder[T], text: bytes) -> T:
    """As `decode`, with a decoder that is kept."""
    try:
        return decoder.decode(text)
    except (ValueError, RecursionError, MemoryError) as error:
        raise RecordError(" ".join(str(error).split())) from None


def encode(record: Struct) -> bytes:
    """A record as one line of JSON, without the line's end; numpy's scalars and arrays become numbers and lists."""
    return msgspec.json.encode(record, enc_hook=_as_plain)


def _as_plain(value: Any) -> Any:
    """numpy scalars and arrays as JSON."""
    for method in ("item", "tolist"):
        if hasattr(value, method):
            with contextlib.suppress(ValueError):
                return getattr(value, method)()
    return readable(str(value))


def readable(text: str) -> str:
    """Text of others that can be stored and printed: no lone surrogates, no control characters, MOST_TEXT at most."""
    shown = "".join(
        each if each.isprintable() or each in "\n\t" else each.encode("unicode_escape").decode()
        for each in text[:MOST_TEXT]
    )
    return shown if len(text) <= MOST_TEXT else f"{shown}..."
