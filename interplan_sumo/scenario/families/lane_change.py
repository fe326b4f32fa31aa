"""Lane changes: ordinary road, the goal lies one to three lanes away; the same recipes at three densities."""

from __future__ import annotations

from typing import Final, Literal

from interplan_sumo.scenario.scenario import Behaviour, Density, LanePlace, Scenario, TrafficDemand

FAMILIES: Final[dict[str, Density]] = {
    "lane_change_ltd": "low",
    "lane_change_mtd": "medium",
    "lane_change_htd": "high",
}


def lane_change(
    index: int,
    *,
    family: Literal["lane_change_ltd", "lane_change_mtd", "lane_change_htd"],
    map: str,
    start: LanePlace,
    start_speed_mps: float,
    goal: LanePlace,
    route: tuple[str, ...],
    behaviour: Behaviour,
) -> Scenario:
    """Drive from `start` to `goal`, which lies on another lane, through traffic of the family's density."""
    return Scenario(
        id=f"{family}/{index}",
        family=family,
        map=map,
        start=start,
        start_speed_mps=start_speed_mps,
        goal=goal,
        route=route,
        traffic=TrafficDemand(density=FAMILIES[family], behaviour=behaviour),
    )


def _recipes(family: Literal["lane_change_ltd", "lane_change_mtd", "lane_change_htd"]) -> tuple[Scenario, ...]:
    return (
        lane_change(  # two changes to the left on a three-lane arterial, 240 m to do them
            0,
            family=family,
            map="strip",
            start=LanePlace("402032", 20.0),
            start_speed_mps=12.0,
            goal=LanePlace("402030", 260.0),
            route=("40203",),
            behaviour="mixed",
        ),
    )


SCENARIOS: Final[dict[str, tuple[Scenario, ...]]] = {
    "lane_change_ltd": _recipes("lane_change_ltd"),
    "lane_change_mtd": _recipes("lane_change_mtd"),
    "lane_change_htd": _recipes("lane_change_htd"),
}
