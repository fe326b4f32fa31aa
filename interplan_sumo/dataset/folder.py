"""Folder: where a dataset lies, and whose it is.

| in the folder | what |
|---|---|
| manifest.json | what it is and how it was made, all hashes; written last, so a folder without one is not finished |
| drives.jsonl | a line per drive: scenario, family, map, seed, planner, score, route, goal lane, split |
| shards/<split>-<number>.npz | samples, a fixed number in each but the last of a split |
| maps/<name>.npz | the lane graph of a map |
| driven/ | run folders of a dataset for which drives were made; may be deleted |
| unfinished, parts/ | only while it is being written |
"""

from __future__ import annotations

import shutil
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Final

from interplan_sumo.dataset.records import DatasetManifest, ManifestHead, record_of, text_of
from interplan_sumo.errors import InputError
from interplan_sumo.world.files import replacing, writing

FORMAT: Final = 1
KIND: Final = "interplan-sumo training data"
MANIFEST, DRIVES, SHARDS, MAPS = "manifest.json", "drives.jsonl", "shards", "maps"
UNFINISHED, PARTS = "unfinished", "parts"
DRIVEN: Final = "driven"
"""Run folders that were made for the dataset; kept when it is made anew."""


def begin(folder: Path) -> None:
    """Make room for a dataset: a new or empty folder, or one that holds another dataset, which is deleted.

    InputError if it holds anything else or cannot be written.
    """
    with writing_in(folder):
        check_free(folder)
        (folder / PARTS).mkdir(parents=True, exist_ok=True)
        (folder / UNFINISHED).touch()
        for name in (MANIFEST, DRIVES):
            (folder / name).unlink(missing_ok=True)
        for name in (PARTS, SHARDS, MAPS):
            shutil.rmtree(folder / name, ignore_errors=True)
            (folder / name).mkdir()


def check_free(folder: Path) -> None:
    """InputError if the folder is a file, or holds what belongs to no dataset."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file; give a folder as --out")
    strangers = sorted({each.name for each in folder.iterdir()} - {DRIVEN}) if folder.is_dir() else []
    if strangers and not _is_ours(folder):
        raise InputError(f"{folder} holds {strangers[0]!r} and is no dataset; give an empty or a new folder as --out")


def finish(folder: Path, manifest: DatasetManifest) -> None:
    """Write the manifest, which makes the dataset whole, and tidy up."""
    with replacing(folder / MANIFEST) as fresh:
        fresh.write_text(text_of(manifest, indent=2) + "\n", encoding="utf-8")
        shutil.rmtree(folder / PARTS)
    (folder / UNFINISHED).unlink()


def read_manifest(folder: Path) -> DatasetManifest:
    """The manifest; InputError if the folder is not a dataset, not finished, or of another version."""
    path = folder / MANIFEST
    if not path.is_file():
        if (folder / UNFINISHED).is_file():
            raise InputError(f"{folder} is a dataset that was not finished; repeat the export")
        raise InputError(f"{folder} is no dataset: it has no {MANIFEST}; make one with `interplan-sumo export`")
    try:
        text = path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}; export the data again") from None
    head = record_of(text, ManifestHead, str(path))
    if head.kind != KIND:
        raise InputError(f"{folder} is no dataset: its {MANIFEST} tells of {head.kind!r}")
    if head.format != FORMAT:
        raise InputError(f"{path} has format {head.format}, this version reads {FORMAT}; export the data again")
    return record_of(text, DatasetManifest, str(path))


def writing_in(folder: Path) -> AbstractContextManager[None]:
    """Inside the block what of a dataset cannot be written is an InputError."""
    return writing(f"the dataset {folder}", "give another folder as --out")


def _is_ours(folder: Path) -> bool:
    if (folder / UNFINISHED).is_file():
        return True
    try:
        return record_of((folder / MANIFEST).read_bytes(), ManifestHead, MANIFEST).kind == KIND
    except (OSError, InputError):
        return False
