"""`python -m tools.train PLANNER --data DIR --out DIR`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
import yaml

from interplan_sumo.errors import InputError, InterplanError
from interplan_sumo.extras import library
from interplan_sumo.planner_options import OptionLoader

if TYPE_CHECKING:
    from tools.train.loop import EpochDone


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


def main() -> None:
    """Train; what the user got wrong is one line."""
    try:
        app(prog_name="python -m tools.train")
    except InterplanError as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        sys.exit(2 if isinstance(error, InputError) else 1)


@app.command()
def train(
    planner: Annotated[str, typer.Argument(help="what to train, such as pdm_open")],
    data: Annotated[Path, typer.Option(help="a folder that `interplan-sumo export` wrote")],
    out: Annotated[Path, typer.Option(help="folder for the weights (.onnx) and the model card (.json)")],
    name: Annotated[str | None, typer.Option(help="of the weights; the planner's by default")] = None,
    size: Annotated[str | None, typer.Option(help="compact or published; by default the usual one")] = None,
    option: Annotated[list[str] | None, typer.Option(help="NAME=VALUE of the network; may be repeated")] = None,
    epochs: Annotated[int | None, typer.Option(help="by default the recipe's")] = None,
    batch: Annotated[int | None, typer.Option(help="samples per step, by default the recipe's")] = None,
    learning_rate: Annotated[float | None, typer.Option(help="by default the recipe's")] = None,
    patience: Annotated[int | None, typer.Option(help="epochs without progress before it stops")] = None,
    seed: Annotated[int, typer.Option(help="of weights and samples")] = 0,
    share: Annotated[float, typer.Option(help="of the drives to learn from, drawn; for a curve over data")] = 1.0,
    max_minutes: Annotated[float | None, typer.Option(help="stop after so long; --resume goes on")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="go on from the checkpoint in --work")] = False,
    work: Annotated[Path, typer.Option(help="folder for checkpoints")] = Path("runs/training"),
    device: Annotated[str, typer.Option(help="cpu or cuda")] = "cpu",
    processes: Annotated[int, typer.Option(help="that share each batch; more than 1 where cores are idle")] = 1,
) -> None:
    """Train a planner's network on a data set and write it with its model card."""
    library("torch", "training", "train")
    library("onnx", "training", "train")
    library("onnxruntime", "training", "learned")
    from tools.train.session import TrainRequest, train_planner

    given = {"epochs": epochs, "batch": batch, "learning_rate": learning_rate, "patience": patience, "seed": seed}
    card = train_planner(
        TrainRequest(
            planner=planner, data=data, out=out, work=work, name=name, size=size,
            options=_options(option or []), settings={key: value for key, value in given.items() if value is not None},
            share=share, resume=resume, device=device, processes=processes, max_minutes=max_minutes,
        ),
        _told,
    )  # fmt: skip
    for split, errors in card.errors.items():
        print(
            f"{split}: {errors['network']['ade']:.2f} m off on average, constant velocity "
            f"{errors['constant_velocity']['ade']:.2f} m ({errors['samples']} samples)"
        )
    print(f"{card.parameters} weights, {card.size}: {out / (name or planner)}.json")


def _options(pairs: list[str]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for pair in pairs:
        key, equals, value = pair.partition("=")
        if not equals:
            raise InputError(f"option {pair!r} has no value; write --option {key}=VALUE")
        found[key] = yaml.load(value, OptionLoader)  # a safe loader
    return found


def _told(done: EpochDone) -> None:
    print(
        f"epoch {done.epoch}/{done.epochs}  loss {done.loss:.4f}  held out {done.held_out_m:.3f} m "
        f"(best {done.best_m:.3f})  {done.seconds:.0f} s",
        flush=True,
    )


if __name__ == "__main__":
    main()
