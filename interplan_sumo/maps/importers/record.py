"""The record of an import: which stretch of which lane of the file became what, stored beside the map."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from interplan_sumo.errors import MapError

FORMAT = 1
RECORD_FILE = "import.json"


class LaneOrigin(NamedTuple):
    """A stretch of a lane of the file, and where it lies on a lane or connector of the map."""

    source_id: str
    from_share: float
    """Of the length of the lane of the file."""
    to_share: float
    start_m: float
    """Along the centre line of the lane or connector."""
    end_m: float


@dataclass(frozen=True, slots=True)
class ImportRecord:
    """Where the parts of an imported map come from."""

    file: str
    """Name of the file, without its folder."""
    sha256: str
    format: str
    origins: Mapping[str, tuple[LaneOrigin, ...]]
    """By lane and connector id, in driving order."""
    left_out: Mapping[str, tuple[str, ...]]
    """Ids of the file by the reason why they are no lanes of the map."""
    notes: tuple[str, ...]

    def write(self, folder: Path) -> None:
        """Write `import.json` into a folder; equal records give equal bytes."""
        content = {"version": FORMAT, **asdict(self)}
        text = json.dumps(content, indent=1, ensure_ascii=False)
        (folder / RECORD_FILE).write_text(text + "\n", encoding="utf-8", newline="\n")


def read_record(folder: Path) -> ImportRecord | None:
    """The record of the map in a folder, None if it was not imported; MapError if it is damaged."""
    path = folder / RECORD_FILE
    try:
        content = msgspec.json.decode(path.read_bytes(), type=dict[str, Any])
        if content.get("version") != FORMAT:
            raise MapError(f"{path} is of version {content.get('version')!r}, expected {FORMAT}; import the map again")
        return msgspec.convert(content, ImportRecord)
    except FileNotFoundError:
        return None
    except (OSError, ValueError, RecursionError) as error:
        raise MapError(f"{path} is not the record of an import ({error}); import the map again") from None
