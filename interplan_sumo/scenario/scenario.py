"""Scenario: one test drive as frozen data. Nothing here knows SUMO or a planner."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np

from interplan_sumo.errors import ScenarioError, UnknownNameError
from interplan_sumo.scenario.kinds import (
    OBSTACLE_HEIGHTS_M,
    OBSTACLES,
    SLOW_KINDS,
    VEHICLE_KINDS,
    WALKERS,
    ObstacleKind,
    VehicleKind,
    WalkerKind,
)
from interplan_sumo.scenario.recorded_parts import EgoPast, LoggedLight, ReplayedTrack
from interplan_sumo.world.geometry import Pose, wrap_angle
from interplan_sumo.world.roads import Lane, Roads

Density = Literal["none", "rare", "sparse", "low", "medium", "high"]
Behaviour = Literal[
    "conservative", "assertive", "mixed", "urban", "measured_city", "measured_city_mild", "measured_city_bold"
]
DRIVERS: tuple[Behaviour, ...] = (
    "conservative", "measured_city_mild", "assertive", "measured_city_bold", "mixed", "measured_city",
)  # fmt: skip
"""Of the benchmark: the paper's types and measured drivers in turn, cautious ones, pushing ones, and both."""

LARGEST_GAP_M: dict[str, float] = {"rare": 900.0, "sparse": 400.0, "low": 100.0, "medium": 50.0, "high": 33.0}
"""interPlan's densities, one of side streets, and one of an oncoming lane with gaps to overtake in: centre gaps are
uniform from 10 m up to these."""
SMALLEST_GAP_M = 10.0
SITE_BIN_M = 10.0
LONGEST_S, FASTEST_MPS, LARGEST_M = 3600.0, 60.0, 100.0
"""Durations, speeds, sizes and distances from a lane are no larger."""
ADDED_LATER = frozenset({"replayed", "lights", "past", "perception", "light_time_s"})
"""Fields of Scenario that came after suites had been frozen: a scenario without them keeps the hash that it had."""


PERCEPTIONS = ("occluded", "noisy", "late")
"""What can come between the scene and what a planner sees of it; without any of them perception is `full`."""


def perception_modes(text: str) -> tuple[str, ...]:
    """The modes in `full`, `noisy` or `occluded+late`, in the order of `PERCEPTIONS`; UnknownNameError for others."""
    named = () if text == "full" else text.split("+")
    for name in named:
        if name not in PERCEPTIONS:
            ways = f"It is full, or some of {', '.join(PERCEPTIONS)} joined by +, such as occluded+noisy"
            raise UnknownNameError("perception", name, (), ways)
    return tuple(name for name in PERCEPTIONS if name in named)


def perception_named(text: str) -> str:
    """The one text for these modes; UnknownNameError for one that is none."""
    return "+".join(perception_modes(text)) or "full"


@dataclass(frozen=True, slots=True)
class LanePosition:
    """A place on a lane: arc length along its centre line and offset to the left."""

    lane: str
    arc_m: float
    left_m: float = 0.0

    def pose(self, roads: Roads) -> Pose:
        """The pose there, heading along the lane; ScenarioError if the lane or the place does not exist."""
        if self.lane not in roads:
            raise ScenarioError(f"map {roads.name} has no lane {self.lane!r}")
        line = roads[self.lane].centerline
        if not 0.0 <= self.arc_m <= line.length_m:
            raise ScenarioError(
                f"lane {self.lane} is {line.length_m:.1f} m long, there is no place at {self.arc_m:.1f} m"
            )
        return line.pose_at(self.arc_m, self.left_m)


@dataclass(frozen=True, slots=True)
class Obstacle:
    """Something that stands in or beside the road for the whole run."""

    place: LanePosition
    """Of its centre."""
    kind: ObstacleKind = "car"
    turned_rad: float = 0.0
    """Heading relative to the lane, counter-clockwise."""
    length_m: float | None = None
    """None takes the default of its kind."""
    width_m: float | None = None
    height_m: float | None = None
    """Of 1.4 m or more it hides others where perception is `occluded`."""

    @property
    def size_m(self) -> tuple[float, float]:
        """Length and width."""
        _, length_m, width_m = OBSTACLES[self.kind]
        return self.length_m or length_m, self.width_m or width_m

    @property
    def tall_m(self) -> float:
        """Height."""
        return OBSTACLE_HEIGHTS_M[self.kind] if self.height_m is None else self.height_m

    def pose(self, roads: Roads) -> Pose:
        """Pose of its centre in the map frame."""
        pose = self.place.pose(roads)
        return Pose(pose.x_m, pose.y_m, float(wrap_angle(pose.heading_rad + self.turned_rad)))


@dataclass(frozen=True, slots=True)
class WalkStage:
    """One part of a way across: straight to a place, and a stand there."""

    to: LanePosition
    speed_mps: float
    wait_s: float = 0.0
    """How long it stands there."""


@dataclass(frozen=True, slots=True)
class Jaywalker:
    """One who waits at the kerb and sets off across the road when the ego comes near, yielding to nobody."""

    start: LanePosition
    end: LanePosition
    """Where it stays."""
    speed_mps: float
    """On the last part of the way."""
    via: tuple[WalkStage, ...] = ()
    """The parts before that: who stops midway, turns back or breaks into a run has some."""
    kind: WalkerKind = "pedestrian"

    @property
    def places(self) -> tuple[LanePosition, ...]:
        """Where it starts, and the ends of the parts of its way."""
        return (self.start, *(stage.to for stage in self.via), self.end)

    @property
    def size_m(self) -> tuple[float, float]:
        """Length and width."""
        _, length_m, width_m = WALKERS[self.kind]
        return length_m, width_m


@dataclass(frozen=True, slots=True)
class TrafficDemand:
    """The moving traffic around the ego."""

    density: Density = "none"
    behaviour: Behaviour = "mixed"
    """Vehicle-type file in routes/, without its ending."""
    oncoming: Density = "none"
    """Density on the oncoming lanes of a two-way road."""


@dataclass(frozen=True, slots=True)
class PlacedVehicle:
    """A moving vehicle that starts on a given place, besides those that the density brings."""

    place: LanePosition
    """Of its centre; on the centre line of a lane, but for those of `SLOW_KINDS`, which keep their distance from it."""
    speed_mps: float
    kind: VehicleKind = "car"
    """Its driver is drawn among the types of this kind in the scenario's vehicle-type file; those of `SLOW_KINDS` are
    the same in all of them."""


@dataclass(frozen=True, slots=True)
class Scenario:
    """One test drive. ScenarioError names the field that cannot be."""

    id: str
    """`family/index`."""
    family: str
    map: str
    start: LanePosition
    start_speed_mps: float
    goal: LanePosition
    """The run ends when the ego's projection on the route passes this place, in any lane."""
    route: tuple[str, ...]
    """Roadblock and roadblock-connector ids in driving order."""
    traffic: TrafficDemand = TrafficDemand()
    obstacles: tuple[Obstacle, ...] = ()
    jaywalkers: tuple[Jaywalker, ...] = ()
    occluder: int | None = None
    """Index in `obstacles` of the bus that hides pedestrians behind it from the planner; None hides nobody."""
    vehicles: tuple[PlacedVehicle, ...] = ()
    duration_s: float = 30.0
    exempt: tuple[str, ...] = ()
    """Gates that are not judged."""
    replayed: tuple[ReplayedTrack, ...] = ()
    """Recorded road users that move whatever the ego does. They are all the traffic there is, then."""
    lights: tuple[LoggedLight, ...] = ()
    """Recorded traffic lights, one entry per connector; lights of the map without any keep SUMO's program."""
    light_time_s: float = 0.0
    """How long the programs of the map's lights have run when it starts."""
    perception: str = "full"
    """What the planner sees: `full`, or some of `PERCEPTIONS` joined by `+`."""
    past: EgoPast | None = None
    """How the ego came to its start, for planners that look back; None: at constant speed along its lane."""
    maps_beside: Path | None = field(default=None, compare=False)
    """Folder of maps that lies beside the file it was read from: where to look for `map`, besides the shipped ones.

    No part of what the scenario is: neither compared, nor hashed, nor written.
    """

    def __post_init__(self) -> None:
        self._check_measures()
        if abs(self.duration_s * 10 - round(self.duration_s * 10)) > 1e-9:
            raise ScenarioError(f"{self.id}: duration_s is {self.duration_s}, expected a positive multiple of 0.1 s")
        try:
            object.__setattr__(self, "perception", perception_named(self.perception))
        except UnknownNameError as error:
            raise ScenarioError(f"{self.id}: {error}") from None
        if not self.route:
            raise ScenarioError(f"{self.id}: route is empty, expected the roadblock ids from start to goal")
        for i, obstacle in enumerate(self.obstacles):
            if obstacle.kind not in OBSTACLES:
                known = ", ".join(OBSTACLES)
                raise ScenarioError(f"{self.id}: obstacles[{i}].kind is {obstacle.kind!r}, expected one of {known}")
            size_m = (*obstacle.size_m, obstacle.tall_m)
            if not all(0.0 < size <= LARGEST_M for size in size_m):
                raise ScenarioError(
                    f"{self.id}: obstacles[{i}] has the size {size_m}, expected more than 0 and at most {LARGEST_M:g} m"
                )
        for i, walker in enumerate(self.jaywalkers):
            if walker.kind not in WALKERS:
                known = ", ".join(WALKERS)
                raise ScenarioError(f"{self.id}: jaywalkers[{i}].kind is {walker.kind!r}, expected one of {known}")
            numbers = [("speed_mps", walker.speed_mps, 0.1, 5.0)]
            for k, stage in enumerate(walker.via):
                numbers.append((f"via[{k}].speed_mps", stage.speed_mps, 0.1, 5.0))
                numbers.append((f"via[{k}].wait_s", stage.wait_s, 0.0, self.duration_s))
            for name, value, least, most in numbers:
                if not least <= value <= most:
                    text = f"{self.id}: jaywalkers[{i}].{name} is {value}, expected {least:g} to {most:g}"
                    raise ScenarioError(text)
        if self.occluder is not None and not 0 <= self.occluder < len(self.obstacles):
            raise ScenarioError(
                f"{self.id}: occluder is {self.occluder}, expected the index of one of {len(self.obstacles)} obstacles"
            )
        for i, vehicle in enumerate(self.vehicles):
            if vehicle.kind not in VEHICLE_KINDS:
                known = ", ".join(VEHICLE_KINDS)
                raise ScenarioError(f"{self.id}: vehicles[{i}].kind is {vehicle.kind!r}, expected one of {known}")
            if vehicle.place.left_m != 0.0 and vehicle.kind not in SLOW_KINDS:
                raise ScenarioError(
                    f"{self.id}: vehicles[{i}].place.left_m is {vehicle.place.left_m}, expected 0: vehicles start on "
                    "the centre line; what stands beside it is an obstacle"
                )
        if self.replayed:
            self._check_replayed()
        if twice := first_twice(light.connector for light in self.lights):
            raise ScenarioError(f"{self.id}: lights holds connector {twice!r} twice; leave one out")
        for name, density in (("density", self.traffic.density), ("oncoming", self.traffic.oncoming)):
            if density != "none" and density not in LARGEST_GAP_M:
                raise ScenarioError(
                    f"{self.id}: traffic.{name} is {density!r}, expected none, {', '.join(LARGEST_GAP_M)}"
                )

    def _check_measures(self) -> None:
        """No number is one that nobody can have meant."""
        walkers = [(f"jaywalkers[{i}]", place) for i, each in enumerate(self.jaywalkers) for place in each.places]
        places = [
            ("start", self.start),
            ("goal", self.goal),
            *((f"obstacles[{i}].place", each.place) for i, each in enumerate(self.obstacles)),
            *walkers,
            *((f"vehicles[{i}].place", each.place) for i, each in enumerate(self.vehicles)),
        ]
        measures = [
            ("duration_s", self.duration_s, 0.1, LONGEST_S),
            ("start_speed_mps", self.start_speed_mps, 0.0, FASTEST_MPS),
            ("light_time_s", self.light_time_s, 0.0, LONGEST_S),
            *((f"{name}.left_m", place.left_m, -LARGEST_M, LARGEST_M) for name, place in places),
            *((f"obstacles[{i}].turned_rad", each.turned_rad, -7.0, 7.0) for i, each in enumerate(self.obstacles)),
            *((f"vehicles[{i}].speed_mps", each.speed_mps, 0.0, FASTEST_MPS) for i, each in enumerate(self.vehicles)),
        ]
        for name, value, least, most in measures:
            if not least <= value <= most:
                raise ScenarioError(f"{self.id}: {name} is {value}, expected {least:g} to {most:g}")

    def _check_replayed(self) -> None:
        """Recorded road users mind nobody, so there is nobody who would have to mind them but the ego."""
        traffic = self.traffic
        others = {
            "traffic.density": traffic.density != "none",
            "traffic.oncoming": traffic.oncoming != "none",
            "vehicles": bool(self.vehicles),
            "jaywalkers": bool(self.jaywalkers),
        }
        for name, given in others.items():
            if given:
                raise ScenarioError(
                    f"{self.id}: replayed and {name} are both given, but recorded road users would drive through "
                    f"others; leave one of them out"
                )
        if twice := first_twice(track.id for track in self.replayed):
            raise ScenarioError(f"{self.id}: replayed holds track {twice!r} twice; leave one out")

    @property
    def has_flow(self) -> bool:
        """Whether a density is wanted, which is held as long as the episode lasts."""
        return self.traffic.density != "none" or self.traffic.oncoming != "none"

    @property
    def has_traffic(self) -> bool:
        """Whether anybody drives at the start, besides the ego."""
        return self.has_flow or bool(self.vehicles or self.replayed)

    def site(self, roads: Roads) -> str:
        """Where it happens: `<map>/<roadblock id>@<10 m bin>` of the first obstacle or jaywalker, else of the goal."""
        first = (*(o.place for o in self.obstacles), *(w.start for w in self.jaywalkers), self.goal)[0]
        block = roads[first.lane].roadblock_id
        return f"{self.map}/{block}@{int(first.arc_m // SITE_BIN_M) * int(SITE_BIN_M)}"

    def canonical(self) -> dict[str, object]:
        """Plain data, for files and for the hash: measures are floats, however they were written.

        Fields of `ADDED_LATER`, heights of obstacles, and what jaywalkers have besides one straight walk, are left
        out while they have their default.
        """
        plain = asdict(self)
        for walker in plain["jaywalkers"]:
            if not walker["via"]:
                del walker["via"]
            if walker["kind"] == "pedestrian":
                del walker["kind"]
        for obstacle in plain["obstacles"]:
            if obstacle["height_m"] is None:
                del obstacle["height_m"]
        kept = [
            each.name
            for each in fields(self)
            if each.compare and not (each.name in ADDED_LATER and plain[each.name] == each.default)
        ]
        return {name: _as_measured(name, plain[name]) for name in kept}

    def hash(self) -> str:
        """SHA-256 of the canonical JSON."""
        text = json.dumps(self.canonical(), sort_keys=True, separators=(",", ":"), ensure_ascii=True)
        return hashlib.sha256(text.encode()).hexdigest()

    def rng(self, seed: int) -> np.random.Generator:
        """The only source of chance in an episode, from the id and the seed."""
        digest = hashlib.sha256(f"{self.id}#{seed}".encode()).digest()
        return np.random.default_rng(np.frombuffer(digest, dtype=np.uint32))

    def check(self, roads: Roads) -> None:
        """ScenarioError if start, goal or route do not fit the map."""
        places = [("start", self.start), ("goal", self.goal)]
        places += [(f"obstacles[{i}]", obstacle.place) for i, obstacle in enumerate(self.obstacles)]
        for i, walker in enumerate(self.jaywalkers):
            ends = ("start", *(f"via[{k}].to" for k in range(len(walker.via))), "end")
            places += [(f"jaywalkers[{i}].{end}", place) for end, place in zip(ends, walker.places, strict=True)]
        places += [(f"vehicles[{i}]", vehicle.place) for i, vehicle in enumerate(self.vehicles)]
        for name, place in places:
            try:
                place.pose(roads)
            except ScenarioError as error:
                raise ScenarioError(f"{self.id}: {name}: {error}") from None
            if name in ("start", "goal") and roads[place.lane].roadblock_id not in self.route:
                raise ScenarioError(f"{self.id}: {name} lane {place.lane} does not lie on the route")
        for i, light in enumerate(self.lights):
            connector = roads.connectors.get(light.connector)
            if connector is None or not connector.has_traffic_light:
                missing = "connector" if connector is None else "connector with a traffic light"
                raise ScenarioError(f"{self.id}: lights[{i}]: map {roads.name} has no {missing} {light.connector!r}")
        if not isinstance(roads[self.goal.lane], Lane):
            raise ScenarioError(f"{self.id}: goal lies on connector {self.goal.lane}, expected a lane")
        for block in self.route:
            if block not in roads.roadblocks:
                raise ScenarioError(f"{self.id}: route names roadblock {block}, which map {roads.name} does not have")
        for here, there in zip(self.route, self.route[1:], strict=False):
            if there not in roads.outgoing_roadblocks(here):
                raise ScenarioError(f"{self.id}: route jumps from roadblock {here} to {there}, which are not joined")


def first_twice(names: Iterable[str]) -> str | None:
    """The first of some names that was there before."""
    seen: set[str] = set()
    return next((name for name in names if name in seen or seen.add(name)), None)


_MEASURES = ("_m", "_mps", "_rad", "_s")


def _as_measured(key: str, value: Any) -> Any:
    """`value` of a field with every measure in it as a float: 5 m and 5.0 m are one scenario."""
    if isinstance(value, dict):
        return {name: _as_measured(name, part) for name, part in cast("dict[str, Any]", value).items()}
    if isinstance(value, tuple):
        return tuple(_as_measured(key, part) for part in cast("tuple[Any, ...]", value))
    return float(value) if isinstance(value, int) and key.endswith(_MEASURES) else value
