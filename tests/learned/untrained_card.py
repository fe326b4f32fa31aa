"""Networks that have learned nothing, written as a training writes them: planners must drive with those too."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from interplan_learned.card import Card
from interplan_sumo.features import schema
from tools.train.recipe import Batch, Recipe


def write_untrained(recipe: Recipe, model: Any, batch: Batch, folder: Path) -> Path:
    """The card of a network, written beside its graphs, which holds ONNX against torch; skips without the extras."""
    pytest.importorskip("onnx", reason="needs onnx: pip install 'interplan-sumo[train]'")
    pytest.importorskip("onnxruntime", reason="needs onnxruntime: pip install 'interplan-sumo[learned]'")
    from tools.train.onnx_export import export_graphs

    card = Card(
        planner=recipe.planner, what=recipe.what, size=recipe.size, parameters=1, options=recipe.options,
        features_format=schema.FORMAT, graphs=export_graphs(recipe.graphs(model, batch), folder, recipe.planner),
        data={}, training={}, errors={}, versions={},
    )  # fmt: skip
    card.write(folder / f"{recipe.planner}.json")
    return folder / f"{recipe.planner}.json"
