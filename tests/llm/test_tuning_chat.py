"""Tuning reads the tokens that llama.cpp reads: the same template, the same words, the same control tokens."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from interplan_llm.models.fetch import default_model
from interplan_llm.models.protocol import Message
from interplan_sumo.errors import InputError
from tests.llm.native_tokens import Native, native_model

for needed in ("torch", "gguf", "jinja2"):
    pytest.importorskip(needed, reason="needs the extra: pip install 'interplan-sumo[train]'")

from tests.llm.tuning_models import conversation, write_llama  # noqa: E402
from tools.tune_llm.chat import ChatTokens  # noqa: E402
from tools.tune_llm.gguf_weights import read_model  # noqa: E402

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
    return ChatTokens(read_model(tiny).vocabulary)


@pytest.fixture(scope="module")
def theirs(tiny: Path) -> Iterator[Native]:
    pytest.importorskip("xllamacpp", reason="needs the extra: pip install 'interplan-sumo[llm]'")
    with native_model(tiny) as model:
        yield model


def test_pairs_are_joined_in_the_order_of_the_merges(chat: ChatTokens) -> None:
    merged = chat.plain("stop merge")
    assert [chat.numbers[piece] for piece in (b"stop", b" ", b"merg", b"e")] == merged


def test_each_digit_stands_alone(chat: ChatTokens) -> None:
    assert chat.plain("12") == chat.plain("1") + chat.plain("2")


def test_a_prompt_ends_where_the_answer_begins(chat: ChatTokens) -> None:
    assert chat.prompt_text(conversation("Which?")).endswith("Which?<|end|>\n<|begin|>assistant\n")
    begin = chat.prompt([Message("user", "a")])[0]
    assert chat.prompt(conversation("Which?")).count(begin) == 3
    assert chat.prompt(conversation("<|begin|>")).count(begin) == 4
    assert begin not in chat.plain("<|begin|>")


@pytest.mark.parametrize("text", TEXTS)
def test_prompts_are_those_of_the_library(chat: ChatTokens, theirs: Native, text: str) -> None:
    messages = conversation(text, system=f"{text}!")
    assert chat.prompt_text(messages) == theirs.prompt_text(messages)
    assert chat.prompt(messages) == theirs.tokens(theirs.prompt_text(messages))


@settings(max_examples=60)
@given(st.text(st.characters(exclude_categories=("Cs", "Cn", "Co"), exclude_characters="\0"), max_size=40))
def test_any_text_is_cut_as_by_the_library(chat: ChatTokens, theirs: Native, text: str) -> None:
    assert chat.prompt([Message("user", text)]) == theirs.tokens(chat.prompt_text([Message("user", text)]))


@pytest.mark.slow
def test_the_default_model_reads_the_same_tokens() -> None:
    pytest.importorskip("xllamacpp", reason="needs the extra: pip install 'interplan-sumo[llm]'")
    try:
        path = default_model()
    except InputError as error:
        pytest.skip(str(error))
    chat = ChatTokens(read_model(path).vocabulary)
    with native_model(path) as library:
        for text in TEXTS:
            for messages in (conversation(text), [Message("user", text)]):
                assert chat.prompt_text(messages) == library.prompt_text(messages)
                assert chat.prompt(messages) == library.tokens(library.prompt_text(messages))


def test_a_way_of_splitting_that_is_unknown_is_named(tmp_path: Path) -> None:
    vocabulary = read_model(write_llama(tmp_path / "other.gguf", splitting="tekken")).vocabulary
    with pytest.raises(InputError, match="splits text as 'tekken'"):
        ChatTokens(vocabulary)


def test_a_template_that_refuses_is_one_line(tmp_path: Path) -> None:
    strict = write_llama(tmp_path / "strict.gguf", template="{{ raise_exception('no system') }}")
    with pytest.raises(InputError, match="no system"):
        ChatTokens(read_model(strict).vocabulary).prompt(conversation("Which?"))


@pytest.mark.parametrize("content", [None, b"", b"a text", b"GGUF" + bytes(40)])
def test_a_file_that_is_no_model_is_one_line(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "bad.gguf"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=r"bad\.gguf") as refused:
        read_model(path)
    assert "\n" not in str(refused.value)


def test_a_model_of_another_family_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="'qwen2'"):
        read_model(write_llama(tmp_path / "other.gguf", architecture="qwen2"))
