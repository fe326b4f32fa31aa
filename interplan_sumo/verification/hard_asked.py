"""What was asked of a hard search, kept in its folder: no other search takes the place of the scenes there."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

import msgspec

from interplan_sumo.errors import InputError
from interplan_sumo.maps.store import MapFiles
from interplan_sumo.metrics.score import SCORING_VERSION
from interplan_sumo.planner_source import PlannerSource
from interplan_sumo.simulation.traffic import TRAFFIC_VERSION
from interplan_sumo.verification.generation import SCENARIOS
from interplan_sumo.verification.hard_search import HardOptions
from interplan_sumo.world.files import OTHER_FOLDER, replacing, writing

ASKED: Final = "search.json"


class HardAsked(msgspec.Struct, frozen=True):
    """What the scenes of a hard search depend on, but for the code of the search."""

    families: dict[str, int]
    """How many scenes of each."""
    against: dict[str, str]
    """The panel, each with a hash over what makes it what it is."""
    maps: dict[str, str]
    """Each with a hash over its files."""
    seed: str
    """The tag that stands in the ids: a secret seed is not told."""
    difficulty: float
    plausibility: float
    budget: int
    scoring: int = SCORING_VERSION
    traffic: int = TRAFFIC_VERSION

    @classmethod
    def of(cls, every: Sequence[HardOptions], maps: Iterable[MapFiles]) -> HardAsked:
        """Of the searches of some families, alike but for the family and its share."""
        first = every[0]
        return cls(
            {each.family: each.count for each in every},
            {name: PlannerSource.of(name).hash[:12] for name in first.panel},
            {files.name: files.hash()[:12] for files in maps},
            first.seed.tag, first.least_difficulty, first.least_plausibility, first.most_judged,
        )  # fmt: skip

    def differences(self, now: HardAsked) -> list[str]:
        """What is not as it was, in words; a larger budget only goes on."""
        names = [name for name in self.__struct_fields__ if getattr(self, name) != getattr(now, name)]
        changed = [name for name in names if name != "budget" or now.budget < self.budget]
        return [f"{name} {_words(getattr(self, name))}, asked {_words(getattr(now, name))}" for name in changed]

    def check(self, folder: Path) -> None:
        """InputError if the folder holds scenes of something else than this search."""
        if not (folder / SCENARIOS).exists():
            return
        try:
            held = msgspec.json.decode((folder / ASKED).read_bytes(), type=HardAsked)
        except (OSError, msgspec.DecodeError):
            raise InputError(
                f"{folder / SCENARIOS} exists, and no {ASKED} beside it says of which search it is; {OTHER_FOLDER}"
            ) from None
        if changed := held.differences(self):
            raise InputError(f"{folder} holds the scenes of another search ({'; '.join(changed)}); {OTHER_FOLDER}")

    def write(self, folder: Path) -> None:
        """Keep it in the folder, made if needed; InputError if that cannot be."""
        with writing(folder, OTHER_FOLDER):
            folder.mkdir(parents=True, exist_ok=True)
            with replacing(folder / ASKED) as fresh:
                fresh.write_bytes(msgspec.json.format(msgspec.json.encode(self), indent=1) + b"\n")


def _words(value: object) -> str:
    return ", ".join(f"{name} {each}" for name, each in value.items()) if isinstance(value, dict) else str(value)
