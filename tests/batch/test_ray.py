"""The Ray backend: what the engine promises holds on a cluster, too, and what is done there lies here afterwards."""

from __future__ import annotations

import shutil
import signal
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from msgspec import structs

from interplan_sumo.batch import ray_backend
from interplan_sumo.batch.briefs import Brief
from interplan_sumo.batch.judge import judge
from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.processes import environment
from interplan_sumo.batch.ray_backend import RayPool, run_on_ray
from interplan_sumo.batch.records import JobKey, Row
from interplan_sumo.batch.run import run
from interplan_sumo.batch.run_folder import StoredRun, read_run
from interplan_sumo.batch.submit import submit
from interplan_sumo.batch.tasks import Limits, Outcome, Task
from interplan_sumo.batch.verify import RowSample, verify
from interplan_sumo.batch.worker_pool import Report
from interplan_sumo.cli import main
from interplan_sumo.endurance.kilometres import EVENTS, EndureOptions, drive_kilometres
from interplan_sumo.errors import InputError, PlannerLoadError
from interplan_sumo.maps.store import find_map
from interplan_sumo.scenario.files import write_scenarios
from interplan_sumo.scenario.scenario import TrafficDemand
from interplan_sumo.scenario.suite import find_suite
from interplan_sumo.world.trace import Trace
from tests.batch.busy import BUSY
from tests.batch.toys import ToysAway
from tests.records import hashes

pytestmark = pytest.mark.slow  # a cluster takes its time to start

QUICK = Limits(task_s=3.0, load_s=20.0, memory_bytes=4 << 30)


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """A cluster of two CPUs, to which this process is connected."""
    ray = pytest.importorskip("ray", reason="Ray, the extra [ray], is not installed")
    before = signal.getsignal(signal.SIGTERM)
    with environment({"PYTHONPATH": str(Path(__file__).parents[2]), "RAY_USAGE_STATS_ENABLED": "0"}):
        ray.init(address="local", num_cpus=2, include_dashboard=False, log_to_driver=False, logging_level="ERROR",
                 object_store_memory=100 << 20)  # fmt: skip
    yield ray
    ray.shutdown()
    signal.signal(signal.SIGTERM, before)


def outcomes(*groups: str, folder: Path) -> dict[tuple[str, int], Outcome]:
    tasks = [Task((group, n), group, (n, str(folder))) for group in groups for n in range(3)]
    found = list(run_on_ray(tasks, ToysAway(folder), address="auto", limits=QUICK))
    assert len(found) == len(tasks)
    return {(o.task.group, o.task.payload[0]): o for o in found}


FAULTS = {
    "exits hard": ("planner", "exited with code 3 inside plan()"),
    "hangs deaf": ("planner", "no result after 3 s"),
    "crashes in simulate": ("traffic", "SIGSEGV in phase simulate"),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("home")


@pytest.fixture(scope="module")
def found(cluster: Any, folder: Path) -> dict[tuple[str, int], Outcome]:
    """How the tasks of several groups end, of which each but one misbehaves in its own way."""
    del cluster
    return outcomes("works", *FAULTS, "loses SUMO once", "is killed once", folder=folder)


def test_whatever_a_task_does_to_its_process_is_one_fault_of_its_class(found: dict[tuple[str, int], Outcome]) -> None:
    faults = {key: (o.fault.kind, o.fault.message) for key, o in found.items() if o.fault is not None}
    assert faults.keys() == {(group, 1) for group in FAULTS}
    for group, (kind, words) in FAULTS.items():
        assert faults[group, 1][0] == kind
        assert words in faults[group, 1][1]
    assert "my last words" in found["exits hard", 1].printed


def test_the_others_get_their_results_and_their_files_come_home(
    found: dict[tuple[str, int], Outcome], folder: Path
) -> None:
    assert all(o.value["square"] == n * n for (_, n), o in found.items() if o.fault is None)
    assert (folder / "fresh").read_bytes() == b"here"


def test_a_traffic_fault_is_retried_once_and_a_kill_from_outside_forgiven(
    found: dict[tuple[str, int], Outcome], folder: Path
) -> None:
    assert found["loses SUMO once", 1].fault is None
    assert found["is killed once", 1].fault is None
    assert (folder / "losses").read_text() == (folder / "kills").read_text() == "xx"


class Killing(RayPool):
    """Loses the actor that has task 1 in hand, so often."""

    times = 1

    def reports(self) -> list[Report]:
        for worker in self.workers:
            if self.times and worker.task is not None and worker.task.payload[0] == 1:
                self.times -= 1
                self._ray.kill(self._actors[worker])
        return super().reports()


def test_a_task_that_loses_its_actor_is_done_again(
    cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    del cluster
    monkeypatch.setattr(ray_backend, "RayPool", Killing)
    assert [o.fault for o in outcomes("works", folder=tmp_path).values()] == [None] * 3


@pytest.mark.nightly
def test_a_task_that_loses_three_actors_is_a_timeout_that_says_so(
    cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    del cluster
    monkeypatch.setattr(ray_backend, "RayPool", Killing)
    monkeypatch.setattr(Killing, "times", 100)
    found = outcomes("hangs in simulate", folder=tmp_path)
    fault = found["hangs in simulate", 1].fault
    assert fault is not None
    assert fault.kind == "timeout"
    assert fault.message.startswith("its worker on the Ray cluster was lost: ")
    assert fault.message.endswith(", 3 times")
    assert "\n" not in fault.message
    assert [found["hangs in simulate", n].fault for n in (0, 2)] == [None] * 2


def test_a_planner_that_cannot_be_built_ends_the_run(cluster: Any, tmp_path: Path) -> None:
    del cluster
    with pytest.raises(PlannerLoadError, match="exited with code 7; it printed last: these are my last words"):
        outcomes("exits while opening", folder=tmp_path)


def test_machines_with_other_versions_are_refused(
    cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    del cluster
    monkeypatch.setattr(ray_backend, "versions", lambda: {"sumo": "0.0.1"})
    with pytest.raises(InputError, match=r"has sumo 1\..*, this one has 0\.0\.1; equal results need equal versions"):
        outcomes("works", folder=tmp_path)


# --- drives ---


BACKWATER = replace(BUSY, map="backwater")


@pytest.fixture(scope="module")
def mine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two scenarios of one's own on a map that came along with them; not to be changed."""
    place = tmp_path_factory.mktemp("mine")
    shutil.copytree(find_map("strip").folder, place / "maps" / "backwater" / "1.0")
    write_scenarios((BACKWATER, replace(BACKWATER, id="mine/1", traffic=TrafficDemand("low"))), place / "mine.yaml")
    return place


class Interrupting:
    """A watch that has had enough after the first drive."""

    def begin(self, jobs: int, done: Iterable[tuple[JobKey, Brief]]) -> None: ...

    def finished(self, row: Row) -> None:
        raise KeyboardInterrupt(row.scenario_id)


@pytest.mark.nightly
def test_ones_own_scenarios_and_maps_go_on_there_and_are_verified_there_without_the_files_they_came_from(
    cluster: Any, mine: Path, tmp_path: Path
) -> None:
    del cluster
    shutil.copytree(mine, tmp_path / "mine")
    file = str(tmp_path / "mine" / "mine.yaml")
    at_home = run(RunOptions(("straight_ahead",), tmp_path / "home", scenarios=(file,), workers=0))
    there = RunOptions(("straight_ahead",), tmp_path / "there", scenarios=(file,), workers="ray:auto")
    with pytest.raises(KeyboardInterrupt):
        run(there, Interrupting())
    assert len(read_run(tmp_path / "there").rows) == 1
    done = run(there)
    assert hashes(done) == hashes(at_home)
    assert all(row.fault is None for row in done.rows.values())
    shutil.rmtree(tmp_path / "mine")
    found = verify(read_run(tmp_path / "there"), RowSample(None), RunOptions(workers="ray:auto"))
    assert [(check.verdict, check.reason) for check in found.checks] == [("equal", ""), ("equal", "")]


@pytest.mark.nightly
def test_a_bundle_is_judged_there(cluster: Any, mine: Path, tmp_path: Path) -> None:
    del cluster
    file = str(mine / "mine.yaml")
    run(RunOptions(("straight_ahead",), tmp_path / "home", scenarios=(file,), workers=0))
    submit(read_run(tmp_path / "home"), tmp_path / "bundle.zip")
    made = judge(tmp_path / "bundle.zip", tmp_path, RunOptions(scenarios=(file,), workers="ray:auto"))
    assert (made.judged.equal, made.judged.drives) == (2, 2)


@pytest.mark.nightly
def test_the_commands_sweep_and_verify_take_the_same_workers_as_run(
    cluster: Any, mine: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    del cluster
    asked = ["--planner", "straight_ahead", "--param", "tau=1,3", "--scenarios", str(mine / "mine.yaml"), "--quiet"]
    for workers, out in (("0", "home"), ("ray:auto", "there")):
        assert main(["sweep", *asked, "--workers", workers, "--out", str(tmp_path / out)]) == 0
    for setting in ("tau=1", "tau=3"):
        assert hashes(read_run(tmp_path / "there" / setting)) == hashes(read_run(tmp_path / "home" / setting))
    capsys.readouterr()
    assert main(["verify", str(tmp_path / "there" / "tau=3"), "--workers", "ray:auto", "--quiet"]) == 0
    assert "2 of 2 drives come again exactly" in capsys.readouterr().out


def test_a_drive_on_the_cluster_gives_the_hash_and_the_files_of_one_at_home(cluster: Any, tmp_path: Path) -> None:
    del cluster
    nudge = find_suite("smoke==1").scenarios[3].id
    types = tmp_path / "mine.xml"
    types.write_text('<routes><vType id="traffic" maxSpeed="7"/></routes>')
    at_home = RunOptions(("straight_ahead",), tmp_path / "home", "smoke==1", (nudge,), workers=0,
                         traffic=types)  # fmt: skip
    there = replace(at_home, out=tmp_path / "there", workers="ray:auto")

    def summary(stored: StoredRun) -> list[Any]:
        (row,) = stored.rows.values()
        files = sorted(str(p.relative_to(stored.path)) for p in stored.path.glob("traces/**/*"))
        return [row.trace_hash, row.score, row.gates, Trace.read(stored.path / str(row.trace)).hash(), files]

    expected = summary(run(at_home))
    assert len(expected[0]) == 64
    assert summary(run(there)) == expected


@pytest.mark.nightly
@pytest.mark.usefixtures("cluster")
def test_kilometres_that_are_driven_away_from_home_are_those_driven_here(tmp_path: Path) -> None:
    blind = EndureOptions(
        "straight_ahead", "back_bay", 0.2, tmp_path / "here", density=0.2, segment_m=100.0, run=RunOptions(workers=0)
    )
    here = drive_kilometres(blind)
    there = drive_kilometres(replace(blind, out=tmp_path / "there", run=RunOptions(workers="ray:auto")))
    assert any(each.events for each in here)
    assert [structs.replace(each, wall_s=0.0, plan_ms=None) for each in there] == [
        structs.replace(each, wall_s=0.0, plan_ms=None) for each in here
    ]
    kept = [read_run(tmp_path / name / EVENTS).briefs.keys() for name in ("here", "there")]
    assert len(kept[0]) >= 1
    assert kept[0] == kept[1]
    texts = [(tmp_path / name / EVENTS / "scenarios.yaml").read_bytes() for name in ("here", "there")]
    assert texts[0] == texts[1]
