"""Libraries that only some uses need: whoever lacks one is told what for, and how to get it."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from interplan_sumo.errors import InputError
from interplan_sumo.extras import library, need, need_matplotlib

MISSING = r"a plot needs matplotlib, which is not installed; run: pip install 'interplan-sumo\[plots\]'"


def test_who_has_it_gets_it() -> None:
    assert library("json", "reading", "some") is json
    need("json", "reading", "some")


@pytest.mark.parametrize("ask", [need_matplotlib, lambda: library("matplotlib", "a plot", "plots")])
def test_who_lacks_it_is_told_the_extra(ask, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(InputError, match=MISSING):
        ask()


def test_one_that_is_broken_is_not_said_to_be_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "broken_extra.py").write_text("raise ImportError('its other half is gone')\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    need("broken_extra", "a plot", "plots")
    with pytest.raises(InputError, match="which cannot be imported: its other half is gone; run: pip install"):
        library("broken_extra", "a plot", "plots")
