"""Metric: a function that judges a drive, what people are told of it, and what it returns.

A metric is one function of `Facts` under `@metric()`, named in the entry points `interplan_sumo.metrics` of its
package. Profiles, tables, pages and replays need nothing else.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.registry import Registry

if TYPE_CHECKING:
    from interplan_sumo.metrics.facts import Facts


@dataclass(frozen=True, eq=False)
class MetricResult:
    """One metric of one drive."""

    score: float | None
    """0 to 1; None where the metric informs only, or cannot be judged."""
    detail: Mapping[str, Any] = field(default_factory=dict)
    """Figures behind the score; plain numbers, texts, lists and dicts once through `plain`."""
    series: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    """Signals with one value per frame, for plots and debugging."""
    reason: str | None = None
    """One sentence where points are lost: what, when, with whom."""


Judge = Callable[["Facts"], MetricResult]
FrameOfLoss = Callable[["Facts", MetricResult], int]


def last_frame(facts: Facts, _: MetricResult) -> int:
    """The end of the drive, where nothing tells of an earlier loss."""
    return facts.frames - 1


@dataclass(frozen=True, slots=True)
class Metric:
    """A metric with what reports say of it; called like the function that it is made from."""

    judge: Judge
    title: str
    """A few words for tables and pages."""
    failure: str
    """What is said before the reason where points were lost, such as "goal lane missed"."""
    informative: bool
    """Worked out for every drive, whatever the profile; it has no score."""
    lost_at: FrameOfLoss
    """The frame in which points were lost; asked only where some were."""

    def __call__(self, facts: Facts) -> MetricResult:
        """What the function says of a drive; asked once, however many profiles and metrics want it."""
        known: dict[object, MetricResult] = facts.results
        if self.judge not in known:
            known[self.judge] = self.judge(facts)
        return known[self.judge]


def metric(
    *, title: str = "", failure: str = "", informative: bool = False, lost_at: FrameOfLoss = last_frame
) -> Callable[[Judge], Metric]:
    """Make a function a metric; title and failure are the words of its name unless they are given."""

    def made(judge: Judge) -> Metric:
        words = getattr(judge, "__name__", "metric").replace("_", " ")
        return Metric(judge, title or words, failure or title or words, informative, lost_at)

    return made


METRICS: Final[Registry[Metric]] = Registry("interplan_sumo.metrics", "metric", Metric)
"""Every installed metric by name."""


def failure_words(name: str) -> str:
    """What is said of a metric that lost points; the words of its name if it is not installed here."""
    return METRICS[name].failure if name in METRICS else name.replace("_", " ")


def lost_frame(name: str, facts: Facts, result: MetricResult) -> int:
    """The frame in which a metric lost its points; the last one if it is not installed here."""
    return METRICS[name].lost_at(facts, result) if name in METRICS else last_frame(facts, result)


def informative_metrics() -> tuple[str, ...]:
    """Names of those that are reported beside the score, never in it."""
    return tuple(name for name in METRICS if METRICS[name].informative)


def plain(value: Any) -> Any:
    """The same value in JSON's types; numbers that are not finite become None."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value
