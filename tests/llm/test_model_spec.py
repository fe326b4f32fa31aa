"""One text names a model, also inside the options of a planner; so does the name of a shipped adapter."""

from __future__ import annotations

import hashlib
import importlib.util
import json
from pathlib import Path

import pytest

from interplan_llm.models import spec as model_spec
from interplan_llm.models.fetch import SMOLLM2
from interplan_llm.models.protocol import ModelFailure
from interplan_llm.models.spec import ADAPTERS, adapter_file, open_model
from interplan_llm.models.store import AnswerStore, Mode, StoredModel
from interplan_sumo.errors import InputError, UnknownNameError
from interplan_sumo.planner import Mission, Observation, load_planner
from interplan_sumo.world.trajectory import Trajectory
from tests.llm.questions import question

needs_http = pytest.mark.skipif(
    importlib.util.find_spec("httpx2") is None, reason="needs the extra: pip install 'interplan-sumo[llm]'"
)


class OptionHolder:
    """A planner that only holds its options."""

    def __init__(self, model: str = "", store: str = "") -> None:
        self.model, self.store = model, store

    def start(self, mission: Mission) -> None: ...

    def plan(self, observation: Observation) -> Trajectory:
        raise NotImplementedError


def test_scripted_texts_are_said_in_turn() -> None:
    model = open_model("scripted:follow,I say <<stop>>%2C now")
    assert [model.ask(question()).choice for _ in range(3)] == ["follow", "stop", "follow"]


@needs_http
@pytest.mark.parametrize(("spec", "name"), [
    ("http://localhost:11434/v1#smollm2:135m", "http://localhost:11434/v1#smollm2:135m"),
    ("https://host/v1/#org/model%26more", "https://host/v1#org/model&more"),
])  # fmt: skip
def test_a_url_and_the_model_behind_it(spec: str, name: str) -> None:
    model = open_model(spec)
    assert model.name == name
    model.close()


def test_a_store_keeps_what_is_said_and_a_replay_says_it_again(tmp_path: Path) -> None:
    path = tmp_path / "answers.jsonl"
    recorded = open_model("scripted:stop", store=path).ask(question())
    for replayed in (open_model(f"replay:{path}"), open_model("scripted:stop", store=path, mode="replay")):
        assert replayed.ask(question()) == recorded
    with pytest.raises(ModelFailure):
        replayed.ask(question("Anything else."))


def test_a_replay_opens_neither_file_nor_connection(tmp_path: Path) -> None:
    path = tmp_path / "answers.jsonl"
    for spec, name in (("scripted:stop", "http://nowhere.invalid/v1#toy"), ("scripted:follow", "embedded:abc")):
        inner = open_model(spec)
        StoredModel(name, AnswerStore(path), "record", inner).ask(question())
    chat = open_model("http://nowhere.invalid/v1#toy", store=path, mode="replay")
    assert chat.ask(question()).choice == "stop"
    assert open_model("embedded:/no/such.gguf", store=path, mode="replay").ask(question()).choice == "follow"


def test_a_model_whose_name_begins_anothers_can_be_replayed(tmp_path: Path) -> None:
    path = tmp_path / "answers.jsonl"
    for text, name in (("stop", "http://nowhere.invalid/v1#toy"), ("follow", "http://nowhere.invalid/v1#toy-mini")):
        StoredModel(name, AnswerStore(path), "record", open_model(f"scripted:{text}")).ask(question())
    named = open_model(f"replay:{path}#http://nowhere.invalid/v1%23toy")
    replayed = open_model("http://nowhere.invalid/v1#toy", store=path, mode="replay")
    assert named.ask(question()).choice == replayed.ask(question()).choice == "stop"


def test_scripted_texts_with_blanks_can_be_replayed(tmp_path: Path) -> None:
    path = tmp_path / "answers.jsonl"
    recorded = open_model("scripted:stop%20now", store=path).ask(question())
    assert open_model("scripted:stop%20now", store=path, mode="replay").ask(question()) == recorded


def test_a_replay_of_several_models_wants_one_named(tmp_path: Path) -> None:
    path = tmp_path / "answers.jsonl"
    for text in ("stop", "follow"):
        open_model(f"scripted:{text}", store=path).ask(question())
    with pytest.raises(InputError, match=r"several models; name one .* scripted:follow, scripted:stop"):
        open_model(f"replay:{path}")
    assert open_model(f"replay:{path}#scripted:stop").ask(question()).choice == "stop"
    with pytest.raises(InputError, match="no answers of other; it holds: scripted:follow, scripted:stop"):
        open_model(f"replay:{path}#other")


@pytest.mark.parametrize("spec", [
    "", "nonsense", "scripted", "scripted:", "replay", "replay:", "replay:/no/such/file.jsonl", "http://localhost/v1",
    "http:#model", "embedded:", "embedded:/no/such.gguf", "embedded:/no/such.gguf+lora:",
])  # fmt: skip
def test_a_text_that_names_no_model_is_refused_in_one_line(spec: str) -> None:
    with pytest.raises(InputError) as refused:
        open_model(spec)
    assert "\n" not in str(refused.value)


def test_an_unknown_kind_or_mode_suggests_a_near_one_and_a_replay_needs_no_store(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'embedded'"):
        open_model("embeded")
    with pytest.raises(UnknownNameError, match="Did you mean 'replay'"):
        open_model("scripted:x", mode="repla")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="needs no store"):
        open_model("replay:a.jsonl", store=tmp_path / "b.jsonl")


@pytest.mark.parametrize(("spec", "mode", "message"), [
    ("scripted:x", "replay", "scripted:x: mode replay needs the file of the answers; name it as store"),
    ("scripted:x", "refresh", "scripted:x: mode refresh needs the file of the answers; name it as store"),
    ("replay:a.jsonl", "refresh", "replay:a.jsonl: a replay asks nobody anew; name a model, with this file as store"),
])  # fmt: skip
def test_a_mode_that_needs_a_file_or_a_model_asks_nobody_without(spec: str, mode: Mode, message: str) -> None:
    with pytest.raises(InputError) as refused:
        open_model(spec, mode=mode)
    assert str(refused.value) == message


def test_an_empty_store_is_refused_in_options_as_well() -> None:
    with pytest.raises(InputError, match="store is empty; name the file"):
        load_planner("llm_waypoints?model=scripted:x&store=")


def test_names_in_a_file_of_answers_reach_no_terminal_as_they_are(tmp_path: Path) -> None:
    for name in ("a\x1b[2J", "b"):
        StoredModel(name, AnswerStore(tmp_path / "a.jsonl"), "record", open_model("scripted:stop")).ask(question())
    with pytest.raises(InputError, match=r"name one as .*: a\\x1b\[2J, b"):
        open_model(f"replay:{tmp_path / 'a.jsonl'}")


@pytest.mark.parametrize("spec", [
    "embedded", "embedded:/models/a.gguf", "embedded:models/a%20b%26c.gguf+lora:adapter.gguf@0.5",
    "http://localhost:11434/v1#smollm2:135m", "https://api.openai.com/v1#gpt-4o-mini", "http://[::1]:8000/v1?a=b#m",
    "replay:runs/answers.jsonl#http://localhost:11434/v1#smollm2:135m", "scripted:follow,stop",
])  # fmt: skip
def test_a_spec_goes_unchanged_through_the_options_of_a_planner(spec: str) -> None:
    planner = load_planner(f"{__name__}:OptionHolder?model={spec}&store=out/answers.jsonl")
    assert isinstance(planner, OptionHolder)
    assert planner.model == spec
    assert planner.store == "out/answers.jsonl"


MAX_BYTES = 4_000_000


def test_a_name_that_is_none_is_met_with_one_that_is() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'hybrid'"):
        open_model("embedded+tuned:hybird")


def test_an_adapter_that_is_not_there_is_said_to_be_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(model_spec, "files", lambda _: tmp_path)
    with pytest.raises(InputError, match="holds no tuned adapter 'hybrid'"):
        open_model("embedded+tuned:hybrid")
    (tmp_path / "adapters").mkdir()
    (tmp_path / "adapters" / "hybrid.gguf").write_bytes(b"GGUF")
    assert adapter_file("hybrid") == tmp_path / "adapters" / "hybrid.gguf"


@pytest.mark.parametrize("spec", ["embedded+tuned", "embedded:/no/such.gguf+tuned:hybrid", "embedded+other:hybrid"])
def test_what_belongs_to_no_model_is_refused(spec: str) -> None:
    with pytest.raises(InputError, match=r"write embedded, embedded\+tuned:NAME"):
        open_model(spec)


@pytest.mark.parametrize("name", ADAPTERS)
def test_a_shipped_adapter_is_small_and_what_its_card_says(name: str) -> None:
    try:
        path = adapter_file(name)
    except InputError as error:
        pytest.skip(str(error))
    card = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
    assert path.stat().st_size <= MAX_BYTES
    assert card["adapter"]["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
    assert card["base"]["sha256"] == SMOLLM2.model.sha256
    assert "not a zero-shot result" in card["caveat"]
