"""Does a driver of a vehicle-type file drive into another in plain SUMO? `python -m benchmarks.plain_overlaps FILE...`.

Minutes of dense traffic on the shipped maps until there are so many agent-seconds; nothing of ours acts. Exits 1 if one
drove into another. Who scrapes along somebody that stands aslant where lanes fork is counted apart: SUMO does not know
that its rear is still in the lane it has left, whatever the drivers.
"""

from __future__ import annotations

import argparse
from itertools import count
from pathlib import Path

from interplan_sumo.maps.store import find_map
from interplan_sumo.realism.plain_traffic import traffic_on
from interplan_sumo.simulation.network import read_network
from interplan_sumo.simulation.vehicle_types import read_vehicle_types, vehicle_type_file
from tests.realism.overlapping import overlaps

MAPS = ("back_bay", "hazelwood", "one_north", "strip")
LANE_RATE_HZ = 0.2
"""Denser than the traffic that is compared with recordings."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", help="a vehicle-type file, or the name of a shipped one")
    parser.add_argument("--agent-seconds", type=float, default=200_000.0)
    options = parser.parse_args()
    bad = 0
    for name in options.files:
        types = read_vehicle_types(Path(name) if Path(name).exists() else vehicle_type_file(name))
        agent_s, behind, aslant = 0.0, 0, 0
        for seed, map in ((seed, map) for seed in count() for map in MAPS):
            found = overlaps(
                traffic_on(read_network(find_map(map).network), types, name, seed, lane_rate_hz=LANE_RATE_HZ)
            )
            agent_s, behind, aslant = agent_s + found.agent_s, behind + len(found.behind), aslant + len(found.aslant)
            if agent_s >= options.agent_seconds:
                break
        print(
            f"{name}: {agent_s:.0f} agent-s, {behind} drove into another, {aslant} scraped along one that stood aslant",
            flush=True,
        )
        bad += behind
    return int(bad > 0)


if __name__ == "__main__":
    raise SystemExit(main())
