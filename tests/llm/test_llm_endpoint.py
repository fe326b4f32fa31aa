"""Which addresses are ours, which key they may see, and what is said where a library is missing."""

from __future__ import annotations

import json
import subprocess
import sys
import threading

import pytest

from interplan_llm.models.endpoint import address, key_for, spelled, within
from interplan_sumo.errors import InputError
from interplan_sumo.extras import library
from tests.environments import environment
from tests.yardstick import at_most

BOTH = {"INTERPLAN_LLM_KEY": "ours", "OPENAI_API_KEY": "theirs"}


KEY = 'sk-a/"b\\n1'
BY_NUMBER = "".join(f"\\u{ord(character):04X}" for character in KEY)


@pytest.mark.parametrize(
    "text",
    [KEY, json.dumps(KEY)[1:-1], json.dumps(json.dumps(KEY)[1:-1])[1:-1], KEY.replace("/", "\\/"), BY_NUMBER,
     BY_NUMBER.lower(), BY_NUMBER.replace("\\", "\\\\"), KEY.replace("s", "\\u0073")],
)  # fmt: skip
def test_a_key_is_found_however_json_spells_it(text: str) -> None:
    assert spelled(KEY).sub("[key]", f'{{"a": "{text}."}}') == '{"a": "[key]."}'


def test_what_is_no_key_stays_and_takes_no_time() -> None:
    for text in ("sk-a/", KEY[:-1], KEY.upper(), BY_NUMBER[:-1]):
        assert spelled(KEY).sub("[key]", text) == text
    with at_most(67):
        assert spelled("/" + KEY).sub("", "\\" * 200_000) == "\\" * 200_000


@pytest.mark.parametrize(("url", "key"), [
    ("https://api.openai.com/v1", "theirs"), ("https://eu.api.openai.com/v1", "theirs"),
    ("http://api.openai.com/v1", None),
    ("https://api.openai.com.example/v1", None),
    ("https://notopenai.com/v1", None), ("http://localhost:8000/v1", None),
])  # fmt: skip
def test_openais_key_goes_to_openai_over_https_only(url: str, key: str | None) -> None:
    assert key_for(address(url), {"OPENAI_API_KEY": "theirs"}) == key


def test_the_key_of_interplan_goes_where_the_user_says_and_comes_first() -> None:
    assert key_for(address("https://api.openai.com/v1"), BOTH) == "ours"
    assert key_for(address("http://localhost:8000/v1"), BOTH) == "ours"
    assert key_for(address("http://localhost:8000/v1"), {}) is None


@pytest.mark.parametrize(("url", "loopback"), [
    ("http://localhost:1/v1", True), ("http://127.0.0.1/v1", True), ("http://127.8.9.1/v1", True),
    ("http://[::1]:8000/v1", True), ("http://10.0.0.1/v1", False), ("https://localhost.example/v1", False),
])  # fmt: skip
def test_this_machine_is_recognized(url: str, loopback: bool) -> None:
    assert address(url).loopback is loopback


def test_a_missing_library_is_named_with_the_way_to_get_it() -> None:
    with pytest.raises(
        InputError, match=r"the model needs no_such_library, .*; run: pip install 'interplan-sumo\[llm\]'"
    ):
        library("no_such_library", "the model", "llm")


def test_importing_the_models_imports_none_of_the_extra_libraries() -> None:
    program = (
        "import sys, interplan_llm.models.spec; print(sorted({'httpx2', 'openai', 'xllamacpp'} & sys.modules.keys()))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment(), capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


def test_a_call_returns_or_raises_what_it_does_within_its_time_and_is_left_behind_past_it() -> None:
    assert within(5.0, lambda: 7) == 7
    with pytest.raises(ZeroDivisionError):
        within(5.0, lambda: 1 // 0)
    go_on = threading.Event()
    with pytest.raises(TimeoutError):
        within(0.02, lambda: go_on.wait(5.0))
    go_on.set()
