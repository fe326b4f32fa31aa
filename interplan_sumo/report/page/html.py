"""HTML from templates: one file that asks for nothing from anywhere, in which whatever is shown is text."""

from __future__ import annotations

import hashlib
from base64 import b64encode
from functools import cache
from importlib.resources import files
from typing import Final, cast

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

COLOURS: Final = 12
"""Planners that page.css has a colour for; more than so many share them."""


def html(template: str, *, style: str, script: str, connects: bool = False, **fields: object) -> str:
    """A page of `templates/` with its style and script inside, and a policy that allows no others.

    Fields are escaped; what is a `Markup` goes in as it is. Only one that
    `connects` may ask, and nobody but the server that it came from.
    """
    policy = f"default-src 'none'; style-src '{_digest(style)}'; script-src '{_digest(script)}'; base-uri 'none'"
    if connects:
        policy += "; connect-src 'self'"
    parts = {"policy": Markup(policy), "style": Markup(style), "script": Markup(script)}
    return _templates().get_template(template).render(**parts, **fields)


def style_of(*names: str) -> str:
    """Style sheets of this package, one after the other."""
    return "".join(files(__package__ or "").joinpath(name).read_text(encoding="utf-8") for name in names)


@cache
def _templates() -> Environment:
    made = Environment(
        loader=PackageLoader(__package__ or ""),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    cast("dict[str, object]", made.globals)["COLOURS"] = COLOURS
    return made


def _digest(text: str) -> str:
    """A source of the content security policy that allows exactly this text."""
    return f"sha256-{b64encode(hashlib.sha256(text.encode()).digest()).decode()}"
