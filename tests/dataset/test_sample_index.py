"""The sample index: what a drive offers, and that an offer keeps its promise."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec import convert, to_builtins

from interplan_sumo.batch.stored_drive import StoredDrive
from interplan_sumo.dataset.cars import Cars
from interplan_sumo.dataset.drives import Drive
from interplan_sumo.dataset.drives import driven as driven_again
from interplan_sumo.dataset.sample_index import MOST_CARS, MOST_PER_CAR, MOST_STANDING, IndexedSamples, index_samples
from interplan_sumo.dataset.samples import LEAST_FUTURE_FRAMES, drive_samples
from interplan_sumo.features.schema import FUTURE_FRAMES, SITUATIONS
from interplan_sumo.maps.store import find_map
from interplan_sumo.world.trace import Trace

KEY = ("lane_change_mtd/1", "idm", 0)


@pytest.fixture(scope="session")
def offers(stored: StoredDrive) -> list[IndexedSamples]:
    return index_samples(stored.scenario, stored.roads, stored.trace, 5)


def test_the_ego_comes_first_and_cars_follow(stored: StoredDrive, offers: list[IndexedSamples]) -> None:
    own, *others = offers
    assert own.car == ""
    assert own.route == stored.scenario.route
    assert max(own.frames) < len(stored.trace) - LEAST_FUTURE_FRAMES
    assert 3 <= len(others) <= MOST_CARS
    assert {each.car for each in others} <= set(Cars(stored.trace).tokens)


@pytest.mark.slow
def test_cars_offer_few_samples_with_all_of_past_and_future(stored: StoredDrive, offers: list[IndexedSamples]) -> None:
    for offer in offers[1:]:
        assert 1 <= len(offer.frames) <= MOST_PER_CAR
        made = Cars(stored.trace).drive(offer.car)
        scenario = replace(stored.scenario, start=offer.start, goal=offer.goal, route=offer.route)
        columns = drive_samples(scenario, stored.roads, made.trace, drive=0, frames=offer.frames)
        assert columns["ego_future"][..., 3].all()
        assert columns["ego_history_valid"].all()
        assert columns["situation"].tolist() == list(offer.situations)
        assert (np.hypot(*np.diff(columns["ego_history"][..., :2], axis=1).T) < 3.0).all()


def test_offers_come_back_from_plain_json(offers: list[IndexedSamples]) -> None:
    assert convert(json.loads(json.dumps(to_builtins(offers))), list[IndexedSamples]) == offers


def test_what_is_offered_is_found_again_in_the_run_folder(
    driven: Path, stored: StoredDrive, offers: list[IndexedSamples]
) -> None:
    offer = offers[1]
    drive = Drive(
        "run", "mine", replace(stored.scenario, start=offer.start, goal=offer.goal, route=offer.route),
        find_map(stored.scenario.map), "sumo", 0, 1.0, str(stored.row.trace_hash), "", driven, KEY, offer.car,
    )  # fmt: skip
    scenario, _, trace = driven_again(drive)
    assert scenario.route == offer.route
    assert trace.hash() == Cars(stored.trace).drive(offer.car).trace.hash()
    about = drive.record("train", 3)
    assert (about.planner, about.car, about.goal_lane) == ("sumo", offer.car, offer.goal.lane)


@pytest.mark.slow
def test_of_a_long_stand_only_a_few_samples_are_offered(stored: StoredDrive) -> None:
    first = stored.trace
    still = np.zeros(len(first), dtype=np.int64)  # the first frame, over and over
    columns: dict[str, Any] = {name: getattr(first.ego, name)[still] for name in ("x_m", "y_m", "heading_rad")}
    columns |= {name: np.zeros(len(first)) for name in ("vx_mps", "ax_mps2", "yaw_rate_radps")}
    ego = replace(first.ego, **columns)
    trace = Trace(ego, first.actors, first.signals, (), np.zeros(0))
    own = index_samples(stored.scenario, stored.roads, trace, 5)[0]
    assert {SITUATIONS[code] for code in own.situations} == {"standing"}
    assert len(own.frames) == MOST_STANDING
    assert own.frames[-1] - own.frames[0] > FUTURE_FRAMES / 2
