"""Damaged files of every map format become a valid map or one clear line, soon and within little memory."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.mutated_maps import Outcome, outcome
from tests.maps.mutations import bases, mutant
from tests.quick import few


@pytest.mark.parametrize("seeds", few([1, 60], 0, 0))
def test_mutants_of_every_format_are_imported_or_refused(seeds: int, tmp_path: Path) -> None:
    kinds: set[str] = set()
    for format, files in bases(tmp_path / "bases").items():
        assert outcome(files[0], format, tmp_path / "made").kind == "valid"
        for seed in range(seeds):
            how = mutant(files[0], tmp_path / files[0].name, np.random.default_rng(seed))
            got: Outcome = outcome(tmp_path / files[0].name, format, tmp_path / "made")
            assert not got.is_fault, f"{format}, seed {seed}, {how}: {got}"
            kinds.add(got.kind)
    assert kinds == {"valid", "refused"}
