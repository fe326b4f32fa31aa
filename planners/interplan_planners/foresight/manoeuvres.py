"""Manoeuvres: the candidates that the ego may choose from, and what each is worth beside speed and safety."""

from __future__ import annotations

from dataclasses import dataclass
from math import copysign

from interplan_planners.common.driven_route import DrivenRoute
from interplan_planners.foresight.candidate_paths import (
    LOCK_M,
    Base,
    Bypass,
    CandidatePath,
    base_of,
    changed,
    drawn_point,
    kept,
    passed,
    returned,
    shortest_m,
    unbent,
)
from interplan_planners.foresight.caution import BESIDE_M
from interplan_planners.foresight.scene import PlanningScene, curvature_per_m
from interplan_planners.foresight.static_classification import Passage, StandingGroup, blockage, slow_rider
from interplan_sumo.planner import Mission
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import wrap_angle

LOOK_M, RIDER_LOOK_M = 75.0, 35.0
"""Things that stand in the way are thought of from this distance on, and riders of bicycles from the second."""
BEHIND_M = 60.0
"""So much of a way that crosses itself is kept behind the ego."""
PAST_M = 2.4
"""The drawn point begins to return this far behind what it passes: the rest of the car follows its way."""
NEW_LANE_M = 0.9
"""Who passes with a larger offset is in the neighbour lane, where others come from behind."""
ON_LINE_M, ON_LINE_RAD = 0.25, 0.05
"""Nearer than this the ego is on a line and need not be brought to it."""
OFF_LINE_M, UNCOMMITTED_M = 0.6, 0.7
"""Who keeps a lane farther off its line than the first may come back otherwise; who is nearer than the second may still
do anything."""
BENT_MPS, BENT_PER_M, OVER_M = 3.0, 0.08, (0.0, 0.4, 0.8)
"""Slower than the first and bending more than the second the ego may go on to these offsets on the outer side of its
line: the tracker, slow to straighten the wheel, would cut the bend."""
LEAVABLE_M = 1.4
"""A change can be given up while the centre is no farther than this from the old lane's line."""
RECALLABLE_M = 2.2
"""So can a pass."""
ALMOST_BESIDE_M = 0.8
"""Nearer than this to the offset of a pass the ego may reach it when it is beside already."""
SETTING_OFF_MPS, LATER_M = 2.0, 8.0
"""Slower than the first the ego may steer to the stop, and be at the offset of a pass so much later than is usual."""
GENTLE = 1.7
"""How much longer the gentler way back is."""
BEYOND_LANE = 1.5
"""A change may take this much of what is left of the lane: it may be finished on the next."""

# Worths are in points of progress: ten of them are the way that the limit allows within the horizon.
PER_CHANGE, PER_URGENT_CHANGE, ROOM_PER_CHANGE_M = 8.0, 6.0, 140.0
"""What each lane change that is left to the goal costs, and what comes on top as the room for it runs out."""
BLOCKED, BLOCKED_FADES_M = 3.0, 80.0
"""For a lane that is blocked ahead."""
BEGINNING = 0.6
"""For a change, so that it is not made for nothing; for a pass it is half of this."""
AGAINST_TRAFFIC = 1.0
RESOLVED = 0.4
"""What it is worth to go on with what has been begun."""
ANEW, GIVING_UP = 0.2, 1.0
"""What it costs to do the same on another way, and to go back to the lane that was being left."""


@dataclass(frozen=True, slots=True, eq=False)
class ManoeuvreOption:
    """A candidate and what it is worth."""

    candidate: CandidatePath
    worth: float
    """For its lane and the way ahead on it; at most about 0."""
    begun: float = 0.0
    """Minus what beginning it costs, or what it is worth to go on with it."""

    @property
    def bonus(self) -> float:
        return self.worth + self.begun


class Manoeuvres:
    """All that may be done on one mission; lays out each lane's base once."""

    def __init__(self, mission: Mission, ego: EgoState, fallback_limit_mps: float, change_time_s: float) -> None:
        self._mission = mission
        self._fallback_limit_mps = fallback_limit_mps
        self._change_time_s = change_time_s
        self.began_s = ego.time_s
        """When the drive began."""
        self.route = DrivenRoute(mission, ego.pose, fallback_limit_mps)
        self._bases: dict[tuple[int, str], Base] = {}
        self._kept: dict[tuple[int, str], CandidatePath] = {}

    # --- lanes ---------------------------------------------------------------------------------

    def base(self, index: int, lane_id: str) -> Base:
        """The base of the way from a lane of the route's block `index` on."""
        key = (index, lane_id)
        if key not in self._bases:
            way = self.route.ways.from_lane(index, lane_id)
            changes = self.route.ways.changes_needed.get(way.lanes[-1], 1)
            self._bases[key] = base_of(self._mission.roads, way, index, changes, self._fallback_limit_mps)
        return self._bases[key]

    def kept(self, base: Base) -> CandidatePath:
        """Stay on a base's line."""
        key = (base.index, base.way.lanes[0])
        if key not in self._kept:
            self._kept[key] = kept(base)
        return self._kept[key]

    def onward(self, base: Base, arc_m: float) -> Base:
        """The base of the same way from nearer to the ego on, where its line is not whole."""
        index, lane_id = base.lane_at(arc_m - BEHIND_M)
        return base if base.whole or index == base.index else self.base(index, lane_id)

    def here(self, ego: EgoState) -> CandidatePath:
        """Keep to whatever lane the ego is on."""
        return self.back_to(self.base(*self.route.lane_at(ego.pose)), ego)

    def back_to(self, base: Base, ego: EgoState, stretch: float = 1.0) -> CandidatePath:
        """Come to a base's line and stay on it; `stretch` makes the way longer."""
        shape = self._mission.shape
        axle, own = ego.rear_axle(shape), self.kept(base)
        at_m, left_m = own.path.line.project_point(axle.x_m, axle.y_m)
        turned = wrap_angle(axle.heading_rad - own.path.line.pose_at(at_m).heading_rad)
        if abs(left_m) < ON_LINE_M and abs(turned) < ON_LINE_RAD:
            return own
        way_m = stretch * max(3.0 * ego.speed_mps, shortest_m(left_m) + 4.0, 10.0)
        return returned(base, axle, curvature_per_m(ego, shape), way_m)

    def worth(self, base: Base, at_m: float, blocked: StandingGroup | None) -> float:
        """What it is worth to be at an arc length of a base: 0 on a free way to the goal's lane, else less."""
        _, lane_id = base.lane_at(at_m)
        needed = self.route.ways.changes_needed.get(lane_id, 4)
        room_m = max(base.room_m - at_m, 0.0)
        urgency = min(max(1.0 - room_m / (ROOM_PER_CHANGE_M * max(needed, 1)), 0.0), 1.0)
        worth = -needed * (PER_CHANGE + PER_URGENT_CHANGE * urgency)
        if blocked is not None:
            away_m = max(blocked.start_m - at_m, 0.0)
            worth -= BLOCKED * max(1.0 - away_m / BLOCKED_FADES_M, 0.0)
        return worth

    # --- what may be done ----------------------------------------------------------------------

    def options(
        self, scene: PlanningScene, candidate: CandidatePath
    ) -> tuple[list[ManoeuvreOption], StandingGroup | None]:
        """Candidate paths to choose from, the present one first; and what blocks the way along the present base."""
        ego, shape, base = scene.ego, scene.shape, candidate.base
        at_m, left_m = base.line.project_point(scene.axle.x_m, scene.axle.y_m)
        blocked = self._blocked(scene, base, at_m - (shape.length_m - shape.front_m))
        free, worth = self.worth(base, at_m, None), self.worth(base, at_m, blocked)
        to_pass = blocked or slow_rider(
            base, at_m + shape.front_m, RIDER_LOOK_M, scene.traffic, shape, self.route.ground
        )
        found: list[ManoeuvreOption] = []
        if candidate.kind == "keep":
            found.append(ManoeuvreOption(candidate, worth))
            if scene.speed_mps < BENT_MPS and abs(scene.curvature_per_m) > BENT_PER_M:
                bent = scene.curvature_per_m
                ways = [unbent(base, scene.axle, bent, copysign(over_m, -bent)) for over_m in OVER_M]
                found += [ManoeuvreOption(way, worth, -ANEW) for way in ways]
            elif abs(left_m) > OFF_LINE_M:
                found += [ManoeuvreOption(self.back_to(base, ego, stretch), worth, -ANEW) for stretch in (1.0, GENTLE)]
        elif candidate.kind == "change":
            found.append(ManoeuvreOption(candidate, free, RESOLVED))
            old = candidate.old
            assert old is not None
            old_m, old_left_m = old.line.project_point(ego.x_m, ego.y_m)
            if abs(old_left_m) < LEAVABLE_M:
                behind = self._blocked(scene, old, old_m - 3.0)
                found.append(ManoeuvreOption(self.back_to(old, ego), self.worth(old, old_m, behind), -GIVING_UP))
        else:
            grown = blocked is not None and not set(blocked.ids) <= set(candidate.around)  # there is more to pass
            found.append(ManoeuvreOption(candidate, worth) if grown else ManoeuvreOption(candidate, free, RESOLVED))
            arc_m, _ = candidate.path.line.project_point(scene.axle.x_m, scene.axle.y_m)
            gone = to_pass is None and arc_m < candidate.beside_m[0]  # what was to be passed has gone on
            if gone:
                found[0] = ManoeuvreOption(candidate, free, -AGAINST_TRAFFIC if candidate.oncoming else 0.0)
            passing = gone or arc_m > candidate.beside_m[1] - 2.0
            if passing or abs(base.line.project_point(ego.x_m, ego.y_m)[1]) < RECALLABLE_M:
                found.append(ManoeuvreOption(self.back_to(base, ego), worth, 0.0 if passing else -GIVING_UP))
            if passing:
                found.append(ManoeuvreOption(self.back_to(base, ego, GENTLE), worth))

        uncommitted = candidate.kind != "change" and abs(left_m) < UNCOMMITTED_M
        if to_pass is not None and (uncommitted or candidate.kind == "keep" or to_pass.ids != candidate.around):
            for passage in to_pass.passages:
                found += self._passes(scene, base, to_pass, passage, at_m, free)
        if uncommitted or candidate.kind == "keep":  # what was given up may be begun again on the way back
            found += self._changes(scene, base, at_m)
        return found, blocked

    def _blocked(self, scene: PlanningScene, base: Base, from_m: float) -> StandingGroup | None:
        return blockage(base, from_m, LOOK_M, scene.traffic, scene.stays, scene.shape, self.route.ground)

    def _changes(self, scene: PlanningScene, base: Base, at_m: float) -> list[ManoeuvreOption]:
        """Changes to the neighbours of the lane that the ego is on."""
        shape, axle = scene.shape, scene.axle
        index, lane_id = base.lane_at(at_m + shape.rear_axle_to_center_m)
        longest_m = (base.lane_end_m(at_m + shape.rear_axle_to_center_m) - at_m) * BEYOND_LANE
        found: list[ManoeuvreOption] = []
        for neighbour, _ in self.route.ways.beside(lane_id):
            there = self.base(index, neighbour.id)
            there_m, there_left_m = there.line.project_point(axle.x_m, axle.y_m)
            shortest = shortest_m(there_left_m)
            way_m = min(max(self._change_time_s * scene.speed_mps, shortest + 3.0), longest_m)
            if way_m < shortest:
                continue
            worth = self.worth(there, there_m, self._blocked(scene, there, there_m - 2.0))
            candidate = changed(base, there, axle, scene.curvature_per_m, way_m)
            found.append(ManoeuvreOption(candidate, worth, -BEGINNING))
        return found

    def _passes(
        self, scene: PlanningScene, base: Base, block: StandingGroup, passage: Passage, axle_m: float, worth: float
    ) -> list[ManoeuvreOption]:
        """Ways past what blocks the base, on one side."""
        shape, roads, speed = scene.shape, self._mission.roads, scene.speed_mps
        drawn = drawn_point(scene.axle)
        at_m, left_m = base.line.project_point(drawn.x_m, drawn.y_m)
        there_m, over_m = block.start_m - BESIDE_M, block.end_m + PAST_M
        least_m = shortest_m(passage.offset_m - left_m)
        if abs(passage.offset_m - left_m) < ALMOST_BESIDE_M:
            there_m = max(there_m, at_m + 1.1 * least_m)
        room_m = there_m - at_m
        # the less room there is, the slower
        most_mps = 4.0 + 14.0 * min(max(passage.clear_m - 0.25, 0.0), 0.6)
        new: Base | None = None
        index, lane_id = base.lane_at(axle_m + shape.rear_axle_to_center_m)
        neighbour = roads.left_of(lane_id) if passage.offset_m > 0.0 else roads.right_of(lane_id)
        if neighbour is not None and abs(passage.offset_m) > NEW_LANE_M:
            new = self.base(index, neighbour.id)

        lengths = (max(2.2 * speed, 1.8 * least_m), max(3.4 * speed, 2.5 * least_m))
        outs = [
            (there_m - length_m, there_m)
            for length_m in sorted({min(length_m, room_m) for length_m in lengths})
            if length_m >= 1.1 * least_m
        ]
        at_once_m = max(self._change_time_s * speed, 1.8 * least_m)
        if speed < SETTING_OFF_MPS:
            # there need not be all of the offset before the front is beside: what is hit is seen on the close look
            lock_m = 1.02 * shortest_m(passage.offset_m - left_m, LOCK_M)
            if room_m < lock_m <= room_m + LATER_M:
                outs.append((at_m, at_m + lock_m))
        if new is not None and at_once_m < room_m - 3.0:
            outs.append((at_m, at_m + at_once_m))  # where others drive beside, the first gap is the best
        way_back_m = max(2.4 * max(min(speed, most_mps), 4.0), 1.3 * least_m)
        found: list[ManoeuvreOption] = []
        for out_m in outs:
            back_m = (max(over_m, out_m[1]), max(over_m, out_m[1]) + way_back_m)
            if new is not None and not _leads_on(new, base, back_m[1]):
                continue
            late = out_m[1] > there_m + 1e-6
            bypass = Bypass(
                passage.offset_m, out_m, back_m, block.ids, passage.oncoming, passage.over_share, most_mps, new, late
            )
            candidate = passed(base, scene.axle, scene.curvature_per_m, bypass)
            if candidate is not None:
                begun = -0.5 * BEGINNING - (AGAINST_TRAFFIC if passage.oncoming else 0.0)
                found.append(ManoeuvreOption(candidate, worth, begun))
        return found


def _leads_on(new: Base, base: Base, arc_m: float) -> bool:
    """Whether the lane beside a base still leads along the route where the base has this arc length."""
    there = base.line.pose_at(arc_m)
    return new.way.arrives or new.line.project_point(there.x_m, there.y_m)[0] < new.room_m
