"""interPlan's configuration with logs and maps of nuPlan: what is made, and what is named because it cannot be."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from interplan_sumo.cli import main
from interplan_sumo.scenario.files import read_scenarios
from interplan_sumo.verification.start_checks import validate
from tests.recordings.nuplan_dbs import MAP, X_M, Y_M, Goes, maps_root, sweep, write_log

pytestmark = pytest.mark.slow
EGO = Goes(X_M + 20.0, Y_M, 0.0, 7.0)
HERE, ELSEWHERE = sweep(0), "00000000000000ff"

FILTER = """
defaults:
  - modifications: details
scenario_tokens:
"""
DETAILS = f"""
modification_details_dictionary: # Not to be modified by the user
  {HERE}:
    extra_agents_to_spawn: []
    goal: {{left: null, right: null, straight: null}}
    spawn_in_intersection: true
    roadblock_locations_to_spawn_agents: [[{X_M + 60.0}, {-Y_M}]]
    special_scenario:
      '0': {{type: nudge_around_parked_vehicle, stopped_vehicle: [[{X_M + 80.0}, {Y_M - 1.9}, 0.05]]}}
      '1': {{type: overtake_parked_vehicle, config: dh, stopped_vehicle: [[{X_M + 80.0}, {Y_M}, 0.0]]}}
      '2':
        type: approaching_construction_zone
        config: gl
        cones: [[{X_M + 70.0}, {Y_M - 1.5}], [{X_M + 72.0}, {Y_M - 1.2}]]
        pedestrian: [[{X_M + 73.0}, {Y_M - 1.5}, {X_M + 74.0}, {Y_M - 1.5}, null]]
      '3':
        type: jaywalking_pedestrian
        pedestrian: [[{X_M + 90.0}, {Y_M - 4.0}, {X_M + 90.0}, {Y_M + 8.0}, null]]
      '4': {{type: avoid_crashed_cars, stopped_vehicle: [[9000.0, 0.0, 0.0]]}}
"""


def configuration(folder: Path, *names: str) -> Path:
    """The files as interPlan has them."""
    (folder / "conf" / "modifications").mkdir(parents=True)
    (folder / "conf" / "modifications" / "details.yaml").write_text(DETAILS)
    file = folder / "conf" / "interplan10.yaml"
    file.write_text(FILTER + "".join(f"  - {name}\n" for name in names))
    return file


def data(folder: Path) -> list[str]:
    """A maps root and a folder of logs, one of them broken, as options."""
    (folder / "logs" / "test").mkdir(parents=True)
    (folder / "logs" / "broken.db").write_bytes(b"no database")
    lights = {13: dict.fromkeys(range(601), "green")}
    write_log(folder / "logs" / "test" / "drive.db", EGO, (Goes(X_M + 50.0, Y_M, 0.0, 7.0),), frames=601, lights=lights)
    return ["--map", str(maps_root(folder)), "--logs", str(folder / "logs")]


def test_names_become_scenarios_and_what_cannot_be_made_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = [*(f"{HERE}-s{number}" for number in range(5)), f"{HERE}-dmgloc", f"{ELSEWHERE}-dhgloa", "nonsense"]
    source = configuration(tmp_path, *names)
    command = ["scenarios", "import", str(source), "--format", "interplan", *data(tmp_path), "--no-certify", "--json"]
    assert main([*command, "--out", str(tmp_path / "out")]) == 0
    said = json.loads(capsys.readouterr().out)
    scenarios = {each.id.rpartition("/")[2]: each for each in read_scenarios(tmp_path / "out" / "scenarios.yaml")}
    assert list(scenarios) == [*names[:4], names[5]]
    families = ["nudge", "overtake", "construction", "jaywalker", "lane_change_mtd"]
    assert [each.family for each in scenarios.values()] == families
    assert scenarios[names[1]].traffic.oncoming == "high"
    assert (scenarios[names[2]].goal.lane, scenarios[names[0]].goal.lane) == ("8", "7")
    assert scenarios[names[5]].traffic.behaviour == "conservative"
    assert all(each.lights for each in scenarios.values())
    reasons = {row["id"]: row["reason"] for row in said["not_made"]}
    assert list(reasons) == [names[4], names[6], names[7]]
    assert "stands beside no lane" in reasons[names[4]]
    assert f"token {ELSEWHERE} is in none of the 2 logs; 1 could not be read" in reasons[names[6]]
    assert "this is no name of a scenario" in reasons["nonsense"]
    assert [validate(scenarios[name]) for name in (names[0], names[3])] == [[], []]


def test_a_scenario_of_interplan_is_driven_with_the_drivers_of_its_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = configuration(tmp_path, f"{HERE}-s0", f"{HERE}-dlgsom")
    command = ["scenarios", "import", str(source.parent), "--format", "interplan", *data(tmp_path)]
    assert main([*command, "--no-certify", "--out", str(tmp_path / "out")]) == 0
    assert "2 scenarios" in capsys.readouterr().out
    drive = ["run", "--planner", "idm", "--scenarios", str(tmp_path / "out" / "scenarios.yaml"), "--workers", "0"]
    code = Path(__file__).parents[2] / "routes" / "interplan_code.xml"
    assert main([*drive, "--traffic", str(code), "--out", str(tmp_path / "run"), "--json", "--quiet"]) == 0
    (line,) = json.loads(capsys.readouterr().out)["rows"]
    assert line["scenarios"] == 2
    assert not line["fault_list"]


def test_a_configuration_without_logs_or_with_nothing_to_make_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, options = configuration(tmp_path, f"{ELSEWHERE}-s0"), data(tmp_path)
    command = ["scenarios", "import", str(source), "--format", "interplan", "--out", str(tmp_path / "out")]
    assert main([*command, *options[:2]]) == 2
    assert "give these as --logs" in capsys.readouterr().err
    assert main([*command, *options, "--at", "3"]) == 2
    assert "is a configuration of interPlan, which takes no --at; it takes --logs" in capsys.readouterr().err
    assert main([*command, *options]) == 2
    assert "none of its 1 scenarios can be made; the first, 00000000000000ff-s0" in capsys.readouterr().err
    assert main([*command, *options[:3], str(tmp_path / "maps")]) == 2
    assert "no .db file in there" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_city_whose_map_is_missing_costs_its_scenarios_only(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, options = configuration(tmp_path, f"{HERE}-s0", f"{sweep(20)}-dlgl"), data(tmp_path)
    command = ["scenarios", "import", str(source), "--format", "interplan", "--out", str(tmp_path / "out")]
    log = tmp_path / "logs" / "test" / "drive.db"
    moved = tmp_path / "logs" / "test" / "other.db"
    log.rename(moved)
    write_log(log, EGO, frames=601, map_name="atlantis", change=(f"DELETE FROM lidar_pc WHERE hex(token) = '{HERE}'",))
    assert main([*command, *options, "--no-certify"]) == 0
    said = capsys.readouterr().out
    assert f"not made: {sweep(20)}-dlgl: no map named 'atlantis'" in said
    assert f"{MAP}.interplan/{HERE}-s0" in said
