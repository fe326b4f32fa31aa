"""interPlan's own configuration: scenario names, and what its modification details say about them.

A name is a token of nuPlan and modifications, `feb82815b92a5512-dhgloc`: pairs
of a letter and a value, in any order. `s<n>` is the n-th hand-made scenario of
its token, which may bring letters of its own instead.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Literal, cast

from interplan_sumo.errors import ScenarioError
from interplan_sumo.scenario.scenario import Behaviour, Density

GoalSide = Literal["left", "right", "straight"]
DENSITY: Final[dict[str, Density]] = {"l": "low", "m": "medium", "h": "high"}
GOAL: Final[dict[str, GoalSide]] = {"l": "left", "r": "right", "s": "straight"}
POLICY: Final[dict[str, Behaviour]] = {"a": "assertive", "c": "conservative", "m": "mixed"}
"""interPlan calls them assertive, cautious and mixed."""
UNNAMED_POLICY: Final[Behaviour] = "assertive"
"""What interPlan's traffic is where a name says nothing."""
_NAME: Final = re.compile(r"([0-9a-f]{16})-((?:[a-z][a-z0-9]\d?)+)")
_MODIFICATION: Final = re.compile(r"a(\d)|d([lmh])|g([lrs])|o([acm])|s(\d{1,2})")
_FARTHEST_M: Final = 1e7

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Letters:
    """What the letters of a name ask for."""

    keep_logged: int | None = None
    density: Density = "none"
    goal: GoalSide | None = None
    policy: Behaviour | None = None
    special: int | None = None


@dataclass(frozen=True, slots=True)
class PublishedWalk:
    """A pedestrian's way, in the map frame."""

    start: Point
    end: Point
    begins_at_step: int | None = None


@dataclass(frozen=True, slots=True)
class Original:
    """One scenario of interPlan, as its configuration describes it. Poses are x, y and heading in the map frame."""

    name: str
    token: str
    family: str
    letters: Letters
    goal_point: Point | None = None
    """None: a goal is found by turning to its side at every junction."""
    cars: tuple[tuple[float, float, float], ...] = ()
    buses: tuple[tuple[float, float, float], ...] = ()
    cones: tuple[Point, ...] = ()
    walks: tuple[PublishedWalk, ...] = ()
    moving: tuple[tuple[float, float, float], ...] = ()
    """x, y and speed of single cars that drive."""
    filled_at: tuple[Point, ...] = ()
    """Points on roads besides the ego's that the density fills."""


def read_original(name: str, details: Mapping[str, Any], families: Mapping[str, str]) -> Original:
    """A scenario by its name; `details` are those of its token, empty if there are none.

    `families` has the family here of each type of hand-made scenario, and of the
    densities `dl`, `dm` and `dh`, which make one of a name without a type.
    Numbers in `details` may be text. ScenarioError names the scenario and what cannot be.
    """
    parts = _NAME.fullmatch(name)
    if parts is None:
        raise ScenarioError(
            f"{name[:60]}: this is no name of a scenario, expected 16 hexadecimal digits, a hyphen and pairs of a "
            "letter and a value, such as feb82815b92a5512-dhgloc"
        )
    token, letters = parts[1], parse_letters(parts[2], name)
    at = _Details(name, details)
    if letters.special is None:
        family = families.get(f"d{letters.density[0]}")
        if family is None:
            raise ScenarioError(
                f"{name}: it asks for no traffic and no hand-made scenario, so nothing is left to drive"
            )
        return _with_traffic(Original(name, token, family, letters), at)
    special = at.special(letters.special)
    if special.text("config"):
        letters = replace(parse_letters(special.text("config"), name), special=letters.special)
    kind = special.text("type")
    if kind not in families:
        raise ScenarioError(f"{name}: type is {kind[:40]!r}, expected one of {', '.join(families)}")
    made = Original(
        name,
        token,
        families[kind],
        letters,
        cars=tuple((x, y, yaw) for x, y, yaw in special.rows("stopped_vehicle", 3)),
        buses=tuple((x, y, yaw) for x, y, yaw in special.rows("stopped_bus", 3)),
        cones=tuple((x, y) for x, y in special.rows("cones", 2)),
        walks=tuple(special.walks()),
    )
    return _with_traffic(made, at, special)


def parse_letters(text: str, name: str) -> Letters:
    """Modifications by their letters, as interPlan writes them; ScenarioError for one that it does not have."""
    found, end = Letters(), 0
    for match in _MODIFICATION.finditer(text):
        if match.start() != end:
            break
        end = match.end()
        keep, density, goal, policy, special = match.groups()
        if keep is not None:
            found = replace(found, keep_logged=int(keep))
        elif density is not None:
            found = replace(found, density=DENSITY[density])
        elif goal is not None:
            found = replace(found, goal=GOAL[goal])
        elif policy is not None:
            found = replace(found, policy=POLICY[policy])
        else:
            found = replace(found, special=int(special))
    if end != len(text) or not text:
        raise ScenarioError(
            f"{name}: {text[end:][:20]!r} is no modification, expected a0 or a1, dl, dm or dh, gl, gr or gs, oa, oc or "
            "om, or s and a number"
        )
    if found.keep_logged is not None and found.keep_logged > 1:
        raise ScenarioError(
            f"{name}: a{found.keep_logged} keeps {found.keep_logged} times the traffic, expected a0 or a1"
        )
    return found


def _with_traffic(made: Original, at: _Details, special: _Details | None = None) -> Original:
    """With the goal, and what drives where there is traffic."""
    goal = at.goal(made.letters.goal) if made.letters.goal is not None else None
    if made.letters.density == "none":
        return replace(made, goal_point=goal)
    own = special is not None and special.has("roadblock_locations_to_spawn_agents")
    filled = (special if own and special is not None else at).rows("roadblock_locations_to_spawn_agents", 2)
    moving = at.rows("extra_agents_to_spawn", 3, more=True)
    return replace(
        made,
        goal_point=goal,
        filled_at=tuple((x, y) for x, y in filled),
        moving=tuple((x, y, speed) for x, y, speed in moving),
    )


class _Details:
    """One mapping of the configuration, with the name of the scenario that asks."""

    def __init__(self, name: str, values: Mapping[str, Any]) -> None:
        self._name = name
        self._values = values

    def has(self, key: str) -> bool:
        return key in self._values

    def text(self, key: str) -> str:
        """A text, "" where there is none."""
        value = self._values.get(key)
        return value if isinstance(value, str) and value != "null" else ""

    def special(self, number: int) -> _Details:
        """The n-th hand-made scenario."""
        specials = self._values.get("special_scenario")
        found = specials.get(str(number)) if isinstance(specials, Mapping) else None
        if not isinstance(found, Mapping):
            raise ScenarioError(
                f"{self._name}: the modification details have no special_scenario {number} of its token"
            )
        return _Details(self._name, cast("Mapping[str, Any]", found))

    def goal(self, side: GoalSide) -> Point | None:
        """The goal on a side, `x, y`; None where the details leave it open."""
        goals = self._values.get("goal")
        value = goals.get(side) if isinstance(goals, Mapping) else None
        if value is None or value in ("", "null"):
            return None
        x, y = self._numbers(value.split(",") if isinstance(value, str) else value, f"goal.{side}", 2)
        return x, y

    def rows(self, key: str, width: int, *, more: bool = False) -> list[list[float]]:
        """A list of lists of numbers, empty where there is none; `more` allows for entries behind the numbers."""
        return [
            self._numbers(row[:width] if more and isinstance(row, list) else row, key, width) for row in self._list(key)
        ]

    def walks(self) -> list[PublishedWalk]:
        """The pedestrians: two points and, if it is not left to the distance, the step at which they begin."""
        found: list[PublishedWalk] = []
        for row in self._list("pedestrian"):
            trigger = row[4] if isinstance(row, list) and len(row) == 5 else None
            x0, y0, x1, y1 = self._numbers(row[:4] if isinstance(row, list) else row, "pedestrian", 4)
            step = None if trigger in (None, "", "null") else int(self._numbers([trigger], "pedestrian", 1)[0])
            found.append(PublishedWalk((x0, y0), (x1, y1), step))
        return found

    def _list(self, key: str) -> Sequence[Any]:
        value = self._values.get(key)
        if value is None or value in ("", "null"):
            return ()
        if not isinstance(value, Sequence) or isinstance(value, str):
            raise ScenarioError(f"{self._name}: {key} is no list")
        return cast("Sequence[Any]", value)

    def _numbers(self, row: Any, key: str, width: int) -> list[float]:
        try:
            found = [float(value) for value in row]
        except (TypeError, ValueError):
            found = []
        if len(found) != width or not all(math.isfinite(value) and abs(value) < _FARTHEST_M for value in found):
            raise ScenarioError(f"{self._name}: {key} holds {str(row)[:60]}, expected {width} numbers")
        return found
