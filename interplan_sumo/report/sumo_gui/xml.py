"""SUMO's XML as text: tags, documents, configurations and colours."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from xml.sax.saxutils import quoteattr


def tag(name: str, inner: str | None = None, /, **attributes: object) -> str:
    """One element; `inner` is markup."""
    text = "".join(f" {key}={quoteattr(str(value))}" for key, value in attributes.items())
    return f"<{name}{text}/>" if inner is None else f"<{name}{text}>{inner}</{name}>"


def document(root: str, tags: Iterable[str]) -> str:
    """A file with one element a line."""
    return "\n".join(('<?xml version="1.0" encoding="UTF-8"?>', f"<{root}>", *tags, f"</{root}>", ""))


def configuration(options: Mapping[str, object]) -> str:
    """A configuration of SUMO; files are named relative to it."""
    return document("configuration", (f'    <{name} value="{value}"/>' for name, value in options.items()))


def colour(hexadecimal: str, opacity: float = 1.0) -> str:
    """`#rrggbb` as SUMO writes colours: red, green, blue and opacity, 0 to 255."""
    parts = [int(hexadecimal[i : i + 2], 16) for i in (1, 3, 5)]
    return ",".join(str(part) for part in (*parts, round(255 * opacity)))
