"""Files are put in their place as wholes, and are known by their hash."""

from __future__ import annotations

import hashlib
import os
import stat
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from interplan_sumo.world.files import PART, file_hash, replacing


def test_a_new_file_takes_the_place_of_the_old_one_when_it_is_complete(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    for content in ("old", "new"):
        with replacing(path) as fresh:
            fresh.write_text(content, encoding="utf-8")
            assert path.exists() is (content == "new")
            assert content == "old" or path.read_text(encoding="utf-8") == "old"
        assert path.read_text(encoding="utf-8") == content
        assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_where_writing_fails_the_old_file_stays_and_nothing_else(tmp_path: Path, error: type[BaseException]) -> None:
    path = tmp_path / "a.json"
    path.write_text("old", encoding="utf-8")

    def write() -> None:
        with replacing(path) as fresh:
            fresh.write_text("half of the n", encoding="utf-8")
            raise error

    with pytest.raises(error):
        write()
    assert path.read_text(encoding="utf-8") == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_disk_that_does_not_take_it_is_an_os_error_and_the_old_file_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_handle: int) -> None:
        raise OSError(28, "No space left on device")

    path = tmp_path / "a.json"
    path.write_text("old", encoding="utf-8")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"), replacing(path) as fresh:
        fresh.write_text("new", encoding="utf-8")
    assert path.read_text(encoding="utf-8") == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_several_may_write_the_same_file_and_the_last_one_stays(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    with replacing(path) as first:
        with replacing(path) as second:
            first.write_text("first", encoding="utf-8")
            second.write_text("second", encoding="utf-8")
            assert all(each.name.startswith(PART) for each in tmp_path.iterdir())
        assert path.read_text(encoding="utf-8") == "second"
    assert path.read_text(encoding="utf-8") == "first"


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no file mode mask")
def test_who_may_read_it_is_what_the_user_wants_for_new_files(tmp_path: Path) -> None:
    (tmp_path / "plain").touch()
    with replacing(tmp_path / "whole") as fresh:
        fresh.touch()
    plain, whole = (stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("plain", "whole"))
    assert whole == plain


@given(st.binary(max_size=64))
def test_the_hash_is_that_of_the_content(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    path = tmp_path_factory.getbasetemp() / "hashed"
    path.write_bytes(content)
    assert file_hash(path) == hashlib.sha256(content).hexdigest()
