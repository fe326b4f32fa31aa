"""Figures in prose are what tables say: cells, differences, the least and the most of rows."""

from __future__ import annotations

import pytest

from tools.figures import with_figures

MADE = {
    "rare": [
        "planner | interPlan | km",
        "---|---|---",
        "`idm` | 17 [15, 18] | 1,001",
        "the oracle, which knows | 76 | -",
        "`foresight` (ours) | 88 [81, 93] | 302.5",
        "`pdm?model=a` | -2 | 0, 3",
        "`twice` | 1 | 1",
        "`twice`, again | 2 | 2",
    ],
    "near": ["Eight planners: rank correlation 0.54 (Spearman), 13 points apart."],
}


def tables(name: str) -> list[str]:
    if name not in MADE:
        raise LookupError(f"no table {name!r}")
    return MADE[name]


@pytest.mark.parametrize(("source", "figure"), [
    ("rare[idm, interPlan]", "17"), ("rare[idm, km]", "1,001"), ("rare[foresight, km]", "302.5"),
    ("rare[the oracle, interPlan]", "76"), ("rare[pdm?model=a, interPlan]", "-2"), ("rare[pdm?model=a, km]", "0"),
    ("rare[foresight, interPlan] - rare[idm, interPlan]", "71"),
    ("rare[idm, interPlan] - rare[foresight, km]", "-285.5"),
    ("rare[idm, km] - rare[foresight, km]", "698.5"),
    ("least rare[idm/foresight, interPlan]", "17"), ("most rare[idm/foresight, interPlan]", "88"),
    ("near[rank correlation]", "0.54"), ("near[planners: rank correlation 0.54 (Spearman)]", "13"),
])  # fmt: skip
def test_a_figure_in_prose_is_what_its_comment_asks_for(source: str, figure: str) -> None:
    right = f"It has {figure}<!-- {source} -->, of 99 (3<!-- a remark -->)."
    for typed in ("0", "12,345.6", "-7"):
        assert with_figures(right.replace(f"{figure}<", f"{typed}<", 1), tables) == right


def test_a_hyphen_before_a_figure_is_no_sign() -> None:
    right = "40-17<!-- rare[idm, interPlan] -->, x -2<!-- rare[pdm?model=a, interPlan] -->"
    assert with_figures(right.replace("17", "3").replace(" -2", " 5"), tables) == right


@pytest.mark.parametrize(("source", "why"), [
    ("rare[foresite, interPlan]", r"1<!-- .* -->: 0 rows are 'foresite', of \['idm', "),
    ("rare[twice, km]", "2 rows are 'twice'"),
    ("rare[idm, paper]", r"no column 'paper' in \['planner', 'interPlan', 'km'\]"),
    ("near[idm, km]", "near is a sentence"),
    ("hard[idm, km]", "no table 'hard'"), ("rare[the oracle, km]", "no number for"), ("near[tau]", "no number for"),
    ("rare[idm/foresight, km]", "several rows; write least or most before them"),
    ("mean rare[idm, km]", r"is no cell; write TABLE\[ROW, COLUMN\]"), ("rare[idm, km] - 3[]", "is no cell"),
])  # fmt: skip
def test_what_no_table_says_is_an_error_with_its_comment(source: str, why: str) -> None:
    with pytest.raises(LookupError, match=why):
        with_figures(f"1<!-- {source} -->", tables)
