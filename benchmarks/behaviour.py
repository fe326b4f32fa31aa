"""How background drivers react to a merging ego: `python -m benchmarks.behaviour [--merges 200] [--plot FILE]`.

First, merges of 6 s in front of a follower at several gaps, per behaviour: when it reacts, at which overlap, how hard
it brakes, how near it comes. Second, the dial: the same random merges (straight, curved, left-hand, over connectors)
for five values of interplan.reactOverlap: the mean overlap at the reaction and the share of followers that yield
must rise and fall with it. Exits 1 if they do not.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from interplan_sumo.maps.store import maps
from interplan_sumo.simulation.vehicle_types import VehicleTypes, read_vehicle_types, vehicle_type_file
from tests.simulation.merges import Merge, Outcome, Site, SiteKind, measured, sites

GAPS_M = (15.0, 20.0, 25.0, 35.0, 45.0)
DIAL = (0.0, 0.25, 0.5, 0.75, 1.0)
KINDS: tuple[SiteKind, ...] = ("straight", "curved", "connector")


def dial(folder: Path, threshold: float) -> VehicleTypes:
    """The conservative drivers with another threshold."""
    path = folder / f"dial_{threshold:g}.xml"
    key = '"interplan.reactOverlap" value='
    path.write_text(vehicle_type_file("conservative").read_text().replace(f'{key}"0"', f'{key}"{threshold}"'))
    return read_vehicle_types(path)


def random_merges(count: int) -> list[Merge]:
    """Merges of 5 to 8 s on random sites, in front of, beside and just behind the follower's front."""
    rng = np.random.default_rng(0)
    pools: list[list[Site]] = [found for name in maps() for kind in KINDS if (found := sites(name, kind))]
    merges: list[Merge] = []
    for _ in range(count):
        pool = pools[int(rng.integers(len(pools)))]
        merges.append(
            Merge(
                pool[int(rng.integers(len(pool)))],
                gap_m=float(rng.uniform(2.0, 30.0)),
                duration_s=float(rng.uniform(5.0, 7.0)),
                ego_mps=float(rng.uniform(6.0, 8.0)),
                follower_mps=float(rng.uniform(8.0, 11.0)),
                from_left=bool(rng.random() < 0.5),
            )
        )
    return merges


def _text(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def staged(console: Console) -> dict[str, list[Outcome]]:
    table = Table(
        "behaviour", "gap [m]", "reacts after [s]", "at overlap", "hardest braking [m/s2]", "least gap [m]", "yields"
    )
    site = sites("strip", "straight")[0]
    rows: dict[str, list[Outcome]] = {}
    for behaviour in ("conservative", "assertive"):
        for gap_m in GAPS_M:
            outcome, _ = measured(Merge(site, gap_m), read_vehicle_types(vehicle_type_file(behaviour)))
            rows.setdefault(behaviour, []).append(outcome)
            table.add_row(
                behaviour, f"{gap_m:g}", _text(outcome.reaction_s, ".1f"), _text(outcome.overlap, ".2f"),
                f"{outcome.hardest_mps2:.2f}", f"{outcome.least_gap_m:.1f}", "yes" if outcome.stays_behind else "no",
            )  # fmt: skip
    console.print("Ego at 8 m/s slides into the lane of a follower at 10 m/s within 6 s, on a straight road.", table)
    return rows


def swept(console: Console, merges: list[Merge]) -> list[list[Outcome]]:
    """Outcomes per dial value, for all merges."""
    results: list[list[Outcome]] = [[] for _ in DIAL]
    with TemporaryDirectory() as folder:
        types = [dial(Path(folder), threshold) for threshold in DIAL]
        for merge in merges:
            blind = None
            for outcomes, kind in zip(results, types, strict=True):
                outcome, blind = measured(merge, kind, blind)
                outcomes.append(outcome)
    table = Table("reactOverlap", "reactions", "mean overlap at reaction", "share that yields", "mean hardest [m/s2]")
    for threshold, outcomes in zip(DIAL, results, strict=True):
        hardest = np.mean([o.hardest_mps2 for o in outcomes])
        table.add_row(
            f"{threshold:g}", str(sum(o.overlap is not None for o in outcomes)), f"{mean_overlap(outcomes):.3f}",
            f"{share_yielding(outcomes):.3f}", f"{hardest:.2f}",
        )  # fmt: skip
    console.print(f"The same {len(merges)} random merges for each value of the dial.", table)
    return results


def mean_overlap(outcomes: list[Outcome]) -> float:
    return float(np.mean([o.overlap for o in outcomes if o.overlap is not None]))


def share_yielding(outcomes: list[Outcome]) -> float:
    """Followers that have reacted and are still behind the ego at the end."""
    return float(np.mean([o.overlap is not None and o.stays_behind for o in outcomes]))


def monotone(results: list[list[Outcome]]) -> bool:
    overlaps, shares = [mean_overlap(r) for r in results], [share_yielding(r) for r in results]
    return bool((np.diff(overlaps) > 0.0).all() and (np.diff(shares) <= 0.0).all() and shares[-1] < shares[0])


def plot(path: Path, rows: dict[str, list[Outcome]], results: list[list[Outcome]]) -> None:
    """Needs the extra `plots`."""
    import matplotlib.pyplot as plt

    figure: Any
    axes: Any
    figure, axes = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    for behaviour, outcomes in rows.items():
        axes[0].plot(GAPS_M, [o.hardest_mps2 for o in outcomes], "o-", label=behaviour)
        axes[1].plot(GAPS_M, [o.least_gap_m for o in outcomes], "o-", label=behaviour)
    axes[0].set(xlabel="gap when the merge begins [m]", ylabel="hardest braking [m/s²]")
    axes[1].set(xlabel="gap when the merge begins [m]", ylabel="least gap [m]")
    axes[0].legend()
    axes[2].plot(DIAL, [mean_overlap(r) for r in results], "o-", label="mean overlap at reaction")
    axes[2].plot(DIAL, [share_yielding(r) for r in results], "s-", label="share that yields")
    axes[2].set(xlabel="interplan.reactOverlap")
    axes[2].legend()
    figure.savefig(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--merges", type=int, default=200)
    parser.add_argument("--plot", type=Path, help="write a figure there")
    options = parser.parse_args()
    console = Console(width=120)
    rows = staged(console)
    results = swept(console, random_merges(options.merges))
    if options.plot is not None:
        plot(options.plot, rows, results)
    if not monotone(results):
        console.print("[red]The dial is not monotone.[/red]")
        sys.exit(1)


if __name__ == "__main__":
    main()
