"""Stop rule: kilometres end by themselves, after the first batch at whose end a rate is known as well as wanted.

Batches are of `BATCH` segments by their numbers, so where it ends does not hang
on workers or kills. The intervals are those of `looks`, which pay for every look
before them; after each batch is said how far it still is, in all and for each of
the strata that make the rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from interplan_sumo.endurance.looks import HoursNeeded, RateLook, hours_needed, looks, stopped_at
from interplan_sumo.endurance.rate_sample import MeasureKey, Stratum
from interplan_sumo.endurance.rates import DrivenRates, endurance_rates
from interplan_sumo.endurance.records import SegmentRecord
from interplan_sumo.errors import InputError

BATCH: Final = 25
"""Segments from one look to the next."""
STRATA: Final[tuple[Stratum, ...]] = ("total", "ordinary", "rare")


@dataclass(frozen=True, slots=True)
class StopRule:
    """When kilometres are enough. InputError for a half-width that cannot be."""

    half_width: float
    """Over the rate, such as 0.3."""
    measure: MeasureKey = "at_fault_collision"
    batch: int = BATCH

    def __post_init__(self) -> None:
        if not 0.01 <= self.half_width <= 2.0:
            raise InputError(f"--until-half-width is {self.half_width:g} of the rate, expected 0.01 to 2")

    def planned(self, done: Sequence[SegmentRecord], most: int) -> int:
        """How many segments are to be driven: up to the end of the next batch, or to where the rate was known.

        `done` are those of one planner, cell and seed, in any order; `most` are as many as the distance allows.
        """
        look = self.stop(done)
        if look is not None:
            return min(look.segments, most)
        return min(self.whole(done) + self.batch, most)

    def whole(self, done: Sequence[SegmentRecord]) -> int:
        """How many segments make whole batches, from the first one on."""
        there = {each.index for each in done}
        upto = next(n for n in range(len(there) + 1) if n not in there)
        return upto - upto % self.batch

    def stop(self, done: Sequence[SegmentRecord]) -> RateLook | None:
        """The look that ends it; None before that."""
        return stopped_at(done, self.measure, self.batch, self.half_width)

    def last_look(self, done: Sequence[SegmentRecord]) -> RateLook | None:
        """The first one at which the rate is known, else the last one; None where no batch had an interval."""
        found = looks(done, self.measure, self.batch, self.half_width)
        return next((each for each in found if each.half_width <= self.half_width), found[-1] if found else None)

    def standing(self, done: Sequence[SegmentRecord]) -> StopStanding:
        """How far it is, after the batches that are whole."""
        upto = self.whole(done)
        records = [each for each in done if each.index < upto]
        metres = sum(each.metres for each in records)
        if not metres > 0.0:
            return StopStanding(self, upto, metres, None, {})
        driven = endurance_rates(records, only=(self.measure,)).planners[0]
        return StopStanding(self, upto, metres, self.last_look(records), self._needed(driven))

    def _needed(self, driven: DrivenRates) -> dict[Stratum, HoursNeeded]:
        every = ((stratum, hours_needed(driven, self.measure, self.half_width, stratum)) for stratum in STRATA)
        return {stratum: needed for stratum, needed in every if needed is not None}


@dataclass(frozen=True, slots=True)
class StopStanding:
    """How well a rate is known after a batch, and what it takes until it is known as well as wanted."""

    rule: StopRule
    segments: int
    metres: float
    look: RateLook | None
    """The last one; None where there is no interval yet."""
    needed: dict[Stratum, HoursNeeded]
    """In all, what was driven included; without those strata in which nothing has happened."""

    @property
    def known(self) -> bool:
        """Whether it ends here."""
        return self.look is not None and self.look.half_width <= self.rule.half_width
