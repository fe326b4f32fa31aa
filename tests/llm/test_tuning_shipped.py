"""The adapters of the package: named for short, and said to be missing where they are."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest

from interplan_llm.models import shipped
from interplan_llm.models.fetch import SMOLLM2
from interplan_llm.models.shipped import ADAPTERS, adapter_file
from interplan_llm.models.spec import open_model
from interplan_sumo.errors import InputError, UnknownNameError

MAX_BYTES = 4_000_000


def test_a_name_that_is_none_is_met_with_one_that_is() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'hybrid'"):
        open_model("embedded+tuned:hybird")


def test_an_adapter_that_is_not_there_is_said_to_be_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shipped, "files", lambda _: tmp_path)
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
