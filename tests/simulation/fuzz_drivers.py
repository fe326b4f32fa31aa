"""Drivers of fuzz cases: a shipped vehicle-type file, or one with another car-following model and other reactions."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

ROUTES = Path(__file__).parents[2] / "routes"
STEADY = "sigma=0"
MODELS = ("Krauss", "KraussOrig1", "PWagner2009", "KraussX", "IDMM", "EIDM", "ACC", "CACC", "W99", "Wiedemann")
DAWDLING = ("Krauss", "KraussX", "KraussOrig1")
"""They dawdle by chance: in every other case only, for where they do no twin tells a reaction either."""
PARAMETERS: Mapping[str, tuple[float, ...]] = {
    "reactOverlap": (0.0, 0.5, 1.0), "anticipation": (0.0, 0.0, 1.0, 3.0), "reactionTime": (0.0, 0.0, 0.8),
    "courtesy": (0.0, 0.0, 1.0), "relaxation": (0.0, 0.0, 10.0),
}  # fmt: skip


def drivers_of(path: Path, rng: np.random.Generator, only: str | None, *, dawdle: bool) -> tuple[Path, str]:
    """A vehicle-type file: a shipped one, or one at `path` with another car-following model and other reactions.

    `only` names the file that has every kind of vehicle, where the scene places some.
    """
    shipped = sorted(ROUTES.glob("*.xml"))
    base = shipped[int(rng.integers(len(shipped)))] if only is None else ROUTES / f"{only}.xml"
    if rng.random() < 0.45:
        return base, base.stem
    text = base.read_text()
    words = [base.stem]
    if rng.random() < 0.7:
        model = str(rng.choice(MODELS))
        steady = model in DAWDLING and not dawdle
        text = text.replace('carFollowModel="IDM"', f'carFollowModel="{model}"' + ' sigma="0"' * steady)
        words += [model, STEADY] if steady else [model]
    for key, values in PARAMETERS.items():
        value = float(rng.choice(values))
        if rng.random() < 0.5:
            text = _with_parameter(text, key, value)
            words.append(f"{key}={value:g}")
    path.write_text(text)
    return path, " ".join(words)


def _with_parameter(text: str, key: str, value: float) -> str:
    """Every type with a parameter of ours at a value."""
    kept = [line for line in text.splitlines() if f'key="interplan.{key}"' not in line]
    text = "\n".join(kept) + "\n"
    return text.replace("</vType>", f'<param key="interplan.{key}" value="{value:g}"/></vType>')
