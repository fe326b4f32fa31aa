"""The embedded model: held to the choices, deaf to what was asked before, quiet, and never the end of the run."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from interplan_llm.models.answers import read_json
from interplan_llm.models.chat_url import ChatUrl
from interplan_llm.models.embedded import Adapter, EmbeddedModel
from interplan_llm.models.fetch import default_model
from interplan_llm.models.protocol import LanguageModel, Message, ModelFailure, Request
from interplan_llm.models.spec import open_model
from interplan_sumo.errors import InputError
from tests.llm.native_tokens import native_model
from tests.llm.questions import CHOICES, SYSTEM, question
from tests.llm.tiny_gguf import TEMPLATE, write_adapter, write_model

pytestmark = pytest.mark.skipif(find_spec("xllamacpp") is None, reason="needs pip install 'interplan-sumo[llm]'")
SCHEMA = {
    "type": "object",
    "properties": {"lane": {"enum": ["left", "right"]}},
    "required": ["lane"],
    "additionalProperties": False,
}


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_model(tmp_path_factory.mktemp("models") / "tiny.gguf")


@pytest.fixture(scope="module")
def adapter(tiny: Path) -> Path:
    return write_adapter(tiny.parent / "adapter.gguf")


@pytest.fixture(scope="module")
def shared(tiny: Path) -> Iterator[EmbeddedModel]:
    model = EmbeddedModel(tiny)
    yield model
    model.close()


def said(model: LanguageModel, text: str, **fields: Any) -> str:
    """Free text, which shows the slightest difference."""
    return model.ask(question(text, choices=None, max_tokens=24, **fields)).text


def test_it_says_one_of_the_choices_or_json_that_follows_the_schema(shared: EmbeddedModel) -> None:
    reply = shared.ask(question())
    assert reply.text == reply.choice
    assert reply.choice in CHOICES
    assert reply.prompt_tokens > 100
    assert (reply.completion_tokens, reply.model) == (len(reply.text) + 1, "tiny.gguf")
    assert reply.provider.startswith("xllamacpp ")
    assert reply.finish_reason == "stop"
    assert isinstance(shared, LanguageModel)
    reply = shared.ask(question(choices=None, schema=SCHEMA, max_tokens=200))
    assert reply.data == read_json(reply.text)
    assert reply.data["lane"] in ("left", "right")
    assert shared.ask(Request((Message("user", "Which?"),), choices=CHOICES)).choice in CHOICES


def test_an_answer_does_not_depend_on_what_was_asked_before(shared: EmbeddedModel, tiny: Path) -> None:
    texts = ["A car stands 12 m ahead.", "A car stands 13 m ahead. The left lane is free.", "Nothing.", "A car " * 50]
    alone = [said(EmbeddedModel(tiny), text) for text in texts]
    assert len(set(alone)) == len(texts)
    for order in ((0, 1, 2, 3), (3, 2, 1, 0), (0, 0, 2, 1)):
        assert [said(shared, texts[i]) for i in order] == [alone[i] for i in order]
    shared.ask(Request((Message("system", SYSTEM.text[:40]), Message("user", texts[0]))))
    assert said(shared, texts[0]) == alone[0]


def test_the_seed_decides_what_chance_says(shared: EmbeddedModel) -> None:
    first, same, other = (said(shared, "Talk.", temperature=1.0, seed=seed) for seed in (1, 1, 2))
    assert first == same != other


def test_a_template_that_wants_a_user_message_is_answered(tmp_path: Path) -> None:
    strict = "{% if messages[-1].role == 'system' %}{{ raise_exception('a user must speak') }}{% endif %}" + TEMPLATE
    model = EmbeddedModel(write_model(tmp_path / "strict.gguf", template=strict))
    assert said(model, "Which?") == said(model, "Which?")


def test_an_adapter_changes_what_is_said_and_counts_by_its_scale(tiny: Path, adapter: Path) -> None:
    models = [EmbeddedModel(tiny, adapters) for adapters in ((), (Adapter(adapter),), (Adapter(adapter, 0.0),))]
    plain, adapted, scaled_away = (said(model, "Which?") for model in models)
    assert plain == scaled_away != adapted
    assert len({model.name for model in models}) == 3


def test_the_name_says_which_files_answered_wherever_they_lie(tiny: Path, tmp_path: Path) -> None:
    copy = tmp_path / "renamed.gguf"
    copy.write_bytes(tiny.read_bytes())
    assert EmbeddedModel(copy).name == EmbeddedModel(tiny).name
    assert EmbeddedModel(write_model(tmp_path / "other.gguf", seed=5)).name != EmbeddedModel(tiny).name


def test_a_spec_opens_the_model_with_its_adapters(tiny: Path, adapter: Path) -> None:
    model = open_model(f"embedded:{tiny}+lora:{adapter}@0.5+lora:{adapter}", threads=1)
    assert isinstance(model, EmbeddedModel)
    assert [a.scale for a in model.adapters] == [0.5, 1.0]
    assert model.ask(question()).choice in CHOICES
    model.close()
    model.close()


def test_a_model_that_another_one_put_out_is_loaded_again(shared: EmbeddedModel, tmp_path: Path) -> None:
    before = said(shared, "Which?")
    other = EmbeddedModel(write_model(tmp_path / "other.gguf", seed=5))
    assert said(other, "Which?") != before
    assert said(shared, "Which?") == before


def test_an_answer_past_its_deadline_is_cut_off_and_the_next_one_comes(shared: EmbeddedModel) -> None:
    before = said(shared, "Which?")
    with pytest.raises(ModelFailure) as failed:
        shared.ask(question("word " * 600, choices=None, max_tokens=900, timeout_s=0.05))
    assert failed.value.cause == "timeout"
    assert 0.05 <= failed.value.latency_s < 2.0
    assert said(shared, "Which?") == before


@pytest.mark.parametrize(("fields", "cause"), [
    ({"text": "word " * 2000}, "too_long"), ({"text": "\ud800"}, "refused"),
    ({"choices": None, "schema": {"type": "nonsense"}}, "refused"),
    ({"constrained": False}, "parse"),  # it may think aloud, and a tiny model talks nonsense
], ids=range(4))  # fmt: skip
def test_a_question_without_an_answer_is_counted_under_its_cause(
    shared: EmbeddedModel, fields: dict[str, Any], cause: str
) -> None:
    with pytest.raises(ModelFailure) as failed:
        shared.ask(question(**fields))
    assert failed.value.cause == cause
    assert (failed.value.reply is None) is (cause != "parse")


@pytest.mark.parametrize("content", [None, b"", b"a text", "cut", "adapter"])
def test_a_file_that_is_no_model_is_named_in_one_line(
    tiny: Path, adapter: Path, tmp_path: Path, content: bytes | str | None
) -> None:
    path = tmp_path / "bad.gguf"
    if content is not None:
        known = {"cut": tiny.read_bytes()[:60_000], "adapter": adapter.read_bytes()}
        path.write_bytes(known[content] if isinstance(content, str) else content)
    with pytest.raises(InputError, match=r"bad\.gguf") as refused:
        EmbeddedModel(path)
    assert "\n" not in str(refused.value)


def test_an_adapter_that_is_none_is_named(tiny: Path) -> None:
    with pytest.raises(InputError, match="not made for each other"):
        EmbeddedModel(tiny, [Adapter(tiny)])


@pytest.mark.skipif(os.name != "posix", reason="signals end processes on POSIX only")
def test_a_library_that_dies_at_once_takes_the_trial_along_and_not_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "xllamacpp.py").write_text("import os, signal\nos.kill(os.getpid(), signal.SIGILL)\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with pytest.raises(InputError, match=r"cannot run model\.gguf on this machine: a trial ended with SIGILL"):
        EmbeddedModel(write_model(tmp_path / "model.gguf"))


def test_nothing_is_printed(tiny: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    model = EmbeddedModel(tiny)
    asked: list[dict[str, Any]] = [{}, {"text": "word " * 2000}, {"choices": None, "schema": {"type": "nonsense"}}]
    for fields in asked:
        try:
            model.ask(question(**fields))
        except ModelFailure:
            continue
    (tmp_path / "cut.gguf").write_bytes(tiny.read_bytes()[:60_000])
    with pytest.raises(InputError):
        EmbeddedModel(tmp_path / "cut.gguf")
    model.close()
    assert capfd.readouterr() == ("", "")


def test_interrupts_stay_ours(tiny: Path) -> None:
    model = EmbeddedModel(tiny)
    for number in (signal.SIGINT, signal.SIGTERM):
        kept = signal.signal(number, _interrupted)
        EmbeddedModel(tiny)
        try:
            with pytest.raises(_Interrupted):
                signal.raise_signal(number)
        finally:
            signal.signal(number, kept)
    assert model.ask(question()).choice in CHOICES


@pytest.mark.skipif(os.name != "posix", reason="no interval timer elsewhere")
def test_an_interrupt_ends_an_answer(shared: EmbeddedModel) -> None:
    kept = signal.signal(signal.SIGALRM, _interrupted)
    shared.ask(question())
    signal.setitimer(signal.ITIMER_REAL, 0.05)
    try:
        with pytest.raises(_Interrupted):
            shared.ask(question("word " * 600, choices=None, max_tokens=900))
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, kept)
    assert shared.ask(question()).choice in CHOICES


class _Interrupted(BaseException):
    pass


def _interrupted(*_: object) -> None:
    raise _Interrupted


def test_another_thread_is_told_that_it_cannot_open_it(tiny: Path) -> None:
    told: list[str] = []

    def open_there() -> None:
        try:
            EmbeddedModel(tiny)
        except InputError as error:
            told.append(str(error))

    thread = threading.Thread(target=open_there)
    thread.start()
    thread.join()
    assert len(told) == 1
    assert "main thread" in told[0]


@pytest.mark.parametrize("threads", [0, 65])
def test_an_odd_number_of_threads_is_refused(tiny: Path, threads: int) -> None:
    with pytest.raises(InputError, match="give 1 to 64"):
        EmbeddedModel(tiny, threads=threads)


def test_the_librarys_server_is_a_chat_url_that_takes_grammars_and_schemas_and_is_shut_to_others(
    tiny: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("httpx2", reason="needs the extra: pip install 'interplan-sumo[llm]'")
    with native_model(tiny) as library:
        monkeypatch.setenv("INTERPLAN_LLM_KEY", "sesame")
        with contextlib.closing(ChatUrl(f"{library.address}/v1", "tiny")) as model:
            can = model.capabilities
            assert not can.choice
            assert all((can.grammar, can.json_schema, can.logprobs, can.prompt_cache))
            assert model.ask(question()).choice in CHOICES
            asked = question(choices=None, schema=SCHEMA, max_tokens=200)
            assert model.ask(asked).data["lane"] in ("left", "right")
        monkeypatch.setenv("INTERPLAN_LLM_KEY", "guess")
        with contextlib.closing(ChatUrl(f"{library.address}/v1", "tiny")) as model:
            with pytest.raises(ModelFailure) as failed:
                model.ask(question())
            assert failed.value.cause == "refused"


@pytest.mark.slow
def test_the_default_model_answers_in_a_few_seconds() -> None:
    try:
        model = EmbeddedModel(default_model())
    except InputError as error:
        pytest.skip(str(error))
    began_s = time.perf_counter()
    assert model.ask(question(timeout_s=60.0)).choice in CHOICES
    assert time.perf_counter() - began_s < 60.0
    model.close()
