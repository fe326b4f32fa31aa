"""The llama.cpp library in this process; run as a program, a trial in a process that may die of it.

Imports nothing but the library, so that the trial needs no more than that.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence
from typing import Any

LIBRARY = "xllamacpp"
NOT_LOADED = 3
"""Exit code of a trial whose model was refused."""

BATCH_TOKENS = 128
"""As many tokens of a prompt as are worked through before the deadline is looked at again."""

_NO_LOGS = -1


def start(path: str, adapters: Sequence[tuple[str, float]], *, threads: int, context_tokens: int, key: str) -> Any:
    """A running model; RuntimeError if the library refuses the files.

    The library always opens a listener on a free loopback port; `key` shuts it to everyone else.
    """
    xllamacpp: Any = importlib.import_module(LIBRARY)
    params = xllamacpp.CommonParams()
    params.model.path = path
    params.lora_adapters = [xllamacpp.CommonAdapterLoraInfo(*adapter) for adapter in adapters]
    params.n_ctx = context_tokens
    params.n_batch = params.n_ubatch = BATCH_TOKENS
    params.cpuparams.n_threads = params.cpuparams_batch.n_threads = threads
    params.cache_ram_mib = 0  # no store of earlier prompts: what is cached must not depend on what was asked before
    params.warmup = False
    params.verbosity = _NO_LOGS
    params.ui = False
    params.n_threads_http = 1
    params.api_keys = [key]
    server = xllamacpp.Server(params)
    # A server that is ended before its loop has begun would wait for the end of that loop for ever.
    server.handle_completions({"prompt": "a", "max_tokens": 0, "cache_prompt": False})
    return server


def _trial(path: str, *adapters: str) -> int:
    """Load a model and let it say one word; each adapter as SCALE:PATH."""
    pairs = [(file, float(scale)) for scale, _, file in (adapter.partition(":") for adapter in adapters)]
    try:
        server = start(path, pairs, threads=1, context_tokens=512, key="trial")
    except RuntimeError:
        return NOT_LOADED
    server.handle_chat_completions({"messages": [{"role": "user", "content": "Hello"}], "max_tokens": 2})
    return 0


if __name__ == "__main__":
    sys.exit(_trial(*sys.argv[1:]))
