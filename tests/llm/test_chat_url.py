"""A chat server may answer, dawdle, refuse, break or ramble: each is counted under its cause, and the key stays put."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from email.utils import format_datetime
from importlib.util import find_spec
from typing import Any

import pytest

from interplan_llm.models.chat_url import RETRY_AFTER_CAP_S, ChatUrl
from interplan_llm.models.endpoint import Endpoint, address
from interplan_llm.models.protocol import MAX_TEXT_BYTES, Capabilities, Cause, LanguageModel, ModelFailure
from interplan_sumo.errors import InputError
from tests.llm import chat_server
from tests.llm.chat_server import Act, ChatServer
from tests.llm.questions import Time, question

pytestmark = pytest.mark.skipif(find_spec("httpx2") is None, reason="needs pip install 'interplan-sumo[llm]'")
CANARY = "sk-canary-4711"


@pytest.fixture(autouse=True)
def _only_our_key(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("INTERPLAN_LLM_KEY", CANARY)
    monkeypatch.delenv("OPENAI_API_KEY", raising=False)


@pytest.fixture
def server() -> Iterator[ChatServer]:
    with ChatServer() as server:
        yield server


def model_of(server: ChatServer, *acts: Act, time: Time | None = None) -> ChatUrl:
    """A model whose server has been probed and will then play `acts`."""
    time = time or Time()
    model = ChatUrl(server.url, "toy", clock=time.clock, sleep=time.sleep)
    assert model.capabilities is not None
    server.bodies.clear()
    server.acts.extend(acts)
    return model


def failure_of(model: LanguageModel, **fields: Any) -> ModelFailure:
    with pytest.raises(ModelFailure) as failed:
        model.ask(question(**fields))
    return failed.value


def test_an_answer_comes_with_its_choice_tokens_latency_and_origin(server: ChatServer) -> None:
    model = ChatUrl(server.url + "/", "toy")
    reply = model.ask(question())
    assert (reply.choice, reply.prompt_tokens, reply.completion_tokens) == ("follow", 300, 2)
    assert (reply.model, reply.provider, reply.finish_reason) == ("toy", server.url, "stop")
    assert 0.0 < reply.latency_s < 5.0
    assert model.name == f"{server.url}#toy"
    assert isinstance(model, LanguageModel)


def test_the_question_is_sent_as_it_was_put(server: ChatServer) -> None:
    model_of(server).ask(question("Was nun? \ud800", max_tokens=7, temperature=0.5, seed=3))
    (sent,) = server.bodies
    assert [message["role"] for message in sent["messages"]] == ["system", "user"]
    assert sent["messages"][1]["content"] == "Was nun? \ud800"
    assert (sent["model"], sent["max_tokens"], sent["temperature"], sent["seed"]) == ("toy", 7, 0.5, 3)


@pytest.mark.parametrize(
    ("understood", "capability"),
    [("structured_outputs", "choice"), ("grammar", "grammar"), ("response_format", "json_schema")],
)
def test_only_what_the_server_obeys_is_sent(understood: str, capability: str) -> None:
    with ChatServer(understands=(understood,), says="I would stop") as server:
        model = model_of(server)
        assert model.capabilities == Capabilities(**{capability: True}, seed=True, prompt_cache=True)
        assert model.ask(question(choices=("merge_left", "stop"))).choice == "merge_left"
        assert {"structured_outputs", "grammar", "response_format"} & server.bodies[-1].keys() == {understood}


def test_a_server_that_ignores_every_constraint_gets_none(server: ChatServer) -> None:
    model = model_of(server)
    assert model.capabilities == Capabilities(seed=True, prompt_cache=True)
    model.ask(question())
    assert not {"structured_outputs", "grammar", "response_format"} & server.bodies[-1].keys()


def test_a_model_that_may_think_first_is_not_held_to_the_choices() -> None:
    with ChatServer(understands=("grammar",), says="Let me see. <<stop>>") as server:
        model = model_of(server)
        assert model.ask(question(constrained=False)).choice == "stop"
        assert "grammar" not in server.bodies[-1]


@pytest.mark.parametrize(("refuses", "sent", "not_sent"), [
    (("max_tokens",), {"max_completion_tokens", "temperature", "seed"}, {"max_tokens"}),
    (("max_tokens", "temperature"), {"max_completion_tokens", "seed"}, {"max_tokens", "temperature"}),
    (("seed",), {"max_tokens", "temperature"}, {"seed"}),
])  # fmt: skip
def test_a_server_is_asked_in_the_dialect_that_it_takes(
    refuses: tuple[str, ...], sent: set[str], not_sent: set[str]
) -> None:
    with ChatServer(refuses=refuses) as server:
        model = model_of(server)
        assert model.ask(question()).choice == "follow"
        assert sent <= server.bodies[-1].keys()
        assert not not_sent & server.bodies[-1].keys()
        assert model.capabilities.seed is ("seed" in sent)


def test_json_is_asked_for_by_schema_and_read(server: ChatServer) -> None:
    schema = {"type": "object", "properties": {"x": {"type": "number"}}, "required": ["x"]}
    with ChatServer(understands=("response_format",), says='{"x": 2.5}') as server:
        reply = model_of(server).ask(question(choices=None, schema=schema))
        assert reply.data == {"x": 2.5}
        assert server.bodies[-1]["response_format"]["json_schema"]["schema"] == schema


@pytest.mark.parametrize(("act", "cause"), [
    (chat_server.saying("merge_right"), "not_offered"),
    (chat_server.saying("accelerate"), "parse"),
    (chat_server.saying("x" * MAX_TEXT_BYTES), "too_long"),
    (chat_server.raw(b"{nonsense"), "parse"), (chat_server.raw(b"[" * 50_000), "parse"),
    (chat_server.raw(b"[]"), "parse"),
    (chat_server.raw(b'{"choices": []}'), "parse"),
    (chat_server.raw(b'{"choices": [{"message": {"content": null}}]}'), "parse"),
    (chat_server.raw(b"\xff\xfe"), "parse"), (chat_server.status(400), "refused"), (chat_server.status(401), "refused"),
    (chat_server.status(404), "refused"),
])  # fmt: skip
def test_what_asking_again_cannot_mend_is_asked_once_and_named(server: ChatServer, act: Act, cause: Cause) -> None:
    model = model_of(server, act)
    failure = failure_of(model, vocabulary=("merge_right",))
    assert failure.cause == cause
    assert len(server.bodies) == 1
    assert model.ask(question()).choice == "follow"


@pytest.mark.parametrize(("act", "cause"), [
    (chat_server.status(429), "rate_limit"), (chat_server.status(500), "server"), (chat_server.status(503), "server"),
    (chat_server.hung_up, "connection"), (chat_server.cut, "connection"),
])  # fmt: skip
def test_what_may_pass_is_asked_four_times_with_growing_waits(server: ChatServer, act: Act, cause: Cause) -> None:
    time = Time()
    model = model_of(server, *[act] * 4, time=time)
    failure = failure_of(model)
    assert failure.cause == cause
    assert failure.latency_s == pytest.approx(3.5)
    assert time.slept_s == [0.5, 1.0, 2.0]
    assert model.ask(question()).choice == "follow"


def test_a_server_that_recovers_answers_and_is_obeyed_when_it_says_when_to_come_back(server: ChatServer) -> None:
    model = model_of(server, chat_server.status(500), chat_server.status(500))
    reply = model.ask(question())
    assert reply.choice == "follow"
    assert reply.latency_s == pytest.approx(1.5)
    time = Time()
    model = model_of(server, chat_server.status(429, Retry_After="7"), time=time)
    assert model.ask(question(timeout_s=10.0)).choice == "follow"
    assert time.slept_s == [7.0]
    time = Time()
    later = format_datetime(datetime.now(UTC) + timedelta(seconds=20), usegmt=True)
    model_of(server, chat_server.status(503, Retry_After=later), time=time).ask(question(timeout_s=60.0))
    assert time.slept_s == [pytest.approx(20.0, abs=3.0)]


@pytest.mark.parametrize(("wait_s", "timeout_s"), [(RETRY_AFTER_CAP_S + 1, 600.0), (5.0, 5.0)])
def test_a_wait_over_the_cap_or_past_the_deadline_is_not_waited_for(
    server: ChatServer, wait_s: float, timeout_s: float
) -> None:
    time = Time()
    model = model_of(server, chat_server.status(429, Retry_After=str(wait_s)), time=time)
    assert failure_of(model, timeout_s=timeout_s).cause == "rate_limit"
    assert time.slept_s == []


@pytest.mark.parametrize("text", ["9999999999", "soon", "Mon, 01 Jan 99999 00:00:00 GMT", "-1"])
def test_where_the_wait_cannot_be_read_the_usual_one_is_taken(server: ChatServer, text: str) -> None:
    time = Time()
    model_of(server, chat_server.status(429, Retry_After=text), time=time).ask(question(timeout_s=60.0))
    assert len(time.slept_s) == 1


@pytest.mark.parametrize("act", [chat_server.silent, chat_server.dripping])
def test_the_deadline_holds_for_the_whole_answer_however_it_comes(server: ChatServer, act: Act) -> None:
    model = model_of(server, act)
    began_s = time.perf_counter()
    assert failure_of(model, timeout_s=0.2).cause == "timeout"
    assert time.perf_counter() - began_s < 2.0


def test_no_more_is_read_than_an_answer_may_be_long(server: ChatServer) -> None:
    model = model_of(server, chat_server.endless)
    assert failure_of(model).cause == "too_long"
    assert server.bytes_sent < 50 * MAX_TEXT_BYTES  # what buffers on the way may hold, not the gigabyte to come


def test_a_server_that_is_not_there_is_a_connection_failure() -> None:
    with ChatServer() as server:
        url = server.url
    time = Time()
    assert failure_of(ChatUrl(url, "toy", clock=time.clock, sleep=time.sleep)).cause == "connection"


def test_a_redirect_is_not_followed_and_told_without_the_key(server: ChatServer) -> None:
    with ChatServer() as elsewhere:
        failure = failure_of(model_of(server, chat_server.status(307, Location=f"{elsewhere.url}/chat/completions")))
        assert not elsewhere.bodies
    assert "redirects to 127.0.0.1" in failure.message
    failure = failure_of(model_of(server, chat_server.status(302, Location=f"http://{CANARY}.example.invalid/")))
    assert "redirects to [key].example.invalid" in failure.message
    failure = failure_of(model_of(server, chat_server.status(307, Location="http://[::bad/")))
    assert "redirects to an address that cannot be read" in failure.message


def test_what_a_server_says_of_an_error_reaches_no_terminal_as_it_is(server: ChatServer) -> None:
    failure = failure_of(model_of(server, chat_server.status(401, message="\x1b[2Jall\nis \x9b1mwell")))
    assert failure.message.endswith(r"HTTP 401: \x1b[2Jall is \x9b1mwell")


def test_the_key_goes_to_the_server_and_nowhere_else(
    server: ChatServer, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> None:
    caplog.set_level(logging.DEBUG)
    acts = (
        chat_server.echoing_the_key,
        chat_server.status(401, message=f"Incorrect API key provided: {CANARY}"),
        chat_server.raw(f'{{"choices": "{CANARY}"}}'.encode()),
        chat_server.hung_up,
    )
    model = model_of(server, *acts)
    shown = [repr(model), str(vars(model)), str(model.capabilities)]
    for _ in acts:
        try:
            shown.append(repr(model.ask(question())))
        except ModelFailure as failure:
            shown += [str(failure), repr(failure), repr(failure.reply)]
    assert all(headers["Authorization"] == f"Bearer {CANARY}" for headers in server.headers)
    for text in (*shown, caplog.text, *capfd.readouterr()):
        assert CANARY not in text


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "utf-32-le"])
def test_a_key_that_comes_back_in_disguise_is_kept_out_of_answers(encoding: str, server: ChatServer) -> None:
    disguised = "".join(f"\\u{ord(each):04x}" for each in CANARY)
    content = f'{{"a": "{disguised}", "{CANARY}": "{CANARY}"}}'.encode(encoding)
    server.acts.append(chat_server.raw(content))
    endpoint = Endpoint(address(server.url))
    try:
        assert endpoint.post("/chat/completions", {}, 5.0) == {"a": "[key]", "[key]": "[key]"}
    except ModelFailure as failure:
        assert encoding != "utf-8"
        assert CANARY not in str(failure)  # noqa: PT017
    finally:
        endpoint.close()


def test_openais_key_and_a_proxy_are_not_for_this_machine(server: ChatServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("INTERPLAN_LLM_KEY")
    for name in ("OPENAI_API_KEY", "OPENAI_ORG_ID", "OPENAI_PROJECT_ID"):
        monkeypatch.setenv(name, CANARY)
    model_of(server).ask(question())
    assert not any(CANARY in str(headers) for headers in server.headers)
    monkeypatch.setenv("HTTP_PROXY", "http://127.0.0.1:9")
    assert model_of(server).ask(question()).choice == "follow"


def test_the_server_is_probed_once_before_the_first_answer(server: ChatServer) -> None:
    ChatUrl(server.url, "toy").close()
    assert not server.bodies
    model = ChatUrl(server.url, "toy")
    model.ask(question())
    probed = len(server.bodies) - 1
    assert probed == 5
    model.ask(question())
    assert len(server.bodies) == probed + 2
    server.acts.append(chat_server.status(401))  # a probe without an answer is made again
    model = ChatUrl(server.url, "toy")
    assert failure_of(model).cause == "refused"
    assert model.ask(question()).choice == "follow"


@pytest.mark.parametrize("url", [
    "", "localhost:8000", "ftp://localhost/v1", "http://", "http://[::1/v1", "http://host:99999/v1", "http://a b/v1",
    f"http://user:{CANARY}@localhost/v1", f"http://localhost/v1?key={CANARY}",
])  # fmt: skip
def test_a_url_that_is_none_or_holds_a_secret_is_refused_in_one_line(url: str) -> None:
    with pytest.raises(InputError) as refused:
        ChatUrl(url, "toy")
    assert "\n" not in str(refused.value)
    assert CANARY not in str(refused.value)


def test_a_key_that_no_header_can_hold_is_refused_without_being_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("INTERPLAN_LLM_KEY", f"{CANARY}\r\nX: y")
    with pytest.raises(InputError) as refused:
        ChatUrl("http://localhost/v1", "toy")
    assert CANARY not in str(refused.value)
    assert CANARY in os.environ["INTERPLAN_LLM_KEY"]
