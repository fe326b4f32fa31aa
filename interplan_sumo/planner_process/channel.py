"""Channel: the benchmark's end of the pipes to a planner: bounded messages, within limits, whatever comes.

Nothing of what a planner does blocks longer than the limit or takes more memory than the largest message: writes and
reads never block, lengths are believed only up to a bound, and what it prints is read and forgotten but for the end.
"""

from __future__ import annotations

import os
import select
from collections.abc import Callable
from contextlib import suppress
from typing import Final

from interplan_sumo.planner_process.awake import AwakeClock

LENGTH_BYTES: Final = 4
"""Before each msgpack message, unsigned and little-endian."""
KEPT_BYTES: Final = 8000
"""Of what a planner prints."""
_SLICE_MS: Final = 20
_CHUNK: Final = 1 << 16
_MOST_CHUNKS: Final = 32
_TOLD: Final = 60


CLOSED: Final = "closed its end of the channel"


class ChannelError(Exception):
    """What the planner did to the channel, as a clause without a subject."""


class Overdue(ChannelError):  # noqa: N818 (it is late, not wrong)
    """It did not answer in time."""


class PlannerChannel:
    """Both pipes, and the one that the planner prints to. The descriptors are its own from then on."""

    def __init__(self, requests: int, replies: int, printed: int, is_alive: Callable[[], bool]) -> None:
        self._requests, self._replies, self._output = requests, replies, printed
        self._is_alive = is_alive
        self._buffer = bytearray()
        self._printed = bytearray()
        self._open = True
        for descriptor in (requests, replies, printed):
            os.set_blocking(descriptor, False)
        self._reading, self._writing = select.poll(), select.poll()
        self._writing.register(requests, select.POLLOUT)
        for poll in (self._reading, self._writing):
            poll.register(replies, select.POLLIN)
            poll.register(printed, select.POLLIN)

    @property
    def printed(self) -> str:
        """The end of what the planner printed."""
        if self._open:
            for _ in range(_MOST_CHUNKS):
                if not self._take_printed():
                    break
        return self._printed.decode(errors="replace")

    def close(self) -> None:
        if self._open:
            _ = self.printed
            self._open = False
            for descriptor in (self._requests, self._replies, self._output):
                with suppress(OSError):
                    os.close(descriptor)

    def send(self, message: bytes, limit_s: float) -> None:
        """Hand bytes over; ChannelError if the planner does not take them, or spoke without being asked."""
        if self._buffer or self._spoke():
            raise ChannelError(f"wrote to the channel without having been asked: {_shown(bytes(self._buffer))}")
        left = memoryview(message)
        clock: AwakeClock | None = None
        while True:
            try:
                left = left[os.write(self._requests, left) :]
            except BlockingIOError:
                pass
            except OSError:
                raise ChannelError(CLOSED) from None
            if not left:
                return
            clock = clock or AwakeClock()
            self._wait_to_write(clock, limit_s)

    def receive(self, most_bytes: int, limit_s: float) -> bytes:
        """The next message with its length before it; ChannelError if there is none within the limits."""
        clock = AwakeClock()
        while len(self._buffer) < LENGTH_BYTES:
            self._read(clock, limit_s)
        length = int.from_bytes(self._buffer[:LENGTH_BYTES], "little")
        if length > most_bytes:
            raise ChannelError(f"announced a message of {length} bytes, at most {most_bytes} may come")
        end = LENGTH_BYTES + length
        while len(self._buffer) < end:
            self._read(clock, limit_s)
        return self._taken(LENGTH_BYTES, end, end)

    def receive_line(self, most_bytes: int, limit_s: float) -> bytes:
        """The next line without its end; ChannelError as `receive`."""
        clock = AwakeClock()
        searched = 0
        while (end := self._buffer.find(b"\n", searched)) < 0:
            searched = len(self._buffer)
            if searched > most_bytes:
                raise ChannelError(f"wrote a line of more than {most_bytes} bytes")
            self._read(clock, limit_s)
        if end > most_bytes:
            raise ChannelError(f"wrote a line of {end} bytes, at most {most_bytes} may come")
        return self._taken(0, end, end + 1)

    def _taken(self, begin: int, end: int, used: int) -> bytes:
        taken = bytes(self._buffer[begin:end])
        del self._buffer[:used]
        return taken

    def _spoke(self) -> bool:
        """Whether there is anything to read though nothing was asked; the first of it is then in the buffer."""
        for descriptor, _ in self._reading.poll(0):
            if descriptor == self._replies:
                self._take_reply(_TOLD)
                return True
            self._take_printed()
        return False

    def _read(self, clock: AwakeClock, limit_s: float) -> None:
        """Take what comes next into the buffer, or wait for it a moment."""
        for descriptor, _ in self._reading.poll(_SLICE_MS):
            if descriptor == self._replies:
                self._take_reply(_CHUNK)
            else:
                self._take_printed()
        self._check(clock, limit_s)

    def _wait_to_write(self, clock: AwakeClock, limit_s: float) -> None:
        """Wait a moment for room in the pipe, reading what is printed meanwhile."""
        for descriptor, _ in self._writing.poll(_SLICE_MS):
            if descriptor == self._replies:
                self._take_reply(_TOLD)
                raise ChannelError("answered before it had read what it was asked")
            if descriptor == self._output:
                self._take_printed()
        self._check(clock, limit_s)

    def _check(self, clock: AwakeClock, limit_s: float) -> None:
        if clock.now_s() > limit_s:
            raise Overdue(f"took longer than {limit_s:g} s")
        if not self._buffer and not self._is_alive() and not self._reading.poll(0):
            raise ChannelError(CLOSED)  # though a child of it holds the other end

    def _take_reply(self, most_bytes: int) -> None:
        try:
            came = os.read(self._replies, most_bytes)
        except BlockingIOError:
            return
        except OSError:
            came = b""
        if not came:
            raise ChannelError(CLOSED)
        self._buffer += came

    def _take_printed(self) -> bool:
        """Read some of what was printed; False if there is no more now."""
        try:
            came = os.read(self._output, _CHUNK)
        except OSError:
            return False
        if not came:
            for poll in (self._reading, self._writing):
                with suppress(KeyError):
                    poll.unregister(self._output)
            return False
        self._printed += came
        del self._printed[:-KEPT_BYTES]
        return True


def _shown(data: bytes) -> str:
    return repr(data[:_TOLD])
