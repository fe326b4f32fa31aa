"""Cockpit: all that a person and the drive know of each other: what is shown, and what the hands do."""

from __future__ import annotations

import signal
import threading
import time
from dataclasses import dataclass, field
from typing import Annotated, Any, Final, Literal

import msgspec
from msgspec import Meta, Struct

Share = Annotated[float, Meta(ge=-1.0, le=1.0)]
Act = Literal["start", "pause", "restart", "again", "next", "quit"]
MOST_ACTS: Final = 20
"""That wait to be looked at; whoever sends more is no person."""


class Hands(Struct, frozen=True, forbid_unknown_fields=True):
    """What a person holds at one moment, as the page says it."""

    number: Annotated[int, Meta(ge=0, lt=2**53)] = 0
    """Counts what the page has sent."""
    push: Share = 0.0
    """1 is full throttle, -1 the hardest braking, 0 keeps the speed."""
    turn: Share = 0.0
    """1 is as far left as is safe at this speed, -1 right."""
    act: Act | None = None


@dataclass
class Cockpit:
    """What goes out to the page and what comes in from it; any thread may use it.

    Events belong to a scene: a page that opens later, or again, is told all of the present one.
    """

    _changed: threading.Condition = field(default_factory=threading.Condition)
    _events: list[bytes] = field(default_factory=list[bytes])
    _scene: int = 0
    _viewer: int = 0
    _watched: bool = False
    _hands: Hands = field(default_factory=Hands)
    _acts: list[Act] = field(default_factory=list[Act])

    # --- the drive's side ---

    def show_scene(self, **scene: Any) -> None:
        """Begin a scene: what was told before is forgotten."""
        with self._changed:
            self._events.clear()
            self._acts.clear()
            self._scene += 1
        self.tell("scene", **scene)

    def tell(self, kind: str, **event: Any) -> None:
        """Show something."""
        text = msgspec.json.encode({"kind": kind, **event})
        with self._changed:
            self._events.append(text)
            self._changed.notify_all()

    @property
    def hands(self) -> Hands:
        """What is held now."""
        return self._hands

    @property
    def watched(self) -> bool:
        """Whether a page is open."""
        return self._watched

    def next_act(self, until_s: float | None = None) -> Act | None:
        """What the person wants done, in the order of its wishes; None where nothing came until then (monotonic)."""
        with self._changed:
            while not self._acts:
                left_s = None if until_s is None else until_s - time.monotonic()
                if left_s is not None and left_s <= 0.0:
                    return None
                self._changed.wait(0.5 if left_s is None else left_s)  # so that Ctrl-C is heard
                if left_s is None and not self._watched:
                    return None
            return self._acts.pop(0)

    def leave(self) -> None:
        """Have the drive end here without a row, as Ctrl-C ends it; call it from the main thread."""
        signal.raise_signal(signal.SIGINT)

    # --- the page's side ---

    def hold(self, hands: Hands) -> None:
        """Take over what the page says, unless it has said something newer."""
        with self._changed:
            if hands.act is not None and len(self._acts) < MOST_ACTS:
                self._acts.append(hands.act)
            if hands.number > self._hands.number:
                self._hands = hands
            self._changed.notify_all()

    def watch(self) -> int:
        """A page opens and shuts out one that was open before; the number by which it asks for events."""
        with self._changed:
            self._viewer += 1
            self._watched = True
            self._hands = Hands()
            self._changed.notify_all()
            return self._viewer

    def unwatch(self, viewer: int) -> None:
        """A page is closed."""
        with self._changed:
            if viewer == self._viewer:
                self._watched = False
                self._hands = Hands(self._hands.number)
                self._changed.notify_all()

    def events(self, viewer: int, scene: int, seen: int, wait_s: float) -> tuple[int, int, list[bytes]] | None:
        """The scene now, how many of its events are known then, and those that are new; None if another page is open.

        Waits until there is one, at most `wait_s`.
        """
        with self._changed:
            self._changed.wait_for(
                lambda: viewer != self._viewer or scene != self._scene or len(self._events) > seen, wait_s
            )
            if viewer != self._viewer:
                return None
            new = self._events[seen if scene == self._scene else 0 :]
            return self._scene, len(self._events), new
