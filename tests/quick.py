"""What runs in a hurry: of many cases that show one behaviour a few; more of them for every change, all at night."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest

from interplan_sumo.maps.store import maps


def few(cases: Iterable[Any], quick: int, often: int = 1) -> list[Any]:
    """Cases for `parametrize`: the first so many as they are, up to `often` marked as slow, others as nightly."""
    return [
        _case(case) if number < quick else slow(case) if number < often else nightly(case)
        for number, case in enumerate(cases)
    ]


def slow(case: Any) -> Any:
    """A case of `parametrize`, marked as slow."""
    return _case(case, marks=pytest.mark.slow)


def nightly(case: Any) -> Any:
    """A case of `parametrize`, marked as nightly."""
    return _case(case, marks=pytest.mark.nightly)


def _case(case: Any, **how: Any) -> Any:
    return pytest.param(*(case if isinstance(case, tuple) else (case,)), **how)


DISTRICTS = few(sorted(maps(), key=lambda name: (name not in ("back_bay", "queenstown"), name)), 2)
"""Of all that ship, one with traffic on the right and one with traffic on the left come first."""
