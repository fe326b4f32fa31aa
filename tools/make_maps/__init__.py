"""The shipped maps, drawn from compact road plans."""

from __future__ import annotations

from pathlib import Path

from tools.make_maps.plan import Plan, read_plan

PLANS: dict[str, Plan] = {file.stem: read_plan(file) for file in sorted(Path(__file__).parent.glob("plans/*.yaml"))}
