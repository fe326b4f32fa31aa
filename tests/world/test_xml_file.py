"""XML files within limits: what would cost more than linear time is refused with one line."""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest

from interplan_sumo.errors import MapError
from interplan_sumo.world.xml_file import DEEPEST, LONGEST_PIECE_BYTES, elements, root_of
from tests.yardstick import at_most


def written(folder: Path, inner: str, *, zipped: bool = False) -> Path:
    path, content = folder / "a.xml", f"<net>{inner}</net>".encode()
    path.write_bytes(gzip.compress(content) if zipped else content)
    return path


@pytest.mark.parametrize("zipped", [False, True])
@pytest.mark.parametrize("piece", ["<edge id='{}'/>", "<!-- {} -->"])
def test_a_tag_without_end_is_refused_long_before_its_end(piece: str, zipped: bool, tmp_path: Path) -> None:
    path = written(tmp_path, piece.format("0 " * 4_000_000), zipped=zipped)
    with at_most(33), pytest.raises(MapError, match=r"a\.xml: a tag or a text is more than 1 MiB long"):
        list(elements(path, "net"))


def test_long_values_below_the_limit_are_read(tmp_path: Path) -> None:
    shape = "0.5," * (LONGEST_PIECE_BYTES // 8)
    assert [item.get("shape") for item in elements(written(tmp_path, f"<edge shape='{shape}'/>"), "net")][1] == shape


def test_elements_within_elements_are_read_to_a_depth_that_no_format_needs(tmp_path: Path) -> None:
    path = written(tmp_path, "<a>" * (DEEPEST - 1) + "</a>" * (DEEPEST - 1))
    assert len(list(elements(path, "net"))) == 2
    path = written(tmp_path, "<a>" * DEEPEST + "</a>" * DEEPEST)
    with pytest.raises(MapError, match=r"a\.xml: elements lie more than 100 deep within each other"):
        list(elements(path, "net"))


def test_what_a_damaged_file_holds_does_not_fill_pages(tmp_path: Path) -> None:
    path = tmp_path / "a.xml"
    path.write_text(f'<?xml version="1.0" encoding="UTF-{"7" * 5000}"?><net/>')
    with pytest.raises(MapError, match=r"a\.xml: the file is damaged \(unknown encoding: UTF-7+\); copy") as error:
        list(elements(path, "net"))
    assert len(str(error.value)) < len(str(path)) + 150


def test_the_root_of_what_has_none_is_none(tmp_path: Path) -> None:
    assert root_of(written(tmp_path, "")) == "net"
    (tmp_path / "a.xml").write_text("<" + "n" * 2 * LONGEST_PIECE_BYTES)
    assert root_of(tmp_path / "a.xml") is None
