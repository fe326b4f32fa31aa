"""The card of an adapter: what it was made of, how, and what it does with held-out examples."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch

from interplan_sumo import __version__
from interplan_sumo.world.files import file_hash
from tools.tune_llm.examples import TokenSample
from tools.tune_llm.fitting import Fitted, FittingSettings
from tools.tune_llm.heldout import HeldOut, Ratio, chance, first_offered

EACH = "drawn"
"""In the card of chats: a line about each of them."""
CAVEAT = "Tuned on examples of its task: what it scores there is not a zero-shot result."


@dataclass(frozen=True, slots=True)
class Made:
    """A tuning that is done."""

    adapter: Path
    base: Path
    examples: Path
    learned: Sequence[TokenSample]
    held_out: Sequence[TokenSample]
    settings: FittingSettings
    before: HeldOut | None
    """None without held-out examples, as for `after`."""
    after: HeldOut | None
    fitted: Fitted


def write_card(path: Path, made: Made) -> None:
    """Write it as JSON."""
    path.write_text(json.dumps(_card(made), indent=2) + "\n", encoding="utf-8")


def _card(made: Made) -> dict[str, Any]:
    return {
        "name": made.adapter.stem,
        "kind": "LoRA adapter, GGUF",
        "caveat": CAVEAT,
        "adapter": {**_file(made.adapter), "bytes": made.adapter.stat().st_size},
        "base": _file(made.base),
        "examples": {
            **_file(made.examples),
            "learned": len(made.learned),
            "held_out": len(made.held_out),
            "tokens": sum(len(sample.read) for sample in made.learned),
            "card": _card_of(made.examples),
        },
        "settings": asdict(made.settings),
        "held_out": {
            "before": _judged(made.before),
            "after": _judged(made.after),
            "chance": chance(made.held_out),
            "always_first": _shares(*first_offered(made.held_out)),
        },
        "learning": _learning(made.fitted),
        "made_with": {"interplan-sumo": __version__, "torch": torch.__version__},
        "date": time.strftime("%Y-%m-%d", time.gmtime()),
    }


def _file(path: Path) -> dict[str, Any]:
    return {"file": path.name, "sha256": file_hash(path)}


def _card_of(examples: Path) -> dict[str, Any] | None:
    """What was written beside the examples about how they were made, if it is about these; but for its list of each."""
    for path in (examples.with_name(f"{examples.name}.card.json"), examples.with_suffix(".json")):
        try:
            card = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            continue
        if isinstance(card, dict) and card.get("sha256") == file_hash(examples):
            return {name: told for name, told in card.items() if name != EACH}
    return None


def _judged(judged: HeldOut | None) -> dict[str, Any] | None:
    if judged is None:
        return None
    return {"token_loss": round(judged.loss, 4), **_shares(judged.agreement, judged.decisive)}


def _shares(agreement: Ratio | None, decisive: Ratio | None) -> dict[str, Any]:
    return {"agreement": _share(agreement), "agreement_where_decisive": _share(decisive)}


def _share(share: Ratio | None) -> dict[str, Any] | None:
    if share is None:
        return None
    interval = [round(end, 3) for end in share.interval]
    return {"count": share.count, "of": share.of, "share": round(share.value, 3), "interval95": interval}


def _learning(fitted: Fitted) -> dict[str, Any]:
    progress = fitted.progress
    return {
        "ending": fitted.ending,
        "steps": progress.step,
        "of": fitted.steps,
        "kept_step": progress.best_step or progress.step,
        "seconds": round(progress.seconds),
        "tokens_per_s": round(progress.tokens / max(progress.seconds, 1e-9)),
        "looks": [
            {"step": step, "loss": round(loss, 4), "held_out_loss": None if held_out is None else round(held_out, 4)}
            for step, loss, held_out in progress.losses
        ],
    }
