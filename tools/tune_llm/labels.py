"""Training examples: `python -m tools.tune_llm.labels --out FILE.jsonl [--per-family N | --scenes FILE.yaml ...]`

Drives training scenes over and over and writes a question with its best answer
a line. What is done stays done: the same command goes on where it was stopped,
and `--minutes` ends it in time. FILE.jsonl.parts keeps the scenes that are
done, FILE.jsonl.card.json says what FILE.jsonl holds; both and the file itself
depend on the scenes and the options alone, not on the workers.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import os
import sys
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

from interplan_sumo.batch.engine import run_tasks
from interplan_sumo.batch.kept_answers import OF_THE_MACHINE
from interplan_sumo.batch.tasks import Answer, Limits, Publish, Task, Work
from interplan_sumo.batch.versions import versions
from interplan_sumo.errors import InputError
from interplan_sumo.verification.ordinary_scenes import FIRST_SEED
from interplan_sumo.world.files import replacing
from tools.tune_llm.rollouts import MARGIN, STEPS_PER_PLAN, labelled
from tools.tune_llm.scenes import START_APART_M, TrainingScene, generated_scenes, scenes_of

KIND: Final = "interplan-sumo decisions labelled by rollout"
FORMAT: Final = 1
PARTS, CARD = ".parts", ".card.json"
"""Endings of the files beside the examples."""
_GROUP: Final = "labels"


@dataclass(frozen=True, slots=True)
class LabelSettings:
    """What decides on the examples of a scene."""

    every: int = 3
    """After a decision whose options came to the same, this one is the next that is looked at."""
    hold: int = 3
    """For so many decisions an option is kept when it is tried."""
    drives_per_scene: int = 12

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if value < 1:
                raise InputError(f"{name.replace('_', '-')} is {value}, expected 1 or more")


DEFAULTS: Final = LabelSettings()


def make_labels(
    out: Path,
    scenes: Sequence[TrainingScene],
    settings: LabelSettings = DEFAULTS,
    *,
    others: float = 1.0,
    workers: int = 1,
    minutes: float | None = None,
) -> dict[str, Any]:
    """Label scenes and write the examples of all that are done; the card.

    Of examples that are not decisive at most `others` times as many are written
    as of those that are. InputError for what cannot be used or written. After
    `minutes` no scene is waited for.
    """
    parts = Parts(out, settings)
    until_s = None if minutes is None else time.monotonic() + 60.0 * minutes
    waiting = [scene for scene in scenes if _key(scene) not in parts.done]
    if len(waiting) < len(scenes):
        _say(f"{len(scenes) - len(waiting)} of {len(scenes)} scenes are done already")
    tasks = [Task(scene.number, _GROUP, scene) for scene in waiting]
    ended = run_tasks(tasks, partial(_open, settings), workers=workers, limits=Limits())
    with contextlib.closing(ended) as outcomes:
        for done, outcome in enumerate(outcomes, start=len(scenes) - len(waiting) + 1):
            value: dict[str, Any] = outcome.value
            if outcome.fault is not None:
                value = {"examples": [], "drives": 0, "reason": f"{outcome.fault.kind}: {outcome.fault.message}"}
            if outcome.fault is None or outcome.fault.kind not in OF_THE_MACHINE:
                parts.keep(outcome.task.payload, value)
            _say(f"[{done}/{len(scenes)}] {outcome.task.payload.scenario.id}: {_in_words(value)}")
            if until_s is not None and time.monotonic() > until_s:
                break
    return _gathered(out, scenes, parts, settings, others)


def _open(settings: LabelSettings, _group: str, publish: Publish) -> Work:
    def work(scene: TrainingScene) -> Answer:
        publish("simulate")
        found = labelled(scene, every=settings.every, hold=settings.hold, most_drives=settings.drives_per_scene)
        return asdict(found), None

    return work


def _in_words(value: dict[str, Any]) -> str:
    if value["reason"]:
        return str(value["reason"])
    decisive = sum(example["about"]["decisive"] for example in value["examples"])
    return f"{len(value['examples'])} examples, {decisive} of them decisive, {value['drives']} drives"


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


# --- scenes that are done ------------------------------------------------------------------------


class Parts:
    """Scenes with their examples, one a line, in the order in which they were done."""

    def __init__(self, out: Path, settings: LabelSettings) -> None:
        """Reads what is there beside the file of examples, and forgets a line that was cut off.

        InputError if it was made with other settings or cannot be read.
        """
        self.path = path = out.with_name(out.name + PARTS)
        self.done: dict[str, dict[str, Any]] = {}
        """What came of them, by key."""
        head = {"kind": KIND, "format": FORMAT, **asdict(settings)}
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            text = path.read_bytes() if path.is_file() else b""
            whole = text[: text.rfind(b"\n") + 1]
            if not whole:
                path.write_bytes(_line(head))
            elif len(whole) < len(text):
                os.truncate(path, len(whole))
            lines = [json.loads(line) for line in whole.splitlines()]
        except OSError as error:
            raise _unwritable(path, error) from None
        except ValueError as error:
            raise InputError(f"{path} is damaged ({error}); delete it, or give another file as --out") from None
        if lines and lines[0] != head:
            raise InputError(f"{path} was made with other options or by another version; give another file as --out")
        self.done = {line["scene"]: line["value"] for line in lines[1:]}

    def keep(self, scene: TrainingScene, value: dict[str, Any]) -> None:
        """Append a scene; InputError if it cannot be written."""
        try:
            with self.path.open("ab") as file:
                file.write(_line({"scene": _key(scene), "value": value}))
        except OSError as error:
            raise _unwritable(self.path, error) from None
        self.done[_key(scene)] = value


def _key(scene: TrainingScene) -> str:
    return f"{scene.number} {scene.seed} {scene.scenario.hash()}"


def _line(value: dict[str, Any]) -> bytes:
    return (json.dumps(value, ensure_ascii=False, allow_nan=False) + "\n").encode()


def _unwritable(path: Path, error: OSError) -> InputError:
    return InputError(f"cannot write {path}: {error.strerror or error}; give another file as --out")


# --- the file and its card -----------------------------------------------------------------------


def balanced(examples: Sequence[dict[str, Any]], others: float = 1.0) -> list[dict[str, Any]]:
    """All decisive examples, and of the rest at most `others` times as many in each split, by their hashes."""
    kept = {id(example) for example in examples if example["about"]["decisive"]}
    for split in ("train", "val"):
        here = [example for example in examples if example["about"]["split"] == split]
        rest = sorted((example for example in here if not example["about"]["decisive"]), key=_drawn)
        kept |= {id(example) for example in rest[: round(others * (len(here) - len(rest)))]}
    return [example for example in examples if id(example) in kept]


def _drawn(example: dict[str, Any]) -> str:
    about = example["about"]
    return hashlib.sha256(f"{about['scenario']} {about['time_s']}".encode()).hexdigest()


def _gathered(
    out: Path, scenes: Sequence[TrainingScene], parts: Parts, settings: LabelSettings, others: float
) -> dict[str, Any]:
    done = [scene for scene in scenes if _key(scene) in parts.done]
    values = [parts.done[_key(scene)] for scene in done]
    examples = balanced([example for value in values for example in value["examples"]], others)
    text = b"".join(_line(example) for example in examples)
    card = _card(out, done, values, examples, {**asdict(settings), "others": others}) | {
        "sha256": hashlib.sha256(text).hexdigest()
    }
    try:
        _place(out, text)
        _place(out.with_name(out.name + CARD), (json.dumps(card, indent=2, ensure_ascii=False) + "\n").encode())
    except OSError as error:
        raise _unwritable(out, error) from None
    return card


def _place(path: Path, content: bytes) -> None:
    with replacing(path) as fresh:
        fresh.write_bytes(content)


def _card(
    out: Path, done: Sequence[TrainingScene], values: Sequence[dict[str, Any]], examples: Sequence[dict[str, Any]],
    settings: dict[str, Any],
) -> dict[str, Any]:  # fmt: skip
    about = [example["about"] for example in examples]
    decisive = [each for each in about if each["decisive"]]
    seeds = [scene.seed for scene in done]
    return {
        "kind": KIND,
        "format": FORMAT,
        "file": out.name,
        "versions": versions(),
        "settings": {**settings, "steps_per_plan": STEPS_PER_PLAN, "margin": MARGIN},
        "scenes": {
            "from": "the scenario generator, or files; none on a site of a suite's scenario, and none that starts "
            f"within {START_APART_M:g} m of one",
            "done": len(done),
            "by_split": _tally(scene.split for scene in done),
            "seeds": [min(seeds), max(seeds)] if seeds else [],
            "without_examples": sum(not value["examples"] for value in values),
            "failed": _tally(value["reason"] for value in values if value["reason"]),
        },
        "drives": sum(value["drives"] for value in values),
        "examples": {
            "all": len(about),
            "by_split": _tally(each["split"] for each in about),
            "by_family": _tally(each["family"] for each in about),
            "by_map": _tally(each["map"] for each in about),
            "by_answer": _tally(example["messages"][-1]["content"] for example in examples),
            "untried": sum(not each["values"] for each in about),
            "by_choices": _tally(str(len(example["choices"])) for example in examples),
        },
        "decisive": {
            "all": len(decisive),
            "by_split": _tally(each["split"] for each in decisive),
            "by_answer": _tally(e["messages"][-1]["content"] for e in examples if e["about"]["decisive"]),
            "better_than_held": sum(
                e["messages"][-1]["content"] != e["about"]["held"] for e in examples if e["about"]["decisive"]
            ),
        },
    }


def _tally(names: Iterable[str]) -> dict[str, int]:
    return dict(sorted(Counter(names).items()))


# --- the command ---------------------------------------------------------------------------------


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.jsonl")
    source = parser.add_mutually_exclusive_group()
    source.add_argument("--per-family", type=int, default=20, help="generate so many scenes of each family")
    source.add_argument("--scenes", type=Path, nargs="+", metavar="FILE.yaml", help="take these instead")
    parser.add_argument("--seeds-from", type=int, default=FIRST_SEED, help="seed of the first scene")
    parser.add_argument(
        "--every", type=int, default=DEFAULTS.every, help="after a decision without a difference look at the n-th"
    )
    parser.add_argument("--hold", type=int, default=DEFAULTS.hold, help="keep an option for so many decisions")
    parser.add_argument("--drives-per-scene", type=int, default=DEFAULTS.drives_per_scene)
    parser.add_argument("--others", type=float, default=1.0, help="for each decisive example, at most so many others")
    parser.add_argument("--workers", type=int, default=1, help="processes; 0 works in this one")
    parser.add_argument("--minutes", type=float, help="wait for no scene after this time")
    given = parser.parse_args(arguments)
    try:
        settings = LabelSettings(given.every, given.hold, given.drives_per_scene)
        if not given.others >= 0.0:
            raise InputError(f"others is {given.others}, expected 0 or more")
        if given.workers < 0:
            raise InputError(f"workers is {given.workers}, expected 0 (in this process) or more")
        Parts(given.out, settings)  # to refuse what cannot be gone on with before scenes are made
        scenes = (
            scenes_of(given.scenes, given.seeds_from)
            if given.scenes
            else generated_scenes(given.per_family, given.seeds_from)
        )
        card = make_labels(
            given.out, scenes, settings, others=given.others, workers=given.workers, minutes=given.minutes
        )
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    counts = ", ".join(f"{count} {split}" for split, count in card["examples"]["by_split"].items())
    print(f"{card['examples']['all']} examples ({counts}) of {card['scenes']['done']} scenes: {given.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
