"""A few steps of training on one batch: whether a network learns at all."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def losses_of(model: Any, loss: Callable[[float], Any], *, steps: int, learning_rate: float) -> list[float]:
    """The loss before each step; `loss` is given the share of the steps that is done. Needs torch."""
    import torch

    rule = torch.optim.AdamW(model.parameters(), lr=learning_rate)
    found: list[float] = []
    for step in range(steps):
        rule.zero_grad()
        value = loss(step / steps)
        value.backward()
        rule.step()
        found.append(float(value.detach()))
    return found
