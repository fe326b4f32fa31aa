"""The page on training data says what the schema says."""

from __future__ import annotations

import re
from pathlib import Path

from interplan_sumo.features import schema

PAGE = (Path(__file__).parents[2] / "docs" / "training_data.md").read_text(encoding="utf-8")


def test_the_tables_of_the_page_are_those_of_the_schema() -> None:
    (tables,) = re.findall(r"<!-- made from \S+ -->\n(.*?)<!-- end -->", PAGE, re.DOTALL)
    assert tables == schema.as_markdown(), "write schema.as_markdown() between the two comments of the page"


def test_the_page_counts_channels_right() -> None:
    assert len(schema.BY_NAME["lanes"].channels) == 11
    assert "That makes 11 channels" in " ".join(PAGE.split())
