"""Without the extra [train], the command says how to get it."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

from tools.tune_llm import __main__ as train


def test_a_missing_library_is_one_line_with_the_way_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    assert train.main([str(tmp_path / "examples.jsonl"), "--out", str(tmp_path / "sign.gguf")]) == train.BAD_INPUT
    error = capsys.readouterr().err
    assert error == "error: tuning needs torch, which is not installed. Run: pip install 'interplan-sumo[train]'\n"
