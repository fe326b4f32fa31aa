"""Rare events: whether one begins now, drawn with boosted probabilities, and the weight that makes up for it.

A rare event of a kind can begin where the state of the traffic gives it an
opportunity. In each second and at each opportunity a uniform number u is drawn,
and the event begins if u < q, where naturally it would if u < p. What then
happens is as probable as in natural traffic but for these draws, so a mean over
boosted segments, each weighted by

    product over the draws of  p / q where it began, (1 - p) / (1 - q) where not,

is that over natural ones (importance sampling; Owen, Monte Carlo theory,
methods and examples, 2013, chapter 9; of driving: Feng et al., Nature
Communications 12:748, 2021). The weight is a martingale with the mean 1, so it
may be stopped at an event: draws after it cannot have caused it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from hashlib import blake2b
from typing import Final

from interplan_sumo.endurance.records import Counts, RareKind
from interplan_sumo.errors import InputError

MOST_PROBABLE: Final = 0.3
"""Boosted probabilities are no greater: 1 / (1 - q) of each draw that passes would let weights explode."""


@dataclass(frozen=True, slots=True)
class BegunRareEvent:
    """A rare event that begins now, and the weight of the segment before and with its draw."""

    kind: RareKind
    opportunity: str
    weight_before: float
    weight: float
    passed: Counts
    """Draws since the start of the segment in which nothing began."""


class RareEventDraws:
    """The draws of one segment; asked once per second.

    At most one event begins at a time. Opportunities of one second are tried in
    an order that is drawn, too, so that none is preferred, until one begins.
    Those after it are not drawn: their numbers have no say in what happens, and
    none in the weight.
    """

    def __init__(
        self,
        segment_seed: int,
        natural: Mapping[RareKind, float],
        boosted: Mapping[RareKind, float] | None = None,
    ) -> None:
        """Naive without `boosted`; a kind that it does not name has its natural probability.

        InputError for a probability outside 0 to 0.3, or a boosted one that is
        less than the natural one or boosts what never happens.
        """
        self.natural: dict[RareKind, float] = {**natural}
        self.drawn_with: dict[RareKind, float] = {**natural, **(boosted or {})}
        for kind, q in self.drawn_with.items():
            if kind not in natural:
                raise InputError(f"{kind} is boosted and has no natural probability; give one")
            _check(kind, natural[kind], q)
        self.weight = 1.0
        """Of all draws so far."""
        self.opportunities: Counts = dict.fromkeys(self.natural, 0)
        """Draws so far."""
        self._passed: Counts = dict.fromkeys(self.natural, 0)
        self._seed = segment_seed

    @property
    def naive(self) -> bool:
        """Whether all probabilities are the natural ones; the weight is then 1 and stays so."""
        return self.natural == self.drawn_with

    def begins(
        self, second: int, opportunities: Mapping[RareKind, Iterable[str]], *, active: bool = False
    ) -> BegunRareEvent | None:
        """What begins in this second, if anything does; nothing is drawn while an event is active.

        `opportunities` are named for as long as they last, each name once. The
        number that is drawn for one depends on the segment's seed, the kind, the
        name and the second only: not on what else there is or was.
        """
        if active:
            return None
        there: list[tuple[int, float, RareKind, str]] = [
            (*_numbers(self._seed, kind, name, second), kind, name)
            for kind, names in opportunities.items()
            if kind in self.natural
            for name in names
        ]
        for _, drawn, kind, name in sorted(there):
            p, q = self.natural[kind], self.drawn_with[kind]
            self.opportunities[kind] += 1
            if drawn < q:
                before, self.weight = self.weight, self.weight * (p / q)
                return BegunRareEvent(kind, name, before, self.weight, self._so_far())
            self._passed[kind] += 1
            self.weight *= (1.0 - p) / (1.0 - q)
        return None

    def _so_far(self) -> Counts:
        return {kind: number for kind, number in self._passed.items() if number}


def boosted_for(
    natural: Mapping[RareKind, float], opportunities: Mapping[RareKind, float], begun: float = 1.0
) -> dict[RareKind, float]:
    """Probabilities with which about so many rare events begin in a segment with so many opportunity-seconds.

    Each kind that has opportunities gets the same share of them, within p and
    0.3. About one event per segment costs least: with L expected ones the
    weight of a segment in which none has begun grows to e^L.
    """
    share = begun / max(sum(opportunities.get(kind, 0.0) > 0.0 and p > 0.0 for kind, p in natural.items()), 1)
    return {
        kind: max(p, min(MOST_PROBABLE, share / opportunities[kind]))
        if p > 0.0 and opportunities.get(kind, 0.0) > 0.0
        else p
        for kind, p in natural.items()
    }


def _check(kind: RareKind, p: float, q: float) -> None:
    if not 0.0 <= p <= MOST_PROBABLE:
        raise InputError(f"{kind} has the probability {p:g} per opportunity and second; give 0 to {MOST_PROBABLE:g}")
    if not p <= q <= MOST_PROBABLE or (p == 0.0 < q):
        raise InputError(
            f"{kind} is boosted from {p:g} to {q:g} per opportunity and second; "
            f"boost what can happen, to no more than {MOST_PROBABLE:g}"
        )


def _numbers(seed: int, kind: RareKind, name: str, second: int) -> tuple[int, float]:
    """Two independent draws: where it stands among the others, and a uniform number in [0, 1).

    A hash as the generator, because each draw has one of its own.
    """
    digest = blake2b(repr((seed, kind, name, second)).encode(), digest_size=16).digest()
    return int.from_bytes(digest[:8]), (int.from_bytes(digest[8:]) >> 11) / 2.0**53
