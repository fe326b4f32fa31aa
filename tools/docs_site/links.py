"""Links: what the pages say of files of the repository, on a site that has the pages only.

A hook of mkdocs. Links out of docs/ become the names of what they lead to, if that is there; else they stay, and the
strict build refuses them.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
_LINK = re.compile(r"\[([^\]]*)\]\((\.\./[^)#\s]+)(#[^)\s]*)?\)")


def on_page_markdown(markdown: str, page: Any, **_: object) -> str:
    """The text of a page as the site has it."""
    return without_outer_links(markdown, page.file.src_uri)


def without_outer_links(markdown: str, page: str) -> str:
    """Links of a page (its place below docs/) to files outside docs/ as plain words."""

    def replaced(link: re.Match[str]) -> str:
        text, target = link[1], link[2]
        place = posixpath.normpath(posixpath.join("docs", posixpath.dirname(page), target))
        return text if not place.startswith("docs/") and (ROOT / place).exists() else link[0]

    return _LINK.sub(replaced, markdown)
