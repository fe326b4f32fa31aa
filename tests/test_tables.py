"""The tables of README and docs are what the stored drives give: nobody types their figures."""

from __future__ import annotations

import pytest

from interplan_sumo.scenario.suite import find_suite
from tools.tables import PAGES, ROOT, TABLE, TABLES, Drives, stored, written


@pytest.fixture(scope="module")
def drives() -> dict[str, Drives]:
    return stored()


@pytest.mark.parametrize("page", PAGES)
def test_each_figure_is_what_the_stored_drives_give(page: str, drives: dict[str, Drives]) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    assert TABLE.search(text) is not None
    assert written(text, drives) == text


def test_every_table_stands_somewhere_and_another_figure_would_be_put_right(drives: dict[str, Drives]) -> None:
    texts = [(ROOT / page).read_text(encoding="utf-8") for page in PAGES]
    assert {name for text in texts for name in TABLE.findall(text)} == set(TABLES)
    wrong = texts[0].replace("| `foresight` (ours) | ", "| `foresight` (ours) | 1")
    assert wrong != texts[0]
    assert written(wrong, drives) == texts[0]


def test_the_stored_drives_are_all_of_the_suites_as_they_are(drives: dict[str, Drives]) -> None:
    for key, held in drives.items():
        suite = find_suite(key)
        assert (held.run.manifest.suite, held.run.manifest.suite_hash) == (key, suite.hash())
        assert held.strict.complete
        assert all(
            line.scenarios == len(suite.scenarios) and line.official and not line.faults for line in held.strict.lines
        )
