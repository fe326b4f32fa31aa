"""traffic realism: from files to a table, a document, a page and a plot; and what it says of what it cannot use."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pytest

from interplan_sumo.realism.baselines import is_vehicle_types, shipped_baselines
from interplan_sumo.realism.features import FEATURES
from interplan_sumo.realism.tracks import RecordedTraffic
from interplan_sumo.simulation.vehicle_types import read_vehicle_types, vehicle_type_file
from tests.commands import ran
from tests.realism.test_comparison import platoon
from tests.realism.test_fcd import car, written
from tests.report.test_page import NASTY, read


def recorded(folder: Path, traffic: RecordedTraffic) -> Path:
    """A file of the plain track form."""
    rows = [
        {
            "track": each.id, "type": "veh", "time_s": time_s, "x_m": x, "y_m": y, "heading_rad": heading,
            "length_m": each.length_m, "width_m": each.width_m,
        }
        for each in traffic.tracks
        for time_s, x, y, heading in zip(each.time_s, each.x_m, each.y_m, each.heading_rad, strict=True)
    ]  # fmt: skip
    path = folder / f"{traffic.name}.parquet"
    pd.DataFrame(rows).to_parquet(path)
    return path


@pytest.fixture
def simulated(tmp_path: Path) -> Path:
    """Fcd output of one car that drives for four seconds."""
    return written(tmp_path, *(car(1.0 * k, speed=10.0) for k in range(40)))


def test_a_table_and_a_document_say_the_same(
    tmp_path: Path, simulated: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one, other = (recorded(tmp_path, platoon(name, 10.0)) for name in ("here", "there"))
    code, out, err = ran(capsys, "traffic", "realism", simulated, "--against", one, other, "--json")
    assert (code, err) == (0, "")
    document = json.loads(out)
    assert [each["key"] for each in document["features"]] == [each.key for each in FEATURES]
    assert [(row["name"], row["kind"]) for row in document["rows"]] == [
        ("fcd.xml", "run"), ("constant velocity", "baseline"), ("here", "recording"), ("there", "recording"),
    ]  # fmt: skip
    speed = document["rows"][0]["features"]["speed"]
    assert speed["simulated"]["p50"] == pytest.approx(10.0)
    assert speed["recorded"]["road_users"] == 24
    assert speed["ks"] == pytest.approx(0.0)
    assert 0.0 < document["rows"][0]["realism"] <= document["rows"][0]["ceiling"] <= 1.0
    code, out, _ = ran(capsys, "traffic", "realism", simulated, "--against", one, "--against", other)
    assert code == 0
    for row in document["rows"]:
        assert f"{row['realism']:.3f}" in out
    assert "Recorded places: here, there;" in out


def test_the_page_shows_names_as_text_and_loads_nothing(
    tmp_path: Path, simulated: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    nasty = simulated.rename(tmp_path / NASTY.replace("/", ""))
    page = tmp_path / "page.html"
    against = recorded(tmp_path, platoon("here", 10.0))
    assert ran(capsys, "traffic", "realism", nasty, "--against", against, "--html", page)[0] == 0
    seen = read(page.read_text(encoding="utf-8"))
    assert NASTY.replace("/", "") in seen.text
    assert not seen.tags & {"script", "link", "img", "iframe"}
    assert all(link.startswith("#") for link in seen.loads)
    assert {"svg", "path"} <= seen.tags
    assert f"--html {page}" in seen.text
    assert 'title="n = 1 simulated, 12 recorded"' in page.read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_plot_is_drawn(tmp_path: Path, simulated: Path, capsys: pytest.CaptureFixture[str]) -> None:
    against, plot = recorded(tmp_path, platoon("here", 10.0)), tmp_path / "plot.png"
    assert ran(capsys, "traffic", "realism", simulated, "--against", against, "--plot", plot)[0] == 0
    assert plot.read_bytes().startswith(b"\x89PNG")
    code, _, err = ran(capsys, "traffic", "realism", simulated, "--against", against, "--plot", tmp_path / "x.unknown")
    assert code == 2
    assert "x.unknown" in err


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("nowhere --against {rec}", "cannot read nowhere"),
        ("{sim} --against nowhere", "cannot read nowhere"),
        ("{sim}", "--against"),
        ("{rec} --against {text}", "is no recording: neither"),
        ("{sim} --against {rec} --types {sim}", "expected <additional> or <routes>"),
        ("{sim} --against {rec} --html {sim}/page.html", "page.html"),
    ],
)
def test_what_cannot_be_used_is_one_line(
    tmp_path: Path, simulated: Path, capsys: pytest.CaptureFixture[str], words: str, says: str
) -> None:
    (tmp_path / "notes.txt").write_text("nothing")
    places = {"sim": simulated, "rec": recorded(tmp_path, platoon("here", 10.0)), "text": tmp_path / "notes.txt"}
    code, out, err = ran(capsys, "traffic", "realism", *words.format(**places).split())
    assert (code, out) == (2, "")
    assert says in err
    assert len(err.splitlines()) == 1


def test_baselines_are_the_shipped_files_and_every_model() -> None:
    with shipped_baselines() as found:
        names = [each.name for each in found]
        assert {"mixed (shipped)", "IDM (SUMO's defaults)", "Krauss (SUMO's defaults)"} <= {*names}
        assert all(read_vehicle_types(each.file).members for each in found)


def test_a_vehicle_type_file_is_told_from_fcd_output_and_a_broken_one_is_refused(
    tmp_path: Path, simulated: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert is_vehicle_types(vehicle_type_file("assertive"))
    routes = tmp_path / "routes.xml"
    routes.write_text('<routes><vType id="traffic"/></routes>')
    assert is_vehicle_types(routes)
    assert not is_vehicle_types(simulated)
    assert not is_vehicle_types(tmp_path)
    against, broken = recorded(tmp_path, platoon("here", 10.0)), tmp_path / "drivers.xml"
    broken.write_text('<additional><vType id="traffic" tau="-1"/></additional>')
    code, _, err = ran(capsys, "traffic", "realism", broken, "--against", against)
    assert code == 2
    assert "drivers.xml, line 1" in err


@pytest.mark.nightly
def test_a_shipped_file_is_simulated_by_its_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    against = recorded(tmp_path, platoon("here", 10.0))
    code, out, err = ran(capsys, "traffic", "realism", "conservative", "--against", against, "--json")
    assert code == 0
    assert err == "simulating 1 of 1: conservative\n"
    row = json.loads(out)["rows"][0]
    assert row["name"] == "conservative"
    assert row["features"]["standstill_gap"]["simulated"]["p50"] == pytest.approx(1.0, abs=0.1)
