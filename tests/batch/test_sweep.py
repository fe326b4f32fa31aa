"""Sweep: every combination is a run of its own with the traffic that was asked for; repeating it drives nothing."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from defusedxml.ElementTree import parse
from hypothesis import given
from hypothesis import strategies as st

from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.overrides import Overrides
from interplan_sumo.batch.records import Row
from interplan_sumo.batch.run_folder import TRAFFIC
from interplan_sumo.batch.sweep import (
    TYPICAL_S,
    Estimate,
    Parameter,
    Result,
    Sweep,
    as_number,
    estimate,
    plan_sweep,
    run_combination,
)
from interplan_sumo.batch.traffic_files import Edit, changed_text, sweepable, write_changed
from interplan_sumo.errors import InputError, RunFolderError, UnknownNameError
from interplan_sumo.resources import routes_root
from interplan_sumo.scenario.files import write_scenarios
from interplan_sumo.scenario.scenario import Scenario, TrafficDemand
from interplan_sumo.simulation.vehicle_types import read_vehicle_types
from tests.batch.busy import BUSY

OTHER = replace(BUSY, id="mine/1", traffic=TrafficDemand("low", "conservative"))
ALONE = replace(BUSY, id="mine/2", traffic=TrafficDemand())


def planned(place: Path, *params: str, scenarios: Sequence[Scenario] = (BUSY,), **changes: Any) -> Sweep:
    write_scenarios(scenarios, place / "mine.yaml")
    base = RunOptions(("straight_ahead",), place / "sweep", scenarios=(str(place / "mine.yaml"),), workers=0)
    return plan_sweep(replace(base, **changes), [Parameter.parse(param) for param in params])


def driven(sweep: Sweep) -> list[Result]:
    return [run_combination(combination) for combination in sweep.combinations]


def rows_of(result: Result) -> list[Row]:
    return [row for run in result.runs for row in run.rows.values()]


# --- parameters ---


def test_a_parameter_has_its_values_in_the_order_given() -> None:
    assert Parameter.parse("interplan.reactOverlap=1,0,0.5") == Parameter("interplan.reactOverlap", ("1", "0", "0.5"))
    assert Parameter.parse("assertive.lcAssertive=2").key == "assertive.lcAssertive"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("tau", "has no values"),
        ("tau=", "has no values"),
        ("tau=1,,2", "has no values"),
        ("tau=1,1.0", "gives 1.0 twice"),
        ("tau=../1", "is no value"),
        ("sigmaa=1", "Did you mean 'sigma'"),
        ("interplan.reactOverlapp=1", "Did you mean 'interplan.reactOverlap'"),
        ("lcAsertive=1", "Did you mean 'lcAssertive'"),
        ("assertive.lcAsertive=1", "Did you mean 'lcAssertive'"),
        ("densty=low", "Did you mean 'density'"),
        ("density=hihg", "Did you mean 'high'"),
        ("behaviour=asertive", "Did you mean 'assertive'"),
        ("perception=noisi", "no perception named 'noisi'"),
        ("perception=noisy+occluded", "is called occluded.noisy"),
        ("track=plian", "Did you mean 'plain'"),
        ("trak=plain", "Did you mean 'track'"),
        ("id=a,b", "no vType attribute"),
        ("probability=0.1,0.9", "name one: --param TYPE.probability"),
    ],
)
def test_a_parameter_that_cannot_be_is_one_line(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        Parameter.parse(text)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("text", "number"), [("0.50", 0.5), ("-1", -1.0), ("IDM", None), ("nan", None), ("inf", None)])
def test_a_number_is_told_from_a_word(text: str, number: float | None) -> None:
    assert as_number(text) == number


@given(
    st.sampled_from(sorted(sweepable() - {"probability"})), st.from_regex(r"[a-z]{1,8}(\.[a-z]{1,8})?", fullmatch=True)
)
def test_every_key_can_be_set_for_all_types_or_for_one(key: str, type_id: str) -> None:
    assert Edit.of(key, "1") == Edit(None, key, "1")
    assert Edit.of(f"{type_id}.{key}", "1") == Edit(type_id, key, "1")


# --- vehicle-type files ---


def attributes(path: Path, key: str) -> dict[str, str]:
    """An attribute or parameter of every type in a file."""
    found: dict[str, str] = {}
    for element in parse(path).iter("vType"):
        params = {param.attrib["key"]: param.attrib["value"] for param in element.iter("param")}
        found[element.attrib["id"]] = {**element.attrib, **params}.get(key, "")
    return found


def test_an_edit_reaches_every_type_or_the_one_that_is_named(tmp_path: Path) -> None:
    source, target = routes_root() / "mixed.xml", tmp_path / "changed.xml"
    write_changed(source, [Edit.of("tau", "2.5"), Edit.of("assertive.interplan.reactOverlap", "0.3")], target)
    assert attributes(target, "tau") == {"conservative": "2.5", "assertive": "2.5"}
    assert attributes(target, "interplan.reactOverlap") == {"conservative": "0", "assertive": "0.3"}
    assert attributes(target, "lcAssertive") == attributes(source, "lcAssertive")
    types = read_vehicle_types(target)
    assert [(each.tau_s, each.react_overlap) for each in types.members] == [(2.5, 0.0), (2.5, 0.3)]


def test_a_parameter_that_the_file_lacks_is_added(tmp_path: Path) -> None:
    write_changed(routes_root() / "mixed.xml", [Edit.of("interplan.swerve", "true")], tmp_path / "changed.xml")
    assert all(member.swerve for member in read_vehicle_types(tmp_path / "changed.xml").members)


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("tau", "11", r"mixed\.xml cannot have tau=11: line \d+: tau is 11, expected 0.1 to 10"),
        ("interplan.reactOverlap", "1.1", "expected 0 to 1"),
        ("interplan.swerve", "1", "expected true or false"),
        ("tau", "fast", "expected a number"),
    ],
)
def test_a_value_that_no_driver_has_is_refused_and_leaves_no_file(
    key: str, value: str, words: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=words):
        write_changed(routes_root() / "mixed.xml", [Edit.of(key, value)], tmp_path / "changed.xml")
    assert list(tmp_path.iterdir()) == []


def test_the_bounds_themselves_are_values(tmp_path: Path) -> None:
    for value in ("0.1", "10"):
        write_changed(routes_root() / "mixed.xml", [Edit.of("tau", value)], tmp_path / "changed.xml")


def test_a_type_that_the_file_does_not_hold_is_suggested() -> None:
    with pytest.raises(UnknownNameError, match=r"no vType in mixed\.xml named 'asertive'\. Did you mean 'assertive'"):
        changed_text(routes_root() / "mixed.xml", [Edit.of("asertive.tau", "1")])


def test_shares_that_stand_at_the_distribution_are_not_changed_in_vain(tmp_path: Path) -> None:
    (tmp_path / "mine.xml").write_text(
        '<additional><vType id="a"/><vType id="b"/>'
        '<vTypeDistribution id="traffic" vTypes="a b" probabilities="0.5 0.5"/></additional>'
    )
    with pytest.raises(InputError, match="move them to the vTypes"):
        changed_text(tmp_path / "mine.xml", [Edit.of("a.probability", "0.9")])


def test_members_that_name_a_type_follow_it_and_take_its_new_share(tmp_path: Path) -> None:
    (tmp_path / "mine.xml").write_text(
        '<additional><vType id="a"/><vType id="b"/><vTypeDistribution id="traffic">'
        '<vType refId="a" probability="3"/><vType refId="b"/></vTypeDistribution></additional>'
    )
    edits = [Edit.of("tau", "2.5"), Edit.of("a.probability", "0.9"), Edit.of("b.probability", "0.2")]
    write_changed(tmp_path / "mine.xml", edits, tmp_path / "changed.xml")
    types = read_vehicle_types(tmp_path / "changed.xml")
    assert ([each.tau_s for each in types.members], types.probabilities) == ([2.5, 2.5], (0.9, 0.2))


def test_an_edit_wins_over_a_nested_car_following_element(tmp_path: Path) -> None:
    (tmp_path / "mine.xml").write_text(
        '<additional><vType id="traffic" accel="1.5"><carFollowing-IDM tau="1.6" accel="2.0"/></vType></additional>'
    )
    for key, value in (("tau", "0.9"), ("carFollowModel", "Krauss")):
        write_changed(tmp_path / "mine.xml", [Edit.of(key, value)], tmp_path / f"{key}.xml")
    slower, other = (read_vehicle_types(tmp_path / f"{key}.xml") for key in ("tau", "carFollowModel"))
    assert (slower.members[0].tau_s, other.members[0].tau_s) == (0.9, 1.6)
    assert [each.elements["traffic"].model for each in (slower, other)] == ["IDM", "Krauss"]
    assert slower.members[0].accel_mps2 == other.members[0].accel_mps2 == 2.0


def test_every_shipped_attribute_can_be_swept() -> None:
    shipped = {
        key for path in routes_root().glob("*.xml") for element in parse(path).iter("vType") for key in element.attrib
    }
    assert shipped - {"id"} <= sweepable()


# --- combinations ---


def test_combinations_are_the_product_in_the_order_given(tmp_path: Path) -> None:
    sweep = planned(tmp_path, "density=high,low", "tau=1,2,3")
    names = [combination.name for combination in sweep.combinations]
    assert names == [f"density={d},tau={t}" for d in ("high", "low") for t in (1, 2, 3)]
    assert sweep.drives == 6
    assert [part.folder for part in sweep.combinations[0].parts] == [tmp_path / "sweep" / names[0]]
    assert sorted(path.name for path in (tmp_path / "sweep" / TRAFFIC).iterdir()) == [
        f"mixed+tau={t}.xml" for t in (1, 2, 3)
    ]


def test_only_vehicle_types_that_change_need_a_file(tmp_path: Path) -> None:
    sweep = planned(tmp_path, "density=high,low", "behaviour=assertive,mixed")
    overrides = [part.options.overrides for combination in sweep.combinations for part in combination.parts]
    assert overrides == [Overrides(d, b) for d in ("high", "low") for b in ("assertive", "mixed")]
    assert not (tmp_path / "sweep" / TRAFFIC).exists()


def test_a_swept_behaviour_is_the_file_that_is_changed(tmp_path: Path) -> None:
    sweep = planned(tmp_path, "behaviour=assertive,urban", "tau=2")
    files = [combination.parts[0].options.traffic for combination in sweep.combinations]
    assert [file.name for file in files if file] == ["assertive+tau=2.xml", "urban+tau=2.xml"]


def test_scenarios_of_several_behaviours_keep_their_own_drivers(tmp_path: Path) -> None:
    sweep = planned(tmp_path, "tau=2", scenarios=(BUSY, OTHER, ALONE))
    (combination,) = sweep.combinations
    folders = {part.folder.name: part.scenarios for part in combination.parts}
    assert folders == {"mixed": ("mine/0", "mine/2"), "conservative": ("mine/1",)}
    assert len(combination.keys) == sweep.drives == 3
    assert sweep.unchanged == ("mine/2",)


def test_a_file_given_with_traffic_is_the_one_that_is_changed(tmp_path: Path) -> None:
    shutil.copy(routes_root() / "urban.xml", tmp_path / "town.xml")
    sweep = planned(tmp_path, "bus.tau=2,3", scenarios=(BUSY, OTHER), traffic=tmp_path / "town.xml")
    files = [part.options.traffic for each in sweep.combinations for part in each.parts]
    assert [file.name for file in files if file] == ["town+bus.tau=2.xml", "town+bus.tau=3.xml"]


@pytest.mark.parametrize(
    ("params", "given", "words"),
    [
        ((), {}, "nothing to vary"),
        (("tau=1", "tau=2"), {}, "--param tau is given twice"),
        (("density=low",), {"density": "high"}, "--set density fixes what --param density varies"),
        (("behaviour=mixed",), {"behaviour": "urban"}, "--set behaviour fixes"),
        (("behaviour=mixed",), {"traffic": routes_root() / "urban.xml"}, "give only one"),
        (("track=plain,bold",), {"traffic": routes_root() / "urban.xml"}, "--param track varies; give only one"),
        (("track=plain,late",), {"perception": "noisy"}, "--set perception fixes what --param track varies"),
        (("density=low", "track=plain,dense"), {}, "--param density and --param track both vary density"),
        (("bus.tau=1",), {}, "no vType in mixed.xml named 'bus'"),
    ],
)
def test_what_contradicts_itself_is_refused_before_anything_is_driven(
    params: tuple[str, ...], given: dict[str, Any], words: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=words):
        planned(tmp_path, *params, **given)


def test_a_track_changes_one_thing_in_each_scene_and_adds_to_what_hides_others_there(tmp_path: Path) -> None:
    hidden = replace(OTHER, perception="occluded")
    sweep = planned(tmp_path, "track=noisy,plain,late,dense,bold", scenarios=(BUSY, hidden, ALONE))
    parts = {part.folder.relative_to(sweep.folder).as_posix(): part for c in sweep.combinations for part in c.parts}
    overrides = {name: part.options.overrides for name, part in parts.items()}
    assert overrides == {
        "track=noisy/noisy": Overrides(perception="noisy"),
        "track=noisy/occluded+noisy": Overrides(perception="occluded+noisy"),
        "track=plain": Overrides(),
        "track=late/late": Overrides(perception="late"),
        "track=late/occluded+late": Overrides(perception="occluded+late"),
        "track=dense": Overrides(density="high"),
        "track=bold": Overrides(behaviour="measured_city_bold"),
    }
    assert parts["track=noisy/occluded+noisy"].scenarios == ("mine/1",)
    assert sweep.drives == 15
    assert sweep.unchanged == ()


def test_vehicle_types_are_changed_of_the_drivers_that_a_track_asks_for(tmp_path: Path) -> None:
    sweep = planned(tmp_path, "track=bold", "tau=2", scenarios=(BUSY, OTHER))
    files = {part.options.traffic.name: part.scenarios for part in sweep.combinations[0].parts if part.options.traffic}
    assert files == {"measured_city_bold+tau=2.xml": ("mine/0", "mine/1")}


@pytest.mark.parametrize("limit", [0, -1])
def test_a_limit_that_leaves_nothing_is_refused(limit: int, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected 1 or more"):
        planned(tmp_path, "density=low", limit=limit)
    assert planned(tmp_path, "density=low", scenarios=(BUSY, OTHER), limit=1).drives == 1


def test_a_run_folder_is_no_place_for_a_sweep(tmp_path: Path) -> None:
    (tmp_path / "sweep").mkdir()
    (tmp_path / "sweep" / "manifest.json").touch()
    with pytest.raises(RunFolderError, match="holds a run"):
        planned(tmp_path, "tau=1")


def test_a_folder_whose_files_sumo_cannot_read_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a,b").mkdir()
    with pytest.raises(InputError, match="no file with a comma"):
        planned(tmp_path / "a,b", "tau=1")


# --- drives ---


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> tuple[Sweep, list[Result]]:
    """Two headways, driven; not to be changed."""
    sweep = planned(tmp_path_factory.mktemp("swept"), "tau=1,3")
    return sweep, driven(sweep)


def test_a_changed_parameter_changes_the_drives_and_rows_say_what_was_changed(
    swept: tuple[Sweep, list[Result]],
) -> None:
    short, long = (rows_of(result)[0] for result in swept[1])
    assert short.trace_hash != long.trace_hash
    assert not short.official
    assert str(short.overrides.traffic).startswith("mixed+tau=1.xml sha256:")
    assert all(result.missing == [] and result.failure is None for result in swept[1])


def test_repeating_a_sweep_drives_nothing_again(swept: tuple[Sweep, list[Result]]) -> None:
    sweep, before = swept
    held = {path: path.read_bytes() for path in sweep.folder.rglob("results.jsonl")}
    assert [rows_of(result) for result in driven(sweep)] == [rows_of(result) for result in before]
    assert {path: path.read_bytes() for path in sweep.folder.rglob("results.jsonl")} == held


def test_an_estimate_is_a_guess_until_drives_were_timed(swept: tuple[Sweep, list[Result]], tmp_path: Path) -> None:
    assert estimate(planned(tmp_path, "tau=1,3"), 2) == Estimate(2, TYPICAL_S, timed=False, workers=2)
    found = estimate(swept[0], 1)
    assert (found.drives, found.timed) == (0, True)
    assert Estimate(6, 2.0, timed=True, workers=4).wall_s == Estimate(6, 2.0, timed=True, workers=0).wall_s / 4 == 3.0


def test_a_combination_that_cannot_be_run_says_why_and_leaves_the_others(
    swept: tuple[Sweep, list[Result]],
) -> None:
    sweep, _ = swept
    (part,) = sweep.combinations[0].parts
    foreign = part.folder.parent / "foreign"
    foreign.mkdir(exist_ok=True)
    (foreign / "letter.txt").touch()
    broken = replace(sweep.combinations[0], parts=(replace(part, options=replace(part.options, out=foreign)),))
    result = run_combination(broken)
    assert result.failure is not None
    assert "holds 'letter.txt'" in result.failure
    assert result.missing == broken.keys
