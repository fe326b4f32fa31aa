"""Tracks: any scenes made harder in one way each, to see how fast a planner falls: a parameter of sweeps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from interplan_sumo.scenario.scenario import Scenario, perception_modes, perception_named

TRACK: Final = "track"
"""The parameter."""
PLAIN: Final = "plain"
"""The scenes as they are."""
TRACKS: Final[Mapping[str, str | None]] = {
    PLAIN: None,
    "noisy": "perception",
    "late": "perception",
    "dense": "density",
    "bold": "behaviour",
}
"""By name, the setting that a track changes."""


def track_settings(track: str, scenario: Scenario) -> dict[str, str]:
    """What a track sets in a scene: errors or delay on top of what hides others already, high density, or those drivers
    of the measured ones that dare most."""
    match TRACKS[track]:
        case "perception":
            modes = [mode for mode in perception_modes(scenario.perception) if mode != track]
            return {"perception": perception_named("+".join([*modes, track]))}
        case "density":
            return {"density": "high"}
        case "behaviour":
            return {"behaviour": "measured_city_bold"}
        case _:
            return {}
