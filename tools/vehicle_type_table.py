"""Drives pairs of vehicle types that differ in one attribute, and writes down which attributes change a drive.

    python -m tools.vehicle_type_table docs/vehicle_types.md

Each attribute of SUMO's schema is driven at two values, scene by scene until the traffic differs; an attribute of one
car-following model is driven with that model. What SUMO is never given is listed with the reason, without a drive.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import cache, partial
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from interplan_sumo.errors import TrafficError
from interplan_sumo.maps.store import load_roads
from interplan_sumo.scenario.route import route_centerline
from interplan_sumo.scenario.suite import find_scenario
from interplan_sumo.simulation.setup import open_sumo_traffic, start_state
from interplan_sumo.simulation.vehicle_type_effects import (
    CANNOT_RUN,
    GENERIC,
    SUBLANE,
    UNUSED,
    WITHOUT_EFFECT,
    car_following_models,
)
from interplan_sumo.simulation.vehicle_type_reader import NUMBERS, PARAMETERS
from interplan_sumo.simulation.vehicle_type_schema import vehicle_type_schema
from interplan_sumo.world.ego import EgoState

SCENES: Final = ("lane_change_htd/3", "overtake/0", "starting_left_turn/0", "stationary_in_traffic/0")
DURATION_S: Final = 12.0
EGO_MPS: Final = 7.0
SLIDES_M: Final = 1.9
"""The ego slides to its left by this, into another lane, after 4 s."""
BASE: Final[Mapping[str, str]] = {
    "accel": "1.5", "decel": "2.5", "emergencyDecel": "9", "tau": "1.2", "minGap": "1.5", "speedDev": "0",
}  # fmt: skip
PAIRS: Final[Mapping[str, tuple[str, str]]] = {
    "vClass": ("passenger", "bus"), "carFollowModel": ("IDM", "Krauss"), "laneChangeModel": ("LC2013", "SL2015"),
    "length": ("4", "6"), "width": ("1.6", "2.4"), "height": ("1.4", "3"), "maxSpeed": ("8", "30"),
    "desiredMaxSpeed": ("8", "30"), "speedFactor": ("0.8", "1.2"), "speedDev": ("0", "0.2"), "minGap": ("1", "4"),
    "tau": ("0.8", "2"), "accel": ("1", "2.5"), "decel": ("1.5", "4"), "emergencyDecel": ("4", "9"),
    "apparentDecel": ("1", "9"), "actionStepLength": ("0.1", "1"), "stepping": ("0.01", "0.1"),
    "impatience": ("0", "1"), "maxSpeedLat": ("0.3", "3"), "latAlignment": ("left", "right"), "sigma": ("0", "0.8"),
    "sigmaStep": ("0.1", "2"), "hasDriverState": ("false", "true"), "vehdynamics": ("false", "true"),
    "maxvehpreview": ("1", "5"), "delta": ("2", "8"), "maxAccelProfile": ("1 1", "3 1"),
    "desAccelProfile": ("1 1", "3 1"),
    "speedTable": ("0 5", "0 30"), "lcStrategic": ("-1", "1"), "lcKeepRight": ("0", "5"), "lcSpeedGain": ("0", "10"),
    "lcCooperative": ("-1", "1"), "lcAssertive": ("0.5", "5"), "cc8": ("0.5", "3.5"),
    "cc9": ("0.5", "3"), "cc3": ("-12", "-4"), "cc4": ("-2", "-0.1"), "treaction": ("0", "2"), "lcOpposite": ("0", "5"),
    "jmDriveAfterYellowTime": ("0", "100"), "jmDriveAfterRedTime": ("0", "100"), "jmDriveRedSpeed": ("1", "20"),
    "jmIgnoreFoeProb": ("0", "1"), "jmIgnoreFoeSpeed": ("0", "20"), "jmIgnoreJunctionFoeProb": ("0", "1"),
    "jmIgnoreKeepClearTime": ("0", "100"), "jmCrossingGap": ("0", "20"), "jmStoplineGap": ("0", "8"),
    "jmStoplineGapMinor": ("0", "8"), "jmTimegapMinor": ("0", "5"), "jmAdvance": ("0", "10"), "jmExtraGap": ("0", "8"),
}  # fmt: skip
"""The two values of an attribute; others are driven at 0.3 and 3, or at what is allowed nearest to that."""
WITH: Final[Mapping[str, Mapping[str, str]]] = {
    "jmDriveRedSpeed": {"jmDriveAfterRedTime": "100"}, "jmIgnoreFoeProb": {"jmIgnoreFoeSpeed": "20"},
    "jmIgnoreFoeSpeed": {"jmIgnoreFoeProb": "1"}, "maxAccelProfile": {"speedTable": "0 30"},
    "desAccelProfile": {"speedTable": "0 30"}, "speedTable": {"maxAccelProfile": "3 1"}, "sigmaStep": {"sigma": "0.8"},
    "maxSpeedLat": {"lcSpeedGain": "10"},
    **{name: {"laneChangeModel": "SL2015"} for name in SUBLANE},
}  # fmt: skip
"""What an attribute needs besides, to act at all."""
TRIED: Final = ("IDM", "Krauss")
"""Models with which an attribute of all models is driven; one of lane changes or junctions with the first only."""
WORKERS: Final = 2


def pair(attribute: str) -> tuple[str, str]:
    """The two values at which an attribute is driven."""
    if attribute in PAIRS:
        return PAIRS[attribute]
    kind = vehicle_type_schema().attributes[attribute]
    lowest, highest = NUMBERS.get(attribute) or kind.bounds()
    low, high = max(0.3, lowest), min(3.0, highest)
    return f"{low:g}", f"{high:g}"


def drive(folder: Path, scene: str, values: Mapping[str, str]) -> str:
    """What the traffic of a scene does in dense traffic of one type, as a hash; what SUMO says where it fails."""
    path = folder / f"{hashlib.sha256(repr(sorted(values.items())).encode()).hexdigest()[:16]}.xml"
    text = " ".join(f'{name}="{value}"' for name, value in {"id": "traffic", **values}.items())
    path.write_text(f"<additional><vType {text}/></additional>")
    try:
        return _driven(scene, path)
    except TrafficError as error:
        return f"fails: {error}"


@cache
def _driven(scene: str, types: Path) -> str:
    found = find_scenario(scene)
    demand = replace(found.traffic, density="high", oncoming="high")
    scenario = replace(found, traffic=demand)
    roads = load_roads(scenario.map, scenario.maps_beside)
    line = route_centerline(roads, scenario)
    begin = start_state(scenario, roads)
    start_m, _ = line.project_point(begin.x_m, begin.y_m)
    digest = hashlib.sha256()
    with open_sumo_traffic(scenario, roads, vehicle_types=types) as traffic:
        now = begin
        for step in range(1, round(DURATION_S / 0.1) + 1):
            time_s = 0.1 * step
            left_m = SLIDES_M * min(max((time_s - 4.0) / 3.0, 0.0), 1.0)
            pose = line.pose_at(min(start_m + EGO_MPS * time_s, line.length_m - 1.0), left_m)
            then = EgoState(time_s, pose.x_m, pose.y_m, pose.heading_rad, vx_mps=EGO_MPS)
            traffic.react(now)
            traffic.place_ego(then)
            traffic.advance()
            actors, now = traffic.observe().actors, then
            for column in (actors.x_m, actors.y_m, actors.heading_rad, actors.vx_mps, actors.vy_mps):
                digest.update(column.round(5).tobytes())
    return digest.hexdigest()


def effect(folder: Path, attribute: str) -> tuple[str, str]:
    """Whether an attribute changes a drive, and where that was seen or why not."""
    for reason, names in UNUSED.items():
        if attribute in names:
            return "no", reason
    if attribute == "probability":
        return "yes", "it weighs the types of a vTypeDistribution"
    readers = [name for name, own in car_following_models().items() if attribute in own]
    refused = [name for name in CANNOT_RUN if attribute in vehicle_type_schema().models.get(name, ())]
    if refused and not readers and attribute not in GENERIC:
        return "no", f"only carFollowModel {', '.join(refused)} reads it, which cannot run here"
    low, high = pair(attribute)
    for model in readers[:2] or TRIED[: 1 if attribute.startswith(("lc", "jm")) else None]:
        besides = {**BASE, "carFollowModel": model, **WITH.get(attribute, {})}
        for scene in SCENES:
            one, other = (drive(folder, scene, {**besides, attribute: value}) for value in (low, high))
            if (fault := next((said for said in (one, other) if said.startswith("fails")), None)) is not None:
                return "fails", f"{scene}, carFollowModel {model}: {fault}"
            if one != other:
                where = f"{scene}, carFollowModel {model}" if attribute != "carFollowModel" else scene
                return "yes", f"{where}: {low} and {high}"
    for reason, names in WITHOUT_EFFECT.items():
        if attribute in names:
            return "no", f"{reason} ({low} and {high} drive alike)"
    return "not seen", f"{low} and {high} drive alike in {len(SCENES)} scenes"


def runs(folder: Path, model: str) -> str:
    """Whether a car-following model drives in all scenes."""
    said = {scene: drive(folder, scene, {**BASE, "carFollowModel": model}) for scene in SCENES}
    faults = [f"{scene} {text}" for scene, text in said.items() if text.startswith("fails")]
    return "; ".join(faults) or f"drives in {len(SCENES)} scenes"


def head() -> str:
    """What the page says first."""
    scenes = ", ".join(f"{scene} {find_scenario(scene).hash()[:8]}" for scene in SCENES)
    return f"""# What acts in a vehicle-type file

Written by `python -m tools.vehicle_type_table docs/vehicle_types.md`; not to be edited by hand.

Each attribute that SUMO's schema has for a vType was driven at two values in dense traffic of one type, beside an ego
that slides half into the lane next to it, {DURATION_S:g} s in each of {len(SCENES)} scenes, until the traffic
of the two differed. They are, with their hashes,
{scenes}.

*yes*: the first scene in which it did. *no*: it cannot act here, and why; `run` and `traffic check` warn of it. *not
seen*: it did not act in these scenes, which proves nothing for others. What a scene needs for
it may be missing: a stop sign, a roundabout, a crossing.
"""


def document(found: Sequence[tuple[str, str, str]], driven: Sequence[tuple[str, str]]) -> str:
    """The page."""
    lines = [head(), "| attribute | changes a drive | where, or why not |", "|---|---|---|"]
    lines += [f"| `{name}` | {changes} | {why} |" for name, changes, why in found]
    ours = ", ".join(f"`{key}`" for key in (*PARAMETERS, "interplan.swerve"))
    lines += ["", f"Parameters of ours: {ours}; [tune_traffic.md](tune_traffic.md) explains them.", ""]
    lines += ["## Car-following models", "", "| carFollowModel | |", "|---|---|"]
    lines += [f"| `{name}` | {said} |" for name, said in driven]
    return "\n".join((*lines, ""))


def main() -> None:
    attributes = [name for name in vehicle_type_schema().attributes if name not in ("id", "refId")]
    names = tuple(car_following_models())
    with TemporaryDirectory() as folder, ProcessPoolExecutor(WORKERS, mp_context=get_context("spawn")) as pool:
        driven = list(zip(names, pool.map(partial(runs, Path(folder)), names), strict=True))
        found: list[tuple[str, str, str]] = []
        for name, (changes, why) in zip(attributes, pool.map(partial(effect, Path(folder)), attributes), strict=True):
            found.append((name, changes, why))
            print(f"[{len(found)}/{len(attributes)}]", *found[-1], file=sys.stderr, flush=True)
    Path(sys.argv[1]).write_text(document(found, driven), encoding="utf-8")


if __name__ == "__main__":
    main()
