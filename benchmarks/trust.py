"""What results survive: python benchmarks/trust.py [--parts kills messages kernels] [--kills 300] [--messages 10000]

kills     runs with three planners (two of Python, one a program of its own), in which the command, a worker or a
          planner's process is killed again and again: every finished folder must equal the undisturbed one
messages  random and mutated bytes where a plan was asked for: how many made the parent raise, the longest answer, the
          memory that it came to take
kernels   drives with other kernels of OpenBLAS and with two threads: do traces come again, and how far apart are they?
"""

from __future__ import annotations

import argparse
import json
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np

from interplan_sumo.batch.run_folder import read_run
from interplan_sumo.planner_process.channel import ChannelError, PlannerChannel
from interplan_sumo.planner_process.conversation import answer, ask
from interplan_sumo.planner_process.messages import MOST_PLAN_BYTES, MSGPACK, Failed, PackedPlan, packed, trajectory
from interplan_sumo.scenario.files import write_scenarios
from interplan_sumo.scenario.suite import find_suite

ROOT = Path(__file__).parents[1]
PLANNERS = ("straight_ahead", "idm", f"exec:{sys.executable} {ROOT / 'planners/examples/python/straight.py'}")
DURATION_S = 3.0
AT_ONCE = 2
"""Kills in one run of the command: a drive that is killed three times is given up, as docs/running.md says."""
LIMIT_S = 0.01
KERNELS = ({}, {"OPENBLAS_CORETYPE": "Haswell"}, {"OPENBLAS_CORETYPE": "Nehalem"}, {"OPENBLAS_NUM_THREADS": "2"})


# --- kills ---------------------------------------------------------------------------------------


def kills(count: int, seed: int) -> None:
    """Kill until so many were, and say how the finished runs compare with the undisturbed one."""
    chance, killed, finished, unequal = random.Random(seed), Counter[str](), 0, 0
    with tempfile.TemporaryDirectory(prefix="interplan-sumo-trust-") as place:
        home = Path(place)
        scenes = [replace(each, duration_s=DURATION_S) for each in find_suite("smoke==1").scenarios[:4]]
        write_scenarios(scenes, home / "scenes.yaml")
        expected = results(home / "undisturbed") if started(home, home / "undisturbed").wait() == 0 else {}
        folder = home / "run-0"
        while sum(killed.values()) < count:
            if disturbed(home, folder, chance, killed) == 0:
                finished += 1
                unequal += results(folder) != expected
                folder = home / f"run-{finished}"
                print(f"{sum(killed.values())} kills, {finished} runs, {unequal} differ", file=sys.stderr, flush=True)
        while started(home, folder).wait():
            pass
        finished, unequal = finished + 1, unequal + (results(folder) != expected)
    told = ", ".join(f"{number} of a {what}" for what, number in sorted(killed.items()))
    print(
        f"kills: {told}; {finished} runs of {len(expected)} drives finished, {unequal} differ from the undisturbed one"
    )


def started(home: Path, folder: Path) -> subprocess.Popen[bytes]:
    asked = [word for planner in PLANNERS for word in ("--planner", planner)]
    command = [sys.executable, "-m", "interplan_sumo", "run", *asked, "--scenarios", str(home / "scenes.yaml")]
    command += ["--seeds", "2", "--workers", "2", "--out", str(folder), "--quiet"]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def results(folder: Path) -> dict[object, object]:
    """What must come again of each drive."""
    rows = read_run(folder).rows.values()
    return {row.key: (row.trace_hash, row.score, row.fault and row.fault.kind) for row in rows}


def disturbed(home: Path, folder: Path, chance: random.Random, killed: Counter[str]) -> int:
    """One run of the command, with kills in it; its exit code."""
    process = started(home, folder)
    for _ in range(AT_ONCE):
        size = written(folder)
        if chance.random() < 0.2:
            time.sleep(chance.uniform(0.0, 3.0))
        while written(folder) == size and process.poll() is None:
            time.sleep(0.01)
        time.sleep(chance.uniform(0.0, 0.3))
        workers = list(children(process.pid))
        found = {"command": [process.pid], "worker": workers, "planner": [p for w in workers for p in children(w)]}
        what = chance.choice([name for name, pids in found.items() if pids])
        with suppress(ProcessLookupError):
            if process.poll() is None:
                os.kill(chance.choice(found[what]), signal.SIGKILL)
                killed[what] += 1
        if what == "command":
            break
    return process.wait()


def written(folder: Path) -> int:
    file = folder / "results.jsonl"
    return file.stat().st_size if file.exists() else 0


def children(pid: int) -> Iterator[int]:
    """The processes that a process has started, but for the one that tracks its shared memory; Linux only."""
    with suppress(OSError):
        for thread in Path(f"/proc/{pid}/task").iterdir():
            for child in (thread / "children").read_text().split():
                with suppress(OSError):
                    if "resource_tracker" not in Path(f"/proc/{child}/cmdline").read_text():
                        yield int(child)


# --- messages ------------------------------------------------------------------------------------


def messages(count: int, seed: int) -> None:
    """Answer so many requests for a plan with bytes that are none."""
    chance = random.Random(seed)
    column = packed(np.arange(80.0))
    whole = msgspec.msgpack.encode(PackedPlan(column, column, column, column, None, 0.001))
    outcomes, longest_s = Counter[str](), 0.0
    exchanged(framed(whole))
    before_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    for _ in range(count):
        began_s = time.perf_counter()
        outcomes[exchanged(spoiled(whole, chance))] += 1
        longest_s = max(longest_s, time.perf_counter() - began_s)
    more_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024 - before_mb
    told = ", ".join(f"{number} {what}" for what, number in outcomes.most_common())
    print(
        f"messages: {told}; the longest took {1e3 * longest_s:.0f} ms (limit {1e3 * LIMIT_S:.0f}), "
        f"memory grew by {more_mb:.1f} MB"
    )


def spoiled(whole: bytes, chance: random.Random) -> bytes:
    """Noise, noise of the right length, a plan with bytes changed, cut or repeated, or a length that is a lie."""
    kind = chance.randrange(5)
    if kind < 2:
        noise = chance.randbytes(chance.choice((0, 3, 4, 40, 4000, 60_000)))
        return framed(noise) if kind else noise
    changed = bytearray(framed(whole))
    for _ in range(chance.randint(1, 6)):
        changed[chance.randrange(len(changed)) if kind < 4 else chance.randrange(4)] = chance.randrange(256)
    return bytes(changed[: chance.randrange(len(changed))]) if kind == 2 else bytes(changed)


def framed(message: bytes) -> bytes:
    return len(message).to_bytes(4, "little") + message


def exchanged(data: bytes) -> str:
    """What the parent made of these bytes."""
    (asked, to_ask), (hear, told), (read, printed) = os.pipe(), os.pipe(), os.pipe()
    channel = PlannerChannel(to_ask, hear, read, lambda: True)
    planner = threading.Thread(target=_say, args=(asked, told, data))
    planner.start()
    try:
        ask(channel, MSGPACK, {"type": "plan"}, LIMIT_S)
        reply = answer(channel, MSGPACK, MSGPACK.plan, MOST_PLAN_BYTES, LIMIT_S)
        if isinstance(reply, Failed):
            return "planner faults"
        trajectory(reply)
        return "plans"
    except (ChannelError, ValueError):
        return "planner faults"
    except Exception as error:
        return f"raised {type(error).__name__}"
    finally:
        channel.close()
        planner.join()
        for each in (asked, told, printed):
            with suppress(OSError):
                os.close(each)


def _say(asked: int, told: int, data: bytes) -> None:
    os.read(asked, 1 << 16)
    with suppress(OSError):
        os.write(told, data)


# --- kernels -------------------------------------------------------------------------------------


def kernels(planners: list[str]) -> None:
    """Drive one scene with each kernel in a process of its own."""
    for planner in planners:
        drives = [driven(planner, kernel) for kernel in KERNELS]
        first = np.array(drives[0]["xy"])
        for kernel, drive in zip(KERNELS[1:], drives[1:], strict=True):
            there = np.array(drive["xy"])
            steps = min(len(first), len(there))
            apart_m = float(np.hypot(*(first[:steps] - there[:steps]).T).max())
            said = (
                "the same trace" if drive["hash"] == drives[0]["hash"] else f"another trace, {1e3 * apart_m:.3g} mm off"
            )
            print(f"kernels: {planner}, {', '.join(f'{k}={v}' for k, v in kernel.items())}: {said}")


def driven(planner: str, kernel: dict[str, str]) -> dict[str, object]:
    program = (
        "import json, sys; from interplan_sumo.planner import load_planner; "
        "from interplan_sumo.planner_seat import InProcess; from interplan_sumo.scenario.suite import find_suite; "
        "from interplan_sumo.simulation.episode import drive; "
        "trace = drive(find_suite('smoke==1').scenarios[0], InProcess(load_planner(sys.argv[1]))).trace; "
        "print(json.dumps({'hash': trace.hash(), 'xy': list(zip(trace.ego.x_m.tolist(), trace.ego.y_m.tolist()))}))"
    )
    threads = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    made = subprocess.run(
        [sys.executable, "-c", program, planner],
        env={**os.environ, **threads, **kernel}, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, check=True,
    )  # fmt: skip
    return json.loads(made.stdout.splitlines()[-1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--parts", nargs="+", default=["kills", "messages", "kernels"])
    parser.add_argument("--kills", type=int, default=300)
    parser.add_argument("--messages", type=int, default=10_000)
    parser.add_argument("--planner", action="append", help="for the kernels; default idm, urban_driver, gameformer")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    if "messages" in asked.parts:
        messages(asked.messages, asked.seed)
    if "kernels" in asked.parts:
        kernels(asked.planner or ["idm", "urban_driver", "gameformer"])
    if "kills" in asked.parts:
        kills(asked.kills, asked.seed)


if __name__ == "__main__":
    main()
