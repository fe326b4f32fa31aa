"""The page of a replay: one file that asks for nothing, in which names are text whatever they hold."""

from __future__ import annotations

import gzip
import json
import re
from base64 import b64decode, b64encode
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest

from interplan_sumo.errors import InputError
from interplan_sumo.report.replay.page import replay_page, write_replay
from tests.report.tiny_drives import CRUISE_MPS, tiny_drive

CRUISE = [CRUISE_MPS] * 80
NASTY = """</script><script>alert('"&1')</script>@data@"""


def part(page: str, tag: str, attributes: str = "") -> str:
    found = re.search(rf"<{tag}{attributes}>(.*?)</{tag}>", page, re.DOTALL)
    assert found is not None
    return found[1]


def data_of(page: str) -> dict[str, Any]:
    packed = json.loads(part(page, "script", ' type="application/json" id="replay-data"'))
    return json.loads(gzip.decompress(b64decode(packed["gzip"])))


def test_the_policy_forbids_everything_but_the_style_and_the_script_of_the_page() -> None:
    page = replay_page([tiny_drive(CRUISE)])
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page)
    assert policy is not None
    allowed = dict(rule.split(" ", 1) for rule in policy[1].split("; "))
    for rule, text in (("style-src", part(page, "style")), ("script-src", part(page, "script", ' type="module"'))):
        assert allowed.pop(rule) == f"'sha256-{b64encode(sha256(text.encode()).digest()).decode()}'"
    assert allowed == {"default-src": "'none'", "base-uri": "'none'"}


def test_the_page_names_no_other_place() -> None:
    page = replay_page([tiny_drive(CRUISE)])
    assert re.findall(r"""(?:https?:)?//\w|\b(?:src|href)=|@import|url\(""", re.sub(r"//[^\n]*\n", "\n", page)) == []


def test_the_script_never_makes_elements_of_text() -> None:
    script = part(replay_page([tiny_drive(CRUISE)]), "script", ' type="module"')
    assert not re.search(r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\b|new Function", script)


def test_names_are_text_in_the_head_and_in_the_data() -> None:
    page = replay_page([tiny_drive(CRUISE, name=NASTY, scenario_id=NASTY)])
    assert "<script>alert" not in page
    assert "&lt;/script&gt;" in part(page, "title")
    assert part(page, "h1").endswith("@data@")
    data = data_of(page)
    assert (data["scenario"]["id"], data["drives"][0]["planner"]) == (NASTY, NASTY)


def test_a_page_is_small_and_equal_for_equal_drives(tmp_path: Path) -> None:
    write_replay([tiny_drive(CRUISE)], tmp_path / "drive.html")
    assert (tmp_path / "drive.html").stat().st_size < 150_000
    assert (tmp_path / "drive.html").read_text(encoding="utf-8") == replay_page([tiny_drive(CRUISE)])
    with pytest.raises(InputError, match=r"cannot write .*nowhere.*No such file"):
        write_replay([tiny_drive(CRUISE)], tmp_path / "nowhere" / "drive.html")


def test_two_drives_stand_side_by_side() -> None:
    data = data_of(replay_page([tiny_drive(CRUISE), tiny_drive([5.0] * 100, name="pdm_closed")]))
    assert (data["frames"], [drive["frames"] for drive in data["drives"]]) == (100, [80, 100])
