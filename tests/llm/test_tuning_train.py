"""Tuning: it learns, the same again, over an interruption too; and says in a card what it did."""

from __future__ import annotations

import importlib.util
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from interplan_sumo.errors import InputError
from interplan_sumo.world.files import file_hash
from tests.llm.tuning_models import NEEDED, line, write_examples, write_llama
from tools.tune_llm import __main__ as command
from tools.tune_llm.examples import TokenSample, as_samples, divided, read_examples, shuffled_batches

if TYPE_CHECKING:
    from tools.tune_llm.fitting import Fitting

pytestmark = [
    pytest.mark.nightly,
    *(
        pytest.mark.skipif(importlib.util.find_spec(name) is None, reason=f"needs {name}: 'interplan-sumo[train]'")
        for name in NEEDED
    ),
]


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_llama(tmp_path_factory.mktemp("tuning") / "tiny.gguf")


@pytest.fixture(scope="module")
def examples(tiny: Path) -> Path:
    return write_examples(tiny.parent / "examples.jsonl")


def samples_of(tiny: Path, examples: Path) -> list[TokenSample]:
    from tools.tune_llm.chat import ChatTokens

    return as_samples(read_examples(examples), ChatTokens(tiny))


def fitting(tiny: Path, examples: Path, folder: Path, **other: Any) -> Fitting:
    from tools.tune_llm.fitting import Fitting, FittingSettings
    from tools.tune_llm.model import TunedModel

    fast = FittingSettings(epochs=5, learning_rate=0.02, rank=4, alpha=4, batch=4, threads=1, precision="float32")
    settings = replace(fast, **other)
    learned, held_out = divided(samples_of(tiny, examples), 100)
    model = TunedModel(tiny, settings.lora)
    return Fitting(model, learned, held_out, settings, folder / "checkpoint.pt", "tiny")


def tuned(tiny: Path, examples: Path, out: Path, *more: str) -> dict[str, Any]:
    """The card of a run of the command."""
    fast = "--epochs 2 --lr 0.02 --rank 4 --batch 4 --threads 1 --precision float32".split()
    assert command.main([str(examples), "--out", str(out), "--base", str(tiny), *fast, *more]) == 0
    return json.loads(out.with_suffix(".json").read_text(encoding="utf-8"))


class _Stopped(Exception):  # noqa: N818 - an interruption
    pass


def test_the_loss_falls_and_what_is_always_right_is_learned(
    tiny: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    examples = write_examples(tmp_path / "always.jsonl", answer="merge_right")
    card = tuned(tiny, examples, tmp_path / "always.gguf", "--epochs", "8", "--targets", "attn_v,attn_output,ffn_down")
    before, after = card["held_out"]["before"], card["held_out"]["after"]
    assert after["token_loss"] < 0.5 * before["token_loss"]
    assert before["agreement"]["count"] < after["agreement"]["count"] == 8
    assert card["held_out"]["chance"] == 0.25
    said = capsys.readouterr().out.splitlines()
    assert said[0].startswith("20 examples to learn from")
    assert "tokens/s" in said[2]
    assert said[-1].startswith("wrote ")


def test_the_card_says_what_was_made_of_what(tiny: Path, examples: Path, tmp_path: Path) -> None:
    card = tuned(tiny, examples, tmp_path / "sign.gguf", "--precision", "bfloat16")
    assert "not a zero-shot result" in card["caveat"]
    assert card["adapter"]["sha256"] == file_hash(tmp_path / "sign.gguf")
    assert card["base"] == {"file": "tiny.gguf", "sha256": file_hash(tiny)}
    assert (card["examples"]["learned"], card["examples"]["held_out"]) == (20, 8)
    assert card["settings"]["seed"] == 0
    assert card["learning"]["ending"] == "done"
    assert card["learning"]["steps"] == card["learning"]["of"] == 10
    assert not list(tmp_path.glob("*.checkpoint.*"))


@pytest.mark.parametrize("name", ["examples.jsonl.card.json", "examples.json"])  # of labels, and of chats
def test_the_card_of_the_examples_is_taken_over_if_it_is_theirs(name: str, tiny: Path, tmp_path: Path) -> None:
    examples = write_examples(tmp_path / "examples.jsonl")
    told = {"seeds": [100_000, 100_015], "sha256": file_hash(examples)}
    for card, taken in (({**told, "drawn": ["a line", "each"]}, told), ({**told, "sha256": "of another file"}, None)):
        (tmp_path / name).write_text(json.dumps(card), encoding="utf-8")
        assert tuned(tiny, examples, tmp_path / "sign.gguf", "--epochs", "1")["examples"]["card"] == taken


@pytest.mark.parametrize("stopped_at", [1, 12])
def test_an_interrupted_run_ends_as_if_nothing_had_happened(
    tiny: Path, examples: Path, tmp_path: Path, stopped_at: int
) -> None:
    def stop(running: Fitting) -> None:
        if running.progress.step == stopped_at:
            raise _Stopped

    undisturbed = fitting(tiny, examples, tmp_path)
    whole = undisturbed.run(math.inf, lambda _: None)
    (tmp_path / "checkpoint.pt").unlink()
    interrupted = fitting(tiny, examples, tmp_path)
    with pytest.raises(_Stopped):
        interrupted.run(math.inf, stop)
    resumed = fitting(tiny, examples, tmp_path)
    if stopped_at >= 2:  # the first look has left a checkpoint
        assert 0 < resumed.resume() <= stopped_at
    assert resumed.run(math.inf, lambda _: None).progress.losses == whole.progress.losses
    undisturbed.model.write_adapter(tmp_path / "whole.gguf", "a")
    resumed.model.write_adapter(tmp_path / "resumed.gguf", "a")
    assert (tmp_path / "whole.gguf").read_bytes() == (tmp_path / "resumed.gguf").read_bytes()


def test_no_time_left_ends_with_a_checkpoint_and_an_adapter(
    tiny: Path, examples: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    card = tuned(tiny, examples, tmp_path / "sign.gguf", "--max-minutes", "0.001")
    assert card["learning"]["ending"] == "out of time"
    assert "--resume goes on" in capsys.readouterr().out
    resumed = tuned(tiny, examples, tmp_path / "sign.gguf", "--resume")
    assert resumed["learning"]["ending"] == "done"
    uninterrupted = tuned(tiny, examples, tmp_path / "whole.gguf")
    assert resumed["learning"]["looks"] == uninterrupted["learning"]["looks"]


def test_it_ends_when_held_out_examples_no_longer_gain(tiny: Path, tmp_path: Path) -> None:
    from tools.tune_llm.fitting import PATIENCE

    lines = [json.loads(line(number, "train")) for number in range(8)]
    wrong = [json.loads(line(number, "val")) for number in range(4)]
    for told in wrong:
        told["messages"][2]["content"] = "merge_left" if told["messages"][2]["content"] != "merge_left" else "stop"
    (tmp_path / "odd.jsonl").write_text("\n".join(json.dumps(told) for told in (*lines, *wrong)), encoding="utf-8")
    fitted = fitting(tiny, tmp_path / "odd.jsonl", tmp_path, epochs=60).run(math.inf, lambda _: None)
    assert fitted.ending == "no longer better"
    looks = [look[2] or 0.0 for look in fitted.progress.losses]
    assert looks.index(min(looks)) == len(looks) - 1 - PATIENCE
    assert fitted.progress.best_step == fitted.progress.losses[looks.index(min(looks))][0]


def test_a_checkpoint_of_something_else_is_refused(tiny: Path, examples: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nothing to resume"):
        fitting(tiny, examples, tmp_path).resume()
    fitting(tiny, examples, tmp_path).run(0.0, lambda _: None)
    other = fitting(tiny, examples, tmp_path, seed=9)
    with pytest.raises(InputError, match="other examples or settings"):
        other.resume()
    (tmp_path / "checkpoint.pt").write_bytes(b"a text")
    with pytest.raises(InputError, match="damaged"):
        fitting(tiny, examples, tmp_path).resume()


def test_lines_without_a_split_are_held_out_by_their_own_hash(tmp_path: Path) -> None:
    lines = [line(number) for number in range(300)]
    lines = [each.replace("Sign", f"Sign {number}") for number, each in enumerate(lines)]
    (tmp_path / "all.jsonl").write_text("\n".join(lines), encoding="utf-8")
    (tmp_path / "some.jsonl").write_text("\n\n".join(lines[100:]), encoding="utf-8")
    everything, some = (read_examples(tmp_path / f"{name}.jsonl") for name in ("all", "some"))
    assert 15 <= sum(example.held_out for example in everything) <= 45
    assert everything[100:] == some


def test_batches_hold_every_example_once(tiny: Path, examples: Path) -> None:
    samples = samples_of(tiny, examples)
    first, same, other = (shuffled_batches(samples, 8, np.random.default_rng(seed)) for seed in (0, 0, 1))
    assert sorted(index for batch in first for index in batch) == list(range(len(samples)))
    assert first == same != other


@pytest.mark.parametrize(("change", "named"), [
    ({"messages": "none"}, "no JSON object with messages"),
    ({"messages": [{"role": "user", "content": "a"}]}, "roles system, user, assistant"),
    ({"choices": ["follow"]}, "the answer 'merge_left' is not among"),
    ({"choices": "follow"}, "not a list of texts"),
    ({"about": {"split": "test"}}, "expected train or val"),
])  # fmt: skip
def test_a_line_that_cannot_be_used_is_named(tmp_path: Path, change: dict[str, Any], named: str) -> None:
    told = {**json.loads(line(1)), **change}
    (tmp_path / "bad.jsonl").write_text(f"{line(0)}\n{json.dumps(told)}\n", encoding="utf-8")
    with pytest.raises(InputError, match=rf"bad\.jsonl:2: .*{named}"):
        read_examples(tmp_path / "bad.jsonl")


def test_nothing_to_learn_from_and_too_long_are_refused(tiny: Path, tmp_path: Path) -> None:
    (tmp_path / "empty.jsonl").write_text(line(0, "val"), encoding="utf-8")
    with pytest.raises(InputError, match="no examples to learn from"):
        read_examples(tmp_path / "empty.jsonl")
    (tmp_path / "long.jsonl").write_text(line(0, "train").replace("Sign", "Sign" * 1100), encoding="utf-8")
    with pytest.raises(InputError, match="takes 4096"):
        samples_of(tiny, tmp_path / "long.jsonl")


@pytest.mark.parametrize(("arguments", "named"), [
    (["--targets", "attn_x"], "no target 'attn_x'"),
    (["--rank", "0"], "--rank is 0"),
    (["--max-minutes", "-1"], "--max-minutes is -1"),
    (["--out", "nowhere/sign.gguf"], "in a folder that is there"),
    (["--out", "sign.bin"], r"expected NAME\.gguf"),
])  # fmt: skip
def test_what_the_command_cannot_do_is_one_line(
    tiny: Path, examples: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], named: str
) -> None:
    given = [str(examples), "--out", str(tmp_path / "sign.gguf"), "--base", str(tiny), *arguments]
    assert command.main(given) == command.BAD_INPUT
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    assert named.replace("\\", "") in error


def test_a_missing_library_is_one_line_with_the_way_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    assert command.main([str(tmp_path / "examples.jsonl"), "--out", str(tmp_path / "sign.gguf")]) == command.BAD_INPUT
    error = capsys.readouterr().err
    assert error == "error: tuning needs torch, which is not installed. Run: pip install --editable '.[train]'\n"


def test_an_interval_holds_its_share_and_shrinks_with_numbers() -> None:
    from tools.tune_llm.heldout import Ratio

    low, high = Ratio(8, 10).interval
    assert (low, high) == (pytest.approx(0.490, abs=1e-3), pytest.approx(0.943, abs=1e-3))
    assert Ratio(0, 10).interval[0] == 0.0
    assert Ratio(10, 10).interval[1] == pytest.approx(1.0)
    wider, narrower = Ratio(8, 10).interval, Ratio(80, 100).interval
    assert wider[0] < narrower[0] < 0.8 < narrower[1] < wider[1]


def test_chance_the_first_option_and_what_is_decisive_are_counted_if_known(tiny: Path, tmp_path: Path) -> None:
    from tools.tune_llm.heldout import Ratio, chance, first_offered

    told = [json.loads(line(number, "train")) for number in range(3)]
    told[0]["choices"], told[1]["choices"] = ["follow", "stop"], ["follow", "merge_left", "stop", "merge_right"]
    del told[2]["choices"]
    (tmp_path / "three.jsonl").write_text("\n".join(map(json.dumps, told)), encoding="utf-8")
    samples = samples_of(tiny, tmp_path / "three.jsonl")
    assert chance(samples) == pytest.approx((1 / 2 + 1 / 4) / 2)
    assert first_offered(samples) == (Ratio(1, 2), None)
    assert chance(samples[2:]) is None
    assert first_offered(samples[2:]) == (None, None)
    told = [json.loads(line(0, "val")) for _ in range(3)]
    for each, decisive in zip(told, (True, False, True), strict=True):
        each["about"]["decisive"] = decisive
        each["choices"] = ["follow", "stop"]
    lines = [*map(json.dumps, told), line(1, "train")]
    (tmp_path / "some.jsonl").write_text("\n".join(lines), encoding="utf-8")
    samples = samples_of(tiny, tmp_path / "some.jsonl")
    learned, held_out = divided(samples, 10)
    assert (len(learned), len(held_out), len(divided(samples, 2)[1])) == (1, 3, 2)
    assert first_offered(held_out) == (Ratio(3, 3), Ratio(2, 2))
