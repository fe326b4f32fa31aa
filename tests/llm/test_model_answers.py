"""From text to an answer: what counts as one, and nothing else; what the scripted model says and what is counted."""

from __future__ import annotations

import contextlib
import json
import string
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from interplan_llm.models.answers import MAX_JSON_DEPTH, MAX_JSON_VALUES, answered, read_choice, read_json
from interplan_llm.models.exchanges import Exchange, usage_stats
from interplan_llm.models.protocol import CAUSES, MAX_TEXT_BYTES, LanguageModel, Message, ModelFailure, Reply, Request
from interplan_llm.models.scripted import ScriptedModel, always
from tests.llm.questions import CHOICES, question

VOCABULARY = (*CHOICES, "merge_right")


@pytest.mark.parametrize(("text", "choice"), [
    ("merge_left", "merge_left"), ("  Merge Left.\n", "merge_left"), ("**MERGE-LEFT**", "merge_left"),
    ('{"choice": "merge_left"}', "merge_left"),
    ("I could <<stop>>, but no: <<merge_left>>", "merge_left"),
    ("We should merge left now, there is room.", "merge_left"),
    ("stop, stop, stop!", "stop"),
])  # fmt: skip
def test_a_choice_is_found_bare_in_json_marked_or_as_the_only_one_that_is_named(text: str, choice: str) -> None:
    assert read_choice(text, CHOICES, VOCABULARY) == choice


@pytest.mark.parametrize("text", [
    "", "accelerate", "follow or stop?", "following", "<<accelerate>> rather than follow", "<<choice>> follow",
    '{"choice": "fly"}', '{"choice": ["stop"]}', '{"lane": "stop"}', '{"choice": "stop", "choice": "follow"}', "{stop",
    "follow, never merge right",
])  # fmt: skip
def test_text_that_says_no_word_or_several_or_a_foreign_one_is_no_answer(text: str) -> None:
    with pytest.raises(ModelFailure) as failed:
        read_choice(text, CHOICES, VOCABULARY)
    assert failed.value.cause == "parse"


@pytest.mark.parametrize("text", ["merge_right", "<<Merge Right>>", "let us merge right", '{"choice":"merge_right"}'])
def test_a_known_word_that_was_not_offered_is_told_apart(text: str) -> None:
    with pytest.raises(ModelFailure, match="offered: follow, merge_left, stop") as failed:
        read_choice(text, CHOICES, VOCABULARY)
    assert failed.value.cause == "not_offered"


def test_a_word_inside_a_longer_one_does_not_count_as_named() -> None:
    assert read_choice("please merge left", ("merge", "merge_left")) == "merge_left"


@given(st.one_of(st.text(), st.text(alphabet='<>{}":follow merge_left stop[],\n`')))
def test_arbitrary_text_gives_an_offered_choice_or_a_model_failure(text: str) -> None:
    try:
        assert read_choice(text, CHOICES, VOCABULARY) in CHOICES
    except ModelFailure as failure:
        told = failure
        assert told.cause in CAUSES
        assert "\n" not in str(told)


WORDS = st.text(alphabet=string.ascii_letters + "äßİ _-", min_size=1, max_size=12)


@given(st.lists(WORDS, min_size=1, max_size=6), st.text(max_size=40))
def test_whatever_the_choices_are_each_is_found_bare_and_marked(words: list[str], before: str) -> None:
    try:
        request = Request((Message("user", "?"),), choices=tuple(words))
    except ValueError:
        return
    assert request.choices is not None
    for word in request.choices:
        assert read_choice(word, request.choices) == word
        if not before.lstrip().startswith("{"):
            assert read_choice(f"{before}!<<{word}>>", request.choices) == word


def test_text_and_json_at_the_limits_are_read_and_a_character_more_is_too_long() -> None:
    assert read_choice("stop".ljust(MAX_TEXT_BYTES), CHOICES) == "stop"
    for read in (lambda text: read_choice(text, CHOICES), read_json):
        with pytest.raises(ModelFailure) as failed:
            read("stop".ljust(MAX_TEXT_BYTES + 1))
        assert failed.value.cause == "too_long"
    assert read_json("[" * MAX_JSON_DEPTH + "]" * MAX_JSON_DEPTH)
    assert len(read_json(json.dumps([0] * (MAX_JSON_VALUES - 1)))) == MAX_JSON_VALUES - 1


@given(st.recursive(st.none() | st.booleans() | st.integers(-(10**9), 10**9) | st.text(max_size=5), st.lists))
def test_plain_json_comes_back_as_it_was(value: object) -> None:
    text = json.dumps(value)
    try:
        assert read_json(text) == value
    except ModelFailure:
        assert text.count("[") >= MAX_JSON_DEPTH


def test_json_in_a_fence_is_read_and_the_last_fence_counts() -> None:
    assert read_json('First ```json\n{"x": 1}\n``` no:\n```\n[2]\n```') == [2]


@pytest.mark.parametrize("text", [
    "", "NaN", "[Infinity]", "[1e999]", f"[1{'0' * 400}]", "1" * 5000, '{"a": 1, "a": 2}', "__import__('os')", "(1, 2)",
    "[" * 50_000, '{"a":' * 15_000,
    "[" * (MAX_JSON_DEPTH + 1) + "]" * (MAX_JSON_DEPTH + 1),
    json.dumps([0] * MAX_JSON_VALUES),
], ids=range(13))  # fmt: skip
def test_json_that_is_broken_not_finite_too_deep_or_too_large_is_no_answer(text: str) -> None:
    with pytest.raises(ModelFailure) as failed:
        read_json(text)
    assert failed.value.cause == "parse"


@given(st.text(alphabet='[]{}",:0123456789.eE-+ nulltruefalse\\\n`', max_size=200))
def test_arbitrary_text_gives_json_or_a_model_failure(text: str) -> None:
    with contextlib.suppress(ModelFailure):
        read_json(text)


def test_a_failure_carries_its_reply_and_free_text_is_an_answer_as_it_is() -> None:
    reply = Reply("perhaps", prompt_tokens=7, latency_s=1.5)
    with pytest.raises(ModelFailure) as failed:
        answered(question(), reply)
    assert failed.value.reply == reply
    assert failed.value.latency_s == 1.5
    assert answered(question(choices=None), Reply("anything")) == Reply("anything")


@pytest.mark.parametrize("fields", [
    {"choices": ()}, {"choices": ("a", "A")}, {"choices": ("merge_left", "merge left")}, {"choices": ("a<b",)},
    {"choices": ('"',)}, {"choices": ("\n",)}, {"choices": ("_",)}, {"schema": {"type": "object"}},
    {"choices": None, "schema": {"maximum": float("inf")}},
    {"choices": None, "grammar": 'root ::= "yes"'},
    {"max_tokens": 0}, {"temperature": -0.1}, {"timeout_s": 0.0},
])  # fmt: skip
def test_a_question_that_cannot_be_answered_as_asked_is_refused(fields: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"."):
        question(**fields)


def test_scripted_texts_are_said_in_turn_over_and_over_or_by_a_function() -> None:
    model = ScriptedModel(["follow", ModelFailure("timeout", "late"), "stop"])
    assert model.ask(question()).choice == "follow"
    with pytest.raises(ModelFailure, match="late"):
        model.ask(question())
    assert model.ask(question()).choice == "stop"
    with pytest.raises(ModelFailure) as failed:
        model.ask(question())
    assert failed.value.cause == "missing"
    model = always("follow", "stop")
    assert [model.ask(question()).choice for _ in range(5)] == ["follow", "stop", "follow", "stop", "follow"]
    model = ScriptedModel(lambda request: (request.choices or ("",))[-1])
    assert model.ask(question()).choice == "stop"
    assert isinstance(model, LanguageModel)
    model.close()


def test_exchanges_are_counted_with_their_fallbacks_tokens_and_time() -> None:
    unusable = Reply("?", prompt_tokens=100, completion_tokens=9)
    reply = Reply("stop", prompt_tokens=300, completion_tokens=2, latency_s=1.0)
    late = ModelFailure("timeout", "late", latency_s=3.0)
    parse = ModelFailure("parse", "no choice", latency_s=0.5, reply=unusable)
    came = ((reply, None), (None, late), (unusable, parse))
    assert usage_stats([Exchange(0.0, question(), *each, "stop") for each in came]) == {
        "queries": 3,
        "fallbacks": {**dict.fromkeys(CAUSES, 0), "timeout": 1, "parse": 1},
        "fallback_share": pytest.approx(2 / 3),
        "prompt_tokens": 400,
        "completion_tokens": 11,
        "latency_sum_s": 4.5,
        "latency_max_s": 3.0,
    }
    assert usage_stats([])["fallback_share"] == 0.0
