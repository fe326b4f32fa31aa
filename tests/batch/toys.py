"""Toy groups for the engine's tests: the group's name says how its tasks misbehave."""

from __future__ import annotations

import os
import signal
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from interplan_sumo.batch.tasks import Answer, Fault, OpenGroup, Publish, Task, Work
from interplan_sumo.errors import InputError, MapError, ProcessRefusedError, TrafficError
from interplan_sumo.planner_process.deaths import KilledWhileBuiltError

if TYPE_CHECKING:  # every worker imports this module: SUMO and pandas with it would be most of what the tests take
    from interplan_sumo.batch.remote_jobs import Files


def open_toy(group: str, publish: Publish) -> Work:
    """A group named after what goes wrong in it; payloads are (number, folder for marks)."""
    if group == "unopenable":
        raise InputError("no toy named 'unopenable'")
    if group == "exits while opening":
        print("these are my last words", flush=True)
        os._exit(7)
    if group.startswith("is killed while opening"):
        marks = Path(group.partition(" in ")[2])
        with marks.open("a") as file:
            file.write("x")
        if "always" in group or marks.stat().st_size == 1:
            raise KilledWhileBuiltError("its process was killed")
    if group.startswith("is refused a process"):
        marks = Path(group.partition(" in ")[2])
        with marks.open("a") as file:
            file.write("x")
        if marks.stat().st_size > 1:
            raise ProcessRefusedError("cannot start a process")
    if group == "raises while opening":
        raise RuntimeError("no weights")
    if group == "opens forever":
        time.sleep(600)
    opened = [0]

    def work(payload: Any) -> Answer:
        number, folder = payload
        opened[0] += 1
        publish("simulate")
        value: dict[str, Any] = {"square": number * number, "process": os.getpid(), "nth": opened[0]}
        if group.endswith("in simulate"):
            misbehave(group.removesuffix(" in simulate"), number, Path(folder))
        publish("plan")
        fault = misbehave(group, number, Path(folder))
        publish("store")
        return value, fault

    return work


@dataclass(frozen=True)
class ToysAway:
    """Toy tasks that leave a file each and need one."""

    home: Path

    def stage_in(self) -> Files:
        return {"deep/needed": b"here"}

    def open_in(self, folder: Path) -> OpenGroup:
        (folder / "fresh").write_bytes((folder / "deep/needed").read_bytes())
        return open_toy

    def needs(self, task: Task) -> Files:  # noqa: ARG002 (as all jobs have it)
        return {}

    def collect(self, folder: Path) -> Files:
        return {path.name: path.read_bytes() for path in folder.glob("fresh")}

    def stage_out(self, files: Files) -> None:
        for name, content in files.items():
            (self.home / name).write_bytes(content)


def misbehave(how: str, number: int, folder: Path) -> Fault | None:
    """Only the task with number 1 misbehaves."""
    if number != 1:
        return None
    match how:
        case "raises":
            raise ValueError("I cannot")
        case "exits":
            sys.exit("enough")
        case "interrupts":
            raise KeyboardInterrupt
        case "exits hard":
            print("my last words", flush=True)
            os._exit(3)
        case "crashes":
            os.kill(os.getpid(), signal.SIGSEGV)
        case "hangs":
            while True:
                time.sleep(0.01)
        case "hangs deaf":
            signal.pthread_sigmask(signal.SIG_BLOCK, set(signal.Signals))
            while True:
                pass
        case "forks":
            if os.fork() == 0:
                return None
        case "forks and hangs":
            child = os.fork()
            if child:
                (folder / "child").write_text(str(child))
            time.sleep(600)
        case "allocates":
            bytearray(50 << 30)
        case "chatters":
            for _ in range(1000):
                print("x" * 1000)
        case "breaks the interpreter":
            sys.modules.clear()
            os.fork = os._exit = None  # type: ignore[assignment]
            raise RuntimeError("broken")
        case "is killed once" | "is killed always":
            with (folder / "kills").open("a") as marks:
                marks.write("x")
            if how == "is killed always" or (folder / "kills").stat().st_size == 1:
                os.kill(os.getpid(), signal.SIGKILL)
        case "loses SUMO once" | "loses SUMO always":
            with (folder / "losses").open("a") as marks:
                marks.write("x")
            if how == "loses SUMO always" or (folder / "losses").stat().st_size == 1:
                return Fault("traffic", "SUMO gave up")
        case "finds no map":
            raise MapError("no map named 'nowhere'")
        case "is refused by SUMO":
            raise TrafficError("SUMO rejected moveToXY")
        case _:
            pass
    return None
