"""Tuning reads what llama.cpp reads and computes what it computes: tokens, odds, choices, with an adapter, too."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from interplan_llm.models.fetch import default_model
from interplan_llm.models.protocol import Message, Request
from interplan_sumo.errors import InputError
from tests.llm.native_tokens import native_model
from tests.llm.tuning_models import NEEDED, OPTIONS, conversation, write_llama
from tools.tune_llm.examples import Example, as_samples

if TYPE_CHECKING:
    from tools.tune_llm.chat import ChatTokens
    from tools.tune_llm.model import TunedModel

pytestmark = [
    pytest.mark.skipif(find_spec(name) is None, reason=f"needs {name}: pip install 'interplan-sumo[train,llm]'")
    for name in (*NEEDED, "xllamacpp")
]
SAME = 0.02
"""Of log-probabilities of a float32 file: llama.cpp keeps keys and values in float16."""
QUANTISED = 1.0
"""Of log-probabilities of the default model: llama.cpp rounds activations to eight bits beside four-bit weights."""
TEXTS = (
    "Own speed 7.3, limit 15.0.\nOptions:\n- follow: stay\n- merge_left: change\n",
    "  two   three \t tab\n\n\nlines \r\n end  ",
    " don't I'LL they've 's 't 'x '' 1234 5 0.001 -5e-3 x**2 != [3];;;",
    "naïve Straße 日本語 ½ Ⅷ ٣ \u00a0no-break — “quoted” 🚗🚙 e\u0301",
    "<|end|>\nb <|begin|>x <|im_end|><|im_start|>user",
    "",
)


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_llama(tmp_path_factory.mktemp("tuning") / "tiny.gguf")


@pytest.fixture(scope="module")
def chat(tiny: Path) -> ChatTokens:
    return chat_of(tiny)


@pytest.fixture(scope="module")
def changed(tiny: Path) -> TunedModel:
    return changed_at_random(tiny, "attn_q attn_k attn_v attn_output ffn_gate ffn_up ffn_down")


def chat_of(path: Path) -> ChatTokens:
    from tools.tune_llm.chat import ChatTokens

    return ChatTokens(path)


def changed_at_random(path: Path, targets: str, size: float = 0.2) -> TunedModel:
    """A model with an adapter that has forgotten to change nothing."""
    import torch

    from tools.tune_llm.model import LoraSettings, TunedModel

    model = TunedModel(path, LoraSettings(tuple(targets.split()), rank=4, alpha=8, seed=1), torch.float32)
    generator = torch.Generator().manual_seed(3)
    with torch.no_grad():
        for name, values in model.learning().items():
            if "lora_B" in name:
                values.copy_(torch.randn(values.shape, generator=generator) * size)
    return model


def log_probabilities(model: TunedModel, tokens: list[int]) -> Any:
    return model.logits([tokens], [1]).detach().log_softmax(-1)[0]


def largest_difference(found: Any, wanted: dict[int, float]) -> float:
    return max(abs(float(found[token]) - theirs) for token, theirs in wanted.items())


def test_a_prompt_ends_where_the_answer_begins(chat: ChatTokens) -> None:
    begin = chat.prompt([Message("user", "a")])[0]
    assert chat.prompt(conversation("Which?")).count(begin) == 3
    assert chat.prompt(conversation("<|begin|>")).count(begin) == 4
    assert begin not in chat.plain("<|begin|>")


def test_prompts_are_those_of_the_library_and_any_text_is_cut_as_there(tiny: Path, chat: ChatTokens) -> None:
    with native_model(tiny) as library:
        for text in TEXTS:
            messages = conversation(text, system=f"{text}!")
            assert chat.prompt_text(messages) == library.prompt_text(messages)
            assert chat.prompt(messages) == library.tokens(library.prompt_text(messages))

        @settings(max_examples=40)
        @given(st.text(st.characters(exclude_categories=("Cs", "Cn", "Co"), exclude_characters="\0"), max_size=40))
        def is_cut_alike(text: str) -> None:
            messages = [Message("user", text)]
            assert chat.prompt(messages) == library.tokens(chat.prompt_text(messages))

        is_cut_alike()


@pytest.mark.parametrize("adapted", [False, True])
def test_the_next_token_is_as_likely_as_in_the_library(
    adapted: bool, tiny: Path, chat: ChatTokens, changed: TunedModel, tmp_path: Path
) -> None:
    prompts = [chat.prompt(conversation(text)) for text in ("Which?", "A car stands 12 m ahead. " * 5)]
    changed.write_adapter(tmp_path / "adapter.gguf", "random")
    with changed.unchanged():
        plain = [log_probabilities(changed, tokens) for tokens in prompts]
    with_it = [log_probabilities(changed, tokens) for tokens in prompts]
    assert (plain[0] - with_it[0]).abs().max() > 10.0 * SAME
    with native_model(tiny, tmp_path / "adapter.gguf" if adapted else None) as library:
        for tokens, found in zip(prompts, with_it if adapted else plain, strict=True):
            assert largest_difference(found, library.log_probabilities(tokens)) < SAME


def test_choices_are_those_of_the_embedded_model(
    tiny: Path, chat: ChatTokens, changed: TunedModel, tmp_path: Path
) -> None:
    from interplan_llm.models.embedded import Adapter, EmbeddedModel
    from tools.tune_llm.heldout import choices_made

    changed.write_adapter(tmp_path / "adapter.gguf", "random")
    offers = (OPTIONS, OPTIONS[1:3], ("stop", "stop and wait", "stop it"), ("merge_right",), ("stör", "stop"))
    questions = [(conversation(f"Case {number}."), offers[number % len(offers)]) for number in range(15)]
    samples = as_samples([Example(asked, offer[0], offer, held_out=True) for asked, offer in questions], chat)
    embedded = EmbeddedModel(tiny, [Adapter(tmp_path / "adapter.gguf")])
    said = [embedded.ask(Request(asked, choices=offer)).choice for asked, offer in questions]
    embedded.close()
    assert choices_made(changed, chat, samples) == said
    assert len(set(said)) > 1


@pytest.mark.nightly
def test_the_default_model_reads_and_computes_the_same(tmp_path: Path) -> None:
    try:
        path = default_model()
    except InputError as error:
        pytest.skip(str(error))
    chat, model = chat_of(path), changed_at_random(path, "attn_q attn_v", size=0.02)
    model.write_adapter(tmp_path / "adapter.gguf", "random")
    with native_model(path, tmp_path / "adapter.gguf") as adapted:
        for text in TEXTS:
            messages = conversation(text)
            assert chat.prompt_text(messages) == adapted.prompt_text(messages)
            assert chat.prompt(messages) == adapted.tokens(adapted.prompt_text(messages))
        tokens = chat.prompt(conversation("A car stands 12 m ahead. Options:\n- follow\n- stop"))
        assert largest_difference(log_probabilities(model, tokens), adapted.log_probabilities(tokens)) < QUANTISED


def test_a_common_beginning_changes_nothing(changed: TunedModel) -> None:
    import torch

    sequences = [[5, 6, 7, 8, 9], [5, 6, 7, 1], [5, 6, 7, 8, 3, 4]]
    found = changed.logits(sequences, [1, 1, 2])
    alone = [log_probabilities(changed, tokens) for tokens in (*sequences[:2], sequences[2][:-1], sequences[2])]
    assert torch.allclose(found.log_softmax(-1), torch.stack(alone), atol=1e-4)


def test_the_loss_counts_answers_and_the_ends_of_their_turns_only(chat: ChatTokens, changed: TunedModel) -> None:
    from tools.tune_llm.heldout import mean_loss

    (sample,) = as_samples([Example(conversation("Which?"), "stop", None, held_out=True)], chat)
    assert sample.answer == (chat.numbers["stop"], chat.end_of_turn)
    first = log_probabilities(changed, list(sample.prompt))[sample.answer[0]]
    second = log_probabilities(changed, [*sample.prompt, sample.answer[0]])[sample.answer[1]]
    assert mean_loss(changed, [sample]) == pytest.approx(-float(first + second) / 2.0, abs=1e-5)


@pytest.mark.parametrize("content", [None, b"a text", b"GGUF" + bytes(40)])
def test_a_file_that_is_no_model_is_one_line(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "bad.gguf"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=r"bad\.gguf") as refused:
        chat_of(path)
    assert "\n" not in str(refused.value)


def test_what_is_unknown_or_refused_by_a_template_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="splits text as 'tekken'"):
        chat_of(write_llama(tmp_path / "other.gguf", splitting="tekken"))
    with pytest.raises(InputError, match="'qwen2'"):
        changed_at_random(write_llama(tmp_path / "family.gguf", architecture="qwen2"), "attn_q")
    with pytest.raises(InputError, match=r"no tensor for .*down_proj"):
        changed_at_random(write_llama(tmp_path / "part.gguf", without="blk.1.ffn_down"), "attn_q")
    strict = write_llama(tmp_path / "strict.gguf", template="{{ raise_exception('no system') }}")
    with pytest.raises(InputError, match="no system"):
        chat_of(strict).prompt(conversation("Which?"))
