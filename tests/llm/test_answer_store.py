"""A recorded run comes back to the letter, from one file that several processes may write."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from interplan_llm.models.protocol import LanguageModel, Message, ModelFailure, Reply, Request
from interplan_llm.models.scripted import ScriptedModel
from interplan_llm.models.store import AnswerStore, Entry, Mode, StoredModel, key_of
from interplan_sumo.errors import InputError
from tests.environments import environment
from tests.llm.questions import question


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "new" / "answers.jsonl"


def stored(path: Path, mode: Mode, *answers: str | ModelFailure) -> StoredModel:
    model = None if mode == "replay" else ScriptedModel(answers, name="toy")
    return StoredModel("toy", AnswerStore(path), mode, model)


def outcome(model: LanguageModel, request: Request) -> Reply | tuple[str, str, float]:
    try:
        return model.ask(request)
    except ModelFailure as failure:
        return failure.cause, failure.message, failure.latency_s


def test_a_question_is_asked_once_or_once_more_to_refresh_it_and_never_guessed(path: Path) -> None:
    first = stored(path, "record", "stop").ask(question())
    assert stored(path, "record").ask(question()) == first
    assert stored(path, "replay").ask(question()) == first
    assert first.choice == "stop"
    with pytest.raises(ModelFailure, match="holds no answer of toy") as failed:
        stored(path, "replay").ask(question("Something else."))
    assert failed.value.cause == "missing"
    assert stored(path, "refresh", "follow").ask(question()).choice == "follow"
    assert stored(path, "replay").ask(question()).choice == "follow"


@pytest.mark.parametrize("answer", ["nonsense", "merge_right", ModelFailure("timeout", "too late", latency_s=2.5)])
def test_a_failure_is_replayed_as_the_failure_that_it_was(path: Path, answer: str | ModelFailure) -> None:
    request = question(vocabulary=("merge_right",))
    recorded = outcome(stored(path, "record", answer), request)
    assert not isinstance(recorded, Reply)
    assert outcome(stored(path, "replay"), request) == recorded


def test_recording_asks_again_what_failed_without_an_answer_and_nothing_else(path: Path) -> None:
    with pytest.raises(ModelFailure):
        stored(path, "record", ModelFailure("timeout", "too late")).ask(question())
    with pytest.raises(ModelFailure):
        stored(path, "record", "nonsense").ask(question("And now?"))
    again = stored(path, "record", "stop")
    assert again.ask(question()).choice == "stop"
    assert outcome(again, question("And now?"))[0] == "parse"  # type: ignore[index]


@pytest.mark.parametrize("other", [
    question("Another text."), question(choices=("follow", "stop")), question(choices=None),
    question(choices=None, schema={"type": "object"}),
    question(choices=None, schema={"type": "object"}, grammar='root ::= "{}"'),
    question(constrained=False), question(max_tokens=33), question(temperature=0.1), question(seed=1),
    Request((Message("user", "A car stands 12 m ahead."),)),
])  # fmt: skip
def test_whatever_determines_an_answer_is_in_its_key(other: Request) -> None:
    assert key_of("toy", other) != key_of("toy", question())
    assert key_of("other", question()) != key_of("toy", question())


def test_a_key_is_the_hash_of_ascii_json_without_limits_of_time() -> None:
    request = Request((Message("user", "über \ud800"),), choices=("a", "b"))
    text = (
        '{"model":"toy","messages":[["user","\\u00fcber \\ud800"]],"choices":["a","b"],"schema":null,'
        '"constrained":true,"max_tokens":32,"temperature":0.0,"seed":0}'
    )
    assert key_of("toy", request) == hashlib.sha256(text.encode("ascii")).hexdigest()
    assert key_of("toy", question(timeout_s=1.0, vocabulary=("fly",))) == key_of("toy", question())


@given(st.text(), st.integers(0, 10**6), st.floats(0.0, 1e6))
@settings(max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_reply_survives_the_file(tmp_path: Path, text: str, tokens: int, latency_s: float) -> None:
    reply = Reply(text, None, None, tokens, tokens, latency_s, text, "p", text)
    file = tmp_path / "any.jsonl"
    AnswerStore(file).keep("k", Entry("toy", reply))
    found = AnswerStore(file).find("k")
    assert found is not None
    assert found.outcome == reply


def test_what_another_process_answered_is_not_asked_again_and_questions_are_not_kept(path: Path) -> None:
    early, asked = stored(path, "record"), question("A secret of the scene.")
    stored(path, "record", "stop").ask(asked)
    assert early.ask(asked).choice == "stop"
    assert "secret" not in path.read_text()


WRITER = """
import sys
from pathlib import Path
from interplan_llm.models.protocol import Reply
from interplan_llm.models.store import AnswerStore, Entry
store = AnswerStore(Path(sys.argv[1]))
for i in range(100):
    store.keep(f"{sys.argv[2]}/{i}", Entry("toy", Reply("x" * 5000)))
"""


def test_processes_that_write_at_once_lose_nothing(tmp_path: Path) -> None:
    path = tmp_path / "answers.jsonl"
    writers = [
        subprocess.Popen([sys.executable, "-c", WRITER, str(path), str(number)], env=environment())
        for number in range(3)
    ]
    assert [writer.wait(60) for writer in writers] == [0, 0, 0]
    assert len(AnswerStore(path)) == 300


def test_a_line_that_was_cut_off_is_overlooked_and_written_over(path: Path) -> None:
    stored(path, "record", "stop").ask(question())
    whole = path.read_bytes()
    path.write_bytes(whole + whole[: len(whole) // 2])
    again = stored(path, "record", "follow")
    assert again.ask(question()).choice == "stop"
    assert again.ask(question("And now?")).choice == "follow"
    assert [json.loads(line)["model"] for line in path.read_text().splitlines()] == ["toy", "toy"]


@pytest.mark.parametrize("kept", [None, b""])
def test_a_file_that_was_taken_away_or_emptied_begins_anew(kept: bytes | None, path: Path) -> None:
    model = stored(path, "record", "stop", "follow", "stop")
    model.ask(question("One."))
    model.ask(question("Two."))
    path.unlink() if kept is None else path.write_bytes(kept)
    model.ask(question("Three."))
    assert stored(path, "replay").ask(question("Three.")).choice == "stop"
    assert len(AnswerStore(path)) == len(path.read_bytes().splitlines()) == 1


@pytest.mark.parametrize("damage", [
    b"nonsense", b"[]", b"{}", b"\xff", b"[" * 5000,
    b'{"key": "k", "model": "m", "failure": {"cause": "bored", "message": "", "latency_s": 0}}',
    b'{"key": "k", "model": "m", "failure": {"cause": "parse", "message": "", "latency_s": NaN}}',
    b'{"key": 1, "model": "m", "reply": {}}',
])  # fmt: skip
def test_a_damaged_line_is_named_in_one_line(path: Path, damage: bytes) -> None:
    stored(path, "record", "stop").ask(question())
    path.write_bytes(path.read_bytes() + damage + b"\n")
    with pytest.raises(InputError, match=r"answers\.jsonl, line 2: .* delete the line") as refused:
        AnswerStore(path)
    assert "\n" not in str(refused.value)


def test_what_cannot_be_kept_or_recorded_is_named(tmp_path: Path) -> None:
    store = AnswerStore(tmp_path / "folder" / "answers.jsonl")
    (tmp_path / "folder").write_text("")
    with pytest.raises(InputError, match="cannot write the answers"):
        store.keep("k", Entry("toy", Reply("x")))
    with pytest.raises(InputError, match="cannot read the answers"):
        AnswerStore(tmp_path)
    with pytest.raises(ValueError, match="needs a model"):
        StoredModel("toy", store, "record")
