"""The four shipped maps, drawn from compact road plans."""

from __future__ import annotations

from tools.make_maps import back_bay, hazelwood, one_north, strip
from tools.make_maps.plan import Plan

PLANS: dict[str, Plan] = {module.PLAN.name: module.PLAN for module in (strip, one_north, back_bay, hazelwood)}
