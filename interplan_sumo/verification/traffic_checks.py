"""Is the traffic of a scenario safe at the start? The start checks that need SUMO."""

from __future__ import annotations

from typing import Final

import numpy as np

from interplan_sumo.scenario.constant_velocity import HOLD_S, OVERLAP_M, STEP_S, ego_held, first_contacts, held
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.setup import open_traffic, start_state
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.roads import Roads

HARDEST_BRAKING_MPS2: Final = 3.0
"""Nobody brakes as hard as this in the first step (benchmark.md)."""
WAY_OUT: Final = "move the start, or draw other traffic with another density or id"


_EGO: Final = -1
"""The ego's row; the actors' begin at 0."""


def traffic_problems(scenario: Scenario, roads: Roads) -> list[str]:
    """What is unsafe about the traffic of seed 0 at t = 0; opens SUMO, unless nothing moves.

    Overlaps, who would hit whom within 3 s if all held lane and speed (the ego
    as well), and who brakes at 3 m/s2 or more in the first step while the ego holds its speed.
    Obstacles and pedestrians count as well, but not what they do to one another.
    Recorded road users do what they did: of them only overlaps are told.
    """
    if not scenario.has_traffic:
        return []
    with open_traffic(scenario, roads) as traffic:
        before = traffic.observe().actors
        agents = frozenset(traffic.behaviours)
        if scenario.replayed:
            return contact_problems(scenario, roads, before, agents, only_overlaps=True)
        traffic.react(start_state(scenario, roads))
        traffic.place_ego(_ego_one_step_on(scenario, roads))
        traffic.advance()
        after = traffic.observe().actors
    return [*contact_problems(scenario, roads, before, agents), *braking_problems(roads, before, after)]


def _ego_one_step_on(scenario: Scenario, roads: Roads) -> EgoState:
    """The ego after a step at constant speed."""
    x_m, y_m, heading_rad = ego_held(scenario, roads)[1].tolist()
    return EgoState(STEP_S, x_m, y_m, heading_rad, scenario.start_speed_mps)


def contact_problems(
    scenario: Scenario, roads: Roads, actors: Actors, agents: frozenset[str], *, only_overlaps: bool = False
) -> list[str]:
    """Overlaps at the start and hits within the hold time in which one of the `agents`, by id, takes part."""
    rows, poses = zip((_EGO, ego_held(scenario, roads)), *held(roads, actors), strict=True)
    owner = np.array(rows)
    sizes = np.vstack(((PACIFICA.length_m, PACIFICA.width_m), np.stack((actors.length_m, actors.width_m), axis=1)))
    contacts = first_contacts(np.stack(poses), sizes[owner - _EGO], owner)
    problems: list[str] = []
    for (first, second), frame in sorted(contacts.items(), key=lambda contact: (contact[1], contact[0])):
        if only_overlaps and frame > 0:
            continue
        if not any(row != _EGO and actors.ids[row] in agents for row in (first, second)):
            continue
        who = f"{_named(roads, actors, first)} and {_named(roads, actors, second)}"
        if frame == 0:
            problems.append(
                f"traffic: {who} overlap at the start, expected no more than {100 * OVERLAP_M:.0f} cm; {WAY_OUT}"
            )
        else:
            problems.append(
                f"traffic: {who} touch after {frame * STEP_S:.1f} s if all hold lane and speed, "
                f"expected nobody to within {HOLD_S:.0f} s; {WAY_OUT}"
            )
    return problems


def braking_problems(roads: Roads, before: Actors, after: Actors) -> list[str]:
    """Who brakes too hard from one step to the next; who has gone in between, drove off the map."""
    speeds = dict(zip(after.ids, after.speed_mps.tolist(), strict=True))
    problems: list[str] = []
    for row, name in enumerate(before.ids):
        braking_mps2 = (float(before.speed_mps[row]) - speeds.get(name, np.inf)) / STEP_S
        if braking_mps2 >= HARDEST_BRAKING_MPS2:
            problems.append(
                f"traffic: {_named(roads, before, row)} brakes with {braking_mps2:.1f} m/s2 in the first step, "
                f"expected less than {HARDEST_BRAKING_MPS2:.0f}; {WAY_OUT}"
            )
    return problems


def _named(roads: Roads, actors: Actors, row: int) -> str:
    """Who and where, for people."""
    if row == _EGO:
        return "the ego"
    x_m, y_m = float(actors.x_m[row]), float(actors.y_m[row])
    lane_id = roads.nearest_lane(x_m, y_m)
    arc_m, _ = roads[lane_id].centerline.project_point(x_m, y_m)
    kind = ActorKind(int(actors.kind[row])).words
    return f"the {kind} on lane {lane_id} at {arc_m:.1f} m ({float(actors.speed_mps[row]):.1f} m/s)"
