"""One HTTP address that takes questions: its key, its limits, and what its failures are called."""

from __future__ import annotations

import json
import os
import re
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from ipaddress import ip_address
from typing import Any, TypeVar
from urllib.parse import urlsplit

from interplan_llm.models.protocol import MAX_TEXT_BYTES, Cause, ModelFailure
from interplan_sumo.errors import InputError, clean_line
from interplan_sumo.extras import library

KEY_VARIABLE = "INTERPLAN_LLM_KEY"
OPENAI_KEY_VARIABLE = "OPENAI_API_KEY"
"""Sent to OpenAI only: other servers must not learn it because it happens to be set."""

T = TypeVar("T")

_OPENAI_DOMAIN = "openai.com"
_DETAIL_CHARS = 200
"""As much of a server's own explanation as a message quotes."""


class HttpFailure(ModelFailure):
    """A refused or broken exchange. `retry_after_s` is what the server asked for, if it did."""

    def __init__(self, cause: Cause, message: str, *, status: int = 0, retry_after_s: float | None = None) -> None:
        super().__init__(cause, message)
        self.status = status
        self.retry_after_s = retry_after_s


@dataclass(frozen=True, slots=True)
class Address:
    """A checked base URL, such as `http://localhost:8000/v1`."""

    url: str
    host: str

    @property
    def loopback(self) -> bool:
        """Whether it leads to this machine, so that no proxy may be asked."""
        try:
            return ip_address(self.host).is_loopback
        except ValueError:
            return self.host == "localhost"

    @property
    def openai(self) -> bool:
        return self.url.startswith("https://") and f".{self.host}".endswith(f".{_OPENAI_DOMAIN}")


def address(url: str) -> Address:
    """InputError for what is not a plain http or https address; a URL with a password in it is not repeated."""
    way_out = "write for example http://localhost:8000/v1"
    try:
        parts = urlsplit(url)
        host, _ = parts.hostname, parts.port
    except ValueError as error:
        raise InputError(f"the model's URL cannot be read: {error}; {way_out}") from None
    if parts.username is not None or parts.password is not None:
        raise InputError(f"the model's URL holds a user name or password; set {KEY_VARIABLE} instead")
    if parts.query:
        raise InputError(f"the model's URL has a part after '?'; set a key as {KEY_VARIABLE}, and {way_out}")
    if parts.scheme not in ("http", "https") or not host or parts.fragment or not re.fullmatch(r"[\x21-\x7e]+", url):
        raise InputError(f"{url!r} is not the URL of a server; {way_out}")
    return Address(url.rstrip("/"), host)


def key_for(where: Address, environment: Mapping[str, str] | None = None) -> str | None:
    """The key in the environment that this address may see."""
    found = os.environ if environment is None else environment
    key = found.get(KEY_VARIABLE) or (found.get(OPENAI_KEY_VARIABLE) if where.openai else None)
    if key and not re.fullmatch(r"[\x21-\x7e]+", key):
        raise InputError(f"{KEY_VARIABLE} or {OPENAI_KEY_VARIABLE} holds characters that no key has")
    return key or None


def spelled(key: str) -> re.Pattern[str]:
    """A key, however JSON may spell it, also inside of JSON that is a text of JSON."""
    return re.compile("".join(_spelled(character) for character in key))


def _spelled(character: str) -> str:
    plain = rf"\\{{0,8}}{re.escape(character)}" if character in '"\\/' else re.escape(character)
    return rf"(?:{plain}|\\{{1,8}}u00(?i:{ord(character):02x}))"


class Endpoint:
    """Posts JSON to one address and reads JSON back: no redirects, no repeats, no more bytes than an answer needs."""

    def __init__(self, where: Address) -> None:
        """Reads the key; connects to nothing yet. InputError without the library."""
        self.where = where
        self._http = library("httpx2", f"the model at {where.url}", "llm")
        headers = {"Content-Type": "application/json", "Accept-Encoding": "identity", "User-Agent": "interplan-sumo"}
        key = key_for(where)
        if key is not None:
            headers["Authorization"] = f"Bearer {key}"
        self._secret = None if key is None else spelled(key)
        try:
            self._http.URL(where.url)
        except self._http.InvalidURL as error:
            raise InputError(f"{where.url!r} is not the URL of a server: {error}") from None
        self._client = self._http.Client(headers=headers, follow_redirects=False, trust_env=not where.loopback)

    def post(self, path: str, body: Mapping[str, Any], timeout_s: float) -> dict[str, Any]:
        """The JSON object that `path` answers to `body`; HttpFailure otherwise."""
        try:
            content = within(timeout_s, lambda: self._exchange(path, body, timeout_s))
        except (TimeoutError, self._http.TimeoutException):
            raise HttpFailure("timeout", f"no answer from {self.where.url} in {timeout_s:.3g} s") from None
        except self._http.RequestError as error:
            raise HttpFailure("connection", f"no connection to {self.where.url}: {self._told(str(error))}") from None
        try:
            value = json.loads(content.decode("utf-8-sig"))  # bytes may be of encodings in which no key is found
        except (ValueError, RecursionError):
            raise HttpFailure("parse", f"{self.where.url} answered something that is not JSON") from None
        if not isinstance(value, dict):
            raise HttpFailure("parse", f"{self.where.url} answered JSON that is not an object")
        return value

    def close(self) -> None:
        self._client.close()

    def _exchange(self, path: str, body: Mapping[str, Any], timeout_s: float) -> bytes:
        sent = json.dumps(body).encode()
        with self._client.stream("POST", self.where.url + path, content=sent, timeout=timeout_s) as response:
            content = self._read(response)
            if response.status_code == self._http.codes.OK:
                return content
            raise self._refusal(response, content)

    def _read(self, response: Any) -> bytes:
        """The body, without the key should the server repeat it; HttpFailure as soon as it is over the limit."""
        length = response.headers.get("Content-Length", "")
        parts: list[bytes] = []
        size = int(length) if re.fullmatch(r"\d{1,18}", length) else 0
        if size <= MAX_TEXT_BYTES:
            size = 0
            for part in response.iter_raw():
                parts.append(part)
                size += len(part)
                if size > MAX_TEXT_BYTES:
                    break
        if size > MAX_TEXT_BYTES and response.status_code == self._http.codes.OK:
            raise HttpFailure("too_long", f"{self.where.url} answered more than {MAX_TEXT_BYTES} bytes")
        content = b"".join(parts)
        if self._secret is None:
            return content
        return self._secret.sub("[key]", content.decode("latin-1")).encode("latin-1")

    def _refusal(self, response: Any, content: bytes) -> HttpFailure:
        status = int(response.status_code)
        if response.is_redirect:
            target = _host_of(response.headers.get("Location", ""))
            message = f"{self.where.url} redirects to {self._told(target)}; it is not followed, give that URL yourself"
            return HttpFailure("refused", message, status=status)
        message = f"{self.where.url} answered HTTP {status}{self._detail(content)}"
        cause: Cause = "rate_limit" if status == 429 else "server" if status >= 500 else "refused"
        return HttpFailure(cause, message, status=status, retry_after_s=_retry_after_s(response.headers))

    def _detail(self, content: bytes) -> str:
        """What an OpenAI-shaped error says, after a colon; empty if it says nothing."""
        try:
            told = json.loads(content.decode("utf-8-sig"))["error"]
            text = told if isinstance(told, str) else told["message"]
        except (ValueError, RecursionError, LookupError, TypeError):
            return ""
        return f": {self._told(text)}" if isinstance(text, str) else ""

    def _told(self, text: str) -> str:
        """Foreign text on one line that can be printed, shortened and without the key."""
        if self._secret is not None:
            text = self._secret.sub("[key]", text)
        return clean_line(text, _DETAIL_CHARS)


def within(seconds: float, work: Callable[[], T]) -> T:
    """What `work` returns or raises, or TimeoutError after `seconds`.

    Time limits of sockets hold for one read each and for no name lookup, so
    the work is done in a thread of its own. Late work is left behind in it: a
    daemon thread, which does not keep the process alive.
    """
    done: list[T] = []
    failed: list[BaseException] = []

    def run() -> None:
        try:
            done.append(work())
        except BaseException as error:
            failed.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(max(0.0, seconds))
    if done:
        return done[0]
    if failed:
        raise failed[0]
    raise TimeoutError


def _host_of(url: str) -> str:
    """Where a redirect leads, without a user's name."""
    try:
        return urlsplit(url).netloc.rpartition("@")[2] or "another path"
    except ValueError:
        return "an address that cannot be read"


def _retry_after_s(headers: Mapping[str, str]) -> float | None:
    """Seconds of a Retry-After header, given as seconds or as a date; None without one that can be read."""
    text = headers.get("Retry-After", "").strip()
    if re.fullmatch(r"\d{1,9}(\.\d+)?", text):
        return float(text)
    try:
        return max(0.0, (parsedate_to_datetime(text) - datetime.now(UTC)).total_seconds())
    except (ValueError, TypeError, OverflowError):
        return None
