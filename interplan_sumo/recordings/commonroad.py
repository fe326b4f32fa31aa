"""The traffic of CommonRoad scenarios (XML, versions 2018b and 2020a)."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
import shapely

from interplan_sumo.errors import InputError
from interplan_sumo.recordings.formats import RecordingFormat, head
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.commonroad_frame import CommonRoadFile, read_commonroad_file
from interplan_sumo.world.geometry import Floats, wrap_angle
from interplan_sumo.world.recording import RecordedTrack, Recording

_KINDS = {
    "car": (ActorKind.VEHICLE, "car"),
    "taxi": (ActorKind.VEHICLE, "car"),
    "parkedVehicle": (ActorKind.VEHICLE, "car"),
    "priorityVehicle": (ActorKind.VEHICLE, "car"),
    "truck": (ActorKind.VEHICLE, "truck"),
    "bus": (ActorKind.VEHICLE, "bus"),
    "motorcycle": (ActorKind.VEHICLE, "motorcycle"),
    "bicycle": (ActorKind.BICYCLE, "car"),
    "pedestrian": (ActorKind.PEDESTRIAN, "car"),
    "constructionZone": (ActorKind.BARRIER, "car"),
    "roadBoundary": (ActorKind.BARRIER, "car"),
}
_OTHER = (ActorKind.GENERIC_OBJECT, "car")
_MOST_STEPS = 36_000
"""An hour; scenarios last some ten seconds."""
_STEP_S = (1e-3, 60.0)
_LONGEST_M = 10_000.0
_FASTEST_MPS = 1_000.0
_STILL_MPS = 1e-3
"""What moves no faster does not tell where it heads."""
_TAGS = ("obstacle", "dynamicObstacle", "staticObstacle")
"""The first is that of version 2018b."""
_NOT_READ = {"environmentObstacle": "part of the surroundings", "phantomObstacle": "phantom obstacle"}


@dataclass(frozen=True, slots=True)
class _Box:
    """A body in the frame of its reference point: the box around it."""

    length_m: float
    width_m: float
    ahead_m: float = 0.0
    left_m: float = 0.0
    turn_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class _State:
    """The reference point of a body at one step, in the coordinates of the file."""

    step: int
    x_m: float
    y_m: float
    heading_rad: float | None
    speed_mps: float | None
    """Along the heading; along x where there is no heading."""
    sideways_mps: float
    """To the left of the heading; along y where there is no heading."""


class _UnusableError(Exception):
    """An obstacle that the file describes in a way that makes no track; the message says why."""


def read_commonroad_recording(path: Path) -> Recording:
    """The obstacles of a CommonRoad file as tracks, in the frame of the map that `read_commonroad` makes of it.

    Positions of the file are those of a body's reference point; the tracks
    hold the centre of the box around the body. Intervals stand for their
    middle. What moves without a heading heads where it moves. Of two states
    at one step the first counts. An obstacle that is missing for some steps
    becomes several tracks (`7`, `7.2`, ...). Static obstacles stand through
    the whole recording. InputError names the file, the obstacle and the field.
    """
    file = read_commonroad_file(path)
    notes = list(file.notes)
    left_out: Counter[str] = Counter({what: len(file.parts.get(tag, ())) for tag, what in _NOT_READ.items()})
    tracks: list[RecordedTrack] = []
    obstacles = [(one, _is_static(one)) for tag in _TAGS for one in file.parts.get(tag, ())]
    for element in (one for one, static in obstacles if not static):
        try:
            tracks += _moving(file, element)
        except _UnusableError as reason:
            left_out[str(reason)] += 1
    steps = max((track.end_step for track in tracks), default=1)
    for element in (one for one, static in obstacles if static):
        try:
            tracks.append(_standing(file, element, steps))
        except _UnusableError as reason:
            left_out[str(reason)] += 1
    twice = [id_ for id_, count in Counter(track.id for track in tracks).items() if count > 1]
    if twice:
        raise InputError(f"{file.path}: two obstacles have the id {twice[0]!r}; every obstacle needs its own")
    notes += [f"Not read, {reason}: {count}." for reason, count in sorted(left_out.items()) if count]
    notes += [_task(file, element) for element in file.parts.get("planningProblem", ())]
    return Recording(
        name=file.name,
        crs=file.frame.crs,
        step_s=_step_s(file),
        tracks=tuple(sorted(tracks, key=lambda track: track.id)),
        notes=tuple(notes),
    )


def _is_static(element: Element) -> bool:
    return element.tag == "staticObstacle" or (element.findtext("role") or "").strip() == "static"


def _step_s(file: CommonRoadFile) -> float:
    text = file.attributes.get("timeStepSize", "")
    try:
        step_s = float(text)
    except ValueError:
        step_s = math.nan
    if not _STEP_S[0] <= step_s <= _STEP_S[1]:
        raise InputError(f"{file.path}: timeStepSize is {text[:20]!r}, expected {_STEP_S[0]:g} to {_STEP_S[1]:g} s")
    return step_s


# --- states ------------------------------------------------------------------------------------------


def _moving_states(file: CommonRoadFile, element: Element) -> list[_State]:
    """The states of a dynamic obstacle by step, the first of each; those without a place are skipped."""
    later = element.findall("trajectory/state")
    if not later and element.find("occupancySet") is not None:
        raise _UnusableError("obstacles with areas instead of a trajectory")
    states = [_state(file, element, state) for state in (*element.iterfind("initialState"), *later)]
    by_step: dict[int, _State] = {}
    for state in states:
        if state is not None:
            by_step.setdefault(state.step, state)
    if not by_step:
        raise _UnusableError("obstacles without a place")
    return [by_step[step] for step in sorted(by_step)]


def _state(file: CommonRoadFile, owner: Element, element: Element) -> _State | None:
    """One state; None where its position is a lanelet or missing."""
    place = _place(file, owner, element.find("position"))
    if place is None:
        return None
    time = element.find("time")
    step = _value(file, owner, time, "time") if time is not None else 0.0
    if step is None or not 0 <= step <= _MOST_STEPS:
        raise file.fault(owner, f"time is {step}, expected a step between 0 and {_MOST_STEPS}")
    heading = _value(file, owner, element.find("orientation"), "orientation")
    speed = _value(file, owner, element.find("velocity"), "velocity")
    sideways = _value(file, owner, element.find("velocityY"), "velocityY")
    return _State(int(step), *place, heading, speed, sideways or 0.0)


def _place(file: CommonRoadFile, owner: Element, position: Element | None) -> tuple[float, float] | None:
    """The point, or the centre of the shape, at which something is."""
    if position is None:
        return None
    for shape in position:
        if shape.tag == "point":
            return file.point(owner, shape, "position")
        if shape.tag == "polygon":
            corners = [file.point(owner, point, "position") for point in shape.iterfind("point")]
            if len(corners) >= 3:
                centre = shapely.MultiPoint(corners).envelope.centroid
                return centre.x, centre.y
        centre = shape.find("center")
        if centre is not None:
            return file.point(owner, centre, "position")
    return None


def _value(file: CommonRoadFile, owner: Element, element: Element | None, name: str) -> float | None:
    """A number given exactly or as an interval, which stands for its middle; None where there is none."""
    if element is None:
        return None
    ends = ("intervalStart", "intervalEnd") if element.find("exact") is None else ("exact", "exact")
    return sum(file.number(owner, element.find(end), name) for end in ends) / 2.0


# --- bodies ------------------------------------------------------------------------------------------


def _box(file: CommonRoadFile, owner: Element, *, static: bool) -> _Box:
    """The box around the shape of an obstacle."""
    shape = owner.find("shape")
    boxes = [_part(file, owner, one, static=static) for one in _simple(shape)] if shape is not None else []
    if not boxes:
        raise _UnusableError("obstacles without a shape")
    return boxes[0] if len(boxes) == 1 else _around(np.concatenate([_corners(box) for box in boxes]), static=static)


def _simple(shape: Element) -> Iterable[Element]:
    """The rectangles, circles, ... that make up a shape."""
    for part in shape:
        if part.tag in ("shape", "shapeGroup"):
            yield from _simple(part)
        else:
            yield part


def _part(file: CommonRoadFile, owner: Element, shape: Element, *, static: bool) -> _Box:
    def number(name: str, default: float | None = None) -> float:
        element = shape.find(f".//{name}")
        if element is None and default is not None:
            return default
        return file.number(owner, element, f"{name} of the shape")

    middle = shape.find("center")
    centre = file.point(owner, middle, "the shape") if middle is not None else (0.0, 0.0)
    if shape.tag in ("rectangle", "truckShape"):
        # The origin lies originXShift ahead of the middle of the box.
        ahead_m = centre[0] - number("originXShift", 0.0)
        box = _Box(number("length"), number("width"), ahead_m, centre[1], number("orientation", 0.0))
    elif shape.tag == "circle":
        box = _Box(2.0 * number("radius"), 2.0 * number("radius"), *centre)
    elif shape.tag == "polygon":
        corners = np.array([file.point(owner, point, "the shape") for point in shape.iterfind("point")])
        if len(corners) < 3:
            raise file.fault(owner, "the polygon of the shape has fewer than three points")
        box = _around(corners, static=static)
    else:
        raise _UnusableError(f"obstacles of shape {shape.tag[:30]}")
    if not (0.0 < box.length_m < _LONGEST_M and 0.0 < box.width_m < _LONGEST_M):
        raise file.fault(owner, f"the shape measures {box.length_m:g} x {box.width_m:g} m, which nothing does")
    return box


def _around(corners: Floats, *, static: bool) -> _Box:
    """The smallest box around what stands; around what moves, the box along its heading."""
    if not static:
        (back, right), (front, left) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
        return _Box(front - back, left - right, (back + front) / 2.0, (right + left) / 2.0)
    around = shapely.MultiPoint(corners).minimum_rotated_rectangle
    if not isinstance(around, shapely.Polygon):
        return _Box(0.0, 0.0)
    ring = shapely.get_coordinates(around)
    sides = np.diff(ring[:3], axis=0)
    lengths = np.hypot(*sides.T)
    long = int(np.argmax(lengths))
    turn = math.atan2(sides[long, 1], sides[long, 0])
    return _Box(float(lengths[long]), float(lengths[1 - long]), around.centroid.x, around.centroid.y, turn)


def _corners(box: _Box) -> Floats:
    """(4, 2) corners in the frame of the reference point."""
    cos, sin = math.cos(box.turn_rad), math.sin(box.turn_rad)
    ahead = np.array([1.0, 1.0, -1.0, -1.0]) * box.length_m / 2.0
    left = np.array([1.0, -1.0, -1.0, 1.0]) * box.width_m / 2.0
    return np.stack((box.ahead_m + cos * ahead - sin * left, box.left_m + sin * ahead + cos * left), axis=1)


# --- tracks ------------------------------------------------------------------------------------------


def _moving(file: CommonRoadFile, element: Element) -> Iterable[RecordedTrack]:
    """One track for every run of consecutive steps of a dynamic obstacle."""
    states = _moving_states(file, element)
    box = _box(file, element, static=False)
    poses, velocity_mps = _motion(file, element, states, box)
    steps = np.array([state.step for state in states])
    for number, rows in enumerate(np.split(np.arange(len(steps)), np.flatnonzero(np.diff(steps) > 1) + 1), start=1):
        yield _track(element, box, number, int(steps[rows[0]]), poses[rows], velocity_mps[rows])


def _standing(file: CommonRoadFile, element: Element, steps: int) -> RecordedTrack:
    """A static obstacle, through the whole recording."""
    initial = element.find("initialState")
    state = _state(file, element, initial) if initial is not None else None
    if state is None:
        raise _UnusableError("obstacles without a place")
    box = _box(file, element, static=True)
    still = replace(state, heading_rad=state.heading_rad or 0.0, speed_mps=0.0, sideways_mps=0.0)
    poses, velocity_mps = _motion(file, element, [still], box)
    return _track(element, box, 1, 0, np.repeat(poses, steps, axis=0), np.repeat(velocity_mps, steps, axis=0))


def _track(
    element: Element, box: _Box, number: int, first_step: int, poses: Floats, velocity_mps: Floats
) -> RecordedTrack:
    kind, model = _KINDS.get((element.findtext("type") or "").strip(), _OTHER)
    id_ = element.get("id", "").strip()
    return RecordedTrack(
        id=id_ if number == 1 else f"{id_}.{number}",
        kind=kind,
        length_m=box.length_m,
        width_m=box.width_m,
        first_step=first_step,
        poses=poses,
        velocity_mps=velocity_mps,
        model=model,
    )


def _motion(file: CommonRoadFile, element: Element, states: Sequence[_State], box: _Box) -> tuple[Floats, Floats]:
    """(K, 3) poses of the box and (K, 2) velocities in the frame of the map.

    Who stands at first, without an orientation, heads as soon after.
    """
    xy = np.array([(state.x_m, state.y_m) for state in states])
    moved = _moved_mps(xy, np.array([state.step for state in states]) * _step_s(file))
    heading = np.zeros(len(states))
    velocity = np.zeros((len(states), 2))
    courses = (_course(state, (x, y), math.nan)[0] for state, (x, y) in zip(states, moved.tolist(), strict=True))
    last_rad = next((rad for rad in courses if not math.isnan(rad)), 0.0)
    for row, (state, (x, y)) in enumerate(zip(states, moved.tolist(), strict=True)):
        last_rad, velocity[row] = _course(state, (x, y), last_rad)
        heading[row] = last_rad
    if not (np.abs(velocity) < _FASTEST_MPS).all():
        raise file.fault(element, f"it moves at more than {_FASTEST_MPS:g} m/s")
    centre = xy + np.array([_turned((box.ahead_m, box.left_m), one) for one in heading.tolist()])
    try:
        placed = file.frame.points(centre)
        turned = file.frame.headings(centre, heading + box.turn_rad)
        return np.column_stack((placed, wrap_angle(turned))), file.frame.vectors(centre, velocity)
    except InputError as error:
        raise file.fault(element, str(error)) from error


def _course(state: _State, moved_mps: tuple[float, float], last_rad: float) -> tuple[float, tuple[float, float]]:
    """Heading and velocity at one step, in the file's coordinates; what a state leaves open is as it has moved."""
    given = (state.speed_mps, state.sideways_mps) if state.speed_mps is not None else None
    if state.heading_rad is not None:
        return state.heading_rad, _turned(given, state.heading_rad) if given else moved_mps
    velocity = given or moved_mps
    if given and not given[1]:  # a speed without a direction
        moves = math.hypot(*moved_mps) > _STILL_MPS
        velocity = _turned(given, math.atan2(moved_mps[1], moved_mps[0]) if moves else last_rad)
    return math.atan2(velocity[1], velocity[0]) if math.hypot(*velocity) > _STILL_MPS else last_rad, velocity


def _moved_mps(xy: Floats, time_s: Floats) -> Floats:
    """(K, 2) velocity by the change of place: that of the step ahead, the last one repeated."""
    if len(xy) < 2:
        return np.zeros_like(xy)
    ahead = np.diff(xy, axis=0) / np.diff(time_s)[:, None]
    return np.concatenate((ahead, ahead[-1:]))


def _turned(vector: Iterable[float], angle_rad: float) -> tuple[float, float]:
    x, y = vector
    return x * math.cos(angle_rad) - y * math.sin(angle_rad), x * math.sin(angle_rad) + y * math.cos(angle_rad)


def _task(file: CommonRoadFile, element: Element) -> str:
    """What a planning problem asks, as a sentence: it is a start, and no track."""
    name = f"Planning problem {element.get('id', '')[:20]}"
    initial = element.find("initialState")
    try:
        state = _state(file, element, initial) if initial is not None else None
        if state is None:
            return f"{name} names no place to start."
        xy = np.array([[state.x_m, state.y_m]])
        ((x, y),) = file.frame.points(xy).tolist()
        (heading,) = file.frame.headings(xy, np.array([state.heading_rad or 0.0])).tolist()
    except InputError:
        return f"{name} could not be read."
    place = f"{x:.2f}, {y:.2f}, heading {heading:.3f} rad"
    return f"{name} starts at step {state.step} at {place}, {state.speed_mps or 0.0:.2f} m/s."


def _is_scenario(path: Path) -> bool:
    return b"<commonRoad" in head(path)


FORMAT = RecordingFormat("a scenario of CommonRoad", _is_scenario, read_commonroad_recording)
