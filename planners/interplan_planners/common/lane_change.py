"""The way from one lane to another: a path that leaves smoothly and arrives smoothly."""

from __future__ import annotations

from math import tan

import numpy as np

from interplan_planners.common.paths import shifted
from interplan_sumo.world.geometry import Floats, Polyline, Pose, wrap_angle


def lane_change_path(target: Polyline, start: Pose, length_m: float, steepest_rad: float = 0.5) -> Polyline:
    """The target lane's centre line, approached from a pose beside it along `length_m` of it.

    The lateral offset is a quintic: it starts with the pose's offset and
    heading (at most `steepest_rad` off the lane's) and without curvature, and
    ends with none of them. Arc lengths before the pose belong to a line parallel to
    the target; those after it are those of the target but for what the way
    across adds.
    """
    arc_m, left_m = target.project_point(start.x_m, start.y_m)
    turned = float(wrap_angle(start.heading_rad - target.pose_at(arc_m).heading_rad))
    slope = tan(max(-steepest_rad, min(steepest_rad, turned)))
    cut = np.arange(max(arc_m - 10.0, 0.0), min(arc_m + length_m, target.length_m), 1.0)
    arcs = np.unique(np.concatenate((target.arc_m, cut, [arc_m])))
    arcs = arcs[np.concatenate(([True], np.diff(arcs) > 0.05))]
    line = Polyline(target.poses_at(arcs)[:, :2])
    # shifting may drop vertices where the line is cut finely; offsets belong to those that are left
    at = target.project(line.points)[0]
    return shifted(line, quintic_offset((at - arc_m) / length_m, left_m, slope * length_m))


def quintic_offset(share: Floats, offset_m: float, slope_m: float) -> Floats:
    """Offsets (N,) at shares of the way: `offset_m` up to share 0, where it changes by `slope_m` per way, 0 from 1 on.

    Slope at the end and curvature at both ends are 0.
    """
    u = np.clip(share, 0.0, 1.0)
    fall = 1.0 - u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    tilt = u - u**3 * (6.0 - 8.0 * u + 3.0 * u**2)
    return offset_m * fall + slope_m * tilt
