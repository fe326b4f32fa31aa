"""Motion: somebody's recorded poses as the track of an ego, and whether a car can have moved so."""

from __future__ import annotations

from math import atan2, cos, sin, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.features.schema import STEP_S
from interplan_sumo.metrics.comfort import BOUNDS
from interplan_sumo.world.ego import PACIFICA, EgoShape
from interplan_sumo.world.geometry import Floats, Ints, wrap_angle
from interplan_sumo.world.savitzky_golay import savitzky_golay
from interplan_sumo.world.trace import EgoTrack

SMOOTHED_FRAMES: Final = 15
SMOOTHED_ORDER: Final = 3
"""Places are smoothed by cubics over 1.5 s: SUMO's lane changes begin and end in one step, a car's do not."""
MOST_MOVED_M: Final = 0.15
"""A place that smoothing moves farther was a hop."""
MOST_TURNED_RAD: Final = 0.3
"""Where a rolling car would be turned farther from the heading that was recorded, it did not roll."""
STANDS_MPS: Final = 0.1
"""At less speed the steering angle is not to be told, and stays."""


def body(length_m: float, width_m: float) -> EgoShape:
    """A body of a size, in the proportions of nuPlan's ego."""
    share = length_m / PACIFICA.length_m
    return EgoShape(
        length_m, width_m, PACIFICA.height_m, share * PACIFICA.wheelbase_m, share * PACIFICA.rear_axle_to_center_m
    )


def smoothed(places: Floats) -> Floats:
    """(F, 2) places without the kinks that no car drives; as they are where there are fewer than 1.5 s."""
    if len(places) < SMOOTHED_FRAMES:
        return places
    return np.stack([savitzky_golay(column, SMOOTHED_FRAMES, SMOOTHED_ORDER) for column in places.T], axis=1)


def rolled(places: Floats, heading_rad: float, shape: EgoShape) -> Floats:
    """(F,) headings of a body whose centre is led through `places` (F, 2) while its rear axle rolls without slip.

    `heading_rad` is the first one. SUMO turns bodies about their middle
    instead: it draws them from where their front is to where their rear is on the lane.
    """
    ahead_m = shape.rear_axle_to_center_m
    heading = heading_rad
    x, y = places[0, 0] - ahead_m * cos(heading), places[0, 1] - ahead_m * sin(heading)
    found = [heading]
    for to_x, to_y in places[1:].tolist():
        forward_x, forward_y = cos(heading), sin(heading)
        along = (to_x - x) * forward_x + (to_y - y) * forward_y
        across = (to_y - y) * forward_x - (to_x - x) * forward_y
        gone_m = along - sqrt(max(0.0, ahead_m**2 - across**2))
        x, y = x + gone_m * forward_x, y + gone_m * forward_y
        heading = atan2(to_y - y, to_x - x)
        found.append(heading)
    return np.array(found)


def ego_track(time_us: Ints, poses: Floats, shape: EgoShape) -> EgoTrack:
    """The track of an ego that was at the poses (F, 3) of its box centre, 0.1 s apart.

    Dynamics are told from the poses as the kinematic bicycle makes poses of
    them: speed and yaw rate carry from a frame to the next one, acceleration
    brought about the speed of its frame. There is no slip. One frame stands still.
    """
    x, y, heading = (np.asarray(column, dtype=np.float64) for column in poses.T)
    rear_x, rear_y = (
        x - shape.rear_axle_to_center_m * np.cos(heading),
        y - shape.rear_axle_to_center_m * np.sin(heading),
    )
    went = np.diff(rear_x) * np.cos(heading[:-1]) + np.diff(rear_y) * np.sin(heading[:-1])
    speed = _onwards(went / STEP_S)
    yaw_rate = _onwards(wrap_angle(np.diff(heading)) / STEP_S)
    tire = _held(np.arctan2(shape.wheelbase_m * yaw_rate, np.maximum(speed, STANDS_MPS)), speed > STANDS_MPS)
    zero = np.zeros(len(speed))
    return EgoTrack(
        time_us, x, y, wrap_angle(heading), speed, zero, _since(speed), zero, tire, _since(tire), yaw_rate,
        _since(yaw_rate),
    )  # fmt: skip


def roadworthy(track: EgoTrack, recorded: Floats) -> NDArray[np.bool_]:
    """(F,) where a car can have moved as the track says, of which the poses (F, 3) were recorded.

    Within nuPlan's bounds of comfort for accelerations and yaw rate, near the
    recorded place and not turned from the recorded heading.
    """
    moved_m = np.hypot(track.x_m - recorded[:, 0], track.y_m - recorded[:, 1])
    turned_rad = np.abs(wrap_angle(track.heading_rad - recorded[:, 2]))
    return (
        (moved_m <= MOST_MOVED_M)
        & (turned_rad <= MOST_TURNED_RAD)
        & _inside("longitudinal_acceleration_mps2", track.ax_mps2)
        & _inside("lateral_acceleration_mps2", track.vx_mps * track.yaw_rate_radps)
        & _inside("yaw_rate_radps", track.yaw_rate_radps)
    )


def _inside(name: str, values: Floats) -> NDArray[np.bool_]:
    low, high = BOUNDS[name]
    return (values > low) & (values < high)


def _onwards(steps: Floats) -> Floats:
    """(F,) from the (F - 1,) changes to the next frame; the last one goes on."""
    return np.append(steps, steps[-1:] if len(steps) else 0.0)


def _since(values: Floats) -> Floats:
    """(F,) rates of change since the frame before; none in the first."""
    return np.diff(values, prepend=values[:1]) / STEP_S


def _held(values: Floats, known: NDArray[np.bool_]) -> Floats:
    """`values` where they are known, the last known one elsewhere, 0 before the first."""
    last = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
    return np.where(last >= 0, values[last], 0.0)
