"""Signal programs serve everybody and send nobody into another's path."""

from __future__ import annotations

import pytest

from interplan_sumo.maps.junctions import Junction, Movement, junction, junction_groups, lane_signs
from interplan_sumo.maps.signals_plan import ALL_RED_S, PERMISSIVE_LANES, YELLOW_S, Program, program
from interplan_sumo.world.roads import DrivingSide, Roads
from tests.maps.road_worlds import GridPlan, Ways, beside, crossing, grid_city, small_roads, straight


def programs(roads: Roads) -> list[tuple[Junction, Program]]:
    signs = lane_signs(roads)
    found = [junction(roads, members, signs) for members in junction_groups(roads)[1].values()]
    return [(meeting, program(roads, meeting, k)) for k, meeting in enumerate(found) if meeting.lit]


def boulevard(lanes: int, pocket: bool, side: DrivingSide = "right") -> Roads:
    """A road of so many through lanes each way, a cross street of one, turns from a pocket or the inner lane."""
    half = 3.5 / 2 if side == "right" else -3.5 / 2
    step = 3.5 if side == "right" else -3.5
    count = lanes + pocket
    near, far, side_m = 12.0 + 3.5 * count, 112.0, 12.0 + 3.5 * count

    def road(a: tuple[float, float], b: tuple[float, float], number: int, skip: int = 0) -> list:
        lines = [beside(straight(a, b), half + step * (k + skip)) for k in range(number)]
        return lines if side == "right" else lines[::-1]

    groups = {
        "11": road((0, far), (0, near), count), "21": road((0, near), (0, far), lanes, pocket),
        "13": road((0, -far), (0, -near), count), "23": road((0, -near), (0, -far), lanes, pocket),
        "12": road((far, 0), (side_m, 0), 1), "22": road((side_m, 0), (far, 0), 1),
        "14": road((-far, 0), (-side_m, 0), 1), "24": road((-side_m, 0), (-far, 0), 1),
    }  # fmt: skip
    inner, kerb, out_kerb = (0, count - 1, lanes - 1) if side == "right" else (count - 1, 0, 0)
    offset = int(pocket) if side == "right" else 0
    through = tuple((k + offset, k) for k in range(lanes))
    far_turn = {"11": ("22", "24"), "13": ("24", "22")}
    if side == "left":
        far_turn = {a: (n, f) for a, (f, n) in far_turn.items()}
    ways = [
        way
        for a, ahead in (("11", "23"), ("13", "21"))
        for way in (
            Ways(a, ahead, through, f"9{a}"),
            Ways(a, far_turn[a][0], ((inner, 0),), f"9{a}"),
            Ways(a, far_turn[a][1], ((kerb, 0),), f"9{a}"),
        )
    ]
    ways += [
        Ways("12", "24", ((0, 0),), "912"), Ways("14", "22", ((0, 0),), "914"),
        Ways("12", "21", ((0, out_kerb),), "912"), Ways("14", "23", ((0, out_kerb),), "914"),
    ]  # fmt: skip
    return small_roads(groups, ways, side=side)


WORLDS = {
    "plain crossing": lambda: crossing(lit=True),
    "plain crossing, left": lambda: crossing(lit=True, side="left"),
    "three arms": lambda: crossing(lit=True, arms="NES"),
    "one lane, no pocket": lambda: boulevard(1, False),
    "two lanes, pocket": lambda: boulevard(2, True),
    "three lanes, pocket": lambda: boulevard(3, True),
    "three lanes, no pocket": lambda: boulevard(3, False),
    "three lanes, pocket, left": lambda: boulevard(3, True, "left"),
    "grid": lambda: grid_city(GridPlan(columns=2, rows=2, lanes=2)),
    "grid, left": lambda: grid_city(GridPlan(columns=2, rows=2, lanes=3, side="left")),
}


@pytest.mark.parametrize("world", WORLDS)
def test_programs_are_sane(world: str) -> None:
    found = programs(WORLDS[world]())
    assert found
    for meeting, plan in found:
        rows = [[c.id for c in meeting.connectors].index(link) for link in plan.links]
        states = [state for _, state in plan.phases]
        for at, i in enumerate(rows):
            letters = [state[at] for state in states]
            assert {"r", "y"} <= set(letters) <= set("Ggyr")
            assert "G" in letters or "g" in letters, "everybody is served"
            for before, after in zip(letters, letters[1:] + letters[:1], strict=True):
                assert (before, after) not in {("G", "r"), ("g", "r"), ("r", "y"), ("y", "G"), ("y", "g")}
                assert (before, after) != ("G", "g"), "the oncoming traffic must not start into a turning car"
            for other, j in enumerate(rows):
                if meeting.conflicts[i, j]:
                    for state in states:
                        pair = state[at] + state[other]
                        assert pair != "GG"
                        if pair in {"gG", "yG"}:
                            assert meeting.yields[i, j]
        for seconds, state in plan.phases:
            if "y" in state:
                assert YELLOW_S[0] <= seconds <= YELLOW_S[1]
            elif set(state) == {"r"}:
                assert seconds >= ALL_RED_S[0]
        cycle_s = sum(seconds for seconds, _ in plan.phases)
        assert 20.0 < cycle_s < 160.0
        assert 0.0 <= plan.offset_s < cycle_s


def letters_of(world: Roads, movement: Movement, approach: str) -> list[str]:
    ((meeting, plan),) = programs(world)
    at = next(
        k
        for k, link in enumerate(plan.links)
        for i, c in enumerate(meeting.connectors)
        if c.id == link
        and meeting.movements[i] is movement
        and approach in meeting.approaches[meeting.approach_of[i]].block_ids
    )
    return [state[at] for _, state in plan.phases]


@pytest.mark.parametrize("side", ["right", "left"])
def test_a_turn_across_more_than_two_lanes_waits_for_its_arrow(side: DrivingSide) -> None:
    assert PERMISSIVE_LANES == 2
    wide = letters_of(boulevard(3, True, side), Movement.FAR_TURN, "11")
    assert "G" in wide
    assert "g" not in wide
    narrow = letters_of(boulevard(2, True, side), Movement.FAR_TURN, "11")
    assert "G" in narrow
    assert "g" in narrow


def test_a_turn_that_shares_its_lane_yields() -> None:
    shared = letters_of(boulevard(1, False), Movement.FAR_TURN, "11")
    assert "g" in shared
    assert "G" not in shared


def test_wide_roads_without_pockets_are_served_one_side_at_a_time() -> None:
    turning = letters_of(boulevard(3, False), Movement.FAR_TURN, "11")
    ahead = letters_of(boulevard(3, False), Movement.STRAIGHT, "13")
    assert "G" in turning
    assert not any(a == "G" and b == "G" for a, b in zip(turning, ahead, strict=True))


def test_a_light_with_nothing_but_pedestrians_to_stop_for_shows_red_too() -> None:
    roads = small_roads(
        {"1": [straight((0, 0), (50, 0))], "2": [straight((60, 0), (100, 0))]}, [Ways("1", "2", stop_line="5")]
    )
    ((_, plan),) = programs(roads)
    assert [state for _, state in plan.phases] == ["G", "y", "r", "r"]


def test_neighbouring_lights_are_out_of_step() -> None:
    roads = WORLDS["grid"]()
    assert len({plan.offset_s for _, plan in programs(roads)}) == 4
