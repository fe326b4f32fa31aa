from __future__ import annotations

import pytest
from worlds import cars, ego, mission, observation, straight_road

from interplan_planners.straight_ahead import StraightAhead

ROAD = straight_road()


def test_heading_and_speed_are_held_whatever_stands_ahead() -> None:
    planner = StraightAhead()
    planner.start(mission(ROAD, ("11",)))
    plan = planner.plan(observation(ego(5.0, 1.0, 10.0, heading_rad=0.3, time_s=2.0), cars((12.0, 1.0))))
    assert len(plan) == 81
    assert (plan.time_s[0], plan.time_s[-1]) == pytest.approx((2.0, 10.0))
    end = plan.at(10.0)
    assert (end.x_m, end.y_m, end.heading_rad) == pytest.approx((5.0 + 76.4269, 1.0 + 23.6416, 0.3), abs=1e-3)
    short = StraightAhead(horizon_s=2.0)
    short.start(mission(ROAD, ("11",)))
    assert short.plan(observation(ego())).time_s[-1] == pytest.approx(2.0)
