"""SUMO's fcd output: of SUMO itself, and damaged in every way."""

from __future__ import annotations

import gzip
import subprocess
from pathlib import Path

import numpy as np
import pytest

from interplan_sumo.errors import InputError
from interplan_sumo.maps.to_sumo import program_path
from interplan_sumo.realism.fcd import SIZES_M, is_fcd, read_bodies, read_fcd
from interplan_sumo.realism.tracks import RecordedTraffic
from interplan_sumo.simulation.standard_situations import ROAD

ROUTES = """<routes>
    <vType id="car" length="4.4" width="1.75" sigma="0"/>
    <vTypeDistribution id="heavy"><vType id="lorry" vClass="truck"/></vTypeDistribution>
    <vehicle id="a" type="car" depart="0" departPos="100" departSpeed="10"><route edges="in out"/></vehicle>
    <vehicle id="b" type="heavy" depart="0" departPos="50"><route edges="in out"/></vehicle>
</routes>
"""


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the routes and the fcd output of ten seconds in plain SUMO."""
    folder = tmp_path_factory.mktemp("fcd")
    sumo = str(program_path("sumo"))
    (folder / "cars.rou.xml").write_text(ROUTES)
    command = [sumo, "-n", str(ROAD), "-r", "cars.rou.xml", "--fcd-output", "fcd.xml.gz", "--step-length", "0.1"]
    subprocess.run([*command, "--end", "10", "--no-step-log"], cwd=folder, check=True, capture_output=True)
    return folder


def test_boxes_lie_where_sumo_has_them(simulated: Path) -> None:
    assert is_fcd(simulated / "fcd.xml.gz")
    traffic = read_fcd(simulated / "fcd.xml.gz", simulated / "cars.rou.xml")
    car, lorry = traffic.tracks
    assert (car.id, car.length_m, car.width_m) == ("a", 4.4, 1.75)
    assert (lorry.id, lorry.length_m, lorry.width_m) == ("b", *SIZES_M["truck"])
    assert car.x_m[0] == pytest.approx(100.0 - 2.2, abs=0.01)  # the road begins at x = 0, eastward
    assert car.heading_rad == pytest.approx(0.0)
    assert np.diff(car.x_m) / np.diff(car.time_s) == pytest.approx(car.speed_mps[1:], abs=0.15)
    assert {each.kind for each in traffic.tracks} == {"vehicle"}


def test_without_types_everybody_is_a_passenger_car_and_plain_text_reads_as_gzipped(simulated: Path) -> None:
    plain = simulated / "fcd.xml"
    plain.write_bytes(gzip.decompress((simulated / "fcd.xml.gz").read_bytes()))
    assert [each.length_m for each in read_fcd(plain).tracks] == [5.0, 5.0]


def written(folder: Path, *steps: str, root: str = "fcd-export", every_s: float = 0.1) -> Path:
    path = folder / "fcd.xml"
    inside = "".join(f'<timestep time="{k * every_s:.2f}">{step}</timestep>' for k, step in enumerate(steps))
    path.write_text(f"<{root}>{inside}</{root}>")
    return path


def car(x: float, y: float = 0.0, angle: str = "90", speed: float = 10.0, tag: str = "vehicle") -> str:
    return f'<{tag} id="a" x="{x}" y="{y}" angle="{angle}" type="t" speed="{speed}" pos="1" lane="e_0"/>'


def read(folder: Path, *steps: str) -> RecordedTraffic:
    return read_fcd(written(folder, *steps))


def test_angles_are_clockwise_from_north_and_walkers_are_where_they_stand(tmp_path: Path) -> None:
    (south,) = read(tmp_path, *(car(3.0, -k, "180") for k in range(3))).tracks
    assert south.heading_rad == pytest.approx(-np.pi / 2.0)
    assert south.y_m == pytest.approx([2.5, 1.5, 0.5])
    (walker,) = read(tmp_path, *(car(k * 0.1, 1.0, speed=1.0, tag="person") for k in range(3))).tracks
    assert walker.kind == "pedestrian"
    assert walker.x_m == pytest.approx([0.0, 0.1, 0.2])


def test_who_rides_in_a_vehicle_does_not_walk(tmp_path: Path) -> None:
    beside = car(9.0, 2.0, speed=1.0, tag="person").replace('"a"', '"b"')
    tracks = read(tmp_path, *(car(k) + car(k, tag="person") + beside for k in range(3))).tracks
    assert [(each.id, each.kind) for each in tracks] == [("a", "vehicle"), ("person b", "pedestrian")]


def test_who_was_away_comes_back_as_another_track(tmp_path: Path) -> None:
    steps = [car(k) for k in range(20)]
    steps[5:15] = [""] * 10
    assert [(each.id, len(each.time_s)) for each in read(tmp_path, *steps).tracks] == [("a", 5), ("a~2", 5)]


@pytest.mark.parametrize(
    ("steps", "says"),
    [
        ([car(1), '<vehicle id="a" x="2" y="0" speed="1"/>'], "vehicle 'a' has no angle"),
        ([car(1), car(2, angle="nan")], "angle 'nan'"),
        ([car(1), car(2, angle="east")], "angle 'east'"),
        ([car(float("inf")), car(2)], "x 'inf'"),
        ([car(9.0 + 1e-6 * k) for k in range(9)], "longitudes"),
        (["", ""], "nobody drives"),
        ([], "nobody drives"),
    ],
)
def test_what_cannot_be_used_is_said_in_a_line(tmp_path: Path, steps: list[str], says: str) -> None:
    with pytest.raises(InputError, match=says) as caught:
        read(tmp_path, *steps)
    assert "\n" not in str(caught.value)


def test_steps_too_long_or_in_disorder_another_root_entities_and_damage_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="steps last 1 s"):
        read_fcd(written(tmp_path, car(1), car(11), car(21), every_s=1.0))
    with pytest.raises(InputError, match="comes after"):
        read_fcd(written(tmp_path, car(1), car(2), every_s=-0.1))
    other = written(tmp_path, root="net")
    assert not is_fcd(other)
    with pytest.raises(InputError, match="expected <fcd-export>"):
        read_fcd(other)
    other.write_text('<!DOCTYPE f [<!ENTITY x "y">]><fcd-export>&x;</fcd-export>')
    with pytest.raises(InputError, match="refused"):
        read_fcd(other)
    other.write_text("<fcd-export><timestep")
    assert is_fcd(other)
    with pytest.raises(InputError, match="damaged"):
        read_fcd(other)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("<routes/>", "holds no vType"),
        ("<net/>", "expected <additional> or <routes>"),
        ('<routes><vType id="t" length="-1"/></routes>', "-1 m long"),
        ('<routes><vType id="t" length="long"/></routes>', "length 'long'"),
    ],
)
def test_a_file_without_sizes_is_refused(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "types.xml"
    path.write_text(text)
    with pytest.raises(InputError, match=says):
        read_bodies(path)


def test_bodies_follow_the_class(tmp_path: Path) -> None:
    path = tmp_path / "types.xml"
    path.write_text(
        '<additional><vType id="t" vClass="bicycle"/><vType id="w" vClass="pedestrian" width="0.6"/></additional>'
    )
    bodies = read_bodies(path)
    assert (bodies["t"].kind, bodies["t"].length_m) == ("bicycle", 1.6)
    assert (bodies["w"].kind, bodies["w"].width_m) == ("pedestrian", 0.6)
