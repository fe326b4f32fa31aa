"""Completion: what the shell offers for a word, and what bash makes of words with `=` and `:`."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final

VARIABLE: Final = "_INTERPLAN_SUMO_COMPLETE"
_BREAKS: Final = re.compile(r"[=:]+")


def starting(names: Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    """The completion of an option that takes one of some names."""
    return lambda incomplete: [name for name in names() if name.startswith(incomplete)]


def planner_names(incomplete: str) -> list[str]:
    from interplan_sumo.planner import PLANNERS

    return [name for name in PLANNERS if name.startswith(incomplete)]


def scenario_ids(incomplete: str) -> list[str]:
    from interplan_sumo.scenario.suite import ids_of, suites

    return sorted({id for key in suites() for id in ids_of(key) if id.startswith(incomplete)})


def suite_names(incomplete: str) -> list[str]:
    from interplan_sumo.scenario.suite import suites

    return [key for key in suites() if key.startswith(incomplete)]


def scenes(incomplete: str) -> list[str]:
    """Ids, or whole suites."""
    return [*suite_names(incomplete), *scenario_ids(incomplete)]


def profile_names(incomplete: str) -> list[str]:
    from interplan_sumo.metrics.profile import PROFILES

    return [name for name in PROFILES if name.startswith(incomplete)]


def measure_names(incomplete: str) -> list[str]:
    """Of rates."""
    from interplan_sumo.endurance.rate_sample import MEASURES

    return [name for name in MEASURES if name.startswith(incomplete)]


def map_names(incomplete: str) -> list[str]:
    from interplan_sumo.maps.store import maps

    return [name for name in maps() if name.startswith(incomplete)]


def settings(incomplete: str) -> list[str]:
    """`KEY=VALUE` for --set; perceptions are joined by +."""
    from interplan_sumo.scenario.scenario import PERCEPTIONS

    held, plus, _ = incomplete.rpartition("+")
    every = [f"{key}={value}" for key, known in _worded().items() for value in known]
    if plus and held.startswith("perception="):
        every = [f"{held}+{value}" for value in PERCEPTIONS if value not in held]
    return [each for each in every if each.startswith(incomplete)]


def sweep_parameters(incomplete: str) -> list[str]:
    """`KEY=V1,V2,...` for --param: keys; after `=` and commas the values that have names and were not given yet."""
    from interplan_sumo.batch.traffic_files import sweepable

    key, equals, listed = incomplete.partition("=")
    worded = {each: values for each, values in _worded().items() if each != "perception"}
    if not equals:
        return [f"{each}=" for each in (*worded, *sorted(sweepable())) if each.startswith(key)]
    *given, last = listed.split(",")
    free = [value for value in worded.get(key, ()) if value not in given and value.startswith(last)]
    return [f"{key}={','.join([*given, value])}" for value in free]


def _worded() -> dict[str, tuple[str, ...]]:
    """What can be changed in traffic and perception, and the values that have names."""
    from interplan_sumo.batch.options import DENSITIES
    from interplan_sumo.resources import routes_root
    from interplan_sumo.scenario.scenario import PERCEPTIONS

    return {
        "density": tuple(DENSITIES),
        "behaviour": tuple(sorted(path.stem for path in routes_root().glob("*.xml"))),
        "perception": ("full", *PERCEPTIONS),
    }


def run_folders(incomplete: str) -> list[str]:
    """Run folders at the place that was typed, and one level below; none leaves it to the shell to complete files."""
    return _folders_with("manifest.json", incomplete)


def endure_folders(incomplete: str) -> list[str]:
    """Folders of `endure`, as `run_folders`."""
    return _folders_with("endure.json", incomplete)


def _folders_with(name: str, incomplete: str) -> list[str]:
    above, slash, _ = incomplete.rpartition("/")
    place = Path(above + slash) if slash else Path()
    files = (file for pattern in ("*", "*/*") for file in place.glob(f"{pattern}/{name}"))
    found = (f"{above}{slash}{each.parent.relative_to(place)}" for each in files)
    return sorted(each for each in found if each.startswith(incomplete))


class BashWords:
    """The words of a command line in bash, which breaks them at `=` and `:` and replaces what follows a break."""

    def __init__(self, words: list[str], at: int) -> None:
        """`at` is the number of the word that is completed."""
        self.words: list[str] = []
        glue = False
        for word in words[: at + 1]:
            broken = _BREAKS.fullmatch(word) is not None
            if self.words and (glue or broken):
                self.words[-1] += word
            else:
                self.words.append(word)
            glue = broken
        last = [each.end() for each in _BREAKS.finditer(self.words[-1])] if self.words else []
        self.kept = last[-1] if last else 0
        """How many characters of the word bash keeps itself."""

    @classmethod
    def of_environment(cls) -> BashWords | None:
        """As bash tells them; None if it is not bash that asks."""
        if os.environ.get(VARIABLE) != "complete_bash":
            return None
        return cls(os.environ.get("COMP_WORDS", "").split("\n"), int(os.environ.get("COMP_CWORD") or 0))

    def tell(self) -> None:
        """Put them where the completion looks for them."""
        os.environ |= {"COMP_WORDS": "\n".join(self.words), "COMP_CWORD": str(len(self.words) - 1)}

    def answer(self, offered: str) -> str:
        """What was offered, a line each, as bash puts it in."""
        return "\n".join(line[self.kept :] for line in offered.splitlines())
