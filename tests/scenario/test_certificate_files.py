"""Certificates on disk: exact, compact, and refused when damaged."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from worlds import ego

from interplan_sumo.errors import InputError
from interplan_sumo.scenario.certificates import (
    Certificate,
    Summary,
    read_certificates,
    read_summaries,
    write_certificates,
)
from interplan_sumo.world.trace import EgoTrack


def certificate(scenario_id: str, frames: int = 20) -> Certificate:
    states = [replace(ego(365_548.123456 + 0.5 * k, 143_575.25, 0.3), time_s=0.1 * k) for k in range(frames)]
    summary = Summary(scenario_id, "1" * 64, 0.95, 150.0, 148.5, False, "0" * 64)
    return Certificate(summary, EgoTrack.of(states))


def test_what_is_read_is_what_was_written(tmp_path: Path) -> None:
    written = {c.summary.scenario_id: c for c in (certificate("b/1", 30), certificate("a/0", 20))}
    written["b/1"] = replace(written["b/1"], summary=replace(written["b/1"].summary, solved_by=("idm", "foresight")))
    write_certificates(tmp_path / "c.parquet", written.values())
    read = read_certificates(tmp_path / "c.parquet")
    assert list(read) == ["a/0", "b/1"]
    for name, found in read.items():
        assert found.summary == written[name].summary
        assert Certificate.of(found.record()).record() == found.record()
        for column in found.track.__dataclass_fields__:
            assert np.array_equal(getattr(found.track, column), getattr(written[name].track, column)), column
    assert read_summaries(tmp_path / "c.parquet") == {name: found.summary for name, found in read.items()}


def test_equal_certificates_give_equal_bytes_in_any_order(tmp_path: Path) -> None:
    some = [certificate("a/0"), certificate("b/1"), certificate("b/2")]
    write_certificates(tmp_path / "one.parquet", some)
    write_certificates(tmp_path / "two.parquet", some[::-1])
    assert (tmp_path / "one.parquet").read_bytes() == (tmp_path / "two.parquet").read_bytes()


@pytest.mark.parametrize("content", [b"", b"PAR1 something else"])
def test_a_damaged_file_is_named(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "c.parquet"
    path.write_bytes(content)
    for read in (read_certificates, read_summaries):
        with pytest.raises(InputError, match=r"certificates at .*c\.parquet"):
            read(path)
