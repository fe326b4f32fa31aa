"""Examples: what stands below the help of each command, and in which order commands are listed."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Final

import typer

from interplan_sumo.cli.help_lines import shorten

PROGRAM: Final = "interplan-sumo"
EXAMPLES: Final[Mapping[str, tuple[str, ...]]] = {
    "": ("run --suite smoke==1 --planner idm --out runs/first", "report runs/first --why", "planners check idm"),
    "run": (
        "run --planner idm --planner 'mine:Best?speed_mps=9' --suite smoke==1 --out runs/mine",
        "run --planner exec:'./best --fast' --scenarios 'nudge/*' --seeds 5 --out runs/nudge",
    ),
    "report": ("report runs/mine --why", "report runs/mine --html report.html --replays lost"),
    "score": ("score runs/mine --profile nuplan",),
    "compare": ("compare runs/before runs/after", "compare runs/mine runs/mine --planner-a idm --planner-b mine:Best"),
    "merge": ("merge runs/mine-1 runs/mine-2 --out runs/mine",),
    "sweep": ("sweep --planner idm --param density=low,high --suite smoke==1 --out runs/sweep",),
    "endure": (
        "endure --planner idm --map strip --km 10 --out runs/kilometres",
        "endure --planner mine:Best --map strip --km 500 --density 0.75",
    ),
    "rates": (
        "rates runs/kilometres --html rates.html",
        "rates runs/idm runs/mine --of near_miss --rare jaywalker=0.001",
    ),
    "atlas": (
        "atlas runs/hard --parameters data/hard --html atlas.html",
        "atlas data/hard --planner idm --over walk_mps,distance_m --png atlas.png",
    ),
    "replay": ("replay runs/mine nudge/0 --html nudge.html",),
    "drive": ("drive nudge/0", "drive nudge/0 --from runs/mine --planner idm --at 6.2"),
    "verify": ("verify runs/mine --all",),
    "submit": ("submit runs/mine --planner mine:Best --card card.yaml --out mine.zip",),
    "judge": ("judge mine.zip --out judged",),
    "leaderboard": ("leaderboard judged --html leaderboard.html",),
    "export": ("export runs/mine --min-score 0.5 --out data/mine",),
    "doctor": ("doctor --json",),
    "scenarios": ("scenarios list --suite interplan==1",),
    "scenarios list": ("scenarios list --suite interplan==1 --json",),
    "scenarios show": ("scenarios show nudge/0",),
    "scenarios export": ("scenarios export nudge/0 mine.yaml",),
    "scenarios validate": ("scenarios validate mine.yaml",),
    "scenarios render": ("scenarios render nudge/0 nudge.png", "scenarios render smoke==1 smoke.png"),
    "scenarios freeze": ("scenarios freeze", "scenarios freeze --suite mine==1"),
    "scenarios certify": ("scenarios certify --suite interplan==1 --check",),
    "scenarios generate": ("scenarios generate --map strip --family nudge --count 5 --out data/nudge",),
    "scenarios harden": (
        "scenarios harden --family jaywalker --map strip --against idm,pdm_closed --count 5 --out data/hard",
    ),
    "scenarios import": ("scenarios import drive.db --map maps --out data/mine",),
    "scenarios audit": ("scenarios audit interplan==1 --planner idm --below 60",),
    "planners": ("planners list", "planners check mine:Best"),
    "planners list": ("planners list --json",),
    "planners check": ("planners check 'mine:Best?speed_mps=9'",),
    "maps": ("maps list", "maps import town.xodr --format opendrive --out maps/town"),
    "maps list": ("maps list --json",),
    "maps import": ("maps import town.osm --format osm --out maps/town",),
    "maps check": ("maps check maps/town",),
    "maps convert": ("maps convert maps/town",),
    "maps render": ("maps render strip strip.png",),
    "llm": ("llm try nudge/0 --planner llm_hybrid",),
    "llm fetch": ("llm fetch",),
    "llm try": ("llm try nudge/0 --at 2",),
    "llm export": ("llm export runs/mine --out answers.jsonl",),
    "traffic": ("traffic check mine.xml",),
    "traffic check": ("traffic check mine.xml --json",),
    "traffic realism": ("traffic realism mixed --against tracks.parquet",),
    "traffic calibrate": ("traffic calibrate tracks.parquet --out mine.xml",),
    "dataset": ("dataset ordinary --samples 1000 --out data/ordinary",),
    "dataset ordinary": ("dataset ordinary --samples 1000 --out data/ordinary",),
}
"""By command, without the program's name."""

FIRST: Final = ("run", "report", "replay", "compare", "planners", "scenarios", "maps", "doctor")
"""What is listed before the rest."""
LINE: Final = 62
"""Characters of a command's line in a list."""


def explain(command: Any, path: str = "") -> None:
    """Give a command and all below it their examples; lists of commands have the beginning of what each says."""
    for name, each in getattr(command, "commands", {}).items():
        explain(each, f"{path} {name}".strip())
        each.short_help = _beginning(each.help or "")
    command.help = _paragraphs(command.help or "")
    for parameter in (*command.params, command.get_help_option(typer.Context(command))):
        shorten(parameter)
    shown = EXAMPLES.get(path, ())
    if shown:
        lines = (f"  {PROGRAM} {example}".replace("[", r"\[") for example in shown)
        command.epilog = "\n\n".join(("Examples:" if len(shown) > 1 else "Example:", *lines))
    if not path:
        names = sorted(command.commands, key=lambda name: FIRST.index(name) if name in FIRST else len(FIRST))
        command.commands = {name: command.commands[name] for name in names}


def _paragraphs(text: str) -> str:
    """Without the line ends of the source."""
    return "\n\n".join(" ".join(each.split()) for each in text.split("\n\n"))


def _beginning(text: str) -> str:
    """The first sentence in one line, or its first clause."""
    sentence = re.split("(?<=[.?]) ", text.partition("\n\n")[0], maxsplit=1)[0].rstrip(".")
    return sentence if len(sentence) <= LINE else re.split(" ?[:,;(]", sentence, maxsplit=1)[0]
