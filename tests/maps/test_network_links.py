"""The summary of a network file that checks work with."""

from __future__ import annotations

import time
from pathlib import Path

from interplan_sumo.maps.network_links import read_network_summary
from tests.maps.sumo_nets import by_hand, lane, written


def test_a_large_network_is_read_in_linear_time(tmp_path: Path) -> None:
    """A chain of lanes, and one of eight times as many."""

    def cpu_s(count: int) -> float:
        edges = [f'<edge id="{n}" from="n{n}" to="n{n + 1}">{lane(f"{n}_0", "0,0 9,0")}</edge>' for n in range(count)]
        nodes = [
            f'<junction id="n{n + 1}" type="priority" x="0" y="0" incLanes="{n}_0" intLanes=""/>' for n in range(count)
        ]
        ways = [
            f'<connection from="{n}" to="{n + 1}" fromLane="0" toLane="0" dir="s" state="M"/>' for n in range(count - 1)
        ]
        path = written(tmp_path, by_hand(*edges, *nodes, *ways))
        start_s = time.process_time()
        assert len(read_network_summary(path).links) == count - 1
        return time.process_time() - start_s

    assert cpu_s(8000) < 16.0 * cpu_s(1000)
