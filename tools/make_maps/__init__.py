"""The shipped maps, drawn from compact road plans."""

from __future__ import annotations

from pathlib import Path

PLANS: dict[str, Path] = {file.stem: file for file in sorted(Path(__file__).parent.glob("plans/*.yaml"))}
"""The files of all plans by the names of their maps."""
