"""Networks at the wheel: trained weights found by name, checked against their card, run with onnxruntime."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from interplan_learned.card import Card, Graph, read_card
from interplan_sumo.errors import InputError
from interplan_sumo.extras import library
from interplan_sumo.world.files import file_hash

Arrays = Mapping[str, NDArray[Any]]
MAIN: Final = "main"


class OnnxNetwork:
    """The graphs of one card. Runs on one thread of the processor: equal inputs give equal outputs."""

    def __init__(self, path: Path) -> None:
        """`path` is a card. InputError if it or its files cannot be used or onnxruntime is missing."""
        self.card: Card = read_card(path)
        runtime = library("onnxruntime", f"planner {self.card.planner!r}", "learned")
        self._sessions = {
            name: _session(runtime, path.parent / graph.file, graph, path) for name, graph in self.card.graphs.items()
        }

    def run(self, inputs: Arrays, graph: str = MAIN) -> dict[str, NDArray[Any]]:
        """Outputs by name, from inputs of any number of samples; ValueError where a shape is not the card's."""
        about = self.card.graphs[graph]
        if inputs.keys() != about.inputs.keys():
            raise ValueError(f"{self.card.planner} was given {sorted(inputs)}, its card names {sorted(about.inputs)}")
        for name, port in about.inputs.items():
            shape = inputs[name].shape[1:]
            if shape != port.shape:
                raise ValueError(f"{self.card.planner} was given {name} of shape {shape}, its card says {port.shape}")
        fed = {name: np.ascontiguousarray(inputs[name], dtype=port.dtype) for name, port in about.inputs.items()}
        names = list(about.outputs)
        return dict(zip(names, self._sessions[graph].run(names, fed), strict=True))

    @property
    def about(self) -> dict[str, Any]:
        """What results should tell of the network that drove: a planner's `report()`."""
        card = self.card
        return {
            "network": {
                "size": card.size,
                "parameters": card.parameters,
                "options": dict(card.options),
                "sha256": {name: graph.sha256 for name, graph in card.graphs.items()},
            }
        }


def shipped_cards() -> dict[str, Path]:
    """The cards of the networks that come with the package, by name; each lies beside its planner."""
    return {path.stem: path for path in sorted(Path(__file__).parent.glob("*/*.json"))}


def load_network(planner: str, weights: str, driver: str | None = None) -> OnnxNetwork:
    """The network of a planner: `weights` is a name of shipped ones, or a path to a card or to the .onnx beside it.

    `planner` is what the card names, `driver` the planner that uses it, where it has another name.

    InputError if there are none, if they are another planner's, or onnxruntime is missing.
    """
    named = Path(weights)
    is_path = named.suffix in (".json", ".onnx") or len(named.parts) > 1
    shipped = shipped_cards()
    path = named.with_suffix(".json") if is_path else shipped.get(weights)
    if path is None or not path.is_file():
        come = f"shipped are {', '.join(sorted(shipped))}" if shipped else "none are shipped"
        raise InputError(
            f"no weights {str(path) if is_path else weights!r} for planner {planner!r} ({come}). "
            f"Train them in a checkout: python -m tools.train {planner} --data DATA --out FOLDER, "
            f"then drive with {driver or planner}?weights=FOLDER/{planner}.json"
        )
    network = OnnxNetwork(path)
    if network.card.planner != planner:
        raise InputError(f"{path} was trained for planner {network.card.planner!r}, not for {planner!r}")
    return network


def _session(runtime: Any, file: Path, graph: Graph, card: Path) -> Any:
    try:
        digest = file_hash(file)
    except OSError as error:
        raise InputError(
            f"cannot read the weights {file}, which {card.name} names: {error.strerror or error}; train again"
        ) from None
    if digest != graph.sha256:
        raise InputError(f"{file} is not the file that {card.name} describes: its hash differs; train again")
    options = runtime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.execution_mode = runtime.ExecutionMode.ORT_SEQUENTIAL
    options.use_deterministic_compute = True
    options.log_severity_level = 3  # errors only
    try:
        return runtime.InferenceSession(str(file), options, providers=["CPUExecutionProvider"])
    except Exception as error:
        raise InputError(f"onnxruntime cannot load {file}: {' '.join(str(error).split())}") from None
