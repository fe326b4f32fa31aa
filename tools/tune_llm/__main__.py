"""Tune a small language model by LoRA: `python -m tools.tune_llm EXAMPLES.jsonl --out NAME.gguf`.

Writes the adapter, and beside it NAME.json, the card: what it was made of, how, and what it does with examples that
were held out. Needs the extra [train]; under an hour on two cores for 3000 examples of 400 tokens.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from interplan_sumo.errors import InputError, InterplanError

NEEDED = ("torch", "transformers", "peft", "gguf")
INSTALL = "pip install --editable '.[train]'"
BAD_INPUT = 2

_ABOVE_ZERO = ("epochs", "rank", "lr", "batch", "threads", "held_out", "max_minutes")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; its exit code."""
    given = _parser().parse_args(arguments)
    try:
        _check(given)
        os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # threads that spin while they wait take cores from others
        os.environ["HF_HUB_OFFLINE"] = "1"  # transformers reads files of this machine only
        from tools.tune_llm.tune import tune

        tune(given)
    except InterplanError as error:
        print(f"error: {error}", file=sys.stderr)
        return BAD_INPUT
    return 0


def _check(given: argparse.Namespace) -> None:
    for name in NEEDED:
        if importlib.util.find_spec(name) is None:
            raise InputError(f"tuning needs {name}, which is not installed. Run: {INSTALL}")
    for name in _ABOVE_ZERO:
        if getattr(given, name) <= 0:
            raise InputError(f"--{name.replace('_', '-')} is {getattr(given, name)}, expected more than 0")
    if given.out.suffix != ".gguf" or not given.out.parent.is_dir():
        raise InputError(f"--out is {given.out}, expected NAME.gguf in a folder that is there")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m tools.tune_llm", description="Tune a small language model by LoRA."
    )
    add = parser.add_argument
    add("examples", type=Path, help="JSONL, one object a line: messages (system, user, assistant), choices, about")
    add("--out", type=Path, required=True, metavar="NAME.gguf", help="the adapter; its card is written beside it")
    add("--base", type=Path, metavar="FILE.gguf", help="the model to tune (default: the embedded model)")
    add("--epochs", type=int, default=1, help="(default: %(default)s)")
    add("--rank", type=int, default=16, help="of the changes (default: %(default)s)")
    add("--targets", default="attn_q,attn_v", help="matrices to tune (default: %(default)s)")
    add("--lr", type=float, default=1e-3, help="learning rate (default: %(default)s)")
    add("--schedule", choices=("cosine", "constant"), default="cosine", help="(default: %(default)s)")
    add("--batch", type=int, default=8, help="examples per step (default: %(default)s)")
    add("--seed", type=int, default=0, help="(default: %(default)s)")
    add("--precision", choices=("bfloat16", "float32"), default="bfloat16", help="of the products of matrices")
    add("--threads", type=int, default=2, help="no more than there are cores (default: %(default)s)")
    add("--held-out", type=int, default=400, help="as many held-out examples are judged (default: %(default)s)")
    add("--max-minutes", type=float, default=55.0, help="for everything (default: %(default)s)")
    add("--resume", action="store_true", help="go on from the checkpoint beside --out")
    return parser


if __name__ == "__main__":
    sys.exit(main())
