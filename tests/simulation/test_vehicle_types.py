"""Vehicle-type files: what is read, what is refused, and where the error points."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from networks import LANE_Y, NETWORK_FILE, ego_at, traffic

from interplan_sumo.errors import UnknownNameError, VehicleTypeError
from interplan_sumo.resources import routes_root
from interplan_sumo.simulation.spawning import Spawn
from interplan_sumo.simulation.sumo import sumo
from interplan_sumo.simulation.vehicle_type_effects import car_following_models
from interplan_sumo.simulation.vehicle_type_schema import vehicle_type_schema
from interplan_sumo.simulation.vehicle_types import (
    CLASS_OF_KIND,
    CLASSES,
    VehicleType,
    read_vehicle_types,
    vehicle_type_file,
)
from tests.yardstick import at_most


def file(folder: Path, text: str) -> Path:
    path = folder / "types.xml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(("behaviour", "overlap"), [("conservative", 0.0), ("assertive", 1.0)])
def test_the_shipped_behaviours_differ_in_the_overlap_at_which_they_react(behaviour: str, overlap: float) -> None:
    (member,) = read_vehicle_types(vehicle_type_file(behaviour)).members
    assert member.react_overlap == overlap
    assert (member.accel_mps2, member.decel_mps2, member.min_gap_m) == (1.0, 2.0, 1.0)  # interPlan's IDM


def test_mixed_draws_both_behaviours_and_the_same_ones_for_the_same_seed() -> None:
    mixed = read_vehicle_types(vehicle_type_file("mixed"))
    rngs = [np.random.default_rng(7), np.random.default_rng(7)]
    first, second = ([mixed.draw(rng).id for _ in range(50)] for rng in rngs)
    assert first == second
    assert set(first) == {"conservative", "assertive"}


def test_a_member_without_probability_is_never_drawn(tmp_path: Path) -> None:
    path = file(
        tmp_path,
        '<additional><vType id="a"/><vType id="b"/>'
        '<vTypeDistribution id="traffic" vTypes="a b" probabilities="0 1"/></additional>',
    )
    rng = np.random.default_rng(0)
    assert {read_vehicle_types(path).draw(rng).id for _ in range(50)} == {"b"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('<additional>\n<vType id="traffic" taau="1"/>\n</additional>', r"line 2: .*'taau'; did you mean 'tau'"),
        ('<additional>\n<vType id="traffic" tau="0"/></additional>', r"line 2: tau is 0, expected 0.1 to 10"),
        ('<additional>\n<vType id="traffic" tau="fast"/></additional>', r"line 2: tau is 'fast', expected a number"),
        ('<additional>\n<vType id="traffic" tau="nan"/></additional>', r"line 2: tau is 'nan', expected a number"),
        (
            '<additional><vType id="traffic">\n<param key="interplan.reactOverlap" value="1.01"/></vType></additional>',
            r"line 2: interplan.reactOverlap is 1.01, expected 0 to 1",
        ),
        (
            '<additional><vType id="traffic">\n<param key="interplan.overlap" value="1"/></vType></additional>',
            r"line 2: unknown parameter 'interplan.overlap'",
        ),
        ('<additional><vType id="cars"/></additional>', r"no vType or vTypeDistribution with id 'traffic'"),
        ('<additional>\n<vehicle id="x"/></additional>', r"line 2: <vehicle> does not belong"),
        ('<additional>\n<vType id="traffic"', r"line 2: not well-formed"),
        ('<!DOCTYPE x [<!ENTITY e "e">]><additional><vType id="traffic"/></additional>', r"cannot be read"),
        ("", r"not well-formed"),
        ('<additional><vType id="traffic"/><vType id="traffic"/></additional>', r"'traffic' is used twice"),
        (
            '<additional><vTypeDistribution id="traffic" vTypes="a"/></additional>',
            r"names the vType 'a', which is not defined",
        ),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_with_file_and_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(VehicleTypeError, match=message) as error:
        read_vehicle_types(file(tmp_path, text))
    assert "types.xml" in str(error.value)


@pytest.mark.parametrize(
    ("attribute", "lowest", "highest"),
    [("length", 0.5, 30.0), ("width", 0.3, 4.0), ("accel", 0.1, 15.0), ("decel", 0.1, 15.0), ("tau", 0.1, 10.0),
     ("minGap", 0.0, 20.0), ("maxSpeed", 0.1, 100.0), ("speedFactor", 0.1, 3.0), ("emergencyDecel", 0.1, 20.0)],
)  # fmt: skip
def test_a_number_is_taken_up_to_its_bounds_and_not_beyond(
    attribute: str, lowest: float, highest: float, tmp_path: Path
) -> None:
    for value, fine in ((lowest, True), (highest, True), (lowest - 0.01, False), (highest + 0.01, False)):
        path = file(tmp_path, f'<additional><vType id="traffic" {attribute}="{value}"/></additional>')
        if fine:
            assert len(read_vehicle_types(path).members) == 1
        else:
            with pytest.raises(VehicleTypeError, match=f"{attribute} is "):
                read_vehicle_types(path)


def test_a_missing_file_and_an_unknown_behaviour_are_named(tmp_path: Path) -> None:
    with pytest.raises(VehicleTypeError, match=r"no vehicle-type file at .*nowhere\.xml"):
        read_vehicle_types(tmp_path / "nowhere.xml")
    with pytest.raises(UnknownNameError, match="Did you mean 'mixed'"):
        vehicle_type_file("mixt")


def test_an_edited_file_is_read_again(tmp_path: Path) -> None:
    path = file(tmp_path, '<additional><vType id="traffic" tau="1.5"/></additional>')
    assert read_vehicle_types(path).members[0].tau_s == 1.5
    path.write_text('<additional><vType id="traffic" tau="1.25"/></additional>')
    assert read_vehicle_types(path).members[0].tau_s == 1.25


def test_city_traffic_has_trucks_buses_and_motorcycles() -> None:
    urban = read_vehicle_types(vehicle_type_file("urban"))
    lengths = {member.id: member.length_m for member in urban.members}
    assert {"truck", "bus", "motorcycle"} < set(lengths)
    assert lengths["motorcycle"] < lengths["conservative"] < lengths["truck"] < lengths["bus"]
    assert sum(urban.probabilities) == pytest.approx(1.0)


def test_the_published_codes_cautious_drivers_look_three_seconds_ahead() -> None:
    cautious, plain = read_vehicle_types(vehicle_type_file("interplan_code")).members
    assert (cautious.anticipation_s, plain.anticipation_s) == (3.0, 0.0)
    assert cautious.react_overlap == plain.react_overlap == 0.0


@pytest.mark.parametrize(
    ("key", "field", "highest"),
    [("reactionTime", "reaction_time_s", 2.0), ("courtesy", "courtesy", 1.0), ("relaxation", "relaxation_s", 30.0)],
)
def test_a_drivers_keys_are_read_within_their_bounds_and_default_to_none(
    key: str, field: str, highest: float, tmp_path: Path
) -> None:
    def read(value: float) -> VehicleType:
        text = f'<additional><vType id="traffic"><param key="interplan.{key}" value="{value}"/></vType></additional>'
        return read_vehicle_types(file(tmp_path, text)).members[0]

    assert getattr(read(highest), field) == highest
    assert getattr(VehicleType("plain"), field) == getattr(read(0.0), field) == 0.0
    for value in (-0.01, highest + 0.01):
        with pytest.raises(VehicleTypeError, match=f"interplan.{key} is .*, expected 0 to {highest:g}"):
            read(value)


def test_the_car_following_model_is_sumos_or_the_files(tmp_path: Path) -> None:
    path = file(tmp_path, '<additional><vType id="traffic"/><vType id="x" carFollowModel="EIDM"/></additional>')
    types = read_vehicle_types(path)
    assert (types.members[0].car_following_model, types.others[0].car_following_model) == ("Krauss", "EIDM")


def test_what_a_class_leaves_out_is_what_sumo_takes(tmp_path: Path) -> None:
    import libsumo

    names = ["passenger", *CLASSES]
    rows = "".join(f'<vType id="{name}" vClass="{name}" carFollowModel="IDM"/>' for name in names)
    path = file(
        tmp_path, f'<additional>{rows}<vTypeDistribution id="traffic" vTypes="{" ".join(names)}"/></additional>'
    )
    members = read_vehicle_types(path).members
    libsumo.start(
        ["sumo", "-n", str(NETWORK_FILE), "-a", str(path), "--no-step-log", "true", "--default.speeddev", "0"]
    )
    try:
        kind = libsumo.vehicletype
        libsumo.route.add("there", ["e0"])
        for place, name in enumerate(names):
            libsumo.vehicle.add(name, "there", name, departPos=f"{20 * place + 20}")
        libsumo.simulationStep()
        limit_mps = libsumo.lane.getMaxSpeed("e0_0")
        for each in members:
            ours = (
                each.length_m, each.width_m, each.min_gap_m, each.tau_s, each.accel_mps2, each.decel_mps2,
                each.emergency_decel_mps2, min(limit_mps, each.max_speed_mps), each.speed_factor,
            )  # fmt: skip
            theirs = (
                kind.getLength(each.id), kind.getWidth(each.id), kind.getMinGap(each.id), kind.getTau(each.id),
                kind.getAccel(each.id), kind.getDecel(each.id), kind.getEmergencyDecel(each.id),
                libsumo.vehicle.getAllowedSpeed(each.id), kind.getSpeedFactor(each.id),
            )  # fmt: skip
            assert ours == pytest.approx(theirs, abs=1e-6), each.id
    finally:
        libsumo.close()


def one(folder: Path, attributes: str, inner: str = "") -> Path:
    return file(folder, f'<additional><vType id="traffic" {attributes}>{inner}</vType></additional>')


def test_every_attribute_of_sumos_schema_is_taken(tmp_path: Path) -> None:
    samples = {"refId": "traffic", "vClass": "bus", "carFollowModel": "W99", "emissionClass": "zero"}
    for name, kind in vehicle_type_schema().attributes.items():
        tried = (
            samples.get(name),
            "0.5",
            "1",
            *(word for each in (kind, *kind.either) for word in each.words),
            "1,0,0",
        )
        value = next(text for text in tried if text is not None and kind.takes(text))
        if name not in ("id", "maxAccelProfile", "desAccelProfile"):
            assert len(read_vehicle_types(one(tmp_path, f'{name}="{value}"')).members) == 1


@pytest.mark.parametrize(
    ("attributes", "message"),
    [
        ('lcPushi="1"', r"unknown attribute 'lcPushi'; did you mean 'lcPushy'"),
        ('cc1="fast"', r"cc1 is 'fast', expected a number, or a distribution"),
        ('lcOvertakeDeltaSpeedFactor="2"', r"lcOvertakeDeltaSpeedFactor is 2, expected -1 to 1"),
        ('jmStopSignWait="-1"', r"jmStopSignWait is -1, expected 0 to 1000"),
        ('maxvehpreview="1.5"', r"maxvehpreview is '1.5', expected a whole number above 0"),
        ('laneChangeModel="LC2014"', r"laneChangeModel is 'LC2014', expected default, DK2008, LC2013"),
        ('jmDriveAfterRedTime="-2"', r"jmDriveAfterRedTime is '-2', expected a number of at least 0 or -1"),
        ('carFollowModel="Kerner"', r"carFollowModel is 'Kerner', which SUMO has not; did you mean 'BKerner'"),
        ('carFollowModel="CC"', r"carFollowModel CC is steered by Plexe"),
        ('carFollowModel="SmartSK"', r"carFollowModel SmartSK never speeds up"),
        ('carFollowModel="Rail"', r"carFollowModel Rail moves trains"),
        ('vClass="ship"', r"vClass is 'ship', which does not drive on roads"),
        ('vClass="passanger"', r"vClass is 'passanger', which SUMO has not; did you mean 'passenger'"),
        ('maxAccelProfile="3 2"', r"maxAccelProfile has 2 numbers and speedTable 0; they belong in pairs"),
        ('maxAccelProfile="3 x" speedTable="0 5"', r"maxAccelProfile is 'x', expected a number"),
        ('tau="norm(1)"', r"tau is 'norm\(1\)': expected a distribution such as"),
        ('tau="weibull(1,2)"', r"'weibull' is no distribution; known: norm, normc"),
        ('tau="norm(-5,0.1)"', r"hardly ever from 0.1 to 10"),
        ('speedDev="norm(0,1)"', r"speedDev is 'norm\(0,1\)', expected a number"),
        ('speedFactor="2.5" speedDev="0.01"', r"hardly ever from 0.2 to 2"),
    ],
)
def test_what_sumo_would_refuse_or_overlook_is_refused_in_one_line(
    tmp_path: Path, attributes: str, message: str
) -> None:
    with pytest.raises(VehicleTypeError, match=rf"types\.xml, line 1: .*{message}"):
        read_vehicle_types(one(tmp_path, attributes))


def test_hostile_files_give_one_short_line_quickly(tmp_path: Path) -> None:
    path = tmp_path / "types.xml"
    for text in (
        b'<?xml version="1.0" encoding="bogus"?><additional/>',
        b'<additional><vType id="traffic" tau="' + 3_900_000 * b"1" + b'"/></additional>',
        b'<additional><vType id="traffic" tau="' + 8_000_000 * b"1" + b'"/></additional>',
        b'<additional><vType id="traffic" ' + 3_900_000 * b"a" + b'="1"/></additional>',
        b"<additional>" + 300_000 * b"<a>",
    ):
        path.write_bytes(text)
        with at_most(67), pytest.raises(VehicleTypeError) as error:
            read_vehicle_types(path)
        assert len(str(error.value)) < 400
        assert "\n" not in str(error.value)


def test_every_model_that_is_taken_starts_from_a_standstill_and_the_one_refused_for_it_does_not(tmp_path: Path) -> None:
    import libsumo

    names = [*car_following_models(), "SmartSK"]
    rows = "".join(f'<vType id="{name}" carFollowModel="{name}"/>' for name in names)
    path = file(tmp_path, f"<additional>{rows}</additional>")
    libsumo.start(["sumo", "-n", str(NETWORK_FILE), "-a", str(path), "--no-step-log", "true", "--step-length", "0.1"])
    try:
        libsumo.route.add("there", ["e0", "e1"])
        for place, name in enumerate(names):
            lane, position_m = place % 3, 380.0 - 60.0 * (place // 3)
            libsumo.vehicle.add(name, "there", name, departLane=str(lane), departPos=f"{position_m}", departSpeed="0")
            libsumo.vehicle.setLaneChangeMode(name, 0)
        for _ in range(100):
            libsumo.simulationStep()
        moving = {name for name in names if libsumo.vehicle.getSpeed(name) > 5.0}
    finally:
        libsumo.close()
    assert moving == set(car_following_models())


def test_a_truth_that_sumo_reads_as_a_number_is_handed_over_as_one(tmp_path: Path) -> None:
    for given, handed in (("true", "1"), ("on", "1"), ("false", "0"), ("1", "1"), ("0", "0")):
        types = read_vehicle_types(one(tmp_path, f'carFollowModel="EIDM" vehdynamics="{given}"'))
        assert f'vehdynamics="{handed}"' in types.sumo_document()
    with traffic(types, (Spawn("e0_1", 20.0, 4.0, types.members[0], ("e0", "e1")),), ego_at(1000.0, LANE_Y[0])) as run:
        assert len(run.observe().actors) == 1


def test_a_nested_car_following_element_is_part_of_its_type(tmp_path: Path) -> None:
    (member,) = read_vehicle_types(one(tmp_path, 'accel="1"', '<carFollowing-EIDM tau="3"/>')).members
    assert (member.car_following_model, member.tau_s, member.accel_mps2) == ("EIDM", 3.0, 1.0)


def test_what_is_said_last_of_a_type_holds_whether_a_number_or_a_distribution(tmp_path: Path) -> None:
    spread = "normal(1.5,0.2)"
    plain_last = read_vehicle_types(one(tmp_path, f'tau="{spread}"', '<carFollowing-IDM tau="3"/>'))
    spread_last = read_vehicle_types(one(tmp_path, 'tau="3"', f'<carFollowing-IDM tau="{spread}"/>'))
    rng = np.random.default_rng(0)
    assert {plain_last.draw(rng).tau_s for _ in range(20)} == {3.0}
    assert len({spread_last.draw(rng).tau_s for _ in range(20)}) == 20


def test_a_distribution_may_refer_to_types_defined_before_it(tmp_path: Path) -> None:
    text = '<vType id="a"/><vTypeDistribution id="traffic"><vType refId="a" probability="3"/></vTypeDistribution>'
    types = read_vehicle_types(file(tmp_path, f"<additional>{text}</additional>"))
    assert [(each.id, share) for each, share in zip(types.members, types.probabilities, strict=True)] == [("a", 3.0)]


@pytest.mark.parametrize(
    ("attributes", "warned"),
    [
        (
            'laneChangeModel="SL2015" lcPushy="1"',
            ["lcPushy cannot act: it acts only with lateral resolution"],
        ),
        ('minGapLat="1" latAlignment="left"', ["minGapLat, latAlignment cannot act"]),
        ('carFollowModel="IDM" cc1="2"', ["cc1 cannot act: IDM does not read it, only W99"]),
        ('carFollowModel="W99" cc1="2"', []),
        ('carFollowModel="ACC" collisionAvoidanceOverride="2"', []),
        ('ploegH="1"', ["ploegH cannot act: Krauss does not read it, only CC, which cannot run here"]),
        ('carFollowModel="KraussX" tmp1="2" tau="1"', []),
        ('speedFactor="normc(1,0.1,0.8,1.2)"', []),
        ('speedFactor="normc(1,0.1,0.8,1.2)" speedDev="0"', ["speedDev 0 takes the spread of speedFactor away"]),
        ('timeToTeleport="5"', ["nothing here is ever teleported"]),
    ],
)
def test_what_cannot_act_is_warned_of_in_one_line_each(tmp_path: Path, attributes: str, warned: list[str]) -> None:
    found = read_vehicle_types(one(tmp_path, attributes)).warnings
    assert len(found) == len(warned)
    assert all(text in line for text, line in zip(warned, found, strict=True))


def test_a_parameter_that_nobody_reads_is_warned_of(tmp_path: Path) -> None:
    keys = ("foo.bar", "has.battery.device", "device.battery.capacity", "interplan.courtesy")
    inner = "".join(f'<param key="{key}" value="1"/>' for key in keys)
    found = read_vehicle_types(file(tmp_path, f'<additional><vType id="traffic">{inner}</vType></additional>'))
    (warning,) = found.warnings
    assert "foo.bar cannot act: of the parameters of a vType SUMO reads those of devices only" in warning


def test_a_lane_change_model_that_cannot_be_told_anything_is_refused(tmp_path: Path) -> None:
    with pytest.raises(VehicleTypeError, match=r"line \d+: laneChangeModel DK2008 cannot be told .*; take another one"):
        read_vehicle_types(one(tmp_path, 'laneChangeModel="DK2008"'))


def test_the_shipped_files_have_nothing_that_cannot_act() -> None:
    for path in routes_root().glob("*.xml"):
        assert read_vehicle_types(path).warnings == ()


SPREAD = (
    'carFollowModel="IDM" tau="normc(1.5,0.5,0.5,3)" length="uniform(4,6)" minGap="lognorm(0.7,0.3)" speedDev="0.1"'
)
KEYS = '<param key="interplan.courtesy" value="norm(0.5,0.2)"/>'


def test_each_vehicle_has_its_own_numbers_within_their_distributions_and_bounds(tmp_path: Path) -> None:
    types, rng = read_vehicle_types(one(tmp_path, SPREAD, KEYS)), np.random.default_rng(1)
    drawn = [types.draw(rng) for _ in range(2000)]
    assert len({each.id for each in drawn}) == 2000
    assert {each.name for each in drawn} == {"traffic"}
    tau = np.array([each.tau_s for each in drawn])
    assert 0.5 <= tau.min() < 0.7
    assert 2.7 < tau.max() <= 3.0
    assert tau.mean() == pytest.approx(1.51, abs=0.05)
    assert np.mean([each.length_m for each in drawn]) == pytest.approx(5.0, abs=0.05)
    assert np.median([each.min_gap_m for each in drawn]) == pytest.approx(np.exp(0.7), abs=0.05)
    assert np.std([each.speed_factor for each in drawn]) == pytest.approx(0.1, abs=0.01)
    assert all(0.0 <= each.courtesy <= 1.0 for each in drawn)
    assert abs(np.corrcoef(tau, [each.length_m for each in drawn])[0, 1]) < 0.07


def test_speed_dev_overrules_the_deviation_that_speed_factor_has_within_its_bounds(tmp_path: Path) -> None:
    types = read_vehicle_types(one(tmp_path, 'speedFactor="normc(1,0.01,0.9,1.1)" speedDev="0.5"'))
    rng = np.random.default_rng(2)
    drawn = np.array([types.draw(rng).speed_factor for _ in range(500)])
    assert 0.9 <= drawn.min() < 0.92
    assert 1.08 < drawn.max() <= 1.1


def test_one_number_is_taken_from_the_generator_whatever_the_file(tmp_path: Path) -> None:
    for path in (one(tmp_path, SPREAD, KEYS), vehicle_type_file("urban"), vehicle_type_file("assertive")):
        rng, other = np.random.default_rng(3), np.random.default_rng(3)
        types = read_vehicle_types(path)
        for _ in range(5):
            types.draw(rng)
            other.random()
        assert rng.random() == other.random()


def test_a_change_to_one_distribution_leaves_the_other_numbers_of_a_vehicle(tmp_path: Path) -> None:
    before, after = (
        read_vehicle_types(one(tmp_path, text, KEYS)).draw(np.random.default_rng(5))
        for text in (SPREAD, SPREAD.replace("normc(1.5,", "normc(2.0,"))
    )
    assert before.tau_s < after.tau_s
    assert (before.length_m, before.courtesy, before.speed_factor) == (
        after.length_m, after.courtesy, after.speed_factor
    )  # fmt: skip


def test_sumo_drives_each_vehicle_with_the_numbers_that_were_drawn(tmp_path: Path) -> None:
    types, rng = read_vehicle_types(one(tmp_path, SPREAD, KEYS)), np.random.default_rng(1)
    drivers = [types.draw(rng) for _ in range(4)]
    spawns = tuple(
        Spawn("e0_1", 40.0 * place + 20.0, 5.0, driver, ("e0", "e1")) for place, driver in enumerate(drivers)
    )
    with traffic(types, spawns, ego_at(1000.0, LANE_Y[0])) as run:
        kinds = [
            sumo.vehicle.getTypeID(name).partition("@")[0]
            for name in sorted(sumo.vehicle.getIDList())
            if name.startswith("a")
        ]
        assert kinds == [driver.id for driver in drivers]
        for number, driver in enumerate(drivers):
            get = sumo.vehicle
            theirs = (get.getTau(f"a{number}"), get.getMinGap(f"a{number}"), get.getSpeedFactor(f"a{number}"))
            assert theirs == pytest.approx((driver.tau_s, driver.min_gap_m, driver.speed_factor), abs=1e-6)
        assert set(run.behaviours.values()) == {"types"}
        assert sorted(run.observe().actors.length_m) == pytest.approx(sorted(each.length_m for each in drivers))


def test_a_driver_who_wants_less_than_the_limit_starts_no_faster(tmp_path: Path) -> None:
    types = read_vehicle_types(one(tmp_path, 'desiredMaxSpeed="8" speedFactor="0.5"'))
    driver = types.members[0]
    assert driver.max_speed_mps == 4.0
    with traffic(types, (Spawn("e0_1", 20.0, 4.0, driver, ("e0", "e1")),), ego_at(1000.0, LANE_Y[0])) as run:
        for _ in range(20):
            run.advance()
        assert run.observe().actors.speed_mps.max() == pytest.approx(4.0, abs=0.05)


def test_a_kind_is_drawn_among_its_own_class_by_probability() -> None:
    urban = read_vehicle_types(vehicle_type_file("urban"))
    rng = np.random.default_rng(0)
    drawn = {kind: {urban.draw_kind(kind, rng).id for _ in range(30)} for kind in CLASS_OF_KIND}
    assert drawn == {
        "car": {"conservative", "assertive"},
        "truck": {"truck"},
        "bus": {"bus"},
        "motorcycle": {"motorcycle"},
    }


def test_a_kind_whose_only_types_have_no_probability_is_not_there(tmp_path: Path) -> None:
    path = file(
        tmp_path,
        '<additional><vType id="a"/><vType id="b" vClass="bus"/>'
        '<vTypeDistribution id="traffic" vTypes="a b" probabilities="1 0"/></additional>',
    )
    with pytest.raises(VehicleTypeError, match=r"types\.xml: no vType .* is a bus"):
        read_vehicle_types(path).draw_kind("bus", np.random.default_rng(0))
