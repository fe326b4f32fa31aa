"""From torch to ONNX: written, stored in half precision where nothing is lost, and held against torch."""

from __future__ import annotations

import io
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from torch import Tensor, nn

from interplan_learned.card import Graph, Port
from interplan_learned.network import MAIN
from interplan_sumo.errors import InterplanError
from interplan_sumo.extras import library
from interplan_sumo.world.files import file_hash
from tools.train.recipe import GraphCall

AGREE: Final = 1e-4
"""Largest difference between ONNX and torch, relative to values above 1."""
_OPSET: Final = 17
_SMALL: Final = 1024
"""Tables with fewer numbers stay as they are."""


def round_to_half(model: nn.Module) -> None:
    """Round the weights to what float16 can hold, in place: they then fit into half the bytes without a loss."""
    with torch.no_grad():
        for weights in model.parameters():
            weights.copy_(weights.half().float())


def export_graphs(calls: Mapping[str, GraphCall], folder: Path, name: str) -> dict[str, Graph]:
    """Write `<name>.onnx` (or `<name>.<graph>.onnx`, if there are several graphs) into a folder.

    Numbers that float16 holds exactly are stored in it. InterplanError if
    onnxruntime and torch differ by more than `AGREE` on the example arguments.
    """
    folder.mkdir(parents=True, exist_ok=True)
    graphs: dict[str, Graph] = {}
    for graph, call in calls.items():
        file = folder / (f"{name}.onnx" if graph == MAIN else f"{name}.{graph}.onnx")
        file.write_bytes(_onnx(call))
        wanted = _called(call)
        difference = _difference(file, call, wanted)
        if not difference <= AGREE:
            raise InterplanError(f"{file} differs from torch by {difference:.2g}, more than {AGREE:g}")
        graphs[graph] = Graph(
            file.name,
            file_hash(file),
            {key: _port(value) for key, value in call.arguments.items()},
            {key: _port(value) for key, value in zip(call.outputs, wanted, strict=True)},
        )
    return graphs


def _onnx(call: GraphCall) -> bytes:
    onnx = library("onnx", "training", "train")
    text = io.BytesIO()
    module = call.module.eval().cpu()
    names = [*call.arguments, *call.outputs]
    with warnings.catch_warnings():  # of torch about its own exporter, and of constants in shapes
        warnings.simplefilter("ignore")
        torch.onnx.export(
            module,
            tuple(value.cpu() for value in call.arguments.values()),
            text,  # type: ignore[arg-type]  # a file is as good as a path
            input_names=list(call.arguments),
            output_names=list(call.outputs),
            dynamic_axes={name: {0: "samples"} for name in names},
            opset_version=_OPSET,
            dynamo=False,  # the other exporter needs onnxscript
        )
    model = onnx.load_from_string(text.getvalue())
    _halve(onnx, model)
    onnx.checker.check_model(model)
    return model.SerializeToString()


def _halve(onnx: Any, model: Any) -> None:
    """Store what float16 holds exactly in it; it is made float32 again when the network is loaded."""
    casts: list[Any] = []
    for held in list(model.graph.initializer):
        values = onnx.numpy_helper.to_array(held)
        if values.dtype != np.float32 or values.size < _SMALL:
            continue
        with np.errstate(over="ignore"):
            half = values.astype(np.float16)
        if np.array_equal(half.astype(np.float32), values):
            name = f"{held.name}.half"
            casts.append(onnx.helper.make_node("Cast", [name], [held.name], to=onnx.TensorProto.FLOAT))
            held.CopyFrom(onnx.numpy_helper.from_array(half, name))
    for cast in reversed(casts):
        model.graph.node.insert(0, cast)


def _called(call: GraphCall) -> tuple[Tensor, ...]:
    with torch.no_grad():
        found = call.module.eval().cpu()(*(value.cpu() for value in call.arguments.values()))
    return found if isinstance(found, tuple) else (found,)


def _difference(file: Path, call: GraphCall, wanted: tuple[Tensor, ...]) -> float:
    runtime = library("onnxruntime", "training", "learned")
    options = runtime.SessionOptions()
    options.log_severity_level = 3
    session = runtime.InferenceSession(str(file), options, providers=["CPUExecutionProvider"])
    found = session.run(list(call.outputs), {name: value.cpu().numpy() for name, value in call.arguments.items()})
    return max(
        float(np.max(np.abs(one - other) / np.maximum(np.abs(other), 1.0), initial=0.0))
        for one, other in zip(found, (each.numpy().astype(np.float64) for each in wanted), strict=True)
    )


def _port(value: Tensor) -> Port:
    return Port(tuple(value.shape[1:]), str(value.dtype).removeprefix("torch."))
