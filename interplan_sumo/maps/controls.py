"""What a map takes over from the file that it was imported from: signal programs and right of way.

nuPlan's schema has no place for them, so they lie beside the map in
`controls.json`; the SUMO network is made from both.
"""

from __future__ import annotations

import json
from collections.abc import Container, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import msgspec

from interplan_sumo.errors import MapError
from interplan_sumo.maps.signal_program import SignalProgram

CONTROLS_FILE = "controls.json"
CONTROLS_FORMAT = 1
YIELDS, GOES, APART, OPEN = "y", "g", ".", "?"
"""Of a pair of connectors: the first yields to the second; they meet and it does not; they do not meet; not known."""

_Rule = Annotated[str, msgspec.Meta(pattern="^[yg.?]*$")]
_Letter = Annotated[str, msgspec.Meta(pattern="^[A-Za-z=-]?$")]
_Link = tuple[str, Annotated[int, msgspec.Meta(ge=0)]]


@dataclass(frozen=True, slots=True)
class JunctionRules:
    """Who goes first among some connectors."""

    id: str
    """The junction in the file."""
    kind: str
    """SUMO's type of junction; empty where it follows from the rules."""
    connectors: tuple[str, ...]
    letters: tuple[_Letter, ...]
    """Per connector SUMO's state of a link without a working light; empty where it follows from the rules."""
    rules: tuple[_Rule, ...]
    """Per connector a row with a letter for each one (`YIELDS`, `GOES`, `APART`, `OPEN`)."""
    meets_known: bool = True
    """Whether the rules say who meets whom; else geometry does, and they say who yields if two meet."""

    def __post_init__(self) -> None:
        count = len(self.connectors)
        if len(self.letters) != count or len(self.rules) != count or any(len(row) != count for row in self.rules):
            raise MapError(f"junction {self.id}: {count} connectors need a square of as many rules")

    def within(self, connectors: Container[str]) -> JunctionRules:
        """Only what concerns some connectors."""
        kept = [row for row, id_ in enumerate(self.connectors) if id_ in connectors]
        return replace(
            self,
            connectors=tuple(self.connectors[row] for row in kept),
            letters=tuple(self.letters[row] for row in kept),
            rules=tuple("".join(self.rules[row][column] for column in kept) for row in kept),
        )


@dataclass(frozen=True, slots=True)
class MapControls:
    """Signal programs and right of way of a map, by its connectors."""

    signals: Mapping[str, tuple[SignalProgram, ...]] = field(default_factory=dict[str, tuple[SignalProgram, ...]])
    """Traffic light -> its programs, of which the last one runs."""
    links: Mapping[str, _Link] = field(default_factory=dict[str, _Link])
    """Connector -> (traffic light, index of its letter in the states)."""
    junctions: tuple[JunctionRules, ...] = ()

    def __post_init__(self) -> None:
        for connector, (light, index) in self.links.items():
            if any(index >= len(phase.state) for each in self.signals[light] for phase in each.phases):
                raise MapError(f"connector {connector} has no letter {index} in the states of traffic light {light}")

    def lighting(self, connectors: Container[str]) -> MapControls:
        """With the lights of some connectors only."""
        links = {id_: link for id_, link in self.links.items() if id_ in connectors}
        used = {light for light, _ in links.values()}
        return replace(self, signals={key: each for key, each in self.signals.items() if key in used}, links=links)

    def within(self, connectors: Container[str]) -> MapControls:
        """Only what concerns some connectors."""
        junctions = tuple(rest for each in self.junctions if (rest := each.within(connectors)).connectors)
        return replace(self.lighting(connectors), junctions=junctions)

    def write(self, folder: Path) -> None:
        """Write `controls.json` into a folder, or remove it if there is nothing to say; equal controls, equal bytes."""
        path = folder / CONTROLS_FILE
        if not (self.signals or self.junctions):
            path.unlink(missing_ok=True)
            return
        content = {"version": CONTROLS_FORMAT, **msgspec.to_builtins(self)}
        path.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8", newline="\n")


def read_controls(folder: Path) -> MapControls:
    """The controls of the map in a folder, empty where it has none; MapError if they are damaged."""
    path = folder / CONTROLS_FILE
    try:
        content = msgspec.json.decode(path.read_bytes(), type=dict[str, Any])
        if content.get("version") != CONTROLS_FORMAT:
            raise MapError(f"version {content.get('version')!r}, expected {CONTROLS_FORMAT}")
        return msgspec.convert(content, MapControls)
    except FileNotFoundError:
        return MapControls()
    except (OSError, ValueError, KeyError, RecursionError, MapError) as error:
        raise MapError(f"{path} does not hold the controls of a map ({error}); import the map again") from None
