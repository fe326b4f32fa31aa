"""docs/vehicle_types.md names every attribute of SUMO's schema, and says of idle ones what users are told."""

from __future__ import annotations

import re
from pathlib import Path

from interplan_sumo.simulation.vehicle_type_effects import (
    CANNOT_RUN,
    GENERIC,
    UNUSED,
    WITHOUT_EFFECT,
    car_following_models,
)
from interplan_sumo.simulation.vehicle_type_schema import vehicle_type_schema

PAGE = Path(__file__).parents[1] / "docs" / "vehicle_types.md"
ROW = re.compile(r"\| `(\w+)` \| (yes|no|not seen|fails) \| (.+) \|")


def rows() -> dict[str, tuple[str, str]]:
    return {found[1]: (found[2], found[3]) for found in map(ROW.fullmatch, PAGE.read_text().splitlines()) if found}


def test_every_attribute_of_the_schema_is_in_the_table() -> None:
    assert rows().keys() == vehicle_type_schema().attributes.keys() - {"id", "refId"}


def test_no_attribute_that_was_seen_to_act_is_warned_of_and_all_that_cannot_are() -> None:
    reasons = {name: reason for group in (UNUSED, WITHOUT_EFFECT) for reason, names in group.items() for name in names}
    read = frozenset().union(*car_following_models().values()) | GENERIC
    for model in CANNOT_RUN:
        only = vehicle_type_schema().models.get(model, frozenset()) - read
        reasons |= dict.fromkeys(only, f"only carFollowModel {model} reads it")
    told = {name: why for name, (changes, why) in rows().items() if changes == "no"}
    assert told.keys() == reasons.keys() - {"deterministic"}
    assert not any(changes == "fails" for changes, _ in rows().values())
    assert all(why.startswith(reasons[name]) for name, why in told.items())


def test_every_car_following_model_that_is_accepted_drives() -> None:
    said = dict(re.findall(r"\| `(\w+)` \| (drives in .+|.*fails.*) \|", PAGE.read_text()))
    assert said.keys() == car_following_models().keys()
    assert all(text.startswith("drives in ") for text in said.values())
