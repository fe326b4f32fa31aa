"""The check finds what is wrong with a network, and names it."""

from __future__ import annotations

import gzip
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from interplan_sumo.errors import MapError
from interplan_sumo.maps.check import MapReport, Spread, check_map
from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.store import MapFiles
from interplan_sumo.maps.to_sumo import convert
from interplan_sumo.world.roads import Roads
from tests.maps.road_worlds import GridPlan, grid_city


@pytest.fixture(scope="module")
def city() -> Roads:
    return grid_city(GridPlan(columns=3, rows=2, lanes=2))


@pytest.fixture(scope="module")
def good(city: Roads, tmp_path_factory: pytest.TempPathFactory) -> MapFiles:
    files = MapFiles("grid", "1.0", tmp_path_factory.mktemp("maps") / "grid" / "1.0")
    convert(city, files.folder)
    return files


def changed(good: MapFiles, folder: Path, change: Callable[[str], str]) -> MapFiles:
    """A copy of the network with another text."""
    files = MapFiles(good.name, good.version, folder)
    text = gzip.decompress(good.network.read_bytes()).decode()
    after = change(text)
    assert after != text
    files.network.write_bytes(gzip.compress(after.encode()))
    files.ids.write_bytes(good.ids.read_bytes())
    return files


def shifted(good: MapFiles, lane_id: str, by_m: float) -> Callable[[str], str]:
    """The first SUMO lane of a lane or connector, moved north."""
    sumo_lane = NetworkIds.read(good.ids).pieces[lane_id][0].sumo_lane

    def move(found: re.Match[str]) -> str:
        points = [point.split(",") for point in found[2].split()]
        return found[1] + " ".join(f"{x},{float(y) + by_m:.3f}" for x, y in points)

    return lambda text: re.sub(rf'(<lane id="{sumo_lane}"[^>]*shape=")([^"]*)', move, text)


def test_a_good_network_has_no_problems(good: MapFiles, city: Roads) -> None:
    report = check_map(good, city)
    assert report.ok
    assert report.lanes == len(city.lanes)
    assert report.connectors == len(city.connectors)
    assert report.lane_km == pytest.approx(sum(lane.centerline.length_m for lane in city.lanes.values()) / 1000)
    assert report.lights == 6
    assert report.light_connectors == report.light_connectors_covered > 0
    data = json.loads(json.dumps(report.as_json()))
    deviations = ("lane_deviation_m", "connector_deviation_m")
    assert {"ok", "lanes", "connectors", *deviations, "missing", "extra", "problems"} <= set(data)
    assert all(set(data[name]) == {"max", "p99"} for name in deviations)
    assert data["ok"] is True


@pytest.mark.parametrize("kind", ["lane", "connector"])
def test_six_centimetres_fail_and_four_do_not(kind: str, good: MapFiles, city: Roads, tmp_path: Path) -> None:
    lane_id = next(iter(city.lanes if kind == "lane" else city.connectors))

    def report(by_m: float) -> MapReport:
        return check_map(changed(good, tmp_path, shifted(good, lane_id, by_m)), city)

    assert report(0.04).ok
    failed = report(0.06)
    assert not failed.ok
    assert (failed.problems[0].kind, failed.problems[0].id) == ("deviation", lane_id)
    assert failed.problems[0].message.startswith("lies 0.06")


def of_first_lane(attribute: str, change: Callable[[str], str]) -> Callable[[str], str]:
    """An attribute of the first SUMO lane of the map, changed."""
    return lambda text: re.sub(rf'(<lane id="1_0"[^>]*{attribute}=")([^"]*)', lambda m: m[1] + change(m[2]), text)


def test_a_line_in_the_wrong_direction_is_far_off(good: MapFiles, city: Roads, tmp_path: Path) -> None:
    turn = of_first_lane("shape", lambda shape: " ".join(shape.split()[::-1]))
    assert check_map(changed(good, tmp_path, turn), city).lane_deviation_m.max > 10.0


def test_another_limit_is_named(good: MapFiles, city: Roads, tmp_path: Path) -> None:
    report = check_map(changed(good, tmp_path, of_first_lane(" speed", lambda _: "20.0")), city)
    (lane_id,) = report.wrong_limits
    assert NetworkIds.read(good.ids).pieces[lane_id][0].sumo_lane == "1_0"
    assert [(p.kind, p.id) for p in report.problems] == [("limit", lane_id)]


def test_a_missing_connector_is_named(good: MapFiles, city: Roads, tmp_path: Path) -> None:
    connector = next(iter(city.connectors))
    files = changed(good, tmp_path, lambda text: text.replace("<net", "<net ", 1))
    data = json.loads(good.ids.read_text())
    del data["pieces"][connector]
    data["links"].pop(connector, None)
    files.ids.write_text(json.dumps(data))
    report = check_map(files, city)
    assert report.missing == (connector,)
    assert len(report.extra) == 1, "the network's own way is now nobody's"


def test_a_connector_that_the_map_lacks_is_extra(good: MapFiles, city: Roads) -> None:
    gone = next(iter(city.connectors.values()))
    block = city.roadblocks[gone.roadblock_id]
    blocks = {**city.roadblocks, block.id: replace(block, lane_ids=tuple(i for i in block.lane_ids if i != gone.id))}
    less = replace(city, connectors={k: v for k, v in city.connectors.items() if k != gone.id}, roadblocks=blocks)
    report = check_map(good, less)
    assert len(report.extra) == 1
    assert not report.ok


def test_a_way_that_leads_to_another_lane_is_found(good: MapFiles, city: Roads, tmp_path: Path) -> None:
    def redirect(text: str) -> str:
        return re.sub(r'(<connection from="[^:"]+" to=")([^"]+)("[^>]*toLane=")0"', r'\g<1>\g<2>\g<3>1"', text, count=1)

    report = check_map(changed(good, tmp_path, redirect), city)
    assert report.extra
    assert not report.ok


def programs(change: Callable[[str], str]) -> Callable[[str], str]:
    """The states of all phases, changed."""
    return lambda text: re.sub(r'(<phase [^>]*state=")([^"]*)', lambda m: m[1] + change(m[2]), text)


def careless(text: str) -> str:
    return re.sub(r'response="[01]+"', lambda m: m[0].replace("1", "0"), programs(lambda s: "g" * len(s))(text))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (programs(lambda s: "G" * len(s)), "both show G and G"),
        (careless, "both show g and g"),
        (programs(lambda s: "r" * len(s)), "never gets green"),
        (programs(lambda s: s.replace("y", "r")), "from green to red without yellow"),
        (programs(lambda s: s.replace("G", "o", 1)), "letters other than"),
        (programs(lambda s: s[:-1]), "shorter than its links"),
        (lambda t: re.sub(r'(<phase duration=")[^"]*(" state="[^"]*y)', r"\g<1>1\g<2>", t), "1 s of yellow"),
        (lambda t: re.sub(r' tl="[^"]*" linkIndex="\d+"', "", t, count=1), "has the light None in the network"),
    ],
)
def test_senseless_lights_are_found(
    change: Callable[[str], str], message: str, good: MapFiles, city: Roads, tmp_path: Path
) -> None:
    assert any(message in p.message for p in check_map(changed(good, tmp_path, change), city).problems)


def test_the_wrong_driving_side_is_found(good: MapFiles, city: Roads) -> None:
    problems = check_map(good, replace(city, driving_side="left")).problems
    assert [p.kind for p in problems][:2] == ["driving_side", "driving_side"]


def test_broken_schema_rules_are_problems(good: MapFiles, city: Roads) -> None:
    lane = next(iter(city.lanes.values()))
    broken = replace(city, lanes={**city.lanes, lane.id: replace(lane, speed_limit_mps=-1.0)})
    assert any("speed limit of -1" in p.message for p in check_map(good, broken).problems)


# --- damaged files -----------------------------------------------------------------------------


def test_a_missing_network_says_how_to_make_one(good: MapFiles, city: Roads, tmp_path: Path) -> None:
    files = MapFiles("grid", "1.0", tmp_path)
    files.ids.write_bytes(good.ids.read_bytes())
    with pytest.raises(MapError, match=r"no network at .*maps convert"):
        check_map(files, city)


@pytest.mark.parametrize(
    "damage",
    [
        lambda data: data[: len(data) // 2],
        lambda _: b"",
        lambda _: b"not a network",
        lambda _: gzip.compress(b"<net><edge id='a'><lane"),
        lambda _: gzip.compress(b"<net/>"),
        lambda _: gzip.compress(b"<routes/>"),
        lambda _: gzip.compress(b'<!DOCTYPE n [<!ENTITY a "b">]><net version="1">&a;</net>'),
        lambda data: gzip.compress(gzip.decompress(data).replace(b' length="', b' size="')),
        lambda data: gzip.compress(gzip.decompress(data).replace(b' shape="', b' shape="x', 1)),
    ],
)
def test_a_damaged_network_is_one_clear_error(
    damage: Callable[[bytes], bytes], good: MapFiles, city: Roads, tmp_path: Path
) -> None:
    files = MapFiles("grid", "1.0", tmp_path)
    files.ids.write_bytes(good.ids.read_bytes())
    files.network.write_bytes(damage(good.network.read_bytes()))
    with pytest.raises(MapError, match=r"network .*map\.net\.xml\.gz is damaged") as caught:
        check_map(files, city)
    assert "\n" not in str(caught.value)


def test_spreads_are_the_largest_value_and_the_99th_percentile() -> None:
    assert Spread.of([]) == Spread(0.0, 0.0)
    assert Spread.of([float(k) for k in range(101)]) == Spread(100.0, 99.0)
