"""Vehicle-type files: what is read, what is refused, and where the error points."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from networks import NETWORK_FILE

from interplan_sumo.errors import UnknownNameError, VehicleTypeError
from interplan_sumo.simulation.vehicle_types import (
    CLASS_OF_KIND,
    CLASSES,
    VehicleType,
    read_vehicle_types,
    vehicle_type_file,
)


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
        ('<additional>\n<vType id="traffic" tau="nan"/></additional>', r"line 2: tau is nan, expected"),
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
    libsumo.start(["sumo", "-n", str(NETWORK_FILE), "-a", str(path), "--no-step-log", "true"])
    try:
        kind = libsumo.vehicletype
        for each in members:
            ours = (
                each.length_m, each.width_m, each.min_gap_m, each.tau_s, each.accel_mps2, each.decel_mps2,
                each.emergency_decel_mps2, each.max_speed_mps, each.speed_factor,
            )  # fmt: skip
            theirs = (
                kind.getLength(each.id), kind.getWidth(each.id), kind.getMinGap(each.id), kind.getTau(each.id),
                kind.getAccel(each.id), kind.getDecel(each.id), kind.getEmergencyDecel(each.id),
                kind.getMaxSpeed(each.id), kind.getSpeedFactor(each.id),
            )  # fmt: skip
            assert ours == pytest.approx(theirs, abs=1e-6), each.id
    finally:
        libsumo.close()


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
