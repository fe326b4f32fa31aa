"""LLM waypoints: once a second a language model writes a trajectory of 8 s; the tracker follows it."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from interplan_llm.models.exchanges import Exchange, usage_stats
from interplan_llm.models.protocol import LanguageModel, Message, ModelFailure, Request, check_timeout
from interplan_llm.models.spec import open_model
from interplan_llm.models.store import Mode
from interplan_llm.waypoints.answers import kept_up_with, trajectory, waypoints
from interplan_llm.waypoints.form import GRAMMAR, POINTS, SCHEMA, STEP_S, answer_text
from interplan_llm.waypoints.prompt import Prompter
from interplan_llm.waypoints.thoughts import thoughts as thoughts_by_rules
from interplan_planners.common.paths import braking_plan
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.trajectory import Trajectory

ANSWER_TOKENS = 512
"""Longest answer (the published number)."""
KEPT_S = 3.0
"""So long an old plan is driven on when no new one comes; then the car brakes."""
BRAKING_MPS2 = 2.5


class LlmWaypointsPlanner:
    """In the manner of GPT-Driver, as the paper has it: perception as text in, thoughts and 16 waypoints out.

    Other than published: the frame of the prompt is the frame of the numbers,
    headings follow the waypoints, the answer is JSON and never evaluated, the own lane's
    line is told unless `centerline` is false, a plan that the car cannot keep up
    with is moved along with it, and without a usable answer the last plan is
    driven on for 3 s, then the car brakes.
    """

    paper: ClassVar[str] = "Hallgarten et al. 2024, after Mao et al. 2023"

    def __init__(
        self,
        model: str = "embedded",
        store: str | None = None,
        mode: Mode = "record",
        every_s: float = 1.0,
        centerline: bool = True,
        real_time: bool = False,
        timeout_s: float = 120.0,
        threads: int = 1,
    ) -> None:
        """`model`, `store` and `mode` as docs/language_models.md says."""
        if not every_s > 0.0:
            raise ValueError(f"every_s is {every_s}, expected more than 0")
        check_timeout(timeout_s)
        self.model: LanguageModel = open_model(model, store=store, mode=mode, threads=threads)
        self.every_s = every_s
        self.centerline = centerline
        self.real_time = real_time
        self.timeout_s = timeout_s
        self.exchanges: list[Exchange] = []
        """Of the episode."""

    def start(self, mission: Mission) -> None:
        self._prompter = Prompter(mission, centerline=self.centerline)
        self._shape = mission.shape
        self._asks_at_s = -np.inf
        self._pending: tuple[float, Trajectory] | None = None
        self._now: Trajectory | None = None
        self.exchanges = []

    def plan(self, observation: Observation) -> Trajectory:
        self._take(observation.time_s)
        if observation.time_s >= self._asks_at_s - 1e-6:
            self._ask(observation)
            self._take(observation.time_s)
        if self._now is None or observation.time_s > float(self._now.time_s[0]) + KEPT_S:
            return braking_plan(observation.ego, BRAKING_MPS2, POINTS * STEP_S, 0.1)
        self._now = kept_up_with(self._now, observation.ego)
        return self._now

    def request(self, observation: Observation) -> Request:
        """The question as it is put."""
        return Request(
            self._prompter.messages(observation),
            schema=SCHEMA,
            grammar=GRAMMAR,
            max_tokens=ANSWER_TOKENS,
            timeout_s=self.timeout_s,
        )

    def example(
        self, observation: Observation, places: Floats, thoughts: str | None = None
    ) -> tuple[Message, Message, Message]:
        """A step with the answer that would have been right, for fine-tuning; asked as if the episode began there.

        Places (16, 2) are in the car's frame; `thoughts` come from rules if
        none are given. ValueError for an answer that the grammar does not have.
        """
        said = thoughts_by_rules(observation, places, self._shape) if thoughts is None else thoughts
        return *self._prompter.messages(observation), Message("assistant", answer_text(said, places))

    def report(self) -> dict[str, Any]:
        """How often the model was asked in this episode, and how often in vain."""
        return usage_stats(self.exchanges)

    def _take(self, now_s: float) -> None:
        """Drive what was answered, once the answer is there."""
        if self._pending is not None and now_s >= self._pending[0] - 1e-6:
            self._now = self._pending[1]
            self._pending = None

    def _ask(self, observation: Observation) -> None:
        """Put a question; in real time the next one waits until this one is answered."""
        request = self.request(observation)
        try:
            reply = self.model.ask(request)
            plan = trajectory(waypoints(reply), observation.ego)
        except ModelFailure as failure:
            self.exchanges.append(
                Exchange(observation.time_s, request, failure.reply, failure, "the last plan, or braking")
            )
            delay_s = self._delay_s(failure.latency_s)
        else:
            self.exchanges.append(Exchange(observation.time_s, request, reply, None, "the waypoints"))
            delay_s = self._delay_s(reply.latency_s)
            self._pending = (observation.time_s + delay_s, plan)
        self._asks_at_s = observation.time_s + max(self.every_s, delay_s)

    def _delay_s(self, latency_s: float) -> float:
        """Until an answer is there in the episode's time; the first plan is waited for."""
        return latency_s if self.real_time and self._now is not None else 0.0
