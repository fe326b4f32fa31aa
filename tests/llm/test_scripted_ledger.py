"""The scripted model says what it is told; the ledger counts what became of it."""

from __future__ import annotations

import pytest

from interplan_llm.models.protocol import CAUSES, LanguageModel, ModelFailure, Reply
from interplan_llm.models.scripted import ScriptedModel, always
from interplan_llm.models.usage_stats import Ledger
from tests.llm.questions import question


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


def test_a_ledger_counts_queries_fallbacks_tokens_and_time() -> None:
    ledger = Ledger()
    ledger.answered(Reply("stop", prompt_tokens=300, completion_tokens=2, latency_s=1.0))
    ledger.failed(ModelFailure("timeout", "late", latency_s=3.0))
    unusable = Reply("?", prompt_tokens=100, completion_tokens=9)
    ledger.failed(ModelFailure("parse", "no choice", latency_s=0.5, reply=unusable))
    assert ledger.as_json() == {
        "queries": 3,
        "fallbacks": {**dict.fromkeys(CAUSES, 0), "timeout": 1, "parse": 1},
        "fallback_share": pytest.approx(2 / 3),
        "prompt_tokens": 400,
        "completion_tokens": 11,
        "latency_sum_s": 4.5,
        "latency_max_s": 3.0,
    }


def test_ledgers_add_up() -> None:
    total, other = Ledger(), Ledger()
    total.answered(Reply("stop", prompt_tokens=1, latency_s=2.0))
    other.failed(ModelFailure("parse", "", latency_s=1.0))
    total.add(other)
    assert (total.queries, total.fallbacks["parse"], total.latency_sum_s, total.latency_max_s) == (2, 1, 3.0, 2.0)
    assert Ledger().fallback_share == 0.0
