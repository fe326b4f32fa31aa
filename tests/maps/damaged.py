"""Files that cannot be used: the one line that is said of each, and readings of many that are damaged at random."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from interplan_sumo.errors import InputError
from interplan_sumo.maps.importers.source import SourceMap

Reader = Callable[[Path], Any]


def refusal(path: Path, read: Reader) -> str:
    """The one line that reading ends in, without the path."""
    with pytest.raises(InputError) as caught:
        read(path)
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < len(str(path)) + 200
    assert str(path) in message
    return message.replace(str(path), "FILE")


def survive(
    seeds: int, path: Path, damage: Callable[[Path, np.random.Generator], object], readers: Sequence[Reader],
    sound: Callable[[Any], None],
) -> tuple[float, float]:  # fmt: skip
    """The shares of damaged files that are read, and soundly, and that are refused; anything else raises."""
    refused = 0
    for seed in range(seeds):
        how = f"seed {seed}: {damage(path, np.random.default_rng(seed))}"
        for reader in readers:
            start = time.monotonic()
            try:
                found: Any = reader(path)
                sound(found)
            except InputError as error:
                found = error
            except Exception as error:
                raise AssertionError(f"{how}: {error!r}") from error
            assert time.monotonic() - start < 10.0, how
            refused += isinstance(found, InputError)
            assert not isinstance(found, InputError) or "\n" not in str(found), how
    whole = seeds * len(readers)
    return 1.0 - refused / whole, refused / whole


def assert_sound(source: object) -> None:
    """What every reader of a source map promises, however odd the file; counts promise nothing."""
    if not isinstance(source, SourceMap):
        return
    lanes = source.lanes
    for one in lanes.values():
        assert min(len(one.left), len(one.right)) >= 2
        assert np.isfinite(one.left).all()
        assert np.isfinite(one.right).all()
        assert all(one.id in lanes[other].predecessors for other in one.successors if other in lanes)
        assert all(one.id in lanes[other].successors for other in one.predecessors if other in lanes)
        assert one.left_neighbour is None or lanes[one.left_neighbour].right_neighbour == one.id
        assert one.right_neighbour is None or lanes[one.right_neighbour].left_neighbour == one.id
    for line in source.stop_lines:
        assert len(line.points) >= 2
        assert set(line.lane_ids) <= lanes.keys()
    surfaces = (*source.crosswalks, *source.walkways, *source.carparks, *source.drivable)
    left_out = (item.polygon for item in source.left_out if item.polygon is not None)
    assert all(surface.is_valid for surface in (*surfaces, *left_out))


def bytes_changed(content: bytes, rng: np.random.Generator) -> bytes:
    changed = np.frombuffer(content, dtype=np.uint8).copy()
    places = rng.integers(len(changed), size=int(rng.integers(1, 6)))
    changed[places] = rng.integers(1, 256, size=len(places))
    return changed.tobytes()


def cut(content: bytes, rng: np.random.Generator) -> bytes:
    return content[: int(rng.integers(len(content)))]


def mutated(text: str, rng: np.random.Generator) -> bytes:
    """An XML text, damaged in one of many ways."""
    how = int(rng.integers(7))
    if how < 2:
        return (bytes_changed, cut)[how](text.encode(), rng)
    changes = _value_changed, _value_changed, _element_changed, _element_changed, _attribute_changed
    return changes[how - 2](text, rng).encode()


def _value_changed(text: str, rng: np.random.Generator) -> str:
    pool = ("", "x", "-1", "0", "1e308", "-1e308", "nan", "inf", "1e-320", "99999999999", "ü", "1,2", "true")
    spots = list(re.finditer(r"(?<=[>\"'\s,])-?[0-9][0-9.]*(?=[<\"'\s,])", text))
    for spot in sorted(rng.choice(len(spots), size=int(rng.integers(1, 4))).tolist(), reverse=True):
        start, end = spots[spot].span()
        text = text[:start] + str(rng.choice(pool)) + text[end:]
    return text


def _element_changed(text: str, rng: np.random.Generator) -> str:
    """An element that has no children removed, doubled, or given another name."""
    spots = list(re.finditer(r"<(\w+)[^<>]*(?:/>|>[^<>]*</\1>)", text))
    start, end = spots[int(rng.integers(len(spots)))].span()
    piece = text[start:end]
    other = (piece + piece, "", re.sub(r"\w+", "other", piece, count=1))[int(rng.integers(3))]
    return text[:start] + other + text[end:]


def _attribute_changed(text: str, rng: np.random.Generator) -> str:
    spots = list(re.finditer(r""" ([\w:]+)=["']([^"']*)["']""", text))
    one, other = (spots[int(i)] for i in rng.integers(len(spots), size=2))
    value = f' {one[1]}="{other[2]}"' if rng.random() < 0.6 else ""
    return text[: one.start()] + value + text[one.end() :]
