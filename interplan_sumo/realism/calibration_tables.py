"""A calibration for people: what was fitted, how much the recordings told of it, and the error on what was left out."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from interplan_sumo.realism.calibration import NAMES, UNITS, Calibration
from interplan_sumo.realism.driver_population import QUALITIES
from interplan_sumo.realism.features import BY_KEY

if TYPE_CHECKING:
    from rich.table import Table


def calibration_tables(found: Calibration) -> Iterator[Table]:
    """The drivers, and the places left out where there are several."""
    from rich.table import Table

    drawn, told, drivers = found.drawn(), found.told, len(found.drivers.drivers)
    table = Table(title=f"{drivers} drivers of {len(found.recordings)} recordings, and the types drawn from them")
    for name in ("", "p5", "p50", "p95", "", "told by"):
        table.add_column(name, justify="left" if not name else "right")
    for at, name in enumerate(QUALITIES):
        values = (f"{value:.2f}" for value in np.percentile(drawn[:, at], [5, 50, 95]))
        table.add_row(NAMES[name], *values, UNITS[name], f"{told[name]}" if name in told else "-")
    table.caption = (
        f"spacing error of a driver's own type, median over episodes: {np.median(found.rmse_m):.2f} m; "
        "told by: drivers whose own record tells the parameter"
    )
    yield table
    if found.seen.recorded:
        yield _as_seen(found)
    if found.held_out.places:
        yield _left_out(found)


def _as_seen(found: Calibration) -> Table:
    from rich.table import Table

    table = Table(title="Plain traffic of these drivers, seen as the recordings see theirs")
    for name in ("", "", "recorded", "as fitted", "as moved", "moves"):
        table.add_column(name, justify="right" if name.startswith(("rec", "as")) else "left")
    for each, recorded in found.seen.recorded.items():
        feature = BY_KEY[each.feature]
        values = (f"{value:.2f}" for value in (recorded, found.seen.before[each], found.seen.after[each]))
        table.add_row(f"{feature.title}, {feature.unit}", f"p{100.0 * each.share:.0f}", *values, NAMES[each.quality])
    return table


def _left_out(found: Calibration) -> Table:
    from rich.table import Table

    table = Table(title="Each place left out of the fit in turn: spacing error in m, median over episodes")
    for name in ("place", "drivers", "own type", "ahead of its fit", "median type", "KS (places apart)"):
        table.add_column(name, justify="left" if name == "place" else "right")
    between = found.held_out.between
    for each in found.held_out.places:
        errors = (each.own_rmse_m, each.ahead_rmse_m, each.anybody_rmse_m)
        apart = (
            f"{name} {value:.2f} ({between[name]:.2f})" if name in between else f"{name} {value:.2f}"
            for name, value in each.distances.items()
        )
        table.add_row(
            each.place,
            str(each.drivers),
            *(f"{error:.2f}" if np.isfinite(error) else "-" for error in errors),
            "\n".join(apart) or "-",
        )
    return table
