"""Options of planners: held against the constructor before anything is built; what is wrong in them is one line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import pytest

from interplan_sumo.errors import InputError, UnknownNameError
from interplan_sumo.planner import load_planner
from interplan_sumo.planner_options import option_defaults, options_of


class Cautious:
    def __init__(
        self,
        gap_m: Annotated[float, msgspec.Meta(ge=0.0)],
        name: str = "",
        tries: int = 3,
        style: Literal["soft", "hard"] = "soft",
        offsets_m: Sequence[float] = (),
        file: Path = Path(),
        bold: bool | None = None,
    ) -> None: ...


class AnyOption:
    def __init__(self, known: float = 1.0, **others: object) -> None: ...


class NoOption:
    pass


@dataclass
class KeptSettings:
    gap_m: float = 1.0


class Keeping:
    Settings = KeptSettings

    def __init__(self, settings: KeptSettings) -> None: ...


@pytest.mark.parametrize(
    ("make", "query", "options"),
    [
        (Cautious, "gap_m=1", {"gap_m": 1}),
        (Cautious, "gap_m=1e-1&name=2026&style=hard", {"gap_m": 0.1, "name": "2026", "style": "hard"}),
        (Cautious, "gap_m=0&offsets_m=[1, -2.5]&file=a.pt&bold=null",
         {"gap_m": 0, "offsets_m": [1, -2.5], "file": "a.pt", "bold": None}),
        (Cautious, "gap_m=0&name=", {"gap_m": 0, "name": ""}),
        (AnyOption, "other=[a, 1]&known=2", {"other": ["a", 1], "known": 2}),
        (NoOption, "", {}),
        (Keeping, "gap_m=3", {"gap_m": 3}),
        (len, "whatever=1", {"whatever": 1}),
    ],
)  # fmt: skip
def test_options_are_read_as_the_constructor_says(make: Any, query: str, options: dict[str, Any]) -> None:
    if make is len:
        make = type("Unknown", (), {"__signature__": "none"})  # nobody can tell what it takes
    assert options_of("mine", make, query) == options


@pytest.mark.parametrize(
    ("make", "query", "message"),
    [
        (Cautious, "gap_m=wide", "option gap_m of planner 'mine' is 'wide': expected float, got str"),
        (Cautious, "gap_m=-0.1", "option gap_m of planner 'mine' is '-0.1': expected float >= 0.0"),
        (Cautious, "gap_m=.nan", "option gap_m of planner 'mine' is '.nan', expected a number"),
        (Cautious, "gap_m=1&tries=1.5", "option tries of planner 'mine' is '1.5': expected int, got float"),
        (Cautious, "gap_m=1&tries=true", "expected int, got bool"),
        (Cautious, "gap_m=1&bold=2", "expected bool | null, got int"),
        (Cautious, "gap_m=1&offsets_m=[1, far]", r"expected float, got str - at \[1\]"),
        (Cautious, "gap_m=1&style=hrd", "no value of option style of planner 'mine' named 'hrd'. Did you mean 'hard'?"),
        (Cautious, "gap_m=1&name=[", r"option name of planner 'mine' is '\[', which cannot be read"),
        (Cautious, "gap_n=1", "no option of planner 'mine' named 'gap_n'. Did you mean 'gap_m'?"),
        (Cautious, "gap_m", "option 'gap_m' of planner 'mine' has no value; write gap_m=VALUE"),
        (Cautious, "", r"planner 'mine' needs the option gap_m; write mine\?gap_m=VALUE"),
        (Cautious, "gap_m=1&gap_m=2", "planner 'mine' is given the option gap_m twice; leave one of them away"),
        (Cautious, "gap_m=1&bold=", r"option bold of planner 'mine' is '': expected bool \| null, got str"),
        (NoOption, "gap_m=1", "planner 'mine' has no options; leave 'gap_m=1' away"),
        (Keeping, "gap_m=a", "expected float"),
    ],
)
def test_what_it_does_not_take_is_refused_in_one_line(make: Any, query: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as said:
        options_of("mine", make, query)
    assert "\n" not in str(said.value)


def test_defaults_are_those_of_the_constructor_or_of_its_settings() -> None:
    assert list(option_defaults(Cautious)) == "gap_m name tries style offsets_m file bold".split()
    assert option_defaults(Cautious)["tries"] == 3
    assert option_defaults(Keeping) == {"gap_m": 1.0}


BROKEN = {
    "no_module_of_that_name": ("import nowhere", "ModuleNotFoundError: .*nowhere.*py:1 in <mod"),
    "a_typing_error": ("class Mine:\n    def start(self:\n", r"SyntaxError: .*\(a_typing_error.py, line 2\)"),
    "leaves": ("import sys\nsys.exit(3)", r"SystemExit: 3 \(leaves.py:2 in <module>\)"),
    "fails_when_built": (
        "import json\nclass Mine:\n    def __init__(self):\n        self.a()\n    def a(_):\n        json.loads('{')",
        r"could not be built: JSONDecodeError: .* \(fails_when_built.py:4 in __init__, fails_when_built.py:6 in a\)",
    ),
    "none": ("class Mines:\n    pass", "no class of module 'none' named 'Mine'. Did you mean 'Mines'"),
    "no_planner": ("class Mine:\n    pass", r"has no method start\(\); a planner needs start\(mission\) and plan"),
    "of_nuplan": (
        "class Mine:\n    def compute_planner_trajectory(self, current_input): ...",
        r"has no method start\(\); one of nuPlan's is named nuplan:of_nuplan:Mine",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BROKEN)
def test_errors_in_ones_own_file_name_its_lines(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    text, message = BROKEN[name]
    (tmp_path / f"{name}.py").write_text(text)
    with pytest.raises(InputError, match=message) as said:
        load_planner(f"{name}:Mine")
    assert "\n" not in str(said.value)


@pytest.mark.parametrize(
    "spec", ["idm?headway_s=-1", "idm_mobil?politeness=-1", "pdm_closed?exponent=0", "straight_ahead?horizon_s=0"]
)
def test_options_of_ours_have_their_ranges(spec: str) -> None:
    with pytest.raises(InputError, match=r"expected 0 or more|expected more than 0"):
        load_planner(spec)


def test_a_name_that_is_near_is_named() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'headway_s'"):
        load_planner("idm?hedway_s=1")
