"""Map files of every format, and mutants of them: damage of the kinds that broken tools, disks and hands do."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from interplan_sumo.maps.geopackage_writer import write_map
from tests.maps import argoverse_files, commonroad_files, lanelet2_files, opendrive_files, osm_files, sumo_nets
from tests.maps.damaged import mutated
from tests.maps.map_files import mutate
from tests.maps.road_worlds import GridPlan, grid_city

REAL_AT_MOST_BYTES = 80_000
"""Larger ones of the real files make no base: most mutants are to be quick."""
_REAL = {
    "commonroad": "commonroad",
    "lanelet2": "lanelet2",
    "opendrive": "opendrive",
    "osm": "osm",
    "sumo": "sumo_nets",
}
_NUMBERS = (
    b"1e308", b"-1e308", b"1e30", b"nan", b"-inf", b"", b"-1", b"0", b"1e-320", b"99999999999999999999", b"1e7",
    b"0x10", b"1,5", b"\xd9\xa3", b"--", b"1e999999999", b"true", b"123456.75",
)  # fmt: skip
_JSON_VALUES = (
    b"1e308", b"-1e308", b"1e30", b"NaN", b"-Infinity", b"null", b"-1", b"0", b"1e-320", b"99999999999999999999",
    b"1e7", b"true", b"[]", b"{}", b'""', b'"x"', b"123456.75", b'"7"',
)  # fmt: skip
_NUMBER = re.compile(rb"(?<![\w.])-?[0-9]+(?:\.[0-9]+)?(?:e-?[0-9]+)?(?![\w.])")
_ELEMENT = re.compile(rb"<(\w+)\b[^<>]*(?:/>|>[^<>]*</\1>)")


def bases(folder: Path, real: Path | None = None) -> dict[str, list[Path]]:
    """By format: small files, written into `folder`, and those of a folder of real data that are small enough."""
    folder.mkdir(parents=True, exist_ok=True)
    street = argoverse_files.written(argoverse_files.street(), folder)
    lane, place = commonroad_files.lanelet, commonroad_files.location("EPSG:32632", (690_000.0, 5_335_000.0))
    common = commonroad_files.scenario(place, lane(1), lane(2, (100.0, 0.0)), commonroad_files.sign(7, "274", "13.9"))
    gpkg = folder / "map.gpkg"
    write_map(grid_city(GridPlan(columns=2, rows=2, lanes=1, spacing_m=50.0)), gpkg)
    found = {
        "argoverse2": [street],
        "commonroad": [commonroad_files.written(folder, common)],
        "lanelet2": [lanelet2_files.crossing().write(folder / "lanelets.osm")],
        "nuplan": [gpkg],
        "opendrive": [opendrive_files.written(folder, opendrive_files.xodr(opendrive_files.crossing()))],
        "osm": [osm_files.written(folder, osm_files.osm(osm_files.crossing()))],
        "sumo": [sumo_nets.crossroads(folder, "traffic_light")],
    }
    for format, name in _REAL.items():
        files = sorted((real / name).iterdir()) if real and (real / name).is_dir() else ()
        found[format] += [file for file in files if file.stat().st_size <= REAL_AT_MOST_BYTES]
    return found


def mutant(base: Path, target: Path, rng: np.random.Generator) -> str:
    """Write a damaged copy of a base; says how it was damaged."""
    content = base.read_bytes()
    if base.suffix == ".gpkg":
        target.write_bytes(content)
        return mutate(target, rng)
    ways = (*_ANY, *_JSON) if _is_json(content) else (*_ANY, *_XML)
    way = ways[int(rng.integers(len(ways)))]
    for _ in range(int(rng.integers(1, 4)) if way in _OFTEN else 1):
        content = way(content, rng) if content else content
    target.write_bytes(content)
    return way.__name__.strip("_")


def _is_json(content: bytes) -> bool:
    return content.lstrip().startswith(b"{")


def _span(content: bytes, rng: np.random.Generator, longest: int = 2000) -> tuple[int, int]:
    start = int(rng.integers(len(content)))
    return start, min(start + int(rng.integers(1, longest)), len(content))


def _bytes_flipped(content: bytes, rng: np.random.Generator) -> bytes:
    changed = bytearray(content)
    for place in rng.integers(len(changed), size=int(rng.integers(1, 8))):
        changed[place] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def _deleted(content: bytes, rng: np.random.Generator) -> bytes:
    start, end = _span(content, rng)
    return content[:start] + content[end:]


def _doubled(content: bytes, rng: np.random.Generator) -> bytes:
    start, end = _span(content, rng)
    return content[:end] + content[start:]


def _truncated(content: bytes, rng: np.random.Generator) -> bytes:
    return content[: int(rng.integers(len(content)))]


def _encoded(content: bytes, rng: np.random.Generator) -> bytes:
    text = content.decode("utf-8", "replace")
    declared = re.sub(r'encoding="[^"]*"', 'encoding="utf-16"', text)
    one_of = (
        text.encode("utf-16"), text.encode("utf-16-le"), text.encode("utf-32"), text.encode("utf-8-sig"),
        declared.encode("utf-8"), text.replace("a", "ä").encode("latin-1", "replace"), text.encode("cp037", "replace"),
        text.replace(" ", "\0", 3).encode(), text.replace("\n", "\r").encode(),
    )  # fmt: skip
    return one_of[int(rng.integers(len(one_of)))]


def _numbers_changed(content: bytes, rng: np.random.Generator) -> bytes:
    spots = list(_NUMBER.finditer(content))
    pool = _JSON_VALUES if _is_json(content) and rng.random() < 0.9 else _NUMBERS
    for spot in sorted(rng.choice(len(spots), size=min(len(spots), int(rng.integers(1, 5)))).tolist(), reverse=True):
        start, end = spots[spot].span()
        content = content[:start] + pool[int(rng.integers(len(pool)))] + content[end:]
    return content


def _numbers_swapped(content: bytes, rng: np.random.Generator) -> bytes:
    spots = list(_NUMBER.finditer(content))
    one, other = sorted(int(spot) for spot in rng.integers(len(spots), size=2))
    (a, b), (c, d) = spots[one].span(), spots[other].span()
    return content if one == other else content[:a] + content[c:d] + content[b:c] + content[a:b] + content[d:]


def _grown(content: bytes, rng: np.random.Generator) -> bytes:
    """A value of many megabytes."""
    spots = list(_NUMBER.finditer(content))
    start, end = spots[int(rng.integers(len(spots)))].span()
    piece = (b"7", b"0.5 1.5,", b"x", b"1,2 ")[int(rng.integers(4))]
    return content[:start] + piece * (int(rng.choice((100_000, 8_000_000))) // len(piece)) + content[end:]


def _deep(content: bytes, rng: np.random.Generator) -> bytes:
    """Something wrapped many thousand times."""
    depth = int(rng.choice((200, 5_000, 200_000)))
    if _is_json(content):
        spots = list(_NUMBER.finditer(content))
        start, end = spots[int(rng.integers(len(spots)))].span()
        return content[:start] + b"[" * depth + content[start:end] + b"]" * depth + content[end:]
    start, end, name = _element(content, rng)
    return content[:start] + b"<%b>" % name * depth + content[start:end] + b"</%b>" % name * depth + content[end:]


def _element(content: bytes, rng: np.random.Generator) -> tuple[int, int, bytes]:
    spots = list(_ELEMENT.finditer(content))
    if not spots:
        return 0, len(content), b"a"
    spot = spots[int(rng.integers(len(spots)))]
    return *spot.span(), spot[1]


def _repeated(content: bytes, rng: np.random.Generator) -> bytes:
    start, end, _ = _element(content, rng)
    return content[:end] + content[start:end] * int(rng.choice((1, 30, 2_000))) + content[end:]


def _moved(content: bytes, rng: np.random.Generator) -> bytes:
    """An element into another place."""
    start, end, _ = _element(content, rng)
    piece, rest = content[start:end], content[:start] + content[end:]
    at, _, _ = _element(rest, rng)
    return rest[:at] + piece + rest[at:]


def _as_text(content: bytes, rng: np.random.Generator) -> bytes:
    """A value, an element or an attribute, changed as `damaged.mutated` does."""
    try:
        return mutated(content.decode("utf-8", "replace"), rng)
    except ValueError:  # nothing is left to change
        return content


_Way = Callable[[bytes, np.random.Generator], bytes]
_OFTEN: Sequence[_Way] = (_bytes_flipped, _deleted, _doubled, _numbers_changed, _numbers_swapped)
_ANY: Sequence[_Way] = (
    *_OFTEN, _numbers_changed, _numbers_changed, _numbers_swapped, _truncated, _encoded, _grown, _deep,
)  # fmt: skip
_JSON: Sequence[_Way] = (_numbers_changed, _numbers_changed, _numbers_swapped)
_XML: Sequence[_Way] = (_repeated, _moved, _as_text, _as_text, _as_text)
