"""The tables of README and docs are what the stored drives give: nobody types their figures."""

from __future__ import annotations

import pytest

from interplan_sumo.batch.run_folder import read_run
from interplan_sumo.scenario.suite import find_suite
from tools.tables import PAGES, RESULTS, ROOT, TABLE, TABLES, Drives, written


@pytest.fixture(scope="module")
def drives() -> Drives:
    return Drives(read_run(RESULTS))


@pytest.mark.parametrize("page", PAGES)
def test_each_figure_is_what_the_stored_drives_give(page: str, drives: Drives) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    assert TABLE.search(text) is not None
    assert written(text, drives) == text


def test_every_table_stands_somewhere_and_another_figure_would_be_put_right(drives: Drives) -> None:
    texts = [(ROOT / page).read_text(encoding="utf-8") for page in PAGES]
    assert {name for text in texts for name in TABLE.findall(text)} == set(TABLES)
    wrong = texts[0].replace("| `foresight` (ours) | ", "| `foresight` (ours) | 1")
    assert wrong != texts[0]
    assert written(wrong, drives) == texts[0]


def test_the_stored_drives_are_all_of_the_suite_as_it_is(drives: Drives) -> None:
    suite = find_suite(drives.run.manifest.suite)
    assert drives.run.manifest.suite_hash == suite.hash()
    assert drives.strict.complete
    assert all(
        line.scenarios == len(suite.scenarios) and line.official and not line.faults for line in drives.strict.lines
    )
