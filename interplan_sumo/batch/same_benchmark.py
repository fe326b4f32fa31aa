"""Whether two runs drove one benchmark: what all rows of a folder share."""

from __future__ import annotations

from typing import Any, Final

from msgspec import json, to_builtins

from interplan_sumo.batch.records import Manifest

BENCHMARK: Final = ("suite", "suite_hash", "profile", "overrides", "versions", "traffic_version")
"""What all rows of a folder share, by its name in the manifest."""


def benchmark_of(manifest: Manifest) -> tuple[str, ...]:
    """What all rows of a folder share, to hold against that of others."""
    return tuple(json.encode(getattr(manifest, name)).decode() for name in BENCHMARK)


def run_difference(held: Manifest, wanted: Manifest) -> tuple[str, str, str] | None:
    """What keeps two runs' rows out of one folder: its name, and what each says; None if nothing does.

    Beside the benchmark that is the time that plans may take.
    """
    for name in BENCHMARK:
        if (found := _difference(name, *(to_builtins(getattr(each, name)) for each in (held, wanted)))) is not None:
            return found
    return _difference("--plan-limit", *(f"{each.plan_limit_s or 0:g}" for each in (held, wanted)))


def _difference(name: str, held: Any, wanted: Any) -> tuple[str, str, str] | None:
    if held == wanted:
        return None
    if isinstance(held, dict) and isinstance(wanted, dict):
        for key in {**held, **wanted}:
            if held.get(key) != wanted.get(key):
                return _difference(f"{name} {key}", held.get(key, "none"), wanted.get(key, "none"))
    return name, _said(held), _said(wanted)


def _said(value: Any) -> str:
    return "none" if value in (None, {}, "none") else value if isinstance(value, str) else json.encode(value).decode()
