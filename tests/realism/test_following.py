"""Who follows whom: the nearest in one's way, and nobody else."""

from __future__ import annotations

import numpy as np
import pytest
from tracking import DT_S, moved, steady, track

from interplan_sumo.realism.following import Following, followings
from interplan_sumo.realism.tracks import Track


def pairs(*tracks: Track) -> list[tuple[str, str]]:
    return [(each.follower.track.id, each.leader.track.id) for each in episodes(*tracks)]


def episodes(*tracks: Track) -> list[Following]:
    return followings([moved(each) for each in tracks])


def test_the_gap_is_from_bumper_to_bumper() -> None:
    (only,) = episodes(steady("behind", 0.0, 10.0), steady("ahead", 24.0, 12.0))
    assert only.gap_m == pytest.approx(20.0 + 2.0 * only.time_s)
    assert only.speed_mps == pytest.approx(10.0)
    assert only.leader_speed_mps == pytest.approx(12.0)
    assert (only.follower.track.id, only.leader.track.id) == ("behind", "ahead")


def test_only_the_nearest_leads() -> None:
    assert pairs(steady("a", 0.0, 10.0), steady("b", 20.0, 10.0), steady("c", 40.0, 10.0)) == [("a", "b"), ("b", "c")]


def test_who_is_beside_one_s_way_or_comes_towards_one_leads_nobody() -> None:
    ego = steady("a", 0.0, 5.0)
    assert pairs(ego, steady("b", 40.0, 5.0, y_m=1.6)) == [("a", "b")], "bodies of 2 m overlap by 0.4 m"
    assert pairs(ego, steady("b", 40.0, 5.0, y_m=1.8)) == []
    assert pairs(ego, steady("b", 70.0, -2.0, heading_rad=np.pi)) == []
    assert pairs(ego, steady("b", 40.0, 5.0, heading_rad=np.radians(29.0))) == [("a", "b")]
    assert pairs(ego, steady("b", 40.0, 0.0, heading_rad=np.radians(31.0))) == []


def test_who_is_farther_than_eighty_metres_leads_nobody() -> None:
    assert pairs(steady("a", 0.0, 10.0), steady("b", 83.0, 10.0)) == [("a", "b")]
    assert pairs(steady("a", 0.0, 10.0), steady("b", 85.0, 10.0)) == []


def test_pedestrians_neither_lead_nor_follow() -> None:
    assert pairs(steady("a", 0.0, 1.0), steady("b", 10.0, 1.0, kind="pedestrian")) == []  # type: ignore[arg-type]


def test_a_leader_round_the_bend_is_found_along_the_way_that_was_taken() -> None:
    angle_rad = 10.0 * DT_S * np.arange(121.0) / 20.0  # a circle of 20 m at 10 m/s
    bend = np.stack((20.0 * np.sin(angle_rad), 20.0 * (1.0 - np.cos(angle_rad)), angle_rad))

    def on_the_bend(id_: str, rows: slice) -> Track:
        x_m, y_m, heading_rad = bend[:, rows]
        n = len(x_m)
        return Track(id_, "vehicle", DT_S * np.arange(float(n)), x_m, y_m, heading_rad, np.full(n, np.nan), 4.0, 2.0)

    found = episodes(on_the_bend("a", slice(0, 61)), on_the_bend("b", slice(15, 76)))
    first = next(each for each in found if each.follower.track.id == "a")
    early = first.gap_m[first.time_s < 3.0]
    assert early == pytest.approx(15.0 - 4.0, abs=0.3), "15 m along the bend, 13.6 m as the crow flies"


def test_leadership_ends_when_the_leader_leaves_the_lane() -> None:
    time_s = DT_S * np.arange(101.0)
    aside_m = 3.5 * np.clip((time_s - 5.0) / 2.0, 0.0, 1.0)
    (only,) = episodes(steady("a", 0.0, 10.0), track("b", 20.0 + 10.0 * time_s, aside_m))
    assert only.time_s[-1] == pytest.approx(5.0 + 1.7 / 3.5 * 2.0, abs=0.15)


def test_a_leadership_of_less_than_a_second_is_no_episode() -> None:
    assert pairs(steady("a", 0.0, 10.0), steady("b", 20.0, 10.0, seconds=2.4)) == [("a", "b")]
    assert pairs(steady("a", 0.0, 10.0), steady("b", 20.0, 10.0, seconds=2.3)) == []
