"""The weights that come with the package: what their cards say, and how they do on roads like those they learned on."""

from __future__ import annotations

from math import inf
from pathlib import Path

import pytest

from interplan_learned.card import Card, read_card
from interplan_learned.network import SHIPPED
from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.records import Row
from interplan_sumo.batch.run import run
from interplan_sumo.batch.run_folder import read_run
from interplan_sumo.features import schema
from interplan_sumo.world.files import file_hash

PLANNERS = ("dtpp", "gameformer", "gc_pgp", "pdm_hybrid", "pdm_open", "urban_driver")
CARDS = ("dtpp", "gameformer", "gc_pgp", "pdm_offset", "pdm_open", "urban_driver")
AS_PUBLISHED = ("pdm_offset", "pdm_open")
LARGEST_BYTES = 3_000_000
PLAIN = ("following_lane_with_lead/*", "high_magnitude_speed/*", "behind_long_vehicle/*", "changing_lane/*")
"""Sixteen scenes on roads where nothing but driving is asked for."""
PLAIN_S = 15.0


@pytest.fixture(params=CARDS)
def card(request: pytest.FixtureRequest) -> Card:
    return read_card(SHIPPED / f"{request.param}.json")


def test_the_files_are_those_of_the_card_small_in_the_present_schema_and_called_what_they_are(card: Card) -> None:
    for graph in card.graphs.values():
        assert file_hash(SHIPPED / graph.file) == graph.sha256
    assert sum((SHIPPED / graph.file).stat().st_size for graph in card.graphs.values()) < LARGEST_BYTES
    assert card.features_format == schema.FORMAT
    assert card.size == ("published" if card.planner in AS_PUBLISHED else "compact")


def test_all_learned_from_the_same_samples_and_beat_constant_velocity_on_new_traffic_and_a_new_map(card: Card) -> None:
    assert sorted(path.stem for path in SHIPPED.glob("*.json")) == sorted(CARDS)
    assert card.data["hash"] == read_card(SHIPPED / "pdm_open.json").data["hash"]
    assert card.data["samples"]["train"] >= 20_000
    for split in ("val", "test"):
        errors = card.errors[split]
        assert errors["samples"] > 500
        for error in ("ade", "fde_3_s", "fde_8_s"):
            assert errors["network"][error] < 0.8 * errors["constant_velocity"][error], (split, error)


@pytest.mark.slow
@pytest.mark.parametrize("planner", PLANNERS)
def test_on_plain_roads_most_drives_stay_on_the_road_for_fifteen_seconds(planner: str, tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime", reason="needs onnxruntime: the extra [learned]")
    run(RunOptions((planner,), tmp_path / "run", suite="common==1", scenarios=PLAIN, workers=0))
    rows = read_run(tmp_path / "run").rows.values()
    assert len(rows) == 16
    assert all(row.fault is None for row in rows)
    assert sum(_left_road_s(row) > PLAIN_S for row in rows) > len(rows) / 2


def _left_road_s(row: Row) -> float:
    """When the ego left the drivable area, as the reason says: "... at 4.2 s"; infinite if it never did."""
    found = row.metrics["drivable_area"]
    return inf if found.score == 1.0 else float((found.reason or "").rsplit(" at ", 1)[1].removesuffix(" s"))
