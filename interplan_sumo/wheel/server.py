"""Server: the page at the wheel for one person on this machine, and nobody else.

It listens on the loopback only. Every address begins with a random token; whoever does not know it, or came by another
name of this machine (DNS rebinding), or from another page, is refused. What it reads is bounded.
"""

from __future__ import annotations

import re
import secrets
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Final

import msgspec

from interplan_sumo.errors import InputError, InterplanError
from interplan_sumo.wheel.cockpit import Cockpit, Hands

HOST: Final = "127.0.0.1"
MOST_BYTES: Final = 1000
"""Of what the page says at once."""
MOST_CONNECTIONS: Final = 32
SILENCE_S: Final = 1.0
"""After so long without an event a stream says that it is there; so a page that was closed is noticed."""
PATIENCE_S: Final = 20.0
"""For whoever says nothing, or reads nothing."""
_REPLAY: Final = re.compile(r"replay/([0-9]{1,6})")
HEADERS: Final = {
    "Cache-Control": "no-store",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}


class WheelServer(ThreadingHTTPServer):
    """Serves the page, the stream of events, and the replays of what was driven."""

    daemon_threads = True
    request_queue_size = MOST_CONNECTIONS

    def __init__(self, cockpit: Cockpit, page: str, replay: Callable[[int], str], port: int = 0) -> None:
        """`replay` makes the page of the n-th drive, InterplanError if there is none. OSError for a port in use."""
        self.cockpit = cockpit
        self.page = page
        self.replay = replay
        self.token = secrets.token_urlsafe(24)
        self._free = threading.BoundedSemaphore(MOST_CONNECTIONS)
        super().__init__((HOST, port), _Handler)

    @property
    def names(self) -> tuple[str, ...]:
        """By which a browser on this machine may call it."""
        return f"{HOST}:{self.server_port}", f"localhost:{self.server_port}"

    @property
    def address(self) -> str:
        return f"http://{self.names[0]}/{self.token}/"

    def rest(self) -> None:
        """Wait until an open page has been told the last, at most a second."""
        deadline_s = time.monotonic() + 1.0
        while self.cockpit.watched and time.monotonic() < deadline_s:
            time.sleep(0.02)

    def process_request(self, request: Any, client_address: Any) -> None:
        if self._free.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Whoever goes away in the middle of a sentence is no fault."""


@contextmanager
def served(cockpit: Cockpit, page: str, replay: Callable[[int], str], port: int) -> Generator[WheelServer]:
    """A server in threads of its own; InputError for a port that cannot be had."""
    try:
        server = WheelServer(cockpit, page, replay, port)
    except (OSError, OverflowError) as error:
        why = getattr(error, "strerror", None) or error
        raise InputError(f"cannot listen on port {port} of {HOST}: {why}; --port 0 takes a free one") from None
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        server.server_close()


class _Handler(BaseHTTPRequestHandler):
    server: WheelServer  # type: ignore[assignment]
    protocol_version = "HTTP/1.1"
    timeout = PATIENCE_S
    disable_nagle_algorithm = True

    def do_GET(self) -> None:
        place = self._place()
        if place == "":
            self._answer(self.server.page, "text/html; charset=utf-8")
        elif place == "events":
            self._stream()
        elif place is not None and (asked := _REPLAY.fullmatch(place)) is not None:
            try:
                self._answer(self.server.replay(int(asked[1])), "text/html; charset=utf-8")
            except InterplanError as error:
                self._refuse(HTTPStatus.NOT_FOUND, str(error))
        elif place is not None:
            self._refuse(HTTPStatus.NOT_FOUND, "there is no such page")

    def do_POST(self) -> None:
        place = self._place()
        if place is None:
            return
        size = self.headers.get("Content-Length", "")
        if place != "hands" or self.headers.get_content_type() != "application/json":
            self._refuse(HTTPStatus.NOT_FOUND, "there is no such page")
        elif not (size.isascii() and size.isdigit() and len(size) < 5 and int(size) <= MOST_BYTES):
            self._refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"at most {MOST_BYTES} bytes, and say how many")
        else:
            try:
                hands = msgspec.json.decode(self.rfile.read(int(size)), type=Hands)
            except (ValueError, RecursionError) as error:
                self._refuse(HTTPStatus.BAD_REQUEST, str(error))
                return
            self.server.cockpit.hold(hands)
            self._head(HTTPStatus.NO_CONTENT, {})

    def _place(self) -> str | None:
        """What is asked for, below the token; None for somebody who was refused."""
        fetched_by = self.headers.get("Sec-Fetch-Site", "same-origin")
        origin = self.headers.get("Origin")
        known = self.headers.get("Host") in self.server.names and fetched_by in ("same-origin", "none")
        known = known and (origin is None or origin.removeprefix("http://") in self.server.names)
        token, _, place = self.path.removeprefix("/").partition("/")
        if known and secrets.compare_digest(token.encode(), self.server.token.encode()):
            return place
        self._refuse(HTTPStatus.FORBIDDEN, "open the address that the command printed")
        return None

    def _stream(self) -> None:
        """Events as they come, until the page is closed or another one opened."""
        self.close_connection = True
        self._head(HTTPStatus.OK, {"Content-Type": "text/event-stream", "Connection": "close"}, length=None)
        cockpit = self.server.cockpit
        viewer, scene, seen = cockpit.watch(), 0, 0
        try:
            while (found := cockpit.events(viewer, scene, seen, SILENCE_S)) is not None:
                scene, seen, new = found
                self._write(b"".join(b"data: %b\n\n" % each for each in new) or b": still here\n\n")
            self._write(b'data: {"kind":"elsewhere"}\n\n')
        except OSError:
            pass
        finally:
            cockpit.unwatch(viewer)

    def _write(self, text: bytes) -> None:
        self.wfile.write(text)
        self.wfile.flush()

    def _answer(self, text: str, kind: str) -> None:
        body = text.encode()
        self._head(HTTPStatus.OK, {"Content-Type": kind}, length=len(body))
        self._write(body)

    def _refuse(self, status: HTTPStatus, why: str) -> None:
        body = f"{why}\n".encode()
        self.close_connection = True
        self._head(status, {"Content-Type": "text/plain; charset=utf-8", "Connection": "close"}, length=len(body))
        self._write(body)

    def _head(self, status: HTTPStatus, headers: dict[str, str], length: int | None = 0) -> None:
        self.send_response(status)
        for name, value in {**HEADERS, **headers}.items():
            self.send_header(name, value)
        if length is not None and status != HTTPStatus.NO_CONTENT:
            self.send_header("Content-Length", str(length))
        self.end_headers()

    def version_string(self) -> str:
        return "interplan-sumo"

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing: the terminal belongs to the command."""
