"""How background drivers answer to the ego: `python -m benchmarks.behaviour [--merges N] [--workers N] [--plot FILE]`.

First, the standard situations (following, standstill, cut-in, merge, oncoming, junction) for every shipped type and
ten car-following models: time to the first response, hardest braking, least gap, time to recover. Second, the dial: the
same random merges (straight, curved, left-hand, over connectors) for five values each of interplan.reactOverlap,
reactionTime and courtesy. The share that yields, the time to the first response and the hardest braking must be
monotone in each, and of those with courtesy 1 and reactionTime 0.8 at most 5 % of the merges with a gap above 12 m may
force more than 6 m/s2. Exits 1 if not.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from interplan_sumo.maps.store import maps
from interplan_sumo.resources import routes_root
from interplan_sumo.simulation.standard_situations import SITUATIONS, Answer, answer
from interplan_sumo.simulation.vehicle_types import VehicleType, VehicleTypes, read_vehicle_types, vehicle_type_file
from tests.simulation.fuzz_drivers import MODELS
from tests.simulation.merges import Merge, Outcome, Site, SiteKind, measured, sites

KINDS: tuple[SiteKind, ...] = ("straight", "curved", "connector")
DIALS: dict[str, tuple[float, ...]] = {
    "reactOverlap": (0.0, 0.25, 0.5, 0.75, 1.0),
    "reactionTime": (0.0, 0.4, 0.8, 1.4, 2.0),
    "courtesy": (0.0, 0.25, 0.5, 0.75, 1.0),
}
RISING = {"reactOverlap": True, "reactionTime": True, "courtesy": False}
"""Whether a driver answers later and harder, and fewer yield, the higher the value."""
SLACK_S, SLACK_MPS2, SLACK_SHARE = 0.02, 0.05, 0.005
"""What counts as equal between neighbouring values of a dial."""
BESIDE: dict[str, dict[str, float]] = {"reactOverlap": {}, "reactionTime": {}, "courtesy": {"reactOverlap": 1.0}}
"""What else is set: courtesy is for those who would not react by themselves before the ego has merged."""
GENTLE: dict[str, float] = {"courtesy": 1.0, "reactionTime": 0.8}
GAP_M, FORCED_MPS2, MOST_FORCED = 12.0, 6.0, 0.05


@dataclass(frozen=True, slots=True)
class Driver:
    """A type of a file, under the name that it has in tables."""

    name: str
    file: Path
    type_id: str

    def read(self) -> tuple[VehicleTypes, VehicleType]:
        types = read_vehicle_types(self.file)
        return types, next(each for each in types.members if each.id == self.type_id)


def drivers(folder: Path) -> list[Driver]:
    """Every shipped type once, and the conservative one with ten other car-following models."""
    found: dict[str, Driver] = {}
    for file in sorted(routes_root().glob("*.xml")):
        for each in read_vehicle_types(file).members:
            name = file.stem if each.id == "traffic" else each.id
            if file.stem == "interplan_code":
                name = f"interplan_code {each.id}"
            found.setdefault(name, Driver(name, file, each.id))
    text = vehicle_type_file("conservative").read_text()
    for model in MODELS:
        file = folder / f"{model}.xml"
        file.write_text(text.replace('carFollowModel="IDM"', f'carFollowModel="{model}"'))
        found[model] = Driver(model, file, "traffic")
    return list(found.values())


def answers_of(driver: Driver) -> dict[str, Answer]:
    types, kind = driver.read()
    return {situation.name: answer(situation, types, kind) for situation in SITUATIONS}


def dialled(folder: Path, **values: float) -> Path:
    """The conservative drivers with other values of our keys."""
    kept = [
        line
        for line in vehicle_type_file("conservative").read_text().splitlines()
        if not any(f'key="interplan.{key}"' in line for key in values)
    ]
    lines = "".join(f'<param key="interplan.{key}" value="{value:g}"/>' for key, value in values.items())
    name = "_".join(f"{key}{value:g}" for key, value in values.items())
    path = folder / f"dial_{name}.xml"
    path.write_text("\n".join(kept).replace("</vType>", f"{lines}</vType>"))
    return path


def random_merges(count: int) -> list[Merge]:
    """Merges of 5 to 7 s on random sites, in front of, beside and just behind the follower's front."""
    rng = np.random.default_rng(0)
    pools: list[list[Site]] = [found for name in maps() for kind in KINDS if (found := sites(name, kind))]
    merges: list[Merge] = []
    for number in range(count):
        pool = pools[int(rng.integers(len(pools)))]
        merges.append(
            Merge(
                pool[int(rng.integers(len(pool)))],
                gap_m=float(rng.uniform(2.0, 30.0)),
                duration_s=float(rng.uniform(5.0, 7.0)),
                ego_mps=float(rng.uniform(6.0, 8.0)),
                follower_mps=float(rng.uniform(8.0, 11.0)),
                from_left=bool(rng.random() < 0.5),
                chance_seed=number,
            )
        )
    return merges


def merged(merge: Merge, files: tuple[Path, ...]) -> list[Outcome]:
    """The same merge before drivers of several files, which differ in our keys only."""
    blind, found = None, list[Outcome]()
    for file in files:
        outcome, blind = measured(merge, read_vehicle_types(file), blind)
        found.append(outcome)
    return found


@dataclass(frozen=True, slots=True)
class DialRow:
    """What a value of a dial comes to over all merges; times and brakings over those answered at every value."""

    value: float
    yields: float
    """Share of followers that have reacted and are still behind the ego at the end."""
    response_s: float
    hardest_mps2: float


def dial_rows(values: tuple[float, ...], outcomes: list[list[Outcome]]) -> list[DialRow]:
    """`outcomes` hold, per merge, one for each value."""
    answered = [row for row in outcomes if all(each.reaction_s is not None for each in row)]
    rows: list[DialRow] = []
    for i, value in enumerate(values):
        yields = float(np.mean([row[i].reaction_s is not None and row[i].stays_behind for row in outcomes]))
        times = [row[i].reaction_s or 0.0 for row in answered]
        hardest = [row[i].hardest_mps2 for row in answered]
        rows.append(DialRow(value, yields, float(np.mean(times)), float(np.mean(hardest))))
    return rows


def monotone(rows: list[DialRow], *, rising: bool) -> list[str]:
    """What is not, in words."""
    sign = 1.0 if rising else -1.0
    faults: list[str] = []
    for a, b in pairwise(rows):
        between = f"between {a.value:g} and {b.value:g}"
        if sign * (b.yields - a.yields) > SLACK_SHARE:
            faults.append(f"the share that yields {between}: {a.yields:.3f}, {b.yields:.3f}")
        if sign * (b.response_s - a.response_s) < -SLACK_S:
            faults.append(f"the time to the first response {between}: {a.response_s:.2f}, {b.response_s:.2f} s")
        if sign * (b.hardest_mps2 - a.hardest_mps2) < -SLACK_MPS2:
            faults.append(f"the hardest braking {between}: {a.hardest_mps2:.2f}, {b.hardest_mps2:.2f} m/s2")
    first, last = rows[0], rows[-1]
    if not sign * (last.response_s - first.response_s) > SLACK_S:
        faults.append("the dial does nothing from its one end to the other")
    return faults


def forced(outcomes: list[Outcome], merges: list[Merge]) -> float:
    """Share of the merges with a gap above 12 m that force more than 6 m/s2."""
    of = [each.hardest_mps2 > FORCED_MPS2 for each, merge in zip(outcomes, merges, strict=True) if merge.gap_m > GAP_M]
    return float(np.mean(of)) if of else 0.0


def _text(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def situations_table(found: dict[str, dict[str, Answer]]) -> Table:
    """Per driver and situation: response, hardest braking, least gap, recovery."""
    table = Table("driver", *(f"{each.name}" for each in SITUATIONS))
    for name, answers in found.items():
        cells = [
            f"{_text(a.reaction_s, '.1f')} s  {a.hardest_mps2:.1f}  {a.least_gap_m:.1f} m  "
            f"{_text(a.recovery_s, '.1f')} s"
            for a in answers.values()
        ]
        table.add_row(name, *cells)
    return table


def plot(path: Path, found: dict[str, dict[str, Answer]], dials: dict[str, list[DialRow]]) -> None:
    """Needs the extra `plots`."""
    import matplotlib.pyplot as plt

    shown = ("conservative", "assertive", "truck", "Krauss", "EIDM", "ACC", "W99")
    figure: Any
    axes: Any
    figure, axes = plt.subplots(3, 3, figsize=(13, 10), layout="constrained")
    for axis, situation in zip(axes.flat, SITUATIONS, strict=False):
        mine = {name: found[name][situation.name] for name in shown if name in found}
        for name, each in mine.items():
            axis.plot(each.time_s, each.speed_mps, label=name, linewidth=1.2)
        ego = next(iter(mine.values()))
        axis.plot(ego.time_s, ego.ego_mps, "k--", linewidth=1.0, label="ego")
        axis.axvline(situation.at_s, color="0.8", linewidth=1.0, zorder=0)
        axis.set(title=situation.name.replace("_", "-"), xlabel="time [s]", ylabel="speed [m/s]")
    axes[0, 0].legend(fontsize=7)
    for axis, (key, rows) in zip(axes[2], dials.items(), strict=False):
        values = [row.value for row in rows]
        axis.plot(values, [row.yields for row in rows], "o-", color="C2", label="share that yields")
        axis.set(xlabel=f"interplan.{key}", ylim=(0.0, 1.02), ylabel="share that yields")
        other = axis.twinx()
        other.plot(values, [row.response_s for row in rows], "s-", color="C0", label="first response [s]")
        other.plot(values, [row.hardest_mps2 for row in rows], "^-", color="C3", label="hardest braking [m/s²]")
        other.set_ylim(bottom=0.0)
        if key == "reactOverlap":
            lines = [*axis.lines, *other.lines]
            axis.legend(lines, [line.get_label() for line in lines], fontsize=7, loc="center right")
    figure.savefig(path, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--merges", type=int, default=500)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--plot", type=Path, help="write a figure there")
    options = parser.parse_args()
    console = Console(width=220)
    faults: list[str] = []
    dials: dict[str, list[DialRow]] = {}
    with (
        TemporaryDirectory() as place,
        ProcessPoolExecutor(options.workers, mp_context=get_context("spawn")) as pool,
    ):
        folder = Path(place)
        known = drivers(folder)
        found = dict(zip((each.name for each in known), pool.map(answers_of, known), strict=True))
        console.print("First response, hardest braking [m/s2], least gap, recovery.", situations_table(found))
        for situation in SITUATIONS:
            console.print(f"{situation.name}: {situation.description}")
        merges = random_merges(options.merges)
        for key, values in DIALS.items():
            files = tuple(dialled(folder, **BESIDE[key], **{key: value}) for value in values)
            rows = dials[key] = dial_rows(values, list(pool.map(partial(merged, files=files), merges, chunksize=8)))
            table = Table(key, "share that yields", "first response [s]", "hardest braking [m/s2]")
            for row in rows:
                table.add_row(f"{row.value:g}", f"{row.yields:.3f}", f"{row.response_s:.2f}", f"{row.hardest_mps2:.2f}")
            console.print(f"The same {len(merges)} random merges for each value.", table)
            faults += [f"{key}: {fault}" for fault in monotone(rows, rising=RISING[key])]
        gentle = list(pool.map(partial(merged, files=(dialled(folder, **GENTLE),)), merges, chunksize=8))
        share = forced([row[0] for row in gentle], merges)
    console.print(f"Courtesy 1, reactionTime 0.8: {share:.1%} of merges with a gap above 12 m force more than 6 m/s2.")
    if share > MOST_FORCED:
        faults.append(f"{share:.1%} of gentle drivers are forced to brake hard, at most 5 % may be")
    if options.plot is not None:
        plot(options.plot, found, dials)
    for fault in faults:
        console.print(f"[red]{fault}[/red]")
    sys.exit(int(bool(faults)))


if __name__ == "__main__":
    main()
