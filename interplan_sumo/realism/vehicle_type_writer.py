"""Drawn drivers as a vehicle-type file that SUMO and the benchmark read."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final
from xml.sax.saxutils import escape

from interplan_sumo.realism.driver_population import QUALITIES
from interplan_sumo.realism.published import RELAXATION_S
from interplan_sumo.world.files import writing
from interplan_sumo.world.geometry import Floats

LANE_WIDTH_M: Final = 3.5
"""What a lane change covers sideways."""
ASSERTIVE: Final = (0.5, 2.0)
"""Of lcAssertive: beyond, whoever is cut in on brakes by more than four times its `accel`, or nobody ever changes."""
WAVERS: Final = 0.68
"""Root mean square acceleration of EIDM's drivers who keep their speed, over `sigmaerror` times `accel`: as measured in
plain traffic."""
ERROR: Final = 0.25
"""Largest `sigmaerror`. EIDM's error stands still below 3 m/s: with more, too many would crawl on and on."""
REACTION_S: Final = 0.2
"""Behind a leader no longer delay shows in recordings."""
PERSISTS_S: Final = 2.0
"""How long its errors last: with 3 s, its default, jerks are too small."""
_HEAD: Final = '<?xml version="1.0" encoding="UTF-8"?>\n'
_FIXED: Final = (
    'vClass="passenger" carFollowModel="EIDM" length="4.6" width="1.85" height="1.5" emergencyDecel="9.0" maxSpeed="55"'
)
SIDEWAYS_M: Final = 0.3
"""SUMO's `lcSigma`, which lets drivers sway within the lane: then who drives straight on yaws as people do."""
_LANES: Final = (
    f'speedDev="0" lcKeepRight="0" lcSigma="{SIDEWAYS_M}" lcOpposite="0" lcMaxSpeedLatStanding="0" '
    'lcMaxSpeedLatFactor="1"'
)


def vehicle_type_text(drivers: Floats, waver_mps2: float, comment: Sequence[str]) -> str:
    """A file with a distribution `traffic` of one type for each drawn driver (N, 8), and a comment at its head.

    All waver alike: a record of some seconds does not tell who wavers more.
    """
    lines = "\n     ".join(re.sub("-(?=-)", "- ", escape(line)) for line in comment)  # no comment of XML holds two
    types = "".join(_type(number, driver, waver_mps2) for number, driver in enumerate(drivers))
    distribution = f'    <vTypeDistribution id="traffic">\n{types}    </vTypeDistribution>\n'
    return f"{_HEAD}<!-- {lines} -->\n<additional>\n{distribution}</additional>\n"


def write_vehicle_types(path: Path, text: str) -> None:
    """InputError where it cannot be written."""
    with writing(path):
        path.write_text(text, encoding="utf-8")


def _type(number: int, driver: Floats, waver_mps2: float) -> str:
    of = dict(zip(QUALITIES, driver.tolist(), strict=True))
    assertive = min(max(of["time_gap_s"] / of["critical_gap_s"], ASSERTIVE[0]), ASSERTIVE[1])
    error = min(waver_mps2 / (WAVERS * of["accel_mps2"]), ERROR)
    aside_mps = LANE_WIDTH_M / of["lane_change_s"]
    return (
        f'        <vType id="driver_{number:03}" {_FIXED}\n'
        f'               tau="{of["time_gap_s"]:.3f}" minGap="{of["standstill_gap_m"]:.2f}" '
        f'accel="{of["accel_mps2"]:.3f}" decel="{of["decel_mps2"]:.3f}" speedFactor="{of["speed_factor"]:.3f}"\n'
        f'               sigmaerror="{error:.3f}" tPersDrive="{PERSISTS_S}" treaction="{REACTION_S}"\n'
        f'               lcAssertive="{assertive:.2f}" maxSpeedLat="{aside_mps:.3f}" {_LANES}>\n'
        f'            <param key="interplan.reactionTime" value="{of["reaction_s"]:.2f}"/>\n'
        f'            <param key="interplan.relaxation" value="{RELAXATION_S}"/>\n'
        "        </vType>\n"
    )
