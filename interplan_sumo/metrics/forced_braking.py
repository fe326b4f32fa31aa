"""Forced braking: how hard did others have to brake because of the ego, beyond what they would have done without it?

What a vehicle would have done is asked of its own SUMO model during the drive
(`simulation.without_ego`) and stands in the trace. Braking as such would
measure the traffic: without any ego somebody brakes above 2 m/s2 in half of the
scenes.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_sumo.metrics.circumstances import ego_doing
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.metric import MetricResult, metric
from interplan_sumo.world.geometry import Floats, Ints
from interplan_sumo.world.roads import Roads

LEAST_FORCED_MPS2 = 0.5
"""Braking is forced where without the ego it would have been less by this."""
HARDEST_MPS2 = 6.0
"""Nobody may be forced to brake harder."""
COURTEOUS_MPS2 = 3.0
"""Up to this others are not disturbed."""
NEW_S = 1.0
"""Who has come less than this ago brakes for how it came."""
SINCE_S = 3.0
"""Who has followed the ego in its lane for so long, or ever since it came, is an old follower."""
EGO_BRAKES_MPS2 = 3.0
"""While the ego brakes no harder than this, an old follower that must brake harder has kept too little gap."""
EGO_BRAKED_S = 1.0
"""The hardest braking of the ego in this time counts: whoever reacts, reacts later."""
UPSTREAM_M = 60.0
"""Who is farther behind along the lanes does not follow."""
NO_MODELS = "the road users are recorded: they react to nobody, and have no models to ask"


@dataclass(frozen=True, eq=False)
class ForcedBraking:
    """Whom the ego forced to brake: rows of the actor table, in order."""

    rows: Ints
    braking_mps2: Floats
    """(K,) how hard they brake."""
    without_ego_mps2: Floats
    """(K,) how hard they would have braked without the ego; negative where they would have accelerated."""


def hardest_moment(facts: Facts, result: MetricResult) -> int:
    """When somebody had to brake hardest."""
    hardest = result.detail["hardest"]
    return facts.frames - 1 if hardest is None else int(hardest["frame"])


@metric(title="forced braking", failure="forced others to brake hard", lost_at=hardest_moment)
def forced_braking(facts: Facts) -> MetricResult:
    """0 if the ego forced somebody to brake harder than `HARDEST_MPS2`, else 1; None where nobody can be asked."""
    return _judged(facts, lambda hardest: 0.0 if hardest > HARDEST_MPS2 else 1.0)


@metric(failure="discourteous", lost_at=hardest_moment)
def courtesy(facts: Facts) -> MetricResult:
    """1 if nobody was forced to brake harder than `COURTEOUS_MPS2`, 0 from `HARDEST_MPS2` on, linear between."""
    return _judged(
        facts,
        lambda hardest: float(np.clip((HARDEST_MPS2 - hardest) / (HARDEST_MPS2 - COURTEOUS_MPS2), 0.0, 1.0)),
    )


def _judged(facts: Facts, score: Callable[[float], float]) -> MetricResult:
    found = laid_to_the_ego(facts)
    if found is None:
        return MetricResult(None, reason=NO_MODELS)
    if not len(found.rows):
        return MetricResult(1.0, {"hardest": None})
    at = int(np.argmax(found.braking_mps2))
    row, actors = int(found.rows[at]), facts.trace.actors
    frame, track = int(actors.frame[row]), str(actors.ids[row])
    braking, without = float(found.braking_mps2[at]), float(found.without_ego_mps2[at])
    detail = {
        "frame": frame, "time_s": float(facts.time_s[frame]), "track": track, "braking_mps2": braking,
        "without_ego_mps2": without,
    }  # fmt: skip
    value = score(braking)
    reason = None
    if value < 1.0:
        own = f"with {without:.1f} m/s2" if without > 0.0 else "not at all"
        reason = (
            f"vehicle {track} braked with {braking:.1f} m/s2 at {facts.time_s[frame]:.1f} s, without the ego {own}; "
            f"the ego was {ego_doing(facts, frame)}"
        )
    return MetricResult(value, {"hardest": detail}, reason=reason)


def laid_to_the_ego(facts: Facts) -> ForcedBraking | None:
    """All braking that the ego forced, but for that of who has just come, and of old followers of a mildly braking ego.

    None where nobody has a model that could be asked.
    """
    found = all_forced_braking(facts)
    if found is None or not len(found.rows):
        return found
    counts = np.ones(len(found.rows), dtype=np.bool_)
    for track in dict.fromkeys(facts.trace.actors.ids[found.rows].tolist()):
        mine = np.flatnonzero(facts.trace.actors.ids[found.rows] == track)
        counts[mine] = _counted(facts, track, facts.trace.actors.frame[found.rows[mine]])
    return ForcedBraking(found.rows[counts], found.braking_mps2[counts], found.without_ego_mps2[counts])


def all_forced_braking(facts: Facts) -> ForcedBraking | None:
    """Every row that brakes harder than its own model would have without the ego, by `LEAST_FORCED_MPS2` or more."""
    actors = facts.trace.actors
    if actors.ax_without_ego is None:
        return None
    rows = np.flatnonzero(np.isfinite(actors.ax_without_ego))
    before = facts.row_before[rows] if len(rows) else rows
    rows, before = rows[before >= 0], before[before >= 0]
    braking = (facts.actor_speed_mps[before] - facts.actor_speed_mps[rows]) / (facts.step_us * 1e-6)
    without = -actors.ax_without_ego[rows]
    forced = braking - without >= LEAST_FORCED_MPS2
    return ForcedBraking(rows[forced], braking[forced], without[forced])


def _counted(facts: Facts, track: str, frames: Ints) -> NDArray[np.bool_]:
    """Whether braking of a track that the ego forces in these frames is laid to the ego."""
    actors, step_s = facts.trace.actors, facts.step_us * 1e-6
    rows = np.flatnonzero(actors.ids == track)
    first = int(actors.frame[rows[0]])
    settled = facts.time_s[frames] - facts.time_s[first] >= NEW_S - 1e-9
    braked = np.maximum(0.0, -facts.trace.ego.ax_mps2)
    steps, window = round(SINCE_S / step_s), round(EGO_BRAKED_S / step_s)
    behind = np.zeros(facts.frames, dtype=np.bool_)
    behind[actors.frame[rows]] = follows_in_lane(facts, rows)
    counts = settled.copy()
    for i, frame in enumerate(frames.tolist()):
        mildly = float(braked[max(0, frame - window) : frame + 1].max()) <= EGO_BRAKES_MPS2
        old = bool(behind[max(first, frame - steps) : frame + 1].all())
        counts[i] &= not (mildly and old)
    return counts


def follows_in_lane(facts: Facts, rows: Ints) -> NDArray[np.bool_]:
    """(K,) whether an actor is behind the ego on the way into the lane that holds the ego's whole body."""
    actors = facts.trace.actors
    frame = actors.frame[rows]
    xy, heading = facts.actor_xy[rows], actors.heading_rad[rows]
    offset = facts.centre[frame] - xy
    behind = offset[:, 0] * np.cos(heading) + offset[:, 1] * np.sin(heading) > 0.0
    found = np.zeros(len(rows), dtype=np.bool_)
    groups: dict[frozenset[str], list[int]] = {}
    for i in np.flatnonzero(behind).tolist():
        lanes = facts.body_lanes[frame[i]]
        if lanes:
            groups.setdefault(lanes, []).append(i)
    for lanes, members in groups.items():
        for lane in _upstream(facts.roads, lanes):
            found[members] |= shapely.contains_xy(facts.roads[lane].polygon, xy[members])
    return found


def _upstream(roads: Roads, lanes: frozenset[str]) -> set[str]:
    """These lanes and connectors, and those that lead to them within `UPSTREAM_M`."""
    found: dict[str, float] = dict.fromkeys(lanes, 0.0)
    queue = deque(lanes)
    while queue:
        here = queue.popleft()
        for before in roads.incoming(here):
            if before not in found and found[here] < UPSTREAM_M:
                found[before] = found[here] + roads[before].centerline.length_m
                queue.append(before)
    return set(found)
