"""Several processes that learn from each batch together: everyone takes a part, and all follow the mean gradient."""

from __future__ import annotations

import mmap
import multiprocessing
import signal
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from multiprocessing.context import ForkContext
from typing import Final

import torch
from torch import Tensor, nn

from interplan_sumo.errors import InputError, InterplanError
from interplan_sumo.world.geometry import Ints

_SLOTS: Final = 2
"""Gradients are written in turn here and there: who is a step ahead still leaves the last ones as they were."""
_SIGN: Final = b"."


class Crew:
    """Where the processes meet, as one of them sees it; `rank` 0 is the one that was there before.

    The others are copies of it: they have the same model, draw the same batches and
    take the same steps. They differ in the rows of a batch they look at, and in what they draw for these.
    """

    def __init__(self, model: nn.Module, size: int) -> None:
        """InputError where there cannot be so many."""
        if size < 1:
            raise InputError(f"processes is {size}, expected 1 or more")
        if size > 1 and "fork" not in multiprocessing.get_all_start_methods():
            raise InputError("a training has one process on this system; leave --processes away")
        self.size = size
        self.rank = 0
        self._parameters = list(model.parameters())
        self._counts = [each.numel() for each in self._parameters]
        shared = mmap.mmap(-1, 4 * _SLOTS * size * sum(self._counts))
        self._slots: tuple[Tensor, ...] = torch.frombuffer(shared, dtype=torch.float32).view(_SLOTS, size, -1).unbind()
        self._steps = 0
        self._others: list[Connection] = []
        """Ours of the lines to the others; to the first alone, of one of them."""

    @contextmanager
    def together(self, work: Callable[[], None]) -> Generator[None]:
        """While the block runs the others do `work`. InterplanError if one of them ends while it is waited for."""
        processes: list[multiprocessing.process.BaseProcess] = []
        try:
            for rank in range(1, self.size):
                processes.append(self._begun(multiprocessing.get_context("fork"), work, rank))
            yield
        except (EOFError, ConnectionError):
            raise InterplanError("a process of the training has ended; go on with --resume") from None
        finally:
            for line in self._others:
                line.close()
            for process in processes:
                process.terminate()
                process.join()

    def part(self, rows: Ints) -> Ints:
        """The rows of a batch that this process looks at."""
        return rows[self.rank :: self.size]

    def agree(self, share: float) -> None:
        """Make everybody's gradients the mean of those of the parts; `share` is that of this process of the batch.

        That is the gradient of the whole batch where a loss is a mean over its rows. Where it is one over what is
        known of them, rows weigh more in a part of which less is known.
        """
        if self.size == 1:
            return
        slot = self._slots[self._steps % _SLOTS]
        self._steps += 1
        for each, place in zip(self._parameters, slot[self.rank].split(self._counts), strict=True):
            place.copy_(torch.zeros_like(place) if each.grad is None else share * each.grad.flatten())
        if self.rank:
            self._others[0].send_bytes(_SIGN)
            self._others[0].recv_bytes()
        else:
            for line in self._others:
                line.recv_bytes()
            for line in self._others:
                line.send_bytes(_SIGN)
        mean = slot.sum(dim=0)
        for each, gradient in zip(self._parameters, mean.split(self._counts), strict=True):
            each.grad = gradient.view_as(each)

    def _begun(self, fork: ForkContext, work: Callable[[], None], rank: int) -> multiprocessing.process.BaseProcess:
        ours, theirs = fork.Pipe()
        self._others.append(ours)
        process = fork.Process(target=self._follow, args=(work, rank, theirs), daemon=True)
        process.start()
        theirs.close()  # so that the line ends with the process: nobody else has that end of it
        return process

    def _follow(self, work: Callable[[], None], rank: int, first: Connection) -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        for line in self._others:
            line.close()  # nor that of the first process
        self.rank, self._others = rank, [first]
        try:
            work()
        except (EOFError, ConnectionError):
            sys.exit(1)  # the first has ended
