"""The id map: places go both ways, damage is named."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from interplan_sumo.errors import MapError
from interplan_sumo.maps.network import NetworkIds, SumoPiece


def small_ids() -> NetworkIds:
    """Lane 1 cut in two with the internal lane of the cut between, then connector 9 under a light."""
    return NetworkIds(
        origin_m=(331000.0, 4690000.5),
        driving_side="left",
        pieces={
            "1": (SumoPiece("1.0_0", 0.0, 40.0), SumoPiece(":1.1_0_0", 40.0, 40.0), SumoPiece("1.1_0", 40.0, 100.0)),
            "9": (SumoPiece(":J_0_0", 0.0, 6.5), SumoPiece(":J_4_0", 6.5, 15.0)),
        },
        links={"9": ("J", 3)},
    )


def test_a_place_on_a_cut_lane_is_found_on_the_right_sumo_lane() -> None:
    ids = small_ids()
    assert ids.sumo_place("1", 10.0) == ("1.0_0", 0.25)
    assert ids.sumo_place("1", 40.0) == ("1.1_0", 0.0)
    assert ids.sumo_place("1", 70.0) == ("1.1_0", 0.5)
    assert ids.sumo_place("9", 6.4999)[0] == ":J_0_0"


def test_arc_lengths_beyond_the_ends_are_clamped() -> None:
    ids = small_ids()
    assert ids.sumo_place("1", -5.0) == ("1.0_0", 0.0)
    assert ids.sumo_place("1", 1e6) == ("1.1_0", 1.0)


def test_the_internal_lane_of_a_cut_maps_to_the_cut() -> None:
    assert small_ids().sources[":1.1_0_0"] == ("1", 40.0, 40.0)


@given(st.sampled_from(["1", "9"]), st.floats(0.0, 1.0))
def test_places_survive_the_way_to_sumo_and_back(lane_id: str, share: float) -> None:
    ids = small_ids()
    arc_m = share * ids.pieces[lane_id][-1].end_m
    sumo_lane, fraction = ids.sumo_place(lane_id, arc_m)
    back_id, start_m, end_m = ids.sources[sumo_lane]
    assert back_id == lane_id
    assert start_m + fraction * (end_m - start_m) == pytest.approx(arc_m, abs=1e-9)


def test_ids_survive_the_disk_and_equal_ids_give_equal_bytes(tmp_path: Path) -> None:
    ids = small_ids()
    ids.write(tmp_path / "a.json")
    again = NetworkIds.read(tmp_path / "a.json")
    again.write(tmp_path / "b.json")
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()
    assert again.pieces == ids.pieces
    assert again.links == ids.links
    assert again.origin_m == ids.origin_m
    assert again.driving_side == "left"


def test_a_missing_file_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(MapError, match="maps convert"):
        NetworkIds.read(tmp_path / "ids.json")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.update(format=2), "format 2"),
        (lambda d: d.pop("pieces"), "missing required field `pieces`"),
        (lambda d: d.update(origin_m=[1.0]), "damaged"),
        (lambda d: d.update(origin_m=[1.0, "x"]), "Expected `float`, got `str`"),
        (lambda d: d.update(driving_side="middle"), "driving_side"),
        (lambda d: d["pieces"].update({"1": []}), "lane 1"),
        (lambda d: d["pieces"]["1"].pop(1) and d["pieces"]["1"].pop(0), "lane 1"),
        (lambda d: d["pieces"]["1"][0].__setitem__(2, 30.0), "gap after SUMO lane 1.0_0"),
        (lambda d: d["pieces"]["9"][1].__setitem__(0, "1.0_0"), "follows both"),
        (lambda d: d["pieces"]["9"][1].__setitem__(2, float("nan")), "invalid character"),
        (lambda d: d["links"].update({"8": ["J", 0]}), "connector 8 has no SUMO lanes"),
        (lambda d: d["links"].update({"9": ["J", -1]}), "Expected `int` >= 0"),
        (lambda d: d.update(pieces=[1, 2]), "damaged"),
    ],
)
def test_damage_is_named(tmp_path: Path, change: object, message: str) -> None:
    path = tmp_path / "ids.json"
    small_ids().write(path)
    data = json.loads(path.read_text())
    change(data)  # type: ignore[operator]
    path.write_text(json.dumps(data))
    with pytest.raises(MapError, match=message):
        NetworkIds.read(path)


@pytest.mark.parametrize("text", ["", "{", "[]", "\x00\xff", '{"format": 1}'])
def test_a_truncated_or_foreign_file_is_one_clear_error(tmp_path: Path, text: str) -> None:
    path = tmp_path / "ids.json"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(MapError, match=r"ids\.json is damaged"):
        NetworkIds.read(path)
