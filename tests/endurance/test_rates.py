"""Rates: a made-up world of known rates is recovered, naive and boosted, and what cannot be known is not told."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from benchmarks.rate_coverage import (
    BOOSTED,
    CELL,
    NATURAL,
    ToyWorld,
    collisions,
    coverage,
    driven,
    ratio_coverage,
    stopped_coverage,
)
from interplan_sumo.batch.records import Fault
from interplan_sumo.endurance.cell_regression import cell_regression
from interplan_sumo.endurance.looks import hours_needed, looks, stopped_at
from interplan_sumo.endurance.rare_events import RareEventDraws
from interplan_sumo.endurance.rates import endurance_rates, log_ratio
from interplan_sumo.endurance.records import EventRecord, RareEventRecord, RareKind, SegmentRecord, TrafficCell
from interplan_sumo.errors import InputError

structs_replace = msgspec.structs.replace


def segment(index: int, *, hits: int = 0, start: str = "", naive: bool = True) -> SegmentRecord:
    """A kilometre in 100 s with so many at-fault collisions while no rare event was active."""
    hit = EventRecord("collision", 5.0, 50.0, "turn", True, "car", None, 1.0, 0.0, 0.0)
    return SegmentRecord(
        index=index, cell=CELL, planner="idm", planner_hash="h", seed=0, naive=naive, start=start or f"e{index}",
        metres=1000.0, seconds=100.0, weighted_metres=1000.0, weighted_seconds=100.0, final_weight=1.0,
        natural=NATURAL, drawn_with=NATURAL if naive else BOOSTED, opportunities={}, rare_events=(),
        events=(hit,) * hits, metres_at={"turn": 250.0, "straight": 750.0}, wall_s=3.6,
    )  # fmt: skip


def with_jaywalkers(index: int, count: int, fails: int, passed: int = 0) -> SegmentRecord:
    """A boosted segment in which each of so many jaywalkers began after so many draws, and the first few were hit."""
    begun = tuple(RareEventRecord("jaywalker", float(n), str(n), 1.0, 1.0, {"jaywalker": passed}) for n in range(count))
    hits = tuple(
        EventRecord("collision", n + 0.5, 9.0, "straight", True, None, "jaywalker", 0.1, 0.0, 0.0) for n in range(fails)
    )
    return structs_replace(segment(index, naive=False), rare_events=begun, events=hits)


def test_a_rate_counts_events_of_naive_kilometres_per_distance_and_time_in_each_place() -> None:
    found = collisions([segment(n, hits=n % 2) for n in range(80)])
    assert found.total.per_1000_km == pytest.approx(500.0)
    assert found.total.per_hour == pytest.approx(18.0)
    assert found.total.interval is not None
    assert found.total.interval[0] < 500.0 < found.total.interval[1]
    assert found.places["turn"].per_1000_km == pytest.approx(2000.0)
    assert found.places["straight"].per_1000_km == 0.0
    assert found.gain_bound == pytest.approx(1.0)


@pytest.mark.parametrize(("events", "told"), [(29, False), (30, True)])
def test_no_interval_is_told_below_thirty_effective_events(events: int, told: bool) -> None:
    found = collisions([segment(n, hits=int(n < events)) for n in range(100)])
    assert found.total.effective == pytest.approx(events)
    assert (found.total.interval is not None) == told


def test_segments_from_one_start_count_as_one_another() -> None:
    """What happens in all segments of a start, or in none, is known as well as from so many starts only."""
    apart = collisions([segment(n, hits=n % 2) for n in range(200)])
    together = collisions([segment(n, hits=(n // 10) % 2, start=f"e{n // 10}") for n in range(200)])
    assert apart.total.spread is not None
    assert together.total.spread is not None
    assert together.total.spread.log_error > 2.5 * apart.total.spread.log_error


@pytest.mark.parametrize(("naive", "refused"), [(19, True), (20, False)])
def test_rates_need_a_fifth_of_naive_kilometres(naive: int, refused: bool) -> None:
    found = endurance_rates([segment(n, naive=n < naive) for n in range(100)]).planners[0]
    assert bool(found.refused) == bool(not found.measures) == refused


@pytest.mark.parametrize(("begun", "used"), [(9, False), (10, True)])
def test_a_weight_of_more_than_a_tenth_of_all_is_refused_and_the_naive_count_stands(begun: int, used: bool) -> None:
    naive = [structs_replace(segment(n), opportunities={"jaywalker": 100}) for n in range(50)]
    found = collisions([*naive, *(with_jaywalkers(50 + n, 1, 1) for n in range(begun))])
    assert ("jaywalker" in found.given) == used
    assert found.rare["jaywalker"].per_1000_km == pytest.approx(100.0 if used else 0.0)  # 0.001 a draw, 100 per km


def test_a_heavy_weight_among_many_is_refused_from_a_tenth_on() -> None:
    naive = [segment(n) for n in range(50)]
    light = [with_jaywalkers(50 + n, 1, 1) for n in range(100)]
    given = [collisions([*naive, *light, with_jaywalkers(150, 1, 0, passed)]).given for passed in (170, 250)]
    assert [("jaywalker" in each) for each in given] == [True, False]


def test_rates_of_rare_events_are_told_for_other_probabilities_without_driving() -> None:
    run = driven(ToyWorld(800, 0.5, 4), np.random.default_rng(3))
    once = endurance_rates(run, only=("at_fault_collision",)).planners[0].measures["at_fault_collision"]
    rare = endurance_rates(run, {"jaywalker": 0.002}, only=("at_fault_collision",)).planners[0]
    twice = rare.measures["at_fault_collision"]
    assert twice.rare["jaywalker"].per_1000_km == pytest.approx(2.0 * once.rare["jaywalker"].per_1000_km, rel=0.06)
    assert twice.rare["cut_in"].per_1000_km == pytest.approx(once.rare["cut_in"].per_1000_km, rel=0.06)
    assert twice.ordinary.per_1000_km == once.ordinary.per_1000_km


def test_probabilities_that_differ_need_a_word_and_versions_of_a_planner_are_not_mixed() -> None:
    other = structs_replace(segment(1), natural={"jaywalker": 0.1}, drawn_with={"jaywalker": 0.1})
    with pytest.raises(InputError, match="jaywalker was driven with the probabilities"):
        endurance_rates([segment(0), other])
    endurance_rates([segment(0), other], {"jaywalker": 0.1})
    with pytest.raises(InputError, match="two versions"):
        endurance_rates([segment(0), structs_replace(segment(1), planner_hash="i")])
    with pytest.raises(InputError, match="no door could begin"):
        endurance_rates([segment(0)], {"door": 0.1})
    with pytest.raises(InputError, match=r"no kilometre was driven$"):
        endurance_rates([])
    with pytest.raises(InputError, match="no kilometre was driven: 1 planner fault, first: it raised"):
        endurance_rates([structs_replace(segment(0), metres=0.0, fault=Fault("planner", "it raised"))])


def test_a_fault_of_the_planner_is_an_event_and_one_of_ours_is_counted_beside() -> None:
    faults = [structs_replace(segment(n), fault=Fault(kind, "x")) for n, kind in enumerate(("planner", "harness"))]
    found = endurance_rates([*faults, segment(2)]).planners[0]
    assert found.measures["planner_fault"].total.events == 1
    assert found.faults == {"planner": 1, "harness": 1}


@pytest.mark.slow
def test_naive_and_boosted_kilometres_recover_the_rates_of_a_world_that_is_known() -> None:
    """The means over runs are the truth within four standard errors, and nine intervals in ten hold it at least."""
    for naive in (1.0, 0.5):
        world = ToyWorld(1000, naive, 4)
        for holds, width, rate, known in coverage(world, 12).values():
            assert rate == pytest.approx(1.0, abs=0.45 if np.isnan(width) else 0.25)
            assert np.isnan(holds) or holds > 80.0 or known < 50.0


def wary(index: int, *, naive: bool) -> SegmentRecord:
    """Of an ego that hits the first jaywalker of a segment in 6 of 10 cases and those after it in 1 of 10."""
    natural: dict[RareKind, float] = {"jaywalker": 0.001}
    draws, rng = RareEventDraws(index, natural, None if naive else {"jaywalker": 0.02}), np.random.default_rng(index)
    rare: list[RareEventRecord] = []
    hits: list[EventRecord] = []
    for second in range(100):
        found = draws.begins(second, {"jaywalker": ["w"]})
        if found is None:
            continue
        if rng.random() < (0.1 if rare else 0.6):
            hits.append(EventRecord("collision", second, 9.0, "straight", True, "w", "jaywalker", 1.0, 0.0, 0.0))
        rare.append(RareEventRecord("jaywalker", second, "w", found.weight_before, found.weight, found.passed))
    return structs_replace(
        segment(index, naive=naive), natural=natural, drawn_with=draws.drawn_with, opportunities=draws.opportunities,
        rare_events=tuple(rare), events=tuple(hits), final_weight=draws.weight,
    )  # fmt: skip


def test_weights_undo_what_one_boosted_event_does_to_the_next() -> None:
    """Naturally nearly all are the first of their segment: 1 - 0.999^100 of 0.1, so 0.58 of them are hit."""
    run = [wary(n, naive=n % 4 == 0) for n in range(1500)]
    begun = [each for record in run for each in record.rare_events]
    given = collisions(run).given["jaywalker"]
    first = (1.0 - 0.999**100) / 0.1
    assert given.per_event == pytest.approx(0.6 * first + 0.1 * (1.0 - first), abs=0.06)
    assert given.events / len(begun) < 0.4  # unweighted, it would be this
    assert given.interval is not None
    assert given.interval[0] < 0.576 < given.interval[1]


@pytest.mark.nightly
def test_intervals_hold_the_truth_in_93_to_97_of_100_runs() -> None:
    for world in (ToyWorld(1600, 1.0, 4), ToyWorld(2000, 0.5, 4)):
        holds, _, rate, known = coverage(world, 250, seed=1)["total"]
        assert known > 95.0
        assert 92.0 <= holds <= 98.0  # 1.4 points of error with 250 runs
        assert rate == pytest.approx(1.0, abs=0.03)


@pytest.mark.nightly
def test_boosted_and_naive_rates_agree() -> None:
    holds, within = ratio_coverage(ToyWorld(2000, 0.5, 4), ToyWorld(4000, 1.0, 4), 40)
    assert holds >= 85.0
    assert within >= 97.0


@pytest.mark.nightly
def test_an_interval_at_which_somebody_stopped_holds_as_well() -> None:
    holds, events, _ = stopped_coverage(ToyWorld(4000, 0.4, 4), 60, 200, 0.3)
    assert holds > 88.0
    assert 40.0 < events < 90.0


def test_boosting_makes_a_rate_known_from_fewer_kilometres() -> None:
    rng = np.random.default_rng(5)
    naive, boosted = (collisions(driven(ToyWorld(1500, share, 4), rng)) for share in (1.0, 0.4))
    assert naive.total.spread is not None
    assert boosted.total.spread is not None
    assert boosted.total.spread.log_error < 0.9 * naive.total.spread.log_error
    ratio = log_ratio(boosted.total, naive.total)
    assert ratio is not None
    assert ratio[1][0] < 1.0 < ratio[1][1]
    assert boosted.gain_bound == pytest.approx(0.04 / 0.01, rel=0.7)


def test_a_total_of_weighted_events_only_has_no_interval_before_naive_kilometres_say_something() -> None:
    """Of no ordinary event that was seen there may be 3.7."""
    naive = [structs_replace(segment(n), opportunities={"jaywalker": 20}) for n in range(200)]  # 4 begin
    few = collisions([*naive, *(with_jaywalkers(200 + n, 1, 1) for n in range(100))])
    assert few.rare["jaywalker"].effective == pytest.approx(100.0)
    assert few.rare["jaywalker"].interval is not None
    assert few.total.interval is None
    seen = [structs_replace(each, events=segment(0, hits=1).events) if each.index < 5 else each for each in naive]
    enough = collisions([*seen, *(with_jaywalkers(200 + n, 1, 1) for n in range(400))])
    assert (enough.total.interval is not None) == (enough.total.effective >= 30.0)


def looked() -> list[SegmentRecord]:
    return [segment(n, hits=int(n % 5 == 0)) for n in range(500)][::-1]


def test_looks_are_the_same_in_whatever_order_segments_came_and_stop_where_the_interval_is_narrow() -> None:
    found = looks(looked(), "at_fault_collision", 50, 0.3)
    assert found == looks(looked()[::-1], "at_fault_collision", 50, 0.3)
    assert found[0].effective >= 30.0
    assert [look.segments for look in found] == sorted({look.segments for look in found})
    stop = stopped_at(looked(), "at_fault_collision", 50, 0.3)
    assert stop is not None
    assert stop.half_width <= 0.3
    assert all(look.half_width > 0.3 for look in found[: stop.number - 1])
    assert stop.effective > (1.96 / 0.2957) ** 2 * 0.8  # hits are spread evenly: what is binomial varies less


def test_looks_end_where_the_first_segment_is_missing() -> None:
    assert looks([each for each in looked() if each.index != 120], "at_fault_collision", 50, 0.3) == []


def test_a_pilot_says_how_many_hours_it_takes() -> None:
    pilot = [segment(n, hits=int(n % 5 == 0)) for n in range(100)]
    needed = hours_needed(endurance_rates(pilot).planners[0], "at_fault_collision", 0.3)
    assert needed is not None
    assert needed.hours == pytest.approx(needed.kilometres / 1000.0)  # 3.6 s a kilometre
    assert 150.0 < needed.kilometres < 300.0
    assert needed.range[0] < needed.hours < needed.range[1]
    assert needed.naive == 1.0
    assert hours_needed(endurance_rates([segment(0)]).planners[0], "at_fault_collision", 0.3) is None


def test_boosting_pays_where_rare_events_make_the_rate() -> None:
    rng = np.random.default_rng(2)
    needed = hours_needed(endurance_rates(driven(ToyWorld(600, 0.7, 4), rng)).planners[0], "at_fault_collision", 0.3)
    assert needed is not None
    assert 0.2 <= needed.naive < 0.7


def cells(world: ToyWorld, planner: str, density: float, seed: int) -> list[SegmentRecord]:
    """What a planner drives of a toy world in a cell."""
    cell = TrafficCell("toy", density, "mixed")
    run = driven(world, np.random.default_rng(seed))
    return [structs_replace(each, planner=planner, cell=cell) for each in run]


def test_a_regression_over_cells_tells_planner_and_density_apart() -> None:
    quiet = ToyWorld(500, 0.5, 4)
    busy = replace(quiet, places=tuple(replace(each, ordinary=6.0 * each.ordinary) for each in quiet.places))
    segments = [
        *cells(quiet, "careful", 0.3, 1), *cells(busy, "careful", 0.9, 2),
        *cells(quiet, "alike", 0.3, 3), *cells(busy, "alike", 0.9, 4),
    ]  # fmt: skip
    rates = endurance_rates(segments, only=("at_fault_collision",))
    found = cell_regression(rates.cells, "at_fault_collision")
    ratios = {(each.factor, each.level): each for each in found.ratios}
    truth = (0.06 + 0.03) / (0.01 + 0.03)
    low, high = ratios["density", "0.9"].interval
    assert low < truth < high
    assert low > 1.0
    low, high = ratios["planner", "careful"].interval
    assert low < 1.0 < high
    assert len(found.fitted) == 4
    assert [each.cell for each in rates.planners] == [None, None]


def test_a_regression_holds_planners_against_the_one_with_most_events() -> None:
    def of(planner: str, every: int) -> list[SegmentRecord]:
        return [structs_replace(segment(n, hits=int(n % every == 0)), planner=planner) for n in range(100)]

    rates = endurance_rates([*of("able", 10), *of("many", 2), *of("some", 4)])
    found = cell_regression(rates.cells, "at_fault_collision").ratios
    assert [(each.level, each.reference, round(each.ratio, 6)) for each in found] == [
        ("able", "many", 0.2), ("some", "many", 0.5),
    ]  # fmt: skip


def test_a_regression_leaves_out_a_planner_without_events_and_says_so() -> None:
    still = [structs_replace(each, planner="still") for each in map(segment, range(50))]
    half = [structs_replace(segment(n, hits=1), cell=TrafficCell("toy", 0.9, "mixed")) for n in range(50)]
    rates = endurance_rates([*still, *half, *(segment(n, hits=n % 2) for n in range(50))])
    found = cell_regression(rates.cells, "at_fault_collision")
    assert found.left_out == ("planner still (no events)",)
    assert [(each.factor, each.level, round(each.ratio, 6)) for each in found.ratios] == [("density", "0.9", 2.0)]
    assert "two cells" in cell_regression(rates.cells[:1], "at_fault_collision").why_not
