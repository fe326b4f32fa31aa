"""Command `scenarios import`: scenes of recordings and logs, and interPlan's own configuration, as scenarios."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from interplan_sumo.cli.certify import proved
from interplan_sumo.cli.completion import starting
from interplan_sumo.cli.options import DONE, JsonOption, WorkersOption
from interplan_sumo.errors import counted
from interplan_sumo.report.printing import print_json

if TYPE_CHECKING:
    from interplan_sumo.scenario.recorded import RecordedScene
    from interplan_sumo.verification.recorded_scenes import ImportedScenes


def format_names() -> list[str]:
    from interplan_sumo.recordings.formats import RECORDING_FORMATS

    return list(RECORDING_FORMATS)


def import_recorded(
    source: Annotated[
        Path, typer.Argument(help="A recording, a log, or a configuration: a file or a folder.", metavar="SOURCE")
    ],
    map: Annotated[
        str,
        typer.Option(help="Its map, as `maps import` made it; for nuPlan the folder of its maps."),
    ],
    out: Annotated[Path, typer.Option(help="For scenarios, map, certificates and reports.")],
    format: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Default: told by its content.", autocompletion=starting(format_names)),
    ] = None,
    at: Annotated[list[float] | None, typer.Option(help="Seconds into the recording; may be repeated.")] = None,
    token: Annotated[list[str] | None, typer.Option(help="nuPlan: lidar_pc tokens at which scenes begin.")] = None,
    tag: Annotated[list[str] | None, typer.Option(help="nuPlan: scenario types at which scenes begin.")] = None,
    count: Annotated[int | None, typer.Option(help="nuPlan: most scenes of each type. Default: 1.")] = None,
    logs: Annotated[list[Path] | None, typer.Option(help="interPlan: nuPlan's .db files, or folders of them.")] = None,
    ego: Annotated[str | None, typer.Option(help="Whose place the ego takes. Default: the car that measured.")] = None,
    agents: Annotated[
        Literal["sumo", "replayed", "both"] | None,
        typer.Option(help="sumo, replayed (as recorded) or both (default) move the others."),
    ] = None,
    goal: Annotated[
        float | None,
        typer.Option(help="Metres ahead, unless the track goes farther. Default: 150; replayed, 80 % of the track."),
    ] = None,
    duration: Annotated[
        float | None, typer.Option(help="Seconds. Default: the rest of the recording; 30 where SUMO moves the others.")
    ] = None,
    no_certify: Annotated[bool, typer.Option("--no-certify", help="Look for no drive that passes each.")] = False,
    workers: WorkersOption = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace what the folder holds.")] = False,
    as_json: JsonOption = False,
) -> int:
    """Make scenarios of a recording: the ego in the place of a recorded car, among the road users around it."""
    from interplan_sumo.verification.generation import check_folder
    from interplan_sumo.verification.recorded_scenes import import_scenes, write_scenes

    check_folder(out, overwrite=overwrite)
    asked = {
        "at": at, "token": token, "tag": tag, "count": count, "logs": logs,
        "ego": ego, "agents": agents, "goal": goal, "duration": duration,
    }  # fmt: skip
    options = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in asked.items()
        if value is not None and value != []
    }
    made = import_scenes(source, map, out, options, format, overwrite=overwrite)
    scenes = made.scenes
    scenarios = [each.scenario for each in scenes]
    passed = write_scenes(out, scenes, () if no_certify else proved(scenarios, workers))
    entries = [_entry(each) for each in scenes]
    if as_json:
        said = {"folder": str(out), "scenarios": entries, "certified": None if no_certify else passed}
        not_made = [{"id": id_, "reason": reason} for id_, reason in made.not_made]
        print_json(said | {"notes": list(made.notes), "not_made": not_made})
    else:
        _print(entries, made)
        print(f"{counted(len(scenes), 'scenario')}{'' if no_certify else f', {passed} certified'}: {out}")
    return DONE


def _entry(scene: RecordedScene) -> dict[str, Any]:
    from interplan_sumo.verification.start_checks import validate

    scenario = scene.scenario
    return {
        "id": scenario.id,
        "duration_s": scenario.duration_s,
        "vehicles": len(scenario.vehicles),
        "obstacles": len(scenario.obstacles),
        "replayed": len(scenario.replayed),
        "lights": len(scenario.lights),
        "left_out": [{"track": track, "reason": reason} for track, reason in scene.left_out],
        "notes": list(scene.notes),
        "problems": validate(scenario),
    }


def _print(entries: list[dict[str, Any]], made: ImportedScenes) -> None:
    for note in made.notes:
        print(f"recording: {note}")
    for entry in entries:
        lights = ("lights",) if entry["lights"] else ()
        counts = ", ".join(f"{name} {entry[name]}" for name in ("vehicles", "obstacles", "replayed", *lights))
        print(f"{entry['id']}: {entry['duration_s']:g} s; {counts}, left out {len(entry['left_out'])}")
        for name in ("notes", "problems"):
            for text in entry[name]:
                print(f"  {name.removesuffix('s')}: {text}")
    for id_, reason in made.not_made:
        print(f"not made: {id_}: {reason}")
