"""What stands for good and what only waits; and what it takes to get past the former."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from math import inf

import numpy as np
from numpy.typing import NDArray

from interplan_planners.common.ground import Ground
from interplan_planners.common.neighbours import STANDING_MPS, stands_for_good
from interplan_planners.foresight.candidate_paths import Base, quintic
from interplan_planners.foresight.prediction import MOVING_MPS, PredictedTraffic, Prediction
from interplan_planners.foresight.scene import corners_along
from interplan_sumo.planner import Observation
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.ego import EgoShape
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.signals import SignalStatus

ASKEW_RAD, ASIDE_M = 0.2, 0.8
"""Who stands turned like this to its lane, or this far off its line, is in no queue."""
QUEUE_GAP_M = 14.0
"""From centre to centre less half lengths: who is this near behind another one may be waiting for it."""
LIGHT_M, JUNCTION_M = 60.0, 20.0
"""A light that is not green, or a junction, this near ahead is a reason to wait."""
PATIENCE_S = 12.0
"""After this time without a move even who had a reason to wait is taken to stay, unless a light is red."""
HALF_GAP_M = 14.0
"""Things nearer to one another than this, along the road, are passed in one go."""
LEAST_CLEARANCE_M, CLEARANCE_M = 0.22, 0.6
SPARE_M = 0.6
"""Kept to the edge beyond that if there is room: the front swings out."""
OWN_SIDE_EDGE_M, OWN_SIDE_M = 0.05, 0.2
"""Kept by the centre to the lanes of the other direction: at least, and besides if there is room."""
EDGE_M = 0.1
"""Kept to the edge of the road."""
CONTACT_M = 0.15
"""What comes nearer than this to the ego's side blocks its way."""
BALKS_MPS2, BALKS_MORE_MPS2 = 2.0, 1.5
"""Who brakes harder than the first, and by so much more than there is reason to, balks."""
CRAWLS_MPS, SETS_OFF_MPS2, CRAWLS_LESS_MPS2 = 3.0, 0.3, 0.7
"""So does who is slower than the first, does not set off and has room to, by that much."""
BALKED_S, SLOW_AFTER_MPS = 2.0, 5.0
"""For so long after that, while it is no faster than the second, the reason may still be there."""
PROBE_M, PROBES = 0.15, 80
ENTRY_SHARE = 0.12
"""Of the way out: up to there nothing of the ego has moved to the side."""
RIDER_SIDE_M, FASTER_MPS = 0.5, 2.5
"""Kept besides to who rides a bicycle; and how much slower than allowed it is who is passed."""


class Stillness:
    """Who has been standing since when; a memory for one episode."""

    def __init__(self) -> None:
        self._since_s: dict[str, float] = {}
        self._balked_s: dict[str, float] = {}
        """When somebody balked last."""

    def found(
        self, observation: Observation, traffic: PredictedTraffic, prediction: Prediction
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.bool_]]:
        """(A,) whether an actor is taken to stay where it is: standing for 2 s, and no reason to wait in sight.

        And (A,) whether that cannot be told: there may be a reason, but no red light. And (A,) who balks: it brakes,
        crawls or has just stopped, and no reason is in sight for that, either.
        """
        actors = observation.actors
        standing = [actors.ids[row] for row in np.flatnonzero(actors.speed_mps < STANDING_MPS).tolist()]
        self._since_s = {name: self._since_s.get(name, observation.time_s) for name in standing}
        stands = stands_for_good(observation)
        on_wheels = actors.kind == ActorKind.VEHICLE
        slows = on_wheels & ~stands & _slows(traffic)
        doubtful = np.zeros(len(actors), dtype=np.bool_)
        rows = np.flatnonzero((stands & on_wheels) | slows).tolist()
        now_s = observation.time_s
        patient = {row for row in rows if now_s - self._since_s.get(actors.ids[row], now_s) < PATIENCE_S}
        reasons = _Reasons(observation, traffic, prediction, stands, patient)
        for row in rows:
            reason = reasons.of(row)
            if not slows[row]:
                stands[row], doubtful[row] = reason is Reason.NONE, reason is Reason.PERHAPS
            elif reason is Reason.NONE:
                self._balked_s[actors.ids[row]] = now_s
        balked_s = np.array([self._balked_s.get(name, -inf) for name in actors.ids])
        balks = ~stands & (slows | (actors.speed_mps < SLOW_AFTER_MPS)) & (now_s - balked_s < BALKED_S)
        return stands, doubtful, balks


def _slows(traffic: PredictedTraffic) -> NDArray[np.bool_]:
    """(A,) who keeps to a lane and brakes hard or crawls, where lane and those ahead do not ask for that, or stands."""
    actors, changes = traffic.actors, traffic.changes_mps2
    keeps = (np.abs(traffic.turned_rad) < ASKEW_RAD) & (np.abs(traffic.left_m) < ASIDE_M)
    keeps &= np.array([lane is not None for lane in traffic.lane_of], dtype=np.bool_)
    less_mps2 = traffic.expected_mps2 - changes
    brakes = (changes < -BALKS_MPS2) & (less_mps2 > BALKS_MORE_MPS2)
    crawls = (actors.speed_mps < CRAWLS_MPS) & (changes < SETS_OFF_MPS2) & (less_mps2 > CRAWLS_LESS_MPS2)
    return keeps & (brakes | crawls | (actors.speed_mps < STANDING_MPS))


class Reason(Enum):
    """Why somebody who stands may be waiting."""

    NONE = "none"
    PERHAPS = "perhaps"
    """A junction, or somebody ahead who moves or may be waiting."""
    LIGHT = "light"
    """Its own red light, or that of whom it queues behind."""


class _Reasons:
    """Why vehicles may be waiting, or slowing down to wait, at one step."""

    def __init__(
        self,
        observation: Observation,
        traffic: PredictedTraffic,
        prediction: Prediction,
        stands: NDArray[np.bool_],
        patient: set[int],
    ) -> None:
        """`patient` are those for whom a queue or a junction is reason enough."""
        actors = observation.actors
        self._length_m = actors.length_m
        self._stopping_m = actors.speed_mps**2 / (2.0 * np.maximum(-traffic.changes_mps2, BALKS_MPS2))
        self._traffic = traffic
        self._prediction = prediction
        self._stands = stands.copy()
        self._patient = patient
        self._halted = observation.signals.with_status(SignalStatus.RED) | observation.signals.with_status(
            SignalStatus.YELLOW
        )
        self._known: dict[int, Reason] = {}
        self._on: dict[str, list[tuple[float, int]]] = {}
        for row, lane in enumerate(traffic.lane_of):
            if lane is not None:
                self._on.setdefault(lane, []).append((float(traffic.arc_m[row]), row))

    def of(self, row: int) -> Reason:
        """The reason of a vehicle that stands or slows down."""
        behind: list[int] = []
        while row not in self._known:
            self._known[row] = Reason.NONE  # until more is known; ends a ring of cars that wait for one another
            reason = self._reason(row)
            if not isinstance(reason, Reason):
                behind.append(row)
                row = reason
                continue
            self._known[row] = reason
        for follower in behind:
            self._known[follower] = self._known[row]
        return self._known[behind[0] if behind else row]

    def _reason(self, row: int) -> Reason | int:
        """Its reason, or who ahead of it decides that."""
        lane = self._traffic.lane_of[row]
        aside = abs(self._traffic.turned_rad[row]) > ASKEW_RAD or abs(self._traffic.left_m[row]) > ASIDE_M
        if lane is None or aside:
            return Reason.NONE
        chain = self._prediction.chain(lane)
        at_m, stopping_m = float(self._traffic.arc_m[row]), float(self._stopping_m[row])
        before = lane
        for link, start_m in zip(chain.lanes, chain.starts_m.tolist(), strict=True):
            if start_m - at_m > LIGHT_M + stopping_m:
                break
            if link != lane and link in self._halted:
                return Reason.LIGHT
            ahead = [(start_m + s, j) for s, j in self._on.get(link, ()) if start_m + s > at_m + 0.5 and j != row]
            if ahead and row in self._patient:
                there_m, j = min(ahead)
                if there_m - at_m - 0.5 * float(self._length_m[row] + self._length_m[j]) < QUEUE_GAP_M + stopping_m:
                    return j if self._stands[j] else Reason.PERHAPS
            if (
                row in self._patient
                and start_m - at_m < JUNCTION_M + stopping_m
                and self._prediction.crosses(before, link)
            ):
                return Reason.PERHAPS
            before = link
        return Reason.NONE


@dataclass(frozen=True, slots=True)
class Passage:
    """A way past on one side."""

    offset_m: float
    """From the base, left positive."""
    oncoming: bool
    """Whether the ego's centre leaves the lanes of its direction."""
    over_share: float
    """Of the way out: up to there all of the ego is on its own side; infinite if it stays there."""
    clear_m: float
    """What is left between the ego and what it passes."""


@dataclass(frozen=True, slots=True, eq=False)
class StandingGroup:
    """Things that stand in the way along a base, near enough to one another to be passed in one go."""

    base: Base
    ids: tuple[str, ...]
    start_m: float
    """Arc length of the base where they begin."""
    end_m: float
    passages: tuple[Passage, ...]
    """Left before right; empty if there is no way past."""


def blockage(
    base: Base,
    from_m: float,
    look_m: float,
    traffic: PredictedTraffic,
    stays: NDArray[np.bool_],
    shape: EgoShape,
    ground: Ground,
    beside_m: float = 0.0,
) -> StandingGroup | None:
    """The first thing that stays and blocks the way along a base (`beside_m` off its line), and all that go with it.

    Looks from one arc length as far as another distance.
    """
    actors = traffic.actors
    rows = np.flatnonzero(stays)
    if not rows.size:
        return None
    corners = actors.corners[rows]
    ahead = np.hypot(actors.x_m[rows] - base.line.pose_at(from_m).x_m, actors.y_m[rows] - base.line.pose_at(from_m).y_m)
    near = ahead < look_m + 20.0
    rows, corners = rows[near], corners[near]
    if not rows.size:
        return None
    s, d = corners_along(base.path, corners, (from_m - 20.0, from_m + look_m + 20.0))
    low_s, high_s, low_d, high_d = s.min(axis=1), s.max(axis=1), d.min(axis=1), d.max(axis=1)
    half_m = 0.5 * shape.width_m
    reach = half_m + CONTACT_M
    beyond = high_s - low_s > 1e-3  # boxes beyond the ends project on a point
    inside = (high_s > from_m) & (low_s < from_m + look_m) & beyond & (np.abs(d).min(axis=1) < 12.0)
    blocks = inside & (low_d < beside_m + reach) & (high_d > beside_m - reach)
    if not blocks.any():
        return None
    order = np.flatnonzero(blocks)[np.argsort(low_s[blocks], kind="stable")]
    start_m, end_m = float(low_s[order[0]]), float(high_s[order[0]])
    members = [int(order[0])]
    for i in order[1:].tolist():
        if low_s[i] > end_m + HALF_GAP_M:
            break
        members.append(i)
        end_m = max(end_m, float(high_s[i]))
    beside = inside & (high_s > start_m - 2.0) & (low_s < end_m + 2.0)
    passages = _passages(members, beside, low_d, high_d, half_m, _edges(base, start_m, end_m, ground))
    ids = tuple(sorted(actors.ids[rows[i]] for i in members))
    return StandingGroup(base, ids, start_m, end_m, passages)


def slow_rider(
    base: Base, front_m: float, look_m: float, traffic: PredictedTraffic, shape: EgoShape, ground: Ground
) -> StandingGroup | None:
    """The next one ahead who rides a bicycle along a base, slower than one drives there; where it will be passed.

    `front_m` is where the ego's front is; it looks so far.
    """
    actors, half_m = traffic.actors, 0.5 * shape.width_m
    rows = np.flatnonzero((actors.kind == ActorKind.BICYCLE) & (actors.speed_mps > MOVING_MPS))
    if not rows.size:
        return None
    s, d = corners_along(base.path, actors.corners[rows])
    along = np.abs(traffic.turned_rad[rows]) < ASKEW_RAD
    in_way = (d.min(axis=1) < half_m + RIDER_SIDE_M) & (d.max(axis=1) > -half_m - RIDER_SIDE_M)
    ahead = along & in_way & (s.max(axis=1) > front_m - shape.length_m) & (s.min(axis=1) < front_m + look_m)
    if not ahead.any():
        return None
    row = int(np.flatnonzero(ahead)[np.argmin(s.min(axis=1)[ahead])])
    rider_mps = float(actors.speed_mps[rows[row]])
    faster_mps = float(base.limit_mps[min(int(front_m), len(base.limit_mps) - 1)]) - rider_mps
    if faster_mps < FASTER_MPS:
        return None
    low_s, high_s = float(s[row].min()), float(s[row].max())
    until_s = max(low_s - front_m, 0.0) / faster_mps, (high_s - front_m + shape.length_m) / faster_mps
    start_m, end_m = low_s + rider_mps * until_s[0], high_s + rider_mps * max(until_s[1], 0.0)
    side = d[row : row + 1]
    low_d, high_d = side.min(axis=1) - RIDER_SIDE_M, side.max(axis=1) + RIDER_SIDE_M
    passages = _passages([0], np.ones(1, dtype=np.bool_), low_d, high_d, half_m, _edges(base, start_m, end_m, ground))
    return StandingGroup(base, (actors.ids[rows[row]],), start_m, end_m, passages)


def _passages(
    members: list[int],
    beside: NDArray[np.bool_],
    low_d: Floats,
    high_d: Floats,
    half_m: float,
    edges: tuple[tuple[float, float], tuple[float, float]],
) -> tuple[Passage, ...]:
    """Ways past members of things (M,) that lie between offsets; `beside` are those next to the members."""
    found: list[Passage] = []
    for sign, (edge_m, own_m) in zip((1.0, -1.0), edges, strict=True):
        near_d, far_d = (low_d, high_d) if sign > 0 else (-high_d, -low_d)
        need_m = max(float(far_d[i]) for i in members)
        limit_m = inf
        for _ in range(6):
            # what stands between here and where the ego would pass has to be passed as well
            strip = beside & (far_d > need_m) & (near_d < need_m + 2.0 * half_m + LEAST_CLEARANCE_M)
            strip &= far_d > -half_m
            if not strip.any():
                break
            if near_d[strip].min() - need_m >= 2.0 * half_m + 2.0 * LEAST_CLEARANCE_M:
                limit_m = float(near_d[strip].min())
                break
            need_m = float(far_d[strip].max())
        else:
            continue
        most_m = min(edge_m - EDGE_M, limit_m - LEAST_CLEARANCE_M) - half_m
        least_m = need_m + half_m + LEAST_CLEARANCE_M
        if most_m < least_m or need_m + half_m < -0.5:
            continue
        # rather along what stands than along the edge
        wished_m = min(need_m + half_m + CLEARANCE_M, max(most_m - SPARE_M, least_m + 0.2 * (most_m - least_m)))
        if least_m <= own_m:
            wished_m = min(wished_m, max(own_m - OWN_SIDE_M, least_m))
        oncoming = wished_m > own_m + 1e-9
        over_share = ENTRY_SHARE if oncoming else _over_share(wished_m, own_m - half_m)
        found.append(Passage(sign * wished_m, oncoming, over_share, wished_m - need_m - half_m))
    return tuple(found)


def _over_share(offset_m: float, own_m: float) -> float:
    """Share of the way out to an offset at which the ego's side is so far out; infinite if it never is."""
    if offset_m <= own_m:
        return inf
    shares = np.linspace(0.0, 1.0, 51)
    return max(float(np.interp(own_m, quintic(shares, 1.0, (0.0, 0.0, 0.0), offset_m), shares)), ENTRY_SHARE)


def _edges(base: Base, start_m: float, end_m: float, ground: Ground) -> tuple[tuple[float, float], tuple[float, float]]:
    """For left and right of the base: how far the road reaches, and how far the ego's centre stays in its direction."""
    at = np.linspace(start_m - 6.0, end_m + 6.0, 6)
    poses = base.line.poses_at(at)
    d = PROBE_M * np.arange(1, PROBES, dtype=np.float64)
    found: list[tuple[float, float]] = []
    for sign in (1.0, -1.0):
        x = poses[:, 0, None] - sign * d * np.sin(poses[:, 2])[:, None]
        y = poses[:, 1, None] + sign * d * np.cos(poses[:, 2])[:, None]
        under = ground.under(x, y)
        found.append((_reach(under.drivable, d), _reach(under.on_route, d) - OWN_SIDE_EDGE_M))
    return found[0], found[1]


def _reach(good: NDArray[np.bool_], d: Floats) -> float:
    """The farthest of the distances up to which all rows are good."""
    bad = ~good.all(axis=0)
    if not bad.any():
        return float(d[-1])
    first = int(bad.argmax())
    return float(d[first - 1]) if first else 0.0
