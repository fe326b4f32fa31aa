"""At which overlap followers react to a merging ego on the shipped maps: straight, curved, left-hand, on connectors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from merges import Merge, SiteKind, measured, sites

from interplan_sumo.simulation.vehicle_types import VehicleTypes, read_vehicle_types, vehicle_type_file

STEP_OF_OVERLAP = 0.03
"""The overlap grows by at most this in a step: 1.5 lane widths in 8 s, 0.066 m of the ego's 2.297 m."""


def dial(folder: Path, threshold: float) -> VehicleTypes:
    path = folder / "dial.xml"
    text = vehicle_type_file("conservative").read_text()
    key = '"interplan.reactOverlap" value='
    path.write_text(text.replace(f'{key}"0"', f'{key}"{threshold}"'))
    return read_vehicle_types(path)


@pytest.mark.parametrize(
    ("name", "kind"),
    [("strip", "straight"), ("hazelwood", "curved"), ("back_bay", "connector"),  # driving on the right
     ("one_north", "straight"), ("one_north", "curved"), ("one_north", "connector")],  # on the left
)  # fmt: skip
@pytest.mark.parametrize(("threshold", "low", "high"), [(0.0, 0.0, 0.0), (0.5, 0.5, 0.5), (1.0, 0.98, 1.0)])
def test_a_follower_reacts_within_a_step_of_its_threshold(
    name: str, kind: SiteKind, threshold: float, low: float, high: float, tmp_path: Path
) -> None:
    # Slow enough for half an overlap's place in time, but not so slow that the ego leads for 2 s before it is fully in.
    duration_s = 6.0 if threshold == 1.0 else 8.0
    outcome, _ = measured(Merge(sites(name, kind)[0], 28.0, duration_s), dial(tmp_path, threshold))
    assert outcome.overlap is not None
    assert low - 0.01 <= outcome.overlap <= high + STEP_OF_OVERLAP


def test_a_lower_threshold_is_a_gentler_reaction(tmp_path: Path) -> None:
    site = sites("strip", "straight")[0]
    outcomes = [measured(Merge(site, 28.0), dial(tmp_path, threshold))[0] for threshold in (0.0, 0.5, 1.0)]
    assert (np.diff([o.reaction_s for o in outcomes if o.reaction_s is not None]) > 0.0).all()
    assert (np.diff([o.least_gap_m for o in outcomes]) < 0.0).all()
    assert outcomes[0].hardest_mps2 < outcomes[2].hardest_mps2
