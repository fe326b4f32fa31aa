"""When two spellings are the same word: case, spaces, hyphens and underscores do not matter."""

from __future__ import annotations

import re

_BETWEEN = re.compile(r"[\s_-]+")


def normal(text: str) -> str:
    """`text` in lower case with single spaces between its words."""
    return _BETWEEN.sub(" ", text.casefold()).strip()
