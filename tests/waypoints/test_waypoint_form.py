"""The form of an answer: what is written for training is what the grammar lets a model say."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from interplan_llm.models.protocol import Message, ModelFailure, Reply, Request
from interplan_llm.waypoints.answers import waypoints
from interplan_llm.waypoints.form import GRAMMAR, POINTS, SCHEMA, THOUGHTS_CHARS, WORD_CHARS, WORDS, answer_text
from tests.llm.tiny_gguf import write_model

NUMBER = r"-?(0|[1-9][0-9]{0,2})(\.[0-9])?"
PLACE = rf"\[{NUMBER},{NUMBER}\]"
WORD = r"[A-Za-z]{1,14}[,;.]?"
SENTENCE = re.compile(rf'\{{"thoughts":"{WORD}( {WORD}){{0,11}}","waypoints":\[{PLACE}(,{PLACE}){{15}}\]\}}')
"""The grammar in another tongue."""

STRAIGHT = np.array([[5.0 * (k + 1), 0.0] for k in range(POINTS)])


def test_an_answer_has_no_character_too_many() -> None:
    text = answer_text("Nothing comes near. Keep speed, forward.", STRAIGHT - [0.04, 0.16])
    assert text.startswith('{"thoughts":"Nothing comes near. Keep speed, forward.","waypoints":[[5,-0.2],[10,-0.2],')
    assert " " not in text.partition('"waypoints"')[2]


@settings(max_examples=25)
@given(st.lists(st.tuples(st.floats(-999.9, 999.9), st.floats(-999.9, 999.9)), min_size=POINTS, max_size=POINTS))
def test_every_answer_that_is_written_is_one_that_the_grammar_has(rows: list[tuple[float, float]]) -> None:
    text = answer_text("Stand.", np.array(rows))
    assert SENTENCE.fullmatch(text)
    assert json.loads(text)["waypoints"] == (np.round(np.array(rows), 1)).tolist()


@pytest.mark.parametrize(("x_m", "fine"), [(999.94, True), (-999.94, True), (999.96, False), (np.nan, False)])
def test_what_has_no_place_in_the_grammar_is_refused(x_m: float, fine: bool) -> None:
    places = STRAIGHT.copy()
    places[3, 0] = x_m
    if fine:
        assert SENTENCE.fullmatch(answer_text("Stand.", places))
    else:
        with pytest.raises(ValueError, match=r"beyond 999\.9 m"):
            answer_text("Stand.", places)


@pytest.mark.parametrize("count", [POINTS - 1, POINTS + 1])
def test_only_sixteen_places_are_an_answer(count: int) -> None:
    with pytest.raises(ValueError, match="expected"):
        answer_text("Stand.", np.zeros((count, 2)))


@pytest.mark.parametrize("thoughts", ["a" * WORD_CHARS, " ".join(["word,"] * WORDS), "Stop; look. Go"])
def test_a_few_plain_words_are_thoughts(thoughts: str) -> None:
    assert SENTENCE.fullmatch(answer_text(thoughts, STRAIGHT))
    assert len(thoughts) <= THOUGHTS_CHARS


@pytest.mark.parametrize(
    "thoughts",
    ["", "a" * (WORD_CHARS + 1), " ".join(["word"] * (WORDS + 1)), "5 m", 'so "so"', "two  blanks", "Straße"],
)
def test_other_thoughts_are_refused(thoughts: str) -> None:
    with pytest.raises(ValueError, match="thoughts must be"):
        answer_text(thoughts, STRAIGHT)


def test_a_model_that_is_held_to_the_grammar_says_a_sentence_of_it(tmp_path: Path) -> None:
    pytest.importorskip("xllamacpp", reason="needs the extra: pip install 'interplan-sumo[llm]'")
    from interplan_llm.models.embedded import EmbeddedModel

    model = EmbeddedModel(write_model(tmp_path / "tiny.gguf"))
    messages = (Message("system", "Drive."), Message("user", "Where to?"))
    for seed in range(2):
        request = Request(messages, schema=SCHEMA, grammar=GRAMMAR, max_tokens=1500, temperature=1.0, seed=seed)
        reply = model.ask(request)
        assert SENTENCE.fullmatch(reply.text)
        assert _is_read(reply)
    model.close()


def _is_read(reply: Reply) -> bool:
    """Places, or one cause of failure: nobody drives that fast."""
    try:
        return waypoints(reply).shape == (POINTS, 2)
    except ModelFailure as failure:
        return failure.cause == "parse" and "over 60" in failure.message
