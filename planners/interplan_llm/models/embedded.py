"""A GGUF model in this process, on its CPU: no server, no network, equal answers to equal questions."""

from __future__ import annotations

import contextlib
import math
import secrets
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from interplan_llm.models import native
from interplan_llm.models.answers import answered
from interplan_llm.models.constraints import grammar_of, response_format
from interplan_llm.models.protocol import Capabilities, Cause, ModelFailure, Reply, Request
from interplan_sumo.errors import InputError
from interplan_sumo.extras import library
from interplan_sumo.world.files import file_hash

CONTEXT_TOKENS = 4096
MAX_THREADS = 64

_MAGIC = b"GGUF"
_TRIAL_LIMIT_S = 600.0
_CAPABILITIES = Capabilities(json_schema=True, choice=True, grammar=True, logprobs=True, seed=True, prompt_cache=True)
_TOO_LONG = "exceed_context_size_error"


@dataclass(frozen=True, slots=True)
class Adapter:
    """A LoRA adapter as a GGUF file, added to the weights with a factor."""

    path: Path
    scale: float = 1.0


class EmbeddedModel:
    """One GGUF file with its adapters, loaded by `xllamacpp`.

    A process holds one such model at a time: one that was put out by another
    is loaded again at its next question. To be opened and asked on the main
    thread.
    """

    def __init__(
        self,
        path: Path,
        adapters: Sequence[Adapter] = (),
        *,
        threads: int = 1,
        context_tokens: int = CONTEXT_TOKENS,
    ) -> None:
        """Loads the model, the first time after a trial in a process of its own. InputError if it cannot run."""
        if not 1 <= threads <= MAX_THREADS:
            raise InputError(f"{threads} threads for the embedded model; give 1 to {MAX_THREADS}")
        for file in (path, *(adapter.path for adapter in adapters)):
            _check_file(file)
        version = getattr(library(native.LIBRARY, "the embedded model", "llm"), "__version__", "unknown")
        _check_runs(path, tuple(adapters))
        hashes = [f"+lora:{file_hash(adapter.path)}@{adapter.scale}" for adapter in adapters]
        self.name = f"embedded:{file_hash(path)}{''.join(hashes)}:{native.LIBRARY}-{version}"
        self.path = path
        self.adapters = tuple(adapters)
        self.threads = threads
        self.context_tokens = context_tokens
        self._provider = f"{native.LIBRARY} {version}"
        self._server: Any = None
        self._primed: str | None = None
        self._load()

    def __repr__(self) -> str:
        return f"EmbeddedModel({str(self.path)!r})"

    @property
    def capabilities(self) -> Capabilities:
        return _CAPABILITIES

    def ask(self, request: Request) -> Reply:
        """The answer, which depends on the request alone and not on what was asked before it."""
        began_s = time.monotonic()
        deadline_s = began_s + request.timeout_s
        if self._server is None:
            self._load()
        try:
            cached = self._prime(request, deadline_s)
            said = self._say(_body(request, cached=cached), deadline_s)
        except BaseException as error:
            self._primed = None
            if isinstance(error, ModelFailure):
                error.latency_s = time.monotonic() - began_s
            raise
        reply = Reply(
            text=said.text,
            prompt_tokens=said.usage.get("prompt_tokens", 0),
            completion_tokens=said.usage.get("completion_tokens", 0),
            latency_s=time.monotonic() - began_s,
            model=self.path.name,
            provider=self._provider,
            finish_reason=said.finish_reason,
        )
        return answered(request, reply)

    def close(self) -> None:
        if self._server is not None:
            _LOADED.clear()
            self._server = None
            self._primed = None

    def _load(self) -> None:
        for other in tuple(_LOADED):
            other.close()
        adapters = [(str(adapter.path), adapter.scale) for adapter in self.adapters]
        with _own_signals():
            try:
                self._server = native.start(
                    str(self.path),
                    adapters,
                    threads=self.threads,
                    context_tokens=self.context_tokens,
                    key=secrets.token_hex(),
                )
            except RuntimeError:
                raise _not_loaded(self.path, self.adapters) from None
        _LOADED.append(self)

    def _prime(self, request: Request, deadline_s: float) -> bool:
        """Bring the prompt cache into the state that belongs to the system message; whether it may be used.

        The library keeps whatever the last prompt has in common with the
        next. Tokens worked through in other batches come out a little
        different, so the answer would depend on the question before. Going
        back to the end of the system message each time makes the cache a
        function of that message alone, and costs one token.
        """
        first = request.messages[0]
        if first.role != "system" or len(request.messages) == 1:
            self._primed = None
            return False
        body = {
            "messages": [{"role": first.role, "content": first.text}],
            "add_generation_prompt": False,
            "max_tokens": 0,
        }
        before, self._primed = self._primed, None
        try:
            if before != first.text:
                self._say({**body, "cache_prompt": False}, deadline_s)
            self._say({**body, "cache_prompt": True}, deadline_s)
        except ModelFailure as failure:
            if failure.cause in ("timeout", "too_long"):
                raise
            return False  # a template that wants more than a system message
        self._primed = first.text
        return True

    def _say(self, body: dict[str, Any], deadline_s: float) -> _Said:
        """Run a request of the library to its end or to the deadline."""
        said = _Said(deadline_s)
        streamed = {"stream": True, "return_progress": True, "stream_options": {"include_usage": True}}
        thread = threading.Thread(target=said.listen, args=(self._server, {**body, **streamed}))
        thread.start()
        try:
            thread.join()
        except BaseException:  # Ctrl-C, which the library would swallow if it came while it calls us
            said.stopped = True
            thread.join()
            raise
        if said.error:
            raise _refusal(said.error)
        if time.monotonic() > deadline_s:
            raise ModelFailure("timeout", "no answer from the embedded model in time")
        return said


_LOADED: list[EmbeddedModel] = []
"""The model that this process holds, if any."""


class _Said:
    """What comes out of the library, piece by piece, until it is stopped or late."""

    def __init__(self, deadline_s: float) -> None:
        self.text = ""
        self.finish_reason = ""
        self.usage: dict[str, int] = {}
        self.error: dict[str, Any] = {}
        self.stopped = False
        self._deadline_s = deadline_s

    def listen(self, server: Any, body: dict[str, Any]) -> None:
        """Put the question and take in the answer."""
        try:
            server.handle_chat_completions(body, self._take)
        except (RuntimeError, ValueError) as error:  # text or a schema that the library cannot read
            self.error = {"message": str(error)}

    def _take(self, piece: dict[str, Any]) -> bool:
        """True ends the answer."""
        self.error = piece.get("error") or self.error
        self.usage = piece.get("usage") or self.usage
        for choice in piece.get("choices", ()):
            self.text += choice["delta"].get("content") or ""
            self.finish_reason = choice["finish_reason"] or self.finish_reason
        return self.stopped or time.monotonic() > self._deadline_s


def _body(request: Request, *, cached: bool) -> dict[str, Any]:
    body: dict[str, Any] = {
        "messages": [{"role": message.role, "content": message.text} for message in request.messages],
        "max_tokens": request.max_tokens,
        "temperature": request.temperature,
        "seed": request.seed,
        "cache_prompt": cached,
    }
    if not request.constrained:
        return body
    if request.choices is not None:
        body["grammar"] = grammar_of(request.choices)
    elif request.grammar is not None:
        body["grammar"] = request.grammar
    elif request.schema is not None:
        body["response_format"] = response_format(request.schema)
    return body


def _refusal(error: dict[str, Any]) -> ModelFailure:
    cause: Cause = "too_long" if error.get("type") == _TOO_LONG else "refused"
    return ModelFailure(cause, f"the embedded model refused the question: {error.get('message', 'no reason given')}")


@contextlib.contextmanager
def _own_signals() -> Generator[None]:
    """Keep Ctrl-C and SIGTERM ours: the library takes both over while it starts."""
    if threading.current_thread() is not threading.main_thread():
        raise InputError("open the embedded model on the main thread: its library takes over Ctrl-C while it starts")
    kept = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in kept.items():
            if handler is not None:
                signal.signal(number, handler)


def _check_file(path: Path) -> None:
    try:
        with path.open("rb") as file:
            magic = file.read(len(_MAGIC))
    except OSError as error:
        raise InputError(f"cannot read the model {path}: {error.strerror}") from None
    if magic != _MAGIC:
        raise InputError(f"{path} is not a GGUF file; convert it with llama.cpp's convert_hf_to_gguf.py")


@cache
def _check_runs(path: Path, adapters: tuple[Adapter, ...]) -> None:
    """Try the model in a process of its own: an illegal instruction or a damaged file ends that one, not the run."""
    if any(not math.isfinite(adapter.scale) for adapter in adapters):
        raise InputError(f"{path}: an adapter's scale must be a finite number")
    command = [sys.executable, "-P", native.__file__, str(path), *(f"{a.scale}:{a.path}" for a in adapters)]
    try:
        done = subprocess.run(
            command, capture_output=True, encoding="utf-8", errors="replace", timeout=_TRIAL_LIMIT_S, check=False
        )
    except subprocess.TimeoutExpired:
        raise InputError(f"{path} did not load in {_TRIAL_LIMIT_S:.0f} s; take a smaller model or a chat URL") from None
    if done.returncode == native.NOT_LOADED:
        raise _not_loaded(path, adapters)
    if done.returncode != 0:
        raise InputError(
            f"{native.LIBRARY} cannot run {path.name} on this machine: a trial ended with "
            f"{_ending(done.returncode, done.stderr)}; use a chat URL instead, or a build for this processor"
        )


def _ending(code: int, stderr: str) -> str:
    if code < 0:
        with contextlib.suppress(ValueError):
            return signal.Signals(-code).name
    last = stderr.strip().splitlines()[-1:]
    return f"exit code {code}{''.join(f' ({line})' for line in last)}"


def _not_loaded(path: Path, adapters: Sequence[Adapter]) -> InputError:
    beside = f" with {', '.join(str(adapter.path) for adapter in adapters)}" if adapters else ""
    return InputError(f"{native.LIBRARY} cannot load {path}{beside}: damaged, or not made for each other")
