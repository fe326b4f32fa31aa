"""Command `scenarios import`: scenes of a recording as scenarios."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from interplan_sumo.cli.options import DONE, JsonOption
from interplan_sumo.report.printing import print_json

if TYPE_CHECKING:
    from interplan_sumo.scenario.recorded import RecordedScene


def import_scenes(
    source: Annotated[Path, typer.Argument(help="A recording: a file, or an Argoverse 2 folder.", metavar="SOURCE")],
    map: Annotated[str, typer.Option(help="The map that belongs to it, as `maps import` made it.")],
    out: Annotated[Path, typer.Option(help="The folder for scenarios, their map, certificates and reports.")],
    format: Annotated[str | None, typer.Option(help="argoverse2 or commonroad. Default: told by its content.")] = None,
    at: Annotated[list[float] | None, typer.Option(help="Seconds into the recording; may be repeated.")] = None,
    ego: Annotated[str | None, typer.Option(help="Whose place the ego takes. Default: the car that measured.")] = None,
    agents: Annotated[
        Literal["sumo", "replayed", "both"], typer.Option(help="Who moves the others: SUMO, or their tracks.")
    ] = "both",
    goal: Annotated[
        float | None,
        typer.Option(help="Metres ahead, unless the track goes farther or the roads end. Default: 150."),
    ] = None,
    duration: Annotated[
        float | None, typer.Option(help="Seconds. Default: the rest of the recording; 30 where SUMO moves the others.")
    ] = None,
    certify: Annotated[bool, typer.Option(help="Look for a drive that passes each.")] = True,
    workers: Annotated[int | None, typer.Option(help="Processes for that; 0 works in this one. Default: all.")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace what the folder holds.")] = False,
    as_json: JsonOption = False,
) -> int:
    """Make scenarios of a recording: the ego in the place of a recorded car, among the road users around it."""
    from interplan_sumo.maps.store import find_map
    from interplan_sumo.proving.generation import check_folder
    from interplan_sumo.proving.recorded_scenes import Moments, read_recording, recorded_scenes, write_scenes
    from interplan_sumo.scenario.recorded import GOAL_M

    check_folder(out, overwrite=overwrite)
    moments = Moments(tuple(at or (0.0,)), ego, agents, GOAL_M if goal is None else goal, duration)
    recording = read_recording(source, format)
    scenes = recorded_scenes(recording, find_map(map), moments, out, overwrite=overwrite)
    passed = write_scenes(out, scenes, _proved(scenes, workers) if certify else ())
    entries = [_entry(each) for each in scenes]
    if as_json:
        notes = list(recording.notes)
        print_json({"folder": str(out), "scenarios": entries, "certified": passed if certify else None, "notes": notes})
    else:
        _print(entries, recording.notes)
        print(f"{len(scenes)} scenarios{f', {passed} certified' if certify else ''}: {out}")
    return DONE


def _proved(scenes: list[RecordedScene], workers: int | None) -> list[Any]:
    """What the search for a drive came to, each with a line on stderr."""
    from interplan_sumo.batch.certify_job import proofs
    from interplan_sumo.batch.processes import available_cores
    from interplan_sumo.proving.certificates import Verdict

    verdicts: list[Verdict] = []
    many = available_cores() if workers is None else workers
    for proof in proofs([each.scenario for each in scenes], workers=many):
        reason = "; ".join(proof.problems) or None
        verdicts.append(Verdict(proof.scenario.id, proof.certificate, reason, proof.simulations))
        done = "certified" if proof.certificate is not None else f"not certified: {reason}"
        print(f"[{len(verdicts)}/{len(scenes)}] {proof.scenario.id}: {done}", file=sys.stderr, flush=True)
    return verdicts


def _entry(scene: RecordedScene) -> dict[str, Any]:
    from interplan_sumo.proving.start_checks import validate

    scenario = scene.scenario
    return {
        "id": scenario.id,
        "duration_s": scenario.duration_s,
        "vehicles": len(scenario.vehicles),
        "obstacles": len(scenario.obstacles),
        "replayed": len(scenario.replayed),
        "left_out": [{"track": track, "reason": reason} for track, reason in scene.left_out],
        "notes": list(scene.notes),
        "problems": validate(scenario),
    }


def _print(entries: list[dict[str, Any]], notes: tuple[str, ...]) -> None:
    for note in notes:
        print(f"recording: {note}")
    for entry in entries:
        counts = ", ".join(f"{name} {entry[name]}" for name in ("vehicles", "obstacles", "replayed"))
        print(f"{entry['id']}: {entry['duration_s']:g} s; {counts}, left out {len(entry['left_out'])}")
        for name in ("notes", "problems"):
            for text in entry[name]:
                print(f"  {name.removesuffix('s')}: {text}")
