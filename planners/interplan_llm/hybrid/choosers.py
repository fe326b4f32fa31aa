"""Who chooses: a language model, a coin, or a few rules."""

from __future__ import annotations

import zlib

import numpy as np

from interplan_llm.hybrid.behaviours import Behaviour
from interplan_llm.hybrid.scene import BlockedLane, DecisionScene, LaneView, Walker
from interplan_llm.hybrid.text import messages
from interplan_llm.models.exchanges import Exchange
from interplan_llm.models.protocol import LanguageModel, ModelFailure, Request, check_timeout
from interplan_planners.common.gaps import GapRules, clearances_needed_m
from interplan_sumo.planner import Mission

CHOICE_TOKENS, THOUGHT_TOKENS = 24, 256
"""Longest answers: one of the options, or thoughts before it (the published number)."""

GAPS = GapRules()
UNDER_WAY = 0.5
"""Of the clearances that a merge asks for, this is enough to go on with it."""
PASSING_M, PASSING_MPS, PASSING_SPARE_S = 12.0, 5.0, 3.0
"""Way beyond an obstacle until the ego is back, the least speed counted on, and the time to spare before who comes."""
WALKER_SPARE_S, WALKING_MPS = 2.0, 0.3
COVER_MPS, COVER_MPS2 = 4.5, 2.0
"""How fast one may be where somebody could step out from behind a long vehicle, and how one gets as slow as that."""


class RandomChooser:
    """Any of the options, all alike: what a row of the table is worth that knows nothing."""

    def __init__(self, seed: int = 0) -> None:
        self._seed = seed
        self._rng = np.random.default_rng(seed)

    def start(self, mission: Mission) -> None:
        goal = f"{mission.route} {mission.goal.x_m:.3f} {mission.goal.y_m:.3f}"
        self._rng = np.random.default_rng((self._seed, zlib.crc32(goal.encode())))

    def choose(
        self,
        scene: DecisionScene,  # noqa: ARG002
        options: tuple[Behaviour, ...],
        now: Behaviour | None,  # noqa: ARG002
    ) -> tuple[Behaviour, float]:
        return options[int(self._rng.integers(len(options)))], 0.0


class RuleChooser:
    """A few rules: merge into gaps that are large enough, pass when nobody comes, wait for who walks into the road.

    A yardstick for language models, and what others' rollouts go on with.
    """

    def start(self, mission: Mission) -> None:
        self._length_m = mission.shape.length_m

    def choose(
        self, scene: DecisionScene, options: tuple[Behaviour, ...], now: Behaviour | None
    ) -> tuple[Behaviour, float]:
        if Behaviour.STOP in options and (_must_wait(scene, self._length_m) or _too_fast(scene)):
            return Behaviour.STOP, 0.0
        merges = [(Behaviour.MERGE_LEFT, scene.left), (Behaviour.MERGE_RIGHT, scene.right)]
        merges.sort(key=lambda each: each[0] is not now)  # what is under way comes first
        for behaviour, lane in merges:
            share = UNDER_WAY if behaviour is now else 1.0
            if behaviour in options and lane is not None and _gap(scene, lane, share):
                return behaviour, 0.0
        blocked = scene.current.blocked
        if Behaviour.OVERTAKE in options and blocked is not None and self._may_pass(scene, blocked, now):
            return Behaviour.OVERTAKE, 0.0
        rest = (Behaviour.FOLLOW, Behaviour.STOP)
        return next((behaviour for behaviour in rest if behaviour in options), options[0]), 0.0

    def _may_pass(self, scene: DecisionScene, blocked: BlockedLane, now: Behaviour | None) -> bool:
        if not blocked.against_traffic or scene.oncoming is None:
            return True
        if now is Behaviour.OVERTAKE and blocked.gap_m <= 0.0:
            return True
        way_m = blocked.end_m - scene.current.arc_m + self._length_m + PASSING_M
        takes_s = way_m / max(0.5 * (scene.speed_mps + scene.limit_mps), PASSING_MPS)
        return scene.oncoming.meets_in_s > takes_s + PASSING_SPARE_S


def _gap(scene: DecisionScene, lane: LaneView, share: float) -> bool:
    ahead_mps = scene.speed_mps if lane.ahead is None else lane.ahead.speed_mps
    behind_mps = 0.0 if lane.behind is None else max(lane.behind.speed_mps, 0.0)
    before_m, behind_m = clearances_needed_m(GAPS, scene.speed_mps, ahead_mps, behind_mps)
    free_ahead = lane.ahead is None or lane.ahead.gap_m > share * float(before_m)
    return free_ahead and (lane.behind is None or lane.behind.gap_m > share * float(behind_m))


def _must_wait(scene: DecisionScene, length_m: float) -> bool:
    """Whether a pedestrian is about to be where the ego is then."""
    for walker in scene.walkers:
        arrives_s = walker.ahead_m / max(scene.speed_mps, 1.0)
        in_lane = abs(walker.aside_m) < 2.0 and not _shielded(scene, walker, length_m)
        comes = (
            walker.towards_mps > WALKING_MPS and abs(walker.aside_m) / walker.towards_mps < arrives_s + WALKER_SPARE_S
        )
        if (in_lane or comes) and arrives_s < WALKER_SPARE_S + scene.speed_mps / 2.0:
            return True
    return False


def _too_fast(scene: DecisionScene) -> bool:
    """Whether the ego must begin to slow down for who might step out before a long vehicle, within the next second."""
    slow_m = max(scene.speed_mps**2 - COVER_MPS**2, 0.0) / (2.0 * COVER_MPS2)
    return slow_m > 0.0 and any(cover.ahead_m < slow_m + scene.speed_mps for cover in scene.covers)


def _shielded(scene: DecisionScene, walker: Walker, length_m: float) -> bool:
    """Whether who stands there, at work perhaps, is among what blocks the lane, and so is passed with it."""
    blocked = scene.current.blocked
    at_m = scene.current.arc_m + length_m / 2 + walker.ahead_m
    return blocked is not None and abs(walker.towards_mps) <= WALKING_MPS and blocked.start_m < at_m < blocked.end_m


class ModelChooser:
    """A language model, asked in words.

    The options are enforced: an answer that was not offered is as good as
    none. Then what is being done goes on, if it is still offered, else the
    first option is taken.
    """

    def __init__(
        self,
        model: LanguageModel,
        *,
        memory: bool = False,
        thoughts: bool = False,
        real_time: bool = False,
        timeout_s: float = 60.0,
        seed: int = 0,
    ) -> None:
        """`memory` tells the model its last decisions, `thoughts` lets it write before it answers.

        `real_time` has an answer take effect when it would have come; else the
        world waits for it. `seed` goes along with each question.
        """
        check_timeout(timeout_s)
        self.model = model
        self.memory = memory
        self.thoughts = thoughts
        self.real_time = real_time
        self.timeout_s = timeout_s
        self.seed = seed
        self.exchanges: list[Exchange] = []
        """Of the episode."""
        self._past: list[tuple[float, Behaviour]] = []

    def start(self, mission: Mission) -> None:  # noqa: ARG002
        self.exchanges = []
        self._past = []

    def request(self, scene: DecisionScene, options: tuple[Behaviour, ...]) -> Request:
        """The question as it is put."""
        return Request(
            messages(scene, options, self._past if self.memory else (), thoughts=self.thoughts),
            choices=tuple(str(option) for option in options),
            vocabulary=tuple(str(behaviour) for behaviour in Behaviour if behaviour not in options),
            constrained=not self.thoughts,
            max_tokens=THOUGHT_TOKENS if self.thoughts else CHOICE_TOKENS,
            seed=self.seed,
            timeout_s=self.timeout_s,
        )

    def choose(
        self, scene: DecisionScene, options: tuple[Behaviour, ...], now: Behaviour | None
    ) -> tuple[Behaviour, float]:
        request = self.request(scene, options)
        reply, failed = None, None
        try:
            reply = self.model.ask(request)
        except ModelFailure as failure:
            failed, reply = failure, failure.reply
            chosen = now if now is not None and now in options else options[0]
            latency_s = failure.latency_s
        else:
            assert reply.choice is not None
            chosen, latency_s = Behaviour(reply.choice), reply.latency_s
        self._past.append((scene.time_s, chosen))
        self.exchanges.append(Exchange(scene.time_s, request, reply, failed, str(chosen)))
        return chosen, latency_s if self.real_time else 0.0
