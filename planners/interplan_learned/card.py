"""Model cards: what a network is, what it was trained on and how well it does, in a JSON file beside its weights."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, Literal

import msgspec

from interplan_sumo.errors import InputError
from interplan_sumo.features import schema

FORMAT: Final = 1
Size = Literal["compact", "published"]
SIZES: Final = ("compact", "published")


@dataclass(frozen=True, slots=True)
class Port:
    """An input or output of a network."""

    shape: tuple[int, ...]
    """Of one sample, without the axis of the batch."""
    dtype: str


@dataclass(frozen=True, slots=True)
class Graph:
    """One ONNX file. Most planners have one, named `main`; more where numpy works between them."""

    file: str
    sha256: str
    inputs: Mapping[str, Port]
    outputs: Mapping[str, Port]


@dataclass(frozen=True, slots=True, kw_only=True)
class Card:
    """All that is known of a trained network."""

    planner: str
    what: str
    size: Size
    """`published`: with the numbers of the paper; `compact`: the same method with a smaller network."""
    parameters: int
    options: Mapping[str, Any]
    """What the training was told of the network and its inputs; the planner builds its inputs with the same."""
    features_format: int
    """`schema.FORMAT` of the data."""
    graphs: Mapping[str, Graph]
    data: Mapping[str, Any]
    """Hash of the data set, samples per split."""
    training: Mapping[str, Any]
    """Epochs, seed, date and the like."""
    errors: Mapping[str, Any]
    """Per split: open-loop errors of the network and of constant velocity on the same samples."""
    versions: Mapping[str, str]
    format: int = FORMAT

    def write(self, path: Path) -> None:
        path.write_text(json.dumps(asdict(self), indent=2, ensure_ascii=False) + "\n", encoding="utf-8", newline="\n")


def read_card(path: Path) -> Card:
    """A card; InputError if it is none, damaged, or of another version than this package."""
    try:
        plain = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read the model card {path}: {error.strerror or error}") from None
    except ValueError as error:
        raise InputError(f"the model card {path} is damaged: {error}; train again or reinstall") from None
    if not isinstance(plain, dict) or "planner" not in plain:
        raise InputError(f"{path} is no model card; give the .json file that the training wrote")
    for key, held, wanted in (
        ("format", "cards", FORMAT),
        ("features_format", "features", schema.FORMAT),
    ):
        if plain.get(key) != wanted:
            raise InputError(
                f"{path} was trained with {held} of format {plain.get(key)}, this version makes {wanted}; train again"
            )
    try:
        return msgspec.convert(plain, Card)
    except msgspec.ValidationError as error:
        raise InputError(f"the model card {path} is damaged: {error}; train again") from None
