"""Answers on disk: a run that was recorded once is repeated without its model, to the letter.

One JSON object a line, keyed by the SHA-256 of the canonical request. Workers
append to one file under a lock; the last line of a key counts. The questions
are not kept, and no key to a server ever comes here.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Generator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO, Annotated, Any, Literal, get_args

import msgspec

from interplan_llm.models.answers import answered
from interplan_llm.models.protocol import Capabilities, Cause, LanguageModel, ModelFailure, Reply, Request
from interplan_sumo.errors import InputError

Mode = Literal["record", "replay", "refresh"]
"""Ask what is not there yet; never ask; ask everything again."""

MODES: tuple[Mode, ...] = get_args(Mode)
_REPLY = ("text", "prompt_tokens", "completion_tokens", "latency_s", "model", "provider", "finish_reason")
"""What is kept of a reply; choice and data are read from the text again."""


@dataclass(frozen=True, slots=True)
class Entry:
    """What was answered once: the reply as it came, or the failure where none came."""

    model: str
    outcome: Reply | ModelFailure


@dataclass(frozen=True, slots=True)
class _Failure:
    cause: Cause
    message: str
    latency_s: Annotated[float, msgspec.Meta(ge=0.0)]


@dataclass(frozen=True, slots=True)
class _Line:
    """As it stands in the file: a reply or a failure."""

    key: str
    model: str
    reply: Reply | None = None
    failure: _Failure | None = None


def key_of(model: str, request: Request) -> str:
    """SHA-256 of all that determines an answer, as canonical JSON: the model's name, the question, its sampling.

    Left out are the time limit, which decides whether there is an answer and
    not which, and the vocabulary, which says how an answer is read.
    """
    value: dict[str, Any] = {
        "model": model,
        "messages": [[message.role, message.text] for message in request.messages],
        "choices": request.choices,
        "schema": request.schema,  # in its own order: models fill in properties in turn
        "constrained": request.constrained,
        "max_tokens": request.max_tokens,
        "temperature": float(request.temperature),
        "seed": request.seed,
    }
    if request.grammar is not None:  # else the key is the one that it was before there were grammars
        value["grammar"] = request.grammar
    return hashlib.sha256(json.dumps(value, separators=(",", ":"), allow_nan=False).encode("ascii")).hexdigest()


class AnswerStore:
    """The entries of one file. What other processes append is seen when it is looked for."""

    def __init__(self, path: Path) -> None:
        """Reads the file if it is there. InputError names a damaged line."""
        self.path = path
        self._entries: dict[str, Entry] = {}
        self._read_to = 0
        self._lines = 0
        self._catch_up()

    def __len__(self) -> int:
        return len(self._entries)

    @property
    def models(self) -> tuple[str, ...]:
        """Names of the models that answered, sorted."""
        return tuple(sorted({entry.model for entry in self._entries.values()}))

    def find(self, key: str) -> Entry | None:
        if key not in self._entries:
            self._catch_up()
        return self._entries.get(key)

    def keep(self, key: str, entry: Entry) -> None:
        """Append an entry; InputError if the file cannot be written."""
        line = _line(key, entry)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with self.path.open("ab+") as file, _locked(file):
                self._take_in(file)
                file.truncate(self._read_to)  # a line that was cut off when its process died
                file.write(line)
                file.flush()
                self._read_to += len(line)
                self._lines += 1
        except OSError as error:
            raise InputError(f"cannot write the answers to {self.path}: {error.strerror}") from None
        self._entries[key] = entry

    def _catch_up(self) -> None:
        try:
            with self.path.open("rb") as file:
                self._take_in(file)
        except FileNotFoundError:
            return
        except OSError as error:
            raise InputError(f"cannot read the answers in {self.path}: {error.strerror}") from None

    def _take_in(self, file: IO[bytes]) -> None:
        """Read the complete lines that are new: all of them if what was read is no longer there."""
        if file.seek(0, os.SEEK_END) < self._read_to:
            self._entries, self._read_to, self._lines = {}, 0, 0
        file.seek(self._read_to)
        whole, newline, _ = file.read().rpartition(b"\n")
        for line in whole.splitlines() if newline else ():
            self._lines += 1
            try:
                key, entry = _read_line(line)
            except (ValueError, TypeError, RecursionError):
                raise InputError(
                    f"{self.path}, line {self._lines}: not an answer of a language model; "
                    "delete the line, its question is then asked again"
                ) from None
            self._entries[key] = entry
        self._read_to += len(whole) + len(newline)


class StoredModel:
    """A model whose answers are kept, or a store that answers in its place.

    In mode `record` what was answered before is not asked again, and what
    failed before is; in mode `replay` failures come back, too, each with the
    cause and the latency that it had. Nothing recorded is the cause `missing`.
    """

    def __init__(self, name: str, store: AnswerStore, mode: Mode, model: LanguageModel | None = None) -> None:
        """`name` is whose answers these are; `model` is needed but for `replay`."""
        if model is None and mode != "replay":
            raise ValueError(f"mode {mode} needs a model")
        self.name = name
        self._store = store
        self._mode: Mode = mode
        self._model = model

    @property
    def capabilities(self) -> Capabilities:
        return Capabilities() if self._model is None else self._model.capabilities

    def ask(self, request: Request) -> Reply:
        key = key_of(self.name, request)
        entry = None if self._mode == "refresh" else self._store.find(key)
        if self._model is None:
            return self._replayed(request, entry)
        if entry is not None and isinstance(entry.outcome, Reply):
            return answered(request, entry.outcome)
        try:
            reply = self._model.ask(request)
        except ModelFailure as failure:
            self._store.keep(key, Entry(self.name, failure if failure.reply is None else failure.reply))
            raise
        self._store.keep(key, Entry(self.name, reply))
        return reply

    def close(self) -> None:
        if self._model is not None:
            self._model.close()

    def _replayed(self, request: Request, entry: Entry | None) -> Reply:
        if entry is None:
            raise ModelFailure("missing", f"{self._store.path} holds no answer of {self.name} to this question")
        if isinstance(entry.outcome, Reply):
            return answered(request, entry.outcome)
        kept = entry.outcome
        raise ModelFailure(kept.cause, kept.message, latency_s=kept.latency_s)


def _line(key: str, entry: Entry) -> bytes:
    value: dict[str, Any] = {"key": key, "model": entry.model}
    outcome = entry.outcome
    if isinstance(outcome, Reply):
        value["reply"] = {name: getattr(outcome, name) for name in _REPLY}
    else:
        value["failure"] = {"cause": outcome.cause, "message": outcome.message, "latency_s": outcome.latency_s}
    return json.dumps(value, separators=(",", ":"), allow_nan=False).encode("ascii") + b"\n"


def _read_line(line: bytes) -> tuple[str, Entry]:
    """ValueError or TypeError for anything but what `_line` writes."""
    told = msgspec.convert(json.loads(line), _Line)  # json takes lone surrogates, too
    if told.failure is not None:
        return told.key, Entry(told.model, ModelFailure(**asdict(told.failure)))
    if told.reply is None:
        raise ValueError(line)
    return told.key, Entry(told.model, told.reply)


@contextlib.contextmanager
def _locked(file: IO[bytes]) -> Generator[None]:
    """Alone with a file among all processes; the system gives the lock back if this one dies."""
    if os.name == "posix":
        import fcntl

        fcntl.flock(file.fileno(), fcntl.LOCK_EX)
        try:
            yield
        finally:
            fcntl.flock(file.fileno(), fcntl.LOCK_UN)
    else:
        import msvcrt

        beyond = 1 << 40  # a byte that no file reaches, so that reading is not hindered
        file.seek(beyond)
        msvcrt.locking(file.fileno(), msvcrt.LK_LOCK, 1)  # type: ignore[attr-defined]
        try:
            yield
        finally:
            file.seek(beyond)
            msvcrt.locking(file.fileno(), msvcrt.LK_UNLCK, 1)  # type: ignore[attr-defined]
