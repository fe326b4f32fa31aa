"""A chat server on loopback that does what a test tells it: answer, be slow, refuse, break, ramble, echo."""

from __future__ import annotations

import json
import re
import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType
from typing import Any, Self

Body = dict[str, Any]
Act = Callable[["Exchange", Body], None]

USAGE = {"prompt_tokens": 300, "completion_tokens": 2, "prompt_tokens_details": {"cached_tokens": 0}}
PATIENCE_S = 5.0
"""No exchange lasts longer, so that no test can hang."""


class ChatServer:
    """Plays one act for each request, in turn; then answers `says`, held to what it understands.

    `understands` holds what real servers differ in: `structured_outputs`
    (vLLM), `grammar` (llama.cpp), `response_format` (OpenAI, Ollama),
    `logprobs`. Anything else is ignored, as most servers do, but for the
    fields in `refuses`, which are answered with HTTP 400.
    """

    def __init__(self, says: str = "follow", understands: tuple[str, ...] = (), refuses: tuple[str, ...] = ()) -> None:
        self.says = says
        self.understands = understands
        self.refuses = refuses
        self.acts: list[Act] = []
        self.bodies: list[Body] = []
        self.headers: list[dict[str, str]] = []
        self.bytes_sent = 0
        self.closing = threading.Event()
        self._http = ThreadingHTTPServer(("127.0.0.1", 0), Exchange)
        self._http.daemon_threads = True
        self._http.chat = self  # type: ignore[attr-defined]
        self._thread = threading.Thread(target=self._http.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True)

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self._http.server_address[1]}/v1"

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.closing.set()
        self._http.shutdown()
        self._http.server_close()
        self._thread.join()

    def answer(self, body: Body) -> str:
        """What a model that is held to something says."""
        if "structured_outputs" in self.understands and "structured_outputs" in body:
            return self._among(body["structured_outputs"]["choice"])
        if "grammar" in self.understands and "grammar" in body:
            return self._among(re.findall(r'"([^"]*)"', body["grammar"]))
        if "response_format" in self.understands and "response_format" in body:
            schema = body["response_format"]["json_schema"]["schema"]
            offered = schema["properties"].get("choice", {}).get("enum")
            return self.says if offered is None else json.dumps({"choice": self._among(offered)})
        return self.says

    def _among(self, offered: list[str]) -> str:
        return self.says if self.says in offered else offered[0]


class Exchange(BaseHTTPRequestHandler):
    """One request and what is done with it."""

    @property
    def chat(self) -> ChatServer:
        return self.server.chat  # type: ignore[attr-defined]

    def do_POST(self) -> None:
        body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        self.chat.bodies.append(body)
        self.chat.headers.append(dict(self.headers))
        act = self.chat.acts.pop(0) if self.chat.acts else usual
        try:
            act(self, body)
        except OSError:  # the client has left
            self.close_connection = True

    def send(self, content: bytes, status: int = 200, **headers: str) -> None:
        self.send_response(status)
        for name, value in {"Content-Length": str(len(content)), **headers}.items():
            self.send_header(name.replace("_", "-"), value)
        self.end_headers()
        self.wfile.write(content)

    def send_text(self, text: str, **more: Any) -> None:
        choice = {"index": 0, "message": {"role": "assistant", "content": text}, "finish_reason": "stop", **more}
        self.send(json.dumps({"choices": [choice], "usage": USAGE}).encode())

    def log_message(self, format: str, *args: Any) -> None:
        pass


def usual(exchange: Exchange, body: Body) -> None:
    refused = [name for name in exchange.chat.refuses if name in body]
    if refused:
        exchange.send(json.dumps({"error": {"message": f"{refused[0]} is not supported"}}).encode(), 400)
        return
    logprobs = {"content": []} if "logprobs" in exchange.chat.understands and body.get("logprobs") else None
    exchange.send_text(exchange.chat.answer(body), logprobs=logprobs)


def saying(text: str) -> Act:
    return lambda exchange, _: exchange.send_text(text)


def status(code: int, message: str = "no", **headers: str) -> Act:
    content = json.dumps({"error": {"message": message}}).encode()
    return lambda exchange, _: exchange.send(content, code, **headers)


def raw(content: bytes) -> Act:
    return lambda exchange, _: exchange.send(content)


def silent(exchange: Exchange, _: Body) -> None:
    exchange.chat.closing.wait(PATIENCE_S)
    exchange.close_connection = True


def dripping(exchange: Exchange, _body: Body) -> None:
    """A byte now and then, each in time for a limit that holds for one read."""
    exchange.send_response(200)
    exchange.end_headers()
    for _ in range(int(PATIENCE_S / 0.02)):
        if exchange.chat.closing.wait(0.02):
            return
        exchange.wfile.write(b" ")
        exchange.wfile.flush()


def endless(exchange: Exchange, _: Body) -> None:
    """No length told, and text until the client leaves."""
    exchange.send_response(200)
    exchange.end_headers()
    exchange.connection.settimeout(PATIENCE_S)
    while exchange.chat.bytes_sent < 1 << 30 and not exchange.chat.closing.is_set():
        exchange.wfile.write(b"x" * 10_000)
        exchange.chat.bytes_sent += 10_000


def hung_up(exchange: Exchange, _: Body) -> None:
    exchange.close_connection = True


def cut(exchange: Exchange, _: Body) -> None:
    exchange.send(b'{"choices"', Content_Length="1000")
    exchange.close_connection = True


def echoing_the_key(exchange: Exchange, _: Body) -> None:
    exchange.send_text(f"follow {exchange.headers.get('Authorization')}")
