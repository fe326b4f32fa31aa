"""Judged: what is noted in a run folder that was made of a bundle: the card, what was claimed, what came again."""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal

from msgspec import Struct, json

from interplan_sumo.batch.bundle import PlannerCard
from interplan_sumo.batch.records import Count, RecordError, Score, Seconds, Seed, decode, encode
from interplan_sumo.errors import RunFolderError
from interplan_sumo.world.files import replacing, writing

JUDGED: Final = "judged.json"
"""In the run folder."""


class OtherDrive(Struct, frozen=True):
    """A drive that did not come again as it was claimed."""

    scenario_id: str
    seed: Seed
    reason: str
    claimed: Score | None
    score: Score | None


class Judged(Struct, frozen=True):
    """judged.json."""

    card: PlannerCard
    sha256: str
    """Of the bundle."""
    judged: str
    """When, UTC."""
    driven: str
    """When the claimed run began, as it says."""
    platform: str
    """On which machine that was, as it says."""
    planner_hash: str | None
    """As it says."""
    plan_s: Seconds | None
    """What a plan took on average there, as it says."""
    drives: Count
    equal: Count
    others: tuple[OtherDrive, ...]
    changed_versions: dict[str, tuple[str, str]]
    """What had another version when it was driven: name -> (then, now)."""
    format: Literal[1] = 1


def keep_judged(judged: Judged, run_folder: Path) -> None:
    """RunFolderError if it cannot be written."""
    path = run_folder / JUDGED
    with writing(path, kind=RunFolderError), replacing(path) as fresh:
        fresh.write_bytes(json.format(encode(judged), indent=2) + b"\n")


def read_judged(run_folder: Path) -> Judged:
    """RunFolderError for a folder that no judge made."""
    path = run_folder / JUDGED
    try:
        return decode(path.read_bytes(), Judged)
    except FileNotFoundError:
        raise RunFolderError(f"{run_folder} was not judged; make it of a bundle with the command judge") from None
    except OSError as error:
        raise RunFolderError(f"cannot read {path}: {error.strerror or error}") from None
    except RecordError as error:
        raise RunFolderError(f"{path} is damaged ({error}); judge the bundle again") from None


def judged_folders(places: tuple[Path, ...]) -> list[Path]:
    """The judged run folders among these and right below them, by name; RunFolderError for a place without any."""
    found: dict[Path, None] = {}
    for place in places:
        below = [path for path in (place / JUDGED, *sorted(place.glob(f"*/{JUDGED}"))) if path.is_file()]
        if not below:
            raise RunFolderError(f"no judged bundle in {place}; make some with the command judge, or leave it out")
        found.update(dict.fromkeys(path.parent for path in below))
    return list(found)
