"""What of a vehicle-type file acts here, what does not, and what its drivers do in standard situations."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from interplan_sumo.errors import InputError, TrafficError, VehicleTypeError
from interplan_sumo.extras import need_matplotlib
from interplan_sumo.simulation.standard_situations import SITUATIONS, Answer, answer
from interplan_sumo.simulation.vehicle_type_effects import Idle, idle_attributes
from interplan_sumo.simulation.vehicle_types import VehicleType, VehicleTypes, read_vehicle_types

if TYPE_CHECKING:
    from rich.table import Table

_NAMING = frozenset("id probability".split())
"""Attributes of a vType that are about the file, not about a vehicle."""


@dataclass(frozen=True, slots=True, eq=False)
class TypeCheck:
    """One vType."""

    driver: VehicleType
    """At the medians, where distributions stand for its numbers."""
    acts: tuple[str, ...]
    """Its attributes and parameters that can act here."""
    idle: tuple[Idle, ...]
    drawn: dict[str, str]
    """Those that are drawn for each vehicle, as the file has them."""
    answers: dict[str, Answer]
    """By situation."""


@dataclass(frozen=True, slots=True, eq=False)
class TrafficCheck:
    """A vehicle-type file."""

    path: Path
    warnings: tuple[str, ...]
    types: tuple[TypeCheck, ...]


def check_traffic(path: Path) -> TrafficCheck:
    """Read a file, and drive its types. VehicleTypeError if it cannot be used, also if only SUMO finds out."""
    types = read_vehicle_types(path)
    drivers = (*types.members, *types.others)
    return TrafficCheck(path, types.warnings, tuple(_check(types, driver) for driver in drivers))


def _check(types: VehicleTypes, driver: VehicleType) -> TypeCheck:
    element = types.elements[driver.id]
    idle = tuple(idle_attributes(element.attributes, element.model, element.parameters))
    names = {each.attribute for each in idle} | _NAMING
    given = {**element.attributes, **element.parameters}
    answers: dict[str, Answer] = {}
    for situation in SITUATIONS:
        try:
            answers[situation.name] = answer(situation, types, driver)
        except TrafficError as error:
            raise VehicleTypeError(
                f"{types.path}: vType {driver.id!r} cannot drive ({situation.name}): {error}"
            ) from None
    return TypeCheck(
        driver,
        tuple(name for name in given if name not in names),
        idle,
        {name: given[name] for name in element.spreads},
        answers,
    )


def check_json(check: TrafficCheck) -> dict[str, Any]:
    """As one document."""
    return {
        "file": str(check.path),
        "warnings": list(check.warnings),
        "types": [
            {
                "id": each.driver.id,
                "car_following_model": each.driver.car_following_model,
                "acts": list(each.acts),
                "cannot_act": [{"attribute": idle.attribute, "reason": idle.reason} for idle in each.idle],
                "drawn": each.drawn,
                "situations": {name: _row(found) for name, found in each.answers.items()},
            }
            for each in check.types
        ],
    }


def _row(found: Answer) -> dict[str, float | None]:
    return {
        "reaction_s": _rounded(found.reaction_s),
        "hardest_braking_mps2": _rounded(found.hardest_mps2),
        "least_gap_m": _rounded(found.least_gap_m),
        "recovery_s": _rounded(found.recovery_s),
    }


def _rounded(value: float | None) -> float | None:
    return None if value is None or not isfinite(value) else round(value, 3)


def check_tables(check: TrafficCheck) -> Iterable[Table | str]:
    """For people."""
    from rich.markup import escape
    from rich.table import Table as Grid
    from rich.text import Text

    for each in check.types:
        columns = ("situation", "reacts after [s]", "hardest braking [m/s2]", "least gap [m]", "recovers after [s]")
        grid = Grid(*map(escape, columns))
        for name, found in each.answers.items():
            row = _row(found)
            grid.add_row(name, *("-" if value is None else f"{value:.1f}" for value in row.values()))
        yield Text.assemble((each.driver.id, "bold"), f", carFollowModel {each.driver.car_following_model}").markup
        yield Text(f"acts: {', '.join(each.acts) or 'nothing but defaults'}").markup
        if each.drawn:
            drawn = ", ".join(f"{name} {text}" for name, text in each.drawn.items())
            yield Text(f"drawn per vehicle, and at the median below: {drawn}").markup
        yield grid
    for line in check.warnings:
        yield Text(line).markup
    yield Text("; ".join(f"{each.name}: {each.description}" for each in SITUATIONS)).markup


def plot_check(check: TrafficCheck, path: Path) -> None:
    """Speed and gap over time, a row per situation; InputError without matplotlib, or where it cannot be written."""
    need_matplotlib()
    from matplotlib.figure import Figure

    shown = [each for each in SITUATIONS if any(each.name in one.answers for one in check.types)]
    figure = Figure(figsize=(11, 2.4 * len(shown)), layout="constrained")
    axes: Any = figure.subplots(len(shown), 2, squeeze=False, sharex=True)
    for (speeds, gaps), situation in zip(axes, shown, strict=True):
        for number, each in enumerate(check.types):
            found, colour = each.answers[situation.name], f"C{number % 10}"
            if not number:
                speeds.plot(found.time_s, found.ego_mps[: len(found.time_s)], color="0.6", label="ego")
            speeds.plot(found.time_s, found.speed_mps, color=colour, label=each.driver.id)
            gaps.plot(found.time_s, found.gap_m, color=colour, label=each.driver.id)
        for axis in (speeds, gaps):
            axis.axvline(situation.at_s, color="0.85", linewidth=1.0)
        speeds.set(ylabel="speed [m/s]", title=situation.name)
        gaps.set(ylabel="gap to the ego [m]", title=situation.description)
        gaps.title.set_fontsize(7)
    axes[0][0].legend(fontsize=7)
    for axis in axes[-1]:
        axis.set(xlabel="time [s]")
    try:
        figure.savefig(path, dpi=110)
    except (OSError, ValueError) as error:
        raise InputError(f"cannot write {path}: {error}") from None
