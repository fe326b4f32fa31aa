"""Every error a user can meet.

InterplanError
├── InputError             what the user gave cannot be used (exit code 2)
│   ├── UnknownNameError       no map, scenario, suite, planner or option of that name
│   ├── MapError               a map or network file is missing, damaged or inconsistent
│   ├── ScenarioError          a scenario that cannot be staged
│   ├── VehicleTypeError       a vehicle-type file that cannot be used
│   ├── PlannerLoadError       a planner that cannot be imported or built
│   └── RunFolderError         a run folder that holds something else, or is in use
├── PlannerError           a planner raised, timed out or returned nonsense (fault class "planner")
└── TrafficError           SUMO refused a command or gave up (fault class "traffic")

Anything else that escapes is a fault of ours and keeps its traceback.
"""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from functools import cache
from pathlib import PurePath
from sysconfig import get_path
from traceback import StackSummary, walk_tb

MOST_CHARACTERS = 500
"""Of a message that somebody else wrote."""
MOST_PLACES = 3
"""Lines of somebody's code that a message names."""


def clean_line(text: str, most: int = MOST_CHARACTERS) -> str:
    """Text of others as one line that can be stored and printed: no control characters, no lone surrogates."""
    line = " ".join(text[: 4 * most].split())
    shown = "".join(each if each.isprintable() else each.encode("unicode_escape").decode() for each in line[:most])
    return shown if len(line) <= most and len(shown) <= most and len(text) <= 4 * most else f"{shown[: most - 3]}..."


def counted(number: int, what: str) -> str:
    """So many things in words: `no problems`, `1 scenario`, `2 scenarios`."""
    return f"{number or 'no'} {what}{'s' * (number != 1)}"


def text_of(error: BaseException) -> str:
    """What an exception says, whoever made it."""
    try:
        return str(error)
    except BaseException:
        return "an error without a text"


def told(error: BaseException) -> str:
    """What an exception of somebody's own code says, and the lines of that code which it went through."""
    text = text_of(error)
    return f"{type(error).__name__}{': ' if text else ''}{text}{_places(error)}"


def _places(error: BaseException) -> str:
    """The last lines outside of libraries and of this package; of libraries if there are no others."""
    every = StackSummary.extract(walk_tb(error.__traceback__), lookup_lines=False)
    made = ("<frozen", "<string>")  # of importlib, of dataclasses: no lines that anybody wrote
    frames = [frame for frame in every if not frame.filename.startswith(made)]
    own = [frame for frame in frames if not frame.filename.startswith(_libraries())][-MOST_PLACES:]
    if not own and not isinstance(error, (SyntaxError, ImportError)):  # who raises these is nobody's own code
        own = frames[-1:]
    places = [f"{PurePath(frame.filename).name}:{frame.lineno} in {frame.name}" for frame in own]
    return f" ({', '.join(places)})" if places else ""


@cache
def _libraries() -> tuple[str, ...]:
    places = (get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib"))
    return tuple({*(f"{place}/" for place in places), f"{PurePath(__file__).parent}/"})


class InterplanError(Exception):
    """Base of all errors that carry a message for the user."""


class InputError(InterplanError):
    """What the user gave cannot be used; the message says what, where, and the way out."""


class UnknownNameError(InputError):
    """No thing of this name; the message suggests the nearest known one."""

    def __init__(self, what: str, name: str, known: Iterable[str], hint: str = "") -> None:
        names = sorted(set(known))
        near = get_close_matches(name, names, n=1)
        if near:
            guess = f" Did you mean {near[0]!r}?"
        elif names:
            guess = f" Known: {', '.join(names[:20])}{', ...' if len(names) > 20 else ''}."
        else:
            guess = ""
        super().__init__(f"no {what} named {name!r}.{guess}{' ' + hint if hint else ''}")
        self.what = what
        self.name = name


def check_names(what: str, given: Iterable[str], known: Iterable[str]) -> None:
    """UnknownNameError for the first of the given names that is not known."""
    names = set(known)
    for name in given:
        if name not in names:
            raise UnknownNameError(what, name, names)


class MapError(InputError):
    """A map or network file is missing, damaged or inconsistent; names the layer and id where it can."""


class ScenarioError(InputError):
    """A scenario that cannot be staged; names the scenario and the field."""


class VehicleTypeError(InputError):
    """A vehicle-type file that cannot be used; names the file and the line."""


class PlannerLoadError(InputError):
    """A planner that cannot be imported or built from the given name and options."""


class ProcessRefusedError(InputError):
    """The machine starts no further process now, for want of memory, processes or files: no planner's fault."""


class PlannerChangedError(InputError):
    """A planner was edited while it drove: nobody knows which of its versions a row would be of."""


class RunFolderError(InputError):
    """A run folder that holds another benchmark, or that another run is using."""


class PlannerError(InterplanError):
    """A planner raised, timed out or returned a plan that cannot be followed."""


class PlannerOverdueError(PlannerError):
    """A call of a planner took longer than it may."""


class TrafficError(InterplanError):
    """SUMO refused a command or gave up; names the command and the simulated time."""
