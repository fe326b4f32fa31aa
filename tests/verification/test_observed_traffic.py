"""Who else was there in a drive, as the search for another drive sees it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from stages import ONE_LANE, staged
from worlds import cars, drive_through

from interplan_sumo.verification.corridor import frenet_corridor
from interplan_sumo.verification.observed_traffic import recording
from interplan_sumo.world.trace import ActorTable


def test_after_the_last_frame_all_go_on_as_they_did_and_who_stands_from_the_start_is_left_out() -> None:
    heading_rad = 0.1
    frames = [cars((60.0 + k, 0.1 * k, 10.0, heading_rad), (90.0, 0.0)) for k in range(3)]
    trace = replace(drive_through(np.zeros((3, 3)), np.zeros(3)), actors=ActorTable.of(frames, {"car00": "mixed"}))
    found = recording(frenet_corridor(staged(), ONE_LANE), trace, 6)
    assert found.behaviour.tolist() == ["mixed"]
    later_s = 0.1 * np.arange(1.0, 4.0)
    along_mps, across_mps = 10.0 * np.cos(heading_rad), 10.0 * np.sin(heading_rad)
    assert found.near_m[0, 3:] == pytest.approx(found.near_m[0, 2] + along_mps * later_s)
    assert found.left_m[0, 3:] == pytest.approx(found.left_m[0, 2] + across_mps * later_s)
    assert found.along_mps[0] == pytest.approx(along_mps)
