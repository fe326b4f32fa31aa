"""Weights and their cards: what is wrong with them in one clear line, and how those of the package do."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from dataclasses import asdict, replace
from math import inf
from pathlib import Path

import numpy as np
import pytest

from interplan_learned.card import Card, Graph, Port, read_card
from interplan_learned.network import OnnxNetwork, load_network, shipped_cards
from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.records import Row
from interplan_sumo.batch.run import run
from interplan_sumo.batch.run_folder import read_run
from interplan_sumo.errors import InputError
from interplan_sumo.features import schema
from interplan_sumo.world.files import file_hash

PORT = Port((2,), "float32")


def card(file: Path | None = None) -> Card:
    digest = file_hash(file) if file else "0"
    graph = Graph(file.name if file else "tiny.onnx", digest, {"x": PORT}, {"y": PORT})
    return Card(
        planner="tiny", what="twice its input", size="compact", parameters=1, options={},
        features_format=schema.FORMAT, graphs={"main": graph}, data={}, training={}, errors={}, versions={},
    )  # fmt: skip


@pytest.fixture
def doubling(tmp_path: Path) -> Path:
    """The card of a network that doubles its input."""
    pytest.importorskip("onnxruntime", reason="needs onnxruntime: pip install 'interplan-sumo[learned]'")
    onnx = pytest.importorskip("onnx", reason="needs onnx: pip install 'interplan-sumo[train]'")
    ports = [onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, ["n", 2]) for name in "xy"]
    graph = onnx.helper.make_graph([onnx.helper.make_node("Add", ["x", "x"], ["y"])], "tiny", ports[:1], ports[1:])
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=8)
    (tmp_path / "tiny.onnx").write_bytes(model.SerializeToString())
    card(tmp_path / "tiny.onnx").write(tmp_path / "tiny.json")
    return tmp_path / "tiny.json"


def test_a_card_comes_back_as_it_was_written(tmp_path: Path) -> None:
    card().write(tmp_path / "tiny.json")
    assert read_card(tmp_path / "tiny.json") == card()


def test_a_network_runs_batches_of_any_size_and_tells_of_itself(doubling: Path) -> None:
    network = load_network("tiny", str(doubling))
    for count in (1, 3):
        outputs = network.run({"x": np.arange(2.0 * count).reshape(count, 2)})
        np.testing.assert_array_equal(outputs["y"], 2.0 * np.arange(2.0 * count).reshape(count, 2))
    assert network.about["network"]["size"] == "compact"
    assert load_network("tiny", str(doubling.with_suffix(".onnx"))).card == network.card


def test_inputs_of_another_shape_or_name_are_refused(doubling: Path) -> None:
    network = OnnxNetwork(doubling)
    with pytest.raises(ValueError, match=r"was given x of shape \(3,\), its card says \(2,\)"):
        network.run({"x": np.zeros((1, 3))})
    with pytest.raises(ValueError, match=r"was given \['z'\], its card names \['x'\]"):
        network.run({"z": np.zeros((1, 2))})


def test_weights_that_there_are_not_say_how_to_train_them() -> None:
    with pytest.raises(InputError) as error:
        load_network("tiny", "tinier")
    assert "no weights 'tinier' for planner 'tiny'" in str(error.value)
    assert "python -m tools.train tiny" in str(error.value)
    with pytest.raises(InputError, match=r"no weights '.*nowhere.tiny\.json'"):
        load_network("tiny", "nowhere/tiny.onnx")


def test_a_missing_runtime_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    card().write(tmp_path / "tiny.json")
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(InputError) as error:
        load_network("tiny", str(tmp_path / "tiny.json"))
    assert str(error.value) == (
        "planner 'tiny' needs onnxruntime, which is not installed; run: pip install 'interplan-sumo[learned]'"
    )


def resealed(weights: Path) -> None:
    """No network, but the file that the card names."""
    weights.write_bytes(b"no network")
    card(weights).write(weights.with_suffix(".json"))


@pytest.mark.parametrize(("spoil", "planner", "message"), [
    (lambda _weights: None, "other", r"was trained for planner 'tiny', not for 'other'"),
    (lambda file: file.write_bytes(b"other"), "tiny", r"tiny\.onnx is not the file that tiny\.json describes"),
    (lambda file: file.unlink(), "tiny", r"cannot read the weights .*tiny\.onnx, which tiny\.json names"),
    (resealed, "tiny", r"onnxruntime cannot load .*tiny\.onnx"),
])  # fmt: skip
def test_weights_that_cannot_be_used_are_one_clear_line(
    doubling: Path, spoil: Callable[[Path], object], planner: str, message: str
) -> None:
    spoil(doubling.with_suffix(".onnx"))
    with pytest.raises(InputError, match=message) as error:
        load_network(planner, str(doubling))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("spoil", "message"), [
    (lambda _text: "{", "is damaged"), (lambda _text: "[]", "is no model card"),
    (lambda _text: '{"kind": "other"}', "is no model card"),
    (lambda text: text.replace('"dtype"', '"type"'), "is damaged: .*missing required field `dtype`"),
    (lambda text: text.replace('"parameters"', '"weights"'), "is damaged: .*missing required field `parameters`"),
    (
        lambda _text: json.dumps(asdict(replace(card(), features_format=0))),
        f"was trained with features of format 0, this version makes {schema.FORMAT}; train again",
    ),
    (
        lambda _text: json.dumps(asdict(replace(card(), format=99))),
        "was trained with cards of format 99, this version makes 1; train again",
    ),
])  # fmt: skip
def test_a_card_that_cannot_be_used_is_one_clear_line(
    tmp_path: Path, spoil: Callable[[str], str], message: str
) -> None:
    path = tmp_path / "tiny.json"
    card().write(path)
    path.write_text(spoil(path.read_text(encoding="utf-8")), encoding="utf-8")
    with pytest.raises(InputError, match=message) as error:
        read_card(path)
    assert "\n" not in str(error.value)


PLANNERS = ("dtpp", "flow_drive", "gameformer", "gc_pgp", "pdm_hybrid", "pdm_open", "urban_driver")
CARDS = ("dtpp", "flow_drive", "gameformer", "gc_pgp", "pdm_offset", "pdm_open", "urban_driver")
AS_PUBLISHED = ("pdm_offset", "pdm_open")
LARGEST_BYTES = 3_000_000
PLAIN = tuple(
    f"{family}/[0-3]"
    for family in ("following_lane_with_lead", "high_magnitude_speed", "behind_long_vehicle", "changing_lane")
)
"""Sixteen scenes on roads where nothing but driving is asked for."""
PLAIN_S = 15.0


@pytest.fixture(params=CARDS)
def shipped(request: pytest.FixtureRequest) -> Card:
    return read_card(shipped_cards()[request.param])


def test_the_files_are_those_of_the_card_small_in_the_present_schema_and_called_what_they_are(shipped: Card) -> None:
    folder = shipped_cards()[shipped.planner].parent
    for graph in shipped.graphs.values():
        assert file_hash(folder / graph.file) == graph.sha256
    assert sum((folder / graph.file).stat().st_size for graph in shipped.graphs.values()) < LARGEST_BYTES
    assert shipped.features_format == schema.FORMAT
    assert shipped.size == ("published" if shipped.planner in AS_PUBLISHED else "compact")


def test_all_learned_from_the_same_samples_and_beat_constant_velocity_on_new_roads(
    shipped: Card,
) -> None:
    cards = shipped_cards()
    assert sorted(cards) == sorted(CARDS)
    assert {read_card(path).data["hash"] for path in cards.values()} == {shipped.data["hash"]}
    assert shipped.data["samples"]["train"] >= 100_000
    for split in ("val", "test"):
        errors = shipped.errors[split]
        assert errors["samples"] > 500
        for error in ("ade", "fde_3_s", "fde_8_s"):
            assert errors["network"][error] < 0.8 * errors["constant_velocity"][error], (split, error)


@pytest.mark.nightly
@pytest.mark.parametrize("planner", PLANNERS)
def test_on_plain_roads_most_drives_stay_on_the_road_for_fifteen_seconds(planner: str, tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime", reason="needs onnxruntime: the extra [learned]")
    run(RunOptions((planner,), tmp_path / "run", suite="common==1", scenarios=PLAIN, workers=0))
    rows = read_run(tmp_path / "run").rows.values()
    assert len(rows) == 16
    assert all(row.fault is None for row in rows)
    assert sum(_left_road_s(row) > PLAIN_S for row in rows) > len(rows) / 2


def _left_road_s(row: Row) -> float:
    """When the ego left the drivable area, as the reason says: "... at 4.2 s; ..."; infinite if it never did."""
    found = row.metrics["drivable_area"]
    if found.score == 1.0:
        return inf
    when = re.search(r" at (\d+\.\d) s\b", found.reason or "")
    assert when is not None, found.reason
    return float(when[1])
