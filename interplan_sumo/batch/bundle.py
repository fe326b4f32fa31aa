"""Bundle: a result to hand in: what was driven, with which plans, and a card that says by whom. No code, no pickle.

| file | what |
|---|---|
| bundle.json | format, card, and the SHA-256 of every other file |
| manifest.json | suite, profile, versions, planner, as in a run folder |
| results.jsonl | a row per drive, by scenario and seed: what is claimed |
| plans/<scenario>/seed<k>.f64 | the plans of a drive as plain numbers (`world.plans`) |
"""

from __future__ import annotations

import contextlib
import hashlib
import re
from collections.abc import Generator, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, Literal, TypeVar

import msgspec
import yaml
from msgspec import Meta, Struct, structs

from interplan_sumo.batch.bundle_zip import ZipFiles, open_zip, write_zip
from interplan_sumo.batch.records import JobKey, Manifest, RecordError, Row, decode, encode, row_of
from interplan_sumo.batch.run_folder import slug, trace_place
from interplan_sumo.errors import InputError, clean_line, counted
from interplan_sumo.world.files import file_hash
from interplan_sumo.world.plans import plans_from
from interplan_sumo.world.trajectory import Trajectory

ABOUT, MANIFEST, RESULTS = "bundle.json", "manifest.json", "results.jsonl"
MOST_ABOUT: Final = 16 << 20
MOST_RESULTS: Final = 256 << 20
MOST_LINE: Final = 1 << 18
MOST_PLANS: Final = 64 << 20
"""Of one drive."""
MOST_CARD_TEXT: Final = 300
MOST_BUNDLE_SEEDS: Final = 20
"""Of each scenario: judging drives all of them."""
_ESCAPES: Final = re.compile(rb"\\[\\\"/]")
"""Those of JSON that stand for a character that is printed."""
_LINK: Final = re.compile(r"https?://[A-Za-z0-9][^\s\"'<>\\]*")
_FOLDERS: Final = re.compile(r"(?<![\w./\\~-])(?!//)(?:~[\w.-]*|[A-Za-z]:)?[/\\](?:[^/\\\s'\"&?=,;:]+[/\\])*")
"""The folders of an absolute path in a text."""

T = TypeVar("T")

CardText = Annotated[str, Meta(max_length=MOST_CARD_TEXT)]


class PlannerCard(Struct, frozen=True, forbid_unknown_fields=True):
    """Who hands in what; all of it is theirs to say."""

    name: Annotated[str, Meta(max_length=80)] = ""
    """What the planner is called in tables."""
    authors: CardText = ""
    link: CardText = ""
    """http or https."""
    data: CardText = ""
    """What it was trained or tuned on."""
    hardware: CardText = ""
    notes: CardText = ""

    def __post_init__(self) -> None:
        for name in self.__struct_fields__:
            text = getattr(self, name)
            if text != clean_line(text, MOST_CARD_TEXT):
                raise ValueError(f"its {name} holds characters that are not printed, or blanks at its ends")
        if self.link and not _LINK.fullmatch(self.link):
            raise ValueError("its link is none that begins with http:// or https://")


def read_card(path: Path) -> PlannerCard:
    """A card from a YAML file; InputError with what is wrong in it."""
    try:
        if path.stat().st_size > MOST_ABOUT:
            raise ValueError("it is larger than any card")
        return msgspec.convert(yaml.safe_load(path.read_text(encoding="utf-8")) or {}, PlannerCard)
    except OSError as error:
        raise InputError(f"cannot read the card {path}: {error.strerror or error}") from None
    except (ValueError, RecursionError, yaml.YAMLError) as error:
        said = clean_line(str(error).replace("$.", ""), 300)
        known = ", ".join(PlannerCard.__struct_fields__)
        raise InputError(f"{path} is no card: {said}; its fields are {known}") from None


class BundleAbout(Struct, frozen=True):
    """bundle.json."""

    card: PlannerCard
    files: dict[str, str]
    """SHA-256 by name."""
    format: Literal[1] = 1


def public(text: str) -> str:
    """A text without the folders of absolute paths: they are nobody's business."""
    return _FOLDERS.sub("", text)


def plan_place(key: JobKey) -> str:
    """Where the plans of a drive lie in a bundle."""
    return f"plans/{slug(key[0])}/seed{key[2]}.f64"


def write_bundle(
    path: Path, card: PlannerCard, manifest: Manifest, rows: Iterable[Row], plans: Mapping[str, bytes]
) -> None:
    """Write a bundle; the same contents make the same bytes. `plans` are by their places, read when they are needed."""
    files = {MANIFEST: encode(manifest) + b"\n", RESULTS: b"".join(encode(row) + b"\n" for row in rows)}
    places = sorted(plans)
    hashes = {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}
    for place in places:
        content = plans[place]
        if len(content) > MOST_PLANS:
            raise InputError(
                f"{place} would have {len(content) >> 20} MiB of plans, at most {MOST_PLANS >> 20} are taken of a "
                "drive; make plans with fewer poses"
            )
        hashes[place] = hashlib.sha256(content).hexdigest()
    about = encode(BundleAbout(card, hashes)) + b"\n"

    def contents() -> Iterator[tuple[str, bytes]]:
        yield ABOUT, about
        yield from files.items()
        yield from ((place, plans[place]) for place in places)

    write_zip(path, contents())


@dataclass(frozen=True, slots=True)
class Bundle:
    """What is claimed, once everything in it is of one piece. Nothing of it is believed."""

    path: Path
    sha256: str
    card: PlannerCard
    manifest: Manifest
    rows: Mapping[JobKey, Row]
    _files: ZipFiles
    _hashes: Mapping[str, str]

    def plans(self, key: JobKey) -> tuple[Trajectory, ...]:
        """Those of a drive; InputError if they are none."""
        try:
            return plans_from(_content(self._files, self._hashes, plan_place(key), MOST_PLANS))
        except ValueError as error:
            raise InputError(f"{self.path}: {plan_place(key)} holds no plans: {clean_line(str(error), 200)}") from None


@contextlib.contextmanager
def open_bundle(path: Path) -> Generator[Bundle]:
    """A bundle whose files are all there, and whose rows are those of its manifest; InputError says what is not so."""
    with open_zip(path) as files:
        sha256 = file_hash(path)
        about = _record(path, ABOUT, files.read(ABOUT, MOST_ABOUT), BundleAbout)
        manifest = _record(path, MANIFEST, _content(files, about.files, MANIFEST, MOST_ABOUT), Manifest)
        if any(len(text) > 100 for pair in manifest.versions.items() for text in pair):
            raise InputError(f"{path} is no bundle: {MANIFEST} has versions that are none")
        rows = _rows(path, manifest, _content(files, about.files, RESULTS, MOST_RESULTS))
        wanted = {ABOUT, MANIFEST, RESULTS, *(plan_place(key) for key, row in rows.items() if row.trace is not None)}
        for said, names in (("missing", wanted - files.names), ("none of its files", files.names - wanted)):
            if names:
                raise InputError(f"{path} is no whole bundle: {clean_line(min(names), 150)} is {said}")
        yield Bundle(path, sha256, about.card, manifest, rows, files, about.files)


def _content(files: ZipFiles, hashes: Mapping[str, str], name: str, most_bytes: int) -> bytes:
    """A file that is what bundle.json says of it."""
    content = files.read(name, most_bytes)
    if hashlib.sha256(content).hexdigest() != hashes.get(name):
        raise InputError(f"{files.path} was changed: {name} is not the file that {ABOUT} says")
    return content


def _is_plain(text: bytes) -> bool:
    """Whether a line of JSON holds printable characters only, escaped ones included."""
    try:
        return text.decode().isprintable() and b"\\" not in _ESCAPES.sub(b"", text)
    except UnicodeDecodeError:
        return False


def _record(path: Path, name: str, content: bytes, kind: type[T]) -> T:
    try:
        if not _is_plain(content.removesuffix(b"\n")):
            raise RecordError("it holds characters that are not printed")
        return decode(content, kind)
    except RecordError as error:
        raise InputError(f"{path} is no bundle: {name}: {clean_line(str(error), 200)}") from None


def _rows(path: Path, manifest: Manifest, content: bytes) -> dict[JobKey, Row]:
    """The rows by job; InputError if they are not exactly those that were asked for, each with a score."""
    lines = content.removesuffix(b"\n").split(b"\n")
    drives = sum(len(each.planners) * len(each.scenarios) * each.seeds for each in manifest.requests)
    if drives != len(lines) or len(manifest.requests) != 1 or len(manifest.requests[0].planners) != 1:
        raise InputError(f"{path}: {MANIFEST} asks for {counted(drives, 'drive')}, {RESULTS} holds {len(lines)}")
    if manifest.requests[0].seeds > MOST_BUNDLE_SEEDS:
        raise InputError(f"{path} holds {manifest.requests[0].seeds} seeds; at most {MOST_BUNDLE_SEEDS} are judged")
    rows: dict[JobKey, Row] = {}
    for number, line in enumerate(lines, start=1):
        where = f"{path}: {RESULTS}, line {number}"
        if len(line) > MOST_LINE or not _is_plain(line):
            raise InputError(f"{where} is longer than any row, or holds characters that are not printed")
        try:
            row = row_of(line)
        except RecordError as error:
            raise InputError(f"{where}: {clean_line(str(error), 200)}") from None
        if row.score is None or (row.fault is not None and row.fault.kind != "planner"):
            raise InputError(f"{where}: there is no score")
        if row.trace != trace_place(row.key) and not (row.trace is None and row.fault is not None):
            raise InputError(f"{where}: its plans are not named as those of {clean_line(row.scenario_id, 80)} are")
        if row.versions != manifest.versions or row.overrides != manifest.overrides:
            raise InputError(f"{where} has other versions or overrides than {MANIFEST}")
        rows[row.key] = row
    if rows.keys() != set(manifest.keys):
        raise InputError(f"{path}: the rows of {RESULTS} are not those that {MANIFEST} asks for")
    return rows


def published(row: Row, name: str) -> Row:
    """A row as it is handed in: under the planner's public name, without what its process printed or told of itself."""
    fault = None if row.fault is None else structs.replace(row.fault, message=public(row.fault.message))
    trace = None if row.trace is None else trace_place((row.scenario_id, name, row.seed))
    return structs.replace(row, planner=name, fault=fault, trace=trace, planner_report=None, traceback="", printed="")
