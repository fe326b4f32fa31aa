"""The Llama that learns computes what llama.cpp computes, with an adapter and without."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from interplan_llm.models.embedded import Adapter as LoadedAdapter
from interplan_llm.models.embedded import EmbeddedModel
from interplan_llm.models.fetch import default_model
from interplan_llm.models.protocol import Request
from interplan_sumo.errors import InputError
from tests.llm.native_tokens import native_model

for needed in ("gguf", "jinja2"):
    pytest.importorskip(needed, reason="needs the extra: pip install 'interplan-sumo[train]'")
torch = pytest.importorskip("torch", reason="needs the extra: pip install 'interplan-sumo[train]'")

from tests.llm.tuning_models import OPTIONS, conversation, write_llama  # noqa: E402
from tools.tune_llm.adapters import read_adapter, write_adapter  # noqa: E402
from tools.tune_llm.chat import ChatTokens  # noqa: E402
from tools.tune_llm.examples import Example, as_samples  # noqa: E402
from tools.tune_llm.gguf_weights import GgufModel, read_model  # noqa: E402
from tools.tune_llm.heldout import choices_made, mean_loss  # noqa: E402
from tools.tune_llm.llama import TARGETS, Llama, LowRankSettings, token_tree  # noqa: E402

SAME = 0.02
"""Of log-probabilities of a float32 file: llama.cpp keeps keys and values in float16."""
QUANTISED = 1.0
"""Of log-probabilities of the default model: llama.cpp rounds activations to eight bits beside four-bit weights."""


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_llama(tmp_path_factory.mktemp("tuning") / "tiny.gguf")


@pytest.fixture(scope="module")
def read(tiny: Path) -> GgufModel:
    return read_model(tiny)


def changed_at_random(model: Llama, targets: tuple[str, ...] = TARGETS, size: float = 0.3) -> LowRankSettings:
    adapter = model.new_adapter(targets, rank=4, alpha=8.0, seed=1)
    generator = torch.Generator().manual_seed(2)
    with torch.no_grad():
        for change in adapter.changes.values():
            change.up.copy_(torch.randn(change.up.shape, generator=generator) * size)
    return adapter


def log_probabilities(model: Llama, tokens: list[int], adapter: LowRankSettings | None = None) -> Any:
    tree = token_tree([tokens], 0)
    with torch.no_grad():
        return model.logits(tree, torch.tensor([len(tokens) - 1]), adapter).log_softmax(-1)[0]


def largest_difference(
    model: Llama, path: Path, prompts: list[list[int]], adapter: tuple[LowRankSettings, Path] | None
) -> float:
    ours = [log_probabilities(model, tokens, adapter and adapter[0]) for tokens in prompts]
    with native_model(path, adapter and adapter[1]) as library:
        return max(
            abs(float(mine[token]) - theirs)
            for tokens, mine in zip(prompts, ours, strict=True)
            for token, theirs in library.log_probabilities(tokens).items()
        )


# --- beside llama.cpp ---


def test_the_next_token_is_as_likely_as_in_the_library(tiny: Path, read: GgufModel, tmp_path: Path) -> None:
    pytest.importorskip("xllamacpp", reason="needs the extra: pip install 'interplan-sumo[llm]'")
    model, chat = Llama(read), ChatTokens(read.vocabulary)
    prompts = [chat.prompt(conversation(text)) for text in ("Which?", "A car stands 12 m ahead. " * 5)]
    adapter = changed_at_random(model)
    write_adapter(tmp_path / "adapter.gguf", adapter, "random")
    assert largest_difference(model, tiny, prompts, None) < SAME
    assert largest_difference(model, tiny, prompts, (adapter, tmp_path / "adapter.gguf")) < SAME
    moved = log_probabilities(model, prompts[0]) - log_probabilities(model, prompts[0], adapter)
    assert moved.abs().max() > 10.0 * SAME


@pytest.mark.slow
def test_the_default_model_agrees_to_what_quantisation_leaves(tmp_path: Path) -> None:
    pytest.importorskip("xllamacpp", reason="needs the extra: pip install 'interplan-sumo[llm]'")
    try:
        path = default_model()
    except InputError as error:
        pytest.skip(str(error))
    read = read_model(path)
    model, chat = Llama(read), ChatTokens(read.vocabulary)
    prompts = [chat.prompt(conversation("A car stands 12 m ahead. Options:\n- follow\n- stop"))]
    adapter = changed_at_random(model, ("attn_q", "attn_v"), size=0.02)
    write_adapter(tmp_path / "adapter.gguf", adapter, "random")
    assert largest_difference(model, path, prompts, None) < QUANTISED
    assert largest_difference(model, path, prompts, (adapter, tmp_path / "adapter.gguf")) < QUANTISED


def test_choices_are_those_of_the_embedded_model(tiny: Path, read: GgufModel, tmp_path: Path) -> None:
    pytest.importorskip("xllamacpp", reason="needs the extra: pip install 'interplan-sumo[llm]'")
    model, chat = Llama(read), ChatTokens(read.vocabulary)
    adapter = changed_at_random(model)
    write_adapter(tmp_path / "adapter.gguf", adapter, "random")
    offers = (OPTIONS, OPTIONS[1:3], ("stop", "stop and wait", "stop it"), ("merge_right",))
    questions = [(conversation(f"Case {number}."), offers[number % len(offers)]) for number in range(16)]
    samples = as_samples([Example(asked, offer[0], offer, held_out=True) for asked, offer in questions], chat)
    embedded = EmbeddedModel(tiny, [LoadedAdapter(tmp_path / "adapter.gguf")])
    said = [embedded.ask(Request(asked, choices=offer)).choice for asked, offer in questions]
    embedded.close()
    assert choices_made(model, chat, samples, adapter) == said
    assert len(set(said)) > 2


# --- by itself ---


def test_a_common_beginning_changes_nothing(read: GgufModel) -> None:
    model = Llama(read)
    adapter = changed_at_random(model)
    sequences = [[5, 6, 7, 8, 9], [5, 6, 7, 1], [5, 6, 7, 8, 3, 4]]
    shared = token_tree(sequences, 3)
    assert len(shared.trunk) == 3
    found = model.logits(
        shared, torch.tensor([shared.flat(row, len(s) - 1) for row, s in enumerate(sequences)]), adapter
    )
    for row, sequence in enumerate(sequences):
        assert torch.allclose(found[row].log_softmax(-1), log_probabilities(model, sequence, adapter), atol=1e-4)


def test_a_tree_shares_no_more_than_it_may_and_than_there_is() -> None:
    sequences = [[1, 2, 3, 4], [1, 2, 3, 4]]
    assert len(token_tree(sequences, 3).trunk) == 3
    assert len(token_tree([*sequences, [1, 2, 9]], 3).trunk) == 2
    assert len(token_tree([[1], [2]], 3).trunk) == 0
    tree = token_tree(sequences, 3)
    assert (tree.flat(0, 3), tree.flat(1, 3)) == (3, 4)
    with pytest.raises(IndexError):
        tree.flat(0, 2)


def test_a_new_adapter_changes_nothing_and_half_precision_little(read: GgufModel) -> None:
    model = Llama(read)
    tokens = [1, 2, 3, 4, 5]
    plain = log_probabilities(model, tokens)
    assert torch.equal(plain, log_probabilities(model, tokens, model.new_adapter(TARGETS, 2, 2.0, seed=0)))
    assert torch.allclose(plain, log_probabilities(Llama(read, torch.bfloat16), tokens), atol=0.5)


def test_an_adapter_reads_back_as_it_was_written(read: GgufModel, tmp_path: Path) -> None:
    adapter = changed_at_random(Llama(read), ("attn_q", "ffn_down"))
    write_adapter(tmp_path / "adapter.gguf", adapter, "random")
    again = read_adapter(tmp_path / "adapter.gguf")
    assert (again.alpha, again.rank, again.scale) == (8.0, 4, 2.0)
    assert again.tensors().keys() == adapter.tensors().keys()
    for name, tensor in adapter.tensors().items():
        assert torch.equal(tensor.half(), again.tensors()[name].half())


def test_a_file_that_is_no_adapter_is_named(tiny: Path, tmp_path: Path) -> None:
    (tmp_path / "bad.gguf").write_bytes(b"a text")
    for path in (tiny, tmp_path / "bad.gguf", tmp_path / "none.gguf"):
        with pytest.raises(InputError, match=path.name):
            read_adapter(path)


def test_the_loss_counts_answers_and_the_ends_of_their_turns_only(read: GgufModel) -> None:
    model, chat = Llama(read), ChatTokens(read.vocabulary)
    (sample,) = as_samples([Example(conversation("Which?"), "stop", None, held_out=True)], chat)
    assert sample.answer == (chat.numbers[b"stop"], chat.end_of_turn)
    first = log_probabilities(model, list(sample.prompt))[sample.answer[0]]
    second = log_probabilities(model, [*sample.prompt, sample.answer[0]])[sample.answer[1]]
    assert mean_loss(model, [sample]) == pytest.approx(-float(first + second) / 2.0, abs=1e-5)
