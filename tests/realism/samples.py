"""Makers of samples of a feature."""

from __future__ import annotations

from hypothesis import strategies as st

from interplan_sumo.realism.distances import Sample

NUMBERS = st.floats(-100.0, 100.0).map(lambda x: round(x, 3))
SAMPLES = st.lists(st.lists(NUMBERS, min_size=1, max_size=4), min_size=1, max_size=5).map(Sample.of)


def each_once(*values: float) -> Sample:
    """A value of each of several road users."""
    return Sample.of([value] for value in values)
