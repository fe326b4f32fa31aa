"""Visitors of the page at the wheel: without a browser, over HTTP, as anybody on this machine could be."""

from __future__ import annotations

import json
from collections.abc import Generator, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from http.client import HTTPConnection
from typing import Any

from interplan_sumo.wheel.server import WheelServer


@dataclass(frozen=True)
class Answer:
    """What a server said."""

    status: int
    headers: dict[str, str]
    text: str


def asked(server: WheelServer, place: str, body: bytes | None = None, **headers: str) -> Answer:
    """The answer to a GET, or the POST of a body; names of headers with `_` for `-`."""
    with closing(HTTPConnection("127.0.0.1", server.server_port, timeout=10.0)) as connection:
        connection.request(
            "GET" if body is None else "POST",
            place,
            body,
            {name.replace("_", "-"): value for name, value in headers.items()},
        )
        with connection.getresponse() as answer:
            told = {name.lower(): value for name, value in answer.getheaders()}
            ends = told.get("content-type") != "text/event-stream"
            return Answer(answer.status, told, answer.read().decode() if ends else "")


def hold(server: WheelServer, **hands: Any) -> int:
    """Say what the hands do, as the page does; the status."""
    body = json.dumps(hands).encode()
    place = f"/{server.token}/hands"
    return asked(server, place, body, Content_Type="application/json").status


@contextmanager
def events(server: WheelServer) -> Generator[Iterator[dict[str, Any]]]:
    """What the page is told."""
    with closing(HTTPConnection("127.0.0.1", server.server_port, timeout=10.0)) as connection:
        connection.request("GET", f"/{server.token}/events")
        with connection.getresponse() as answer:
            assert answer.status == 200
            yield (json.loads(line[6:]) for line in answer if line.startswith(b"data: "))
