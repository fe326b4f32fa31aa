"""interPlan's configuration files: which scenarios a filter names, and the modification details of their tokens."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, cast

import yaml

from interplan_sumo.errors import InputError
from interplan_sumo.scenario.files import SUFFIXES

PUBLISHED: Final = "interplan10"
"""The filter of the eighty scenarios of the paper; the one that is meant where a folder holds several."""
LARGEST_BYTES: Final = 5_000_000
DEEPEST: Final = 50
TOKENS: Final = "scenario_tokens"
MODIFICATIONS: Final = "modifications"
DETAILS: Final = "modification_details_dictionary"


@dataclass(frozen=True, slots=True)
class Configuration:
    """What a filter asks for."""

    names: tuple[str, ...]
    """Of scenarios, each once, in the order of the file."""
    details: Mapping[str, Mapping[str, Any]]
    """By token; all values are text, lists or mappings."""
    logs: frozenset[str]
    """Names of the logs that hold the tokens, empty where the file does not tell."""


def read_configuration(path: Path) -> Configuration:
    """A scenario filter, or that of a folder: the only one in it, or interPlan's published one.

    The details stand in the file itself, in `modifications/` beside it under
    the name of its defaults, or anywhere in the folder. InputError names the
    file and what is missing.
    """
    path = Path(path)
    file = _filter_in(path) if path.is_dir() else path
    content = _mapping(file)
    names = content.get(TOKENS)
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        raise InputError(f"{file}: {TOKENS} is no list of names; interPlan's filters are scenario_filter/*.yaml")
    logs = content.get("log_names")
    return Configuration(
        tuple(dict.fromkeys(cast("list[str]", names))),
        _details(path, file, content),
        frozenset(name for name in logs if isinstance(name, str)) if isinstance(logs, list) else frozenset(),
    )


def _filter_in(folder: Path) -> Path:
    """The filter of a folder."""
    files = [file for file in _files(folder) if isinstance(_if_readable(file).get(TOKENS), list)]
    published = [file for file in files if file.stem == PUBLISHED]
    if len(files) == 1 or len(published) == 1:
        return (published or files)[0]
    found = ", ".join(str(file.relative_to(folder)) for file in (published or files)[:5]) or "none"
    raise InputError(f"{folder}: expected one scenario filter, found {found}; name a file")


def _details(given: Path, file: Path, content: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    inside = content.get(MODIFICATIONS, content)
    beside = _named_beside(file, content)
    blocks: list[Any] = [inside, *([_mapping(beside)] if beside is not None and beside.is_file() else [])]
    blocks += [_if_readable(place) for place in _files(given)] if given.is_dir() else []
    for block in blocks:
        found = block.get(DETAILS) if isinstance(block, Mapping) else None
        if isinstance(found, Mapping):
            tokens = cast("Mapping[str, Any]", found)
            return {token: value for token, value in tokens.items() if isinstance(value, Mapping)}
    raise InputError(
        f"{file}: no {DETAILS} in it, nor in {file.parent / MODIFICATIONS}; "
        "interPlan keeps them in scenario_filter/modifications/interPlan_modifications.yaml"
    )


def _named_beside(file: Path, content: Mapping[str, Any]) -> Path | None:
    """The file that `defaults: [modifications: NAME]` means."""
    defaults = content.get("defaults")
    for entry in defaults if isinstance(defaults, list) else ():
        name = entry.get(MODIFICATIONS) if isinstance(entry, Mapping) else None
        if isinstance(name, str) and name == Path(name).name:
            return file.parent / MODIFICATIONS / f"{name.removesuffix('.yaml')}.yaml"
    return None


def _files(folder: Path) -> list[Path]:
    return sorted(file for file in folder.rglob("*") if file.suffix.lower() in SUFFIXES and file.is_file())


def _if_readable(path: Path) -> Mapping[str, Any]:
    """A file of a folder; what is no configuration says nothing."""
    try:
        return _mapping(path)
    except InputError:
        return {}


def _mapping(path: Path) -> Mapping[str, Any]:
    """The one document of a file with every value as text; InputError if it is none."""
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_BYTES + 1)
        if len(data) > LARGEST_BYTES:
            raise InputError(f"{path} is larger than {LARGEST_BYTES // 1_000_000} MB; it is no configuration")
        text = data.decode("utf-8-sig")
        _check_events(path, text)
        content: Any = yaml.load(text, Loader=yaml.BaseLoader)  # text, lists and mappings only
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    except (yaml.YAMLError, UnicodeDecodeError, ValueError) as error:
        raise InputError(f"{path}: this is not YAML: {' '.join(str(error).split())[:120]}") from None
    return cast("Mapping[str, Any]", content) if isinstance(content, Mapping) else {}


def _check_events(path: Path, text: str) -> None:
    """InputError for what grows without end when it is read: aliases, and lists within lists."""
    depth = 0
    for event in yaml.parse(text, Loader=yaml.BaseLoader):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if isinstance(event, yaml.AliasEvent) or depth > DEEPEST:
            what = "an alias" if isinstance(event, yaml.AliasEvent) else f"more than {DEEPEST} levels"
            raise InputError(
                f"{path}, line {event.start_mark.line + 1}: {what}, which no configuration of interPlan has"
            )


def known_tokens(names: Sequence[str]) -> tuple[str, ...]:
    """The tokens of names, each once."""
    return tuple(dict.fromkeys(name.partition("-")[0] for name in names))
