"""Planner options: what stands behind the question mark of a planner, read and held against its constructor."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import is_dataclass
from math import isnan
from typing import Any, Literal, get_args, get_origin, get_type_hints

import msgspec
import yaml

from interplan_sumo.errors import PlannerLoadError, UnknownNameError


class OptionLoader(yaml.SafeLoader):
    """Plain YAML, but 1e-4 is a number, as people write it; YAML wants 1.0e-4."""


OptionLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?\d+(\.\d*)?[eE][-+]?\d+$"), list("-+0123456789")
)


def settings_class(make: Any) -> Callable[..., Any] | None:
    """The dataclass of a planner's options, if it keeps them in one."""
    settings = getattr(make, "Settings", None)
    return settings if is_dataclass(settings) and isinstance(settings, type) else None


def option_defaults(make: Any) -> dict[str, Any]:
    """The options of what makes a planner, and their defaults; None where there is none, or it is None."""
    return {p.name: None if p.default is p.empty else p.default for p in _parameters(make)[0]}


def options_of(name: str, make: Any, query: str) -> dict[str, Any]:
    """The options of `key=value&key=value` for what makes planner `name`.

    Values are YAML, an empty one an empty text; a text stays as it was written where the constructor says `str`.
    UnknownNameError or PlannerLoadError for what the constructor does not take, as far as its parameters and their
    annotations tell.
    """
    known, takes_others = _parameters(make)
    hints = _hints(make)
    found: dict[str, Any] = {}
    for pair in filter(None, query.split("&")):
        key, equals, value = pair.partition("=")
        if not equals:
            raise PlannerLoadError(f"option {pair!r} of planner {name!r} has no value; write {key}=VALUE")
        if not takes_others and key not in {p.name for p in known}:
            if not known:
                raise PlannerLoadError(f"planner {name!r} has no options; leave {pair!r} away")
            raise UnknownNameError(f"option of planner {name!r}", key, [p.name for p in known])
        if key in found:
            raise PlannerLoadError(f"planner {name!r} is given the option {key} twice; leave one of them away")
        found[key] = _value(f"option {key} of planner {name!r}", value, hints.get(key, Any))
    missing = [p.name for p in known if p.default is p.empty and p.name not in found]
    if missing:
        way = "&".join(f"{each}=VALUE" for each in missing)
        raise PlannerLoadError(f"planner {name!r} needs the option {missing[0]}; write {name}?{way}")
    return found


def _value(what: str, text: str, hint: Any) -> Any:
    """A value as its annotation wants it: read as YAML, or the text itself."""
    try:
        value = yaml.load(text, OptionLoader) if text else ""  # a safe loader
    except (ValueError, yaml.YAMLError):
        raise PlannerLoadError(f"{what} is {text!r}, which cannot be read; texts with signs need quotes") from None
    if isinstance(value, float) and isnan(value):
        raise PlannerLoadError(f"{what} is {text!r}, expected a number")
    problem = _problem(value, hint)
    if problem is None:
        return value
    if _problem(text, hint) is None:
        return text
    if get_origin(hint) is Literal:
        raise UnknownNameError(f"value of {what}", text, map(str, get_args(hint)))
    raise PlannerLoadError(f"{what} is {text!r}: {problem}")


def _problem(value: Any, hint: Any) -> str | None:
    """Why a value is none for an annotation; None where it is, or where only the planner can tell."""
    try:
        msgspec.convert(value, hint, dec_hook=_unchecked)
    except msgspec.ValidationError as error:
        said = str(error).replace("`", "")
        return said[0].lower() + said[1:].replace("$", "")
    except (TypeError, _UncheckedError):
        return None
    return None


class _UncheckedError(Exception):
    pass


def _unchecked(kind: type, value: Any) -> Any:
    raise _UncheckedError(kind, value)


def _parameters(make: Any) -> tuple[list[inspect.Parameter], bool]:
    """The parameters that may be options, and whether it takes others, too."""
    try:
        every = inspect.signature(settings_class(make) or make).parameters.values()
    except (TypeError, ValueError):
        return [], True
    plain = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    return [p for p in every if p.kind in plain], any(p.kind is p.VAR_KEYWORD for p in every)


def _hints(make: Any) -> dict[str, Any]:
    """The annotations of the parameters; none where they name what is not there."""
    kind = settings_class(make) or make
    with suppress(Exception):
        return get_type_hints(
            kind if is_dataclass(kind) or not isinstance(kind, type) else kind.__init__, include_extras=True
        )
    return {}
