"""Chats: one moment of a drive as a question with the answer that came true, to fine-tune language models on."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np

from interplan_sumo.batch.versions import versions
from interplan_sumo.dataset.drives import Drive, DriveSelection, chosen_drives, driven, source_hash
from interplan_sumo.dataset.observation_replay import ObservationReplay
from interplan_sumo.errors import InputError
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.suite import suites
from interplan_sumo.world.files import file_hash, writing
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.trace import Trace

FORMAT: Final = 1
KIND: Final = "interplan-sumo chats"
SAMPLES: Final = 600
"""The published number, there of as many scenarios."""
STEP_FRAMES, FUTURE_FRAMES = 5, 80
"""Places are told every 0.5 s for 8 s."""
APART_FRAMES: Final = 10
"""Moments of one drive are no nearer to each other."""
HELD_OUT_ONE_IN: Final = 10
"""Scenarios, where some are held out."""
TOO_SHORT: Final = "shorter than 8 s"


class ChatMessage(Protocol):
    """A message of a conversation."""

    @property
    def role(self) -> str: ...

    @property
    def text(self) -> str: ...


class Teller(Protocol):
    """A planner that asks a language model, and can say what the right answer would have been."""

    def start(self, mission: Mission) -> None: ...

    def example(self, observation: Observation, places: Floats) -> Sequence[ChatMessage]:
        """The conversation about a step; places (16, 2) are where the car came to be, in its frame at that step."""
        ...


@dataclass(frozen=True, slots=True)
class ChatRequest:
    """What to write, and where to."""

    file: Path
    """Ends in `.jsonl`; the card is written beside it, with `.json`."""
    runs: tuple[Path, ...]
    count: int = SAMPLES
    """Samples at most."""
    each: int = 1
    """Samples of each scenario at most, at moments at least 1 s apart."""
    seed: int = 0
    """Of the choice among scenarios, drives and moments."""
    choice: DriveSelection = field(default_factory=DriveSelection)
    hold_out: bool = False
    """Whether each line says in `about.split` what it is for: `train`, or `val` for one scenario in ten."""
    benchmark: bool = False
    """Whether scenes of the suites may be among them."""
    form: Mapping[str, Any] = field(default_factory=dict)
    """How the teller was made, for the card."""


@dataclass(frozen=True, slots=True)
class _Sample:
    drive: Drive
    frame: int
    line: str


def write_chats(
    request: ChatRequest, teller: Teller, on_sample: Callable[[Drive, int, int], None] | None = None
) -> dict[str, Any]:
    """Write one conversation a line, and the card; the card. Equal drives and options give equal bytes.

    `on_sample` is told of each sample's drive, how many there are now, and of
    how many at most. InputError for what cannot be used, and for scenes of a
    suite unless they are allowed.
    """
    if request.file.suffix != ".jsonl" or request.file.is_dir():
        raise InputError(f"{request.file} as --out: give a file whose name ends in .jsonl")
    for name in ("count", "each"):
        if getattr(request, name) < 1:
            raise InputError(f"{name} is {getattr(request, name)}, expected 1 or more")
    chosen = chosen_drives(request.runs, (), request.choice)
    held = [drive for drive in chosen.drives if _is_of_a_suite(drive.scenario)]
    if held and not request.benchmark:
        raise _benchmark(held, request.runs)
    drives = _by_scenario(chosen.drives, request.seed)
    left_out = Counter(chosen.left_out)
    samples: list[_Sample] = []
    each = min(request.each, -(-request.count // len(drives)))  # all scenarios before many moments of a few
    for sample in _samples(drives, teller, replace(request, each=each), left_out):
        samples.append(sample)
        if on_sample is not None:
            on_sample(sample.drive, len(samples), min(request.count, each * len(drives)))
        if len(samples) == request.count:
            break
    if not samples:
        raise InputError("no drive is as long as the 8 s that an answer covers; give runs of longer drives")
    return _write(request, samples, left_out)


# --- which scenes --------------------------------------------------------------------------------


def _is_of_a_suite(scenario: Scenario) -> bool:
    """Whether it is a scene of a suite: by its id, as overridden as it may be, or by all but its id."""
    ids, scenes = _official()
    return scenario.id in ids or _nameless(scenario) in scenes


@cache
def _official() -> tuple[frozenset[str], frozenset[str]]:
    """Ids and nameless hashes of all scenes of suites."""
    found = [scenario for suite in suites().values() for scenario in suite.scenarios]
    return frozenset(scenario.id for scenario in found), frozenset(map(_nameless, found))


def _nameless(scenario: Scenario) -> str:
    return replace(scenario, id="").hash()


def _benchmark(held: Sequence[Drive], runs: Sequence[Path]) -> InputError:
    names = sorted({drive.scenario.id for drive in held})
    shown = ", ".join(names[:3]) + (", ..." if len(names) > 3 else "")
    return InputError(
        f"{', '.join(map(str, runs))}: scenes of the benchmark's suites ({shown}) test no model that was trained on "
        "them; give runs of other scenes (scenarios generate), or say --allow-benchmark"
    )


def _by_scenario(drives: Iterable[Drive], seed: int) -> list[list[Drive]]:
    """The drives of each scenario, scenarios and drives in an order that depends on nothing but their names."""
    found: dict[str, list[Drive]] = {}
    for drive in sorted(drives, key=lambda each: _drawn(seed, *each.key)):
        found.setdefault(drive.scenario.id, []).append(drive)
    return [found[name] for name in sorted(found, key=lambda name: _drawn(seed, name))]


def _drawn(seed: int, *names: object) -> bytes:
    return hashlib.sha256(json.dumps(["chats", seed, *names]).encode()).digest()


# --- the samples ---------------------------------------------------------------------------------


def _samples(
    scenarios: Iterable[Sequence[Drive]], teller: Teller, request: ChatRequest, left_out: Counter[str]
) -> Iterator[_Sample]:
    """Samples of each scenario, from the first of its drives that is long enough."""
    for drives in scenarios:
        for drive in drives:
            scenario, roads, trace = driven(drive)
            frames = len(trace) - FUTURE_FRAMES
            if frames < 1:
                left_out[TOO_SHORT] += 1
                continue
            rng = np.random.default_rng(np.frombuffer(_drawn(request.seed, "moment", *drive.key), np.uint32))
            about = {"about": {"split": side_of(scenario.id)}} if request.hold_out else {}
            again = ObservationReplay(scenario, roads, trace)
            teller.start(again.mission)
            for frame in _moments(frames, request.each, rng):
                turns = teller.example(again.at(frame), future_places(trace, frame))
                messages = [{"role": turn.role, "content": turn.text} for turn in turns]
                yield _Sample(drive, frame, json.dumps({"messages": messages, **about}, ensure_ascii=False))
            break


def _moments(frames: int, count: int, rng: np.random.Generator) -> list[int]:
    """So many frames below `frames`, or as many as lie far enough apart; the first is the same for every count."""
    found = [int(rng.integers(frames))]
    for frame in rng.permutation(frames).tolist() if count > 1 else ():
        if len(found) == count:
            break
        if min(abs(frame - other) for other in found) >= APART_FRAMES:
            found.append(frame)
    return sorted(found)


def side_of(scenario: str) -> str:
    """What all moments of a scenario of that id are for, whatever the seed: `train` or, one in ten, `val`."""
    return "train" if int.from_bytes(_drawn(0, "split", scenario)[:8]) % HELD_OUT_ONE_IN else "val"


def future_places(trace: Trace, frame: int) -> Floats:
    """(16, 2) where the car's centre was every 0.5 s after a frame, in the car's frame then; 8 s must be left."""
    ahead = slice(frame + STEP_FRAMES, frame + FUTURE_FRAMES + 1, STEP_FRAMES)
    ego = trace.ego
    dx_m, dy_m = ego.x_m[ahead] - ego.x_m[frame], ego.y_m[ahead] - ego.y_m[frame]
    cos, sin = np.cos(ego.heading_rad[frame]), np.sin(ego.heading_rad[frame])
    return np.stack((cos * dx_m + sin * dy_m, cos * dy_m - sin * dx_m), axis=1)


# --- the files -----------------------------------------------------------------------------------


def _write(request: ChatRequest, samples: Sequence[_Sample], left_out: Counter[str]) -> dict[str, Any]:
    card_file = request.file.with_suffix(".json")
    with writing(request.file, "give another --out"):
        request.file.parent.mkdir(parents=True, exist_ok=True)
        card_file.unlink(missing_ok=True)  # so that no card ever tells of other lines
        request.file.write_text("".join(f"{sample.line}\n" for sample in samples), encoding="utf-8", newline="\n")
        card = _card(request, samples, left_out)
        card_file.write_text(json.dumps(card, indent=1, ensure_ascii=False) + "\n", encoding="utf-8", newline="\n")
    return card


def _card(request: ChatRequest, samples: Sequence[_Sample], left_out: Counter[str]) -> dict[str, Any]:
    drives = [sample.drive for sample in samples]
    return {
        "kind": KIND,
        "format": FORMAT,
        "file": request.file.name,
        "sha256": file_hash(request.file),
        "samples": len(samples),
        "options": {
            "count": request.count,
            "each": request.each,
            "seed": request.seed,
            "min_score": request.choice.min_score,
            "hold_out": request.hold_out,
            **request.form,
        },
        "counts": {
            "by_family": _tally(drive.scenario.family for drive in drives),
            "by_map": _tally(drive.map.name for drive in drives),
            "by_driver": _tally(drive.planner for drive in drives),
        },
        "of_suites": sum(_is_of_a_suite(drive.scenario) for drive in drives),
        "left_out": dict(sorted(left_out.items())),
        "sources": sorted({drive.source for drive in drives}),
        "drives_hash": source_hash(drives),
        "versions": versions(),
        "drawn": [
            {"scenario": s.drive.scenario.id, "planner": s.drive.planner, "seed": s.drive.seed, "frame": s.frame}
            for s in samples
        ],
    }


def _tally(names: Iterable[str]) -> dict[str, int]:
    return dict(sorted(Counter(names).items()))
