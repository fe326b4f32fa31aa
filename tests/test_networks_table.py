"""Tables of networks and of what plans cost: from model cards and from what was measured, digit by digit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from interplan_learned.card import read_card
from interplan_learned.network import shipped_cards
from tools import networks as kept
from tools.networks import data_scaling, gained_of_late, keep_plan_times, keep_scaling, networks, plan_times
from tools.tables import ORDINARY, SMALL, stored


def test_plan_times_are_those_of_the_last_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept, "PLAN_TIMES", tmp_path / "plan_times.csv")
    keep_plan_times([("idm", 9.0, 9.0, 9.0, 9.0, 9.0, 1.0, 9.0)])
    keep_plan_times([
        ("idm", 0.6123, 0.59, 0.71, 2.0, 30.0, 1.0, 0.7), ("gameformer", 18.66, 18.0, 21.5, 40.0, 99.0, 30.5, 20.0),
    ])  # fmt: skip
    assert plan_times() == [
        "planner | mean | median | 90 % | x IDM",
        "---|---|---|---|---",
        "`idm` | 0.6 | 0.6 | 0.7 | 1.0",
        "`gameformer` | 19 | 18 | 22 | 30",
    ]


def test_what_was_gained_of_late_is_that_of_the_last_five_epochs_and_never_negative() -> None:
    assert gained_of_late([4.0, 3.0, 2.9, 2.8, 2.8, 2.85, 2.7]) == "10.0 %"
    assert gained_of_late([4.0, 3.0, 3.1, 3.2, 3.1, 3.1, 3.3]) == "0.0 %"
    assert gained_of_late([4.0, 3.0, 2.9, 2.8, 2.7]) == "-"


def test_every_shipped_network_has_its_line_best_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept, "PLAN_TIMES", tmp_path / "plan_times.csv")
    keep_plan_times([("pdm_open", 3.14, 3.0, 3.0, 3.0, 3.0, 5.0, 3.0)])
    drives = stored()
    head, _, still, *lines = networks(drives[SMALL].by_paper, drives[ORDINARY].by_paper)
    assert head.count("|") == still.count("|") == 10
    cards = {card.planner: card for card in map(read_card, shipped_cards().values())}
    told = [line.split(" | ") for line in lines]
    assert {cells[0].strip("`") for cells in told} == {name.replace("pdm_offset", "pdm_hybrid") for name in cards}
    errors = [float(cells[5]) for cells in told]
    assert errors == sorted(errors)
    (open_loop,) = (cells for cells in told if cells[0] == "`pdm_open`")
    card = cards["pdm_open"]
    assert open_loop[2] == f"{card.parameters:,}"
    assert open_loop[6] == f"{card.errors['test']['network']['ade']:.2f}"
    assert open_loop[-1] == "3.1"
    assert {cells[-1] for cells in told} == {"3.1", "-"}


def test_errors_over_samples_end_with_the_shipped_network_and_are_of_its_data_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kept, "DATA_SCALING", tmp_path / "data_scaling.csv")
    shipped = read_card(shipped_cards()["pdm_open"])

    def part(samples: int, val_m: float, data_hash: str = shipped.data["hash"]) -> Path:
        data = {"hash": data_hash, "samples": {**shipped.data["samples"], "train": samples}}
        errors = {split: {"network": {"ade": val_m}} for split in ("val", "test")}
        path = tmp_path / f"{samples}.json"
        replace(shipped, data=data, errors=errors).write(path)
        return path

    keep_scaling([part(9_000, 4.0), part(25_000, 9.0)])
    keep_scaling([part(25_000, 3.0), part(12_500, 3.504)])
    whole, errors = (
        shipped.data["samples"]["train"],
        [shipped.errors[split]["network"]["ade"] for split in ("val", "test")],
    )
    assert data_scaling()[2:] == [
        "`pdm_open` | 12,500 | 3.50 | 3.50",
        "`pdm_open` | 25,000 | 3.00 | 3.00",
        f"`pdm_open` | {whole:,} | {errors[0]:.2f} | {errors[1]:.2f}",
    ]
    with pytest.raises(SystemExit, match="learned from 0123"):
        keep_scaling([part(25_000, 3.0, "0123")])
    (tmp_path / "data_scaling.csv").write_text("network,data,samples,val,test\npdm_open,0123,5,9,9\n", encoding="utf-8")
    with pytest.raises(SystemExit, match="other data"):
        data_scaling()
