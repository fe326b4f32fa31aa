"""Several processes that learn from each batch together: everyone takes a part, and all follow the mean gradient."""

from __future__ import annotations

import mmap
import multiprocessing
import os
import signal
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from multiprocessing.connection import wait
from multiprocessing.process import BaseProcess
from threading import BrokenBarrierError, Thread

import torch
from torch import nn

from interplan_sumo.errors import InputError, InterplanError
from interplan_sumo.world.geometry import Ints


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
        self._meeting = multiprocessing.Barrier(size)
        shared = mmap.mmap(-1, 4 * size * sum(self._counts))
        self._gradients = torch.frombuffer(shared, dtype=torch.float32).view(size, -1)

    @contextmanager
    def together(self, work: Callable[[], None]) -> Generator[None]:
        """While the block runs the others do `work`. InterplanError if one of them ends before."""
        ranks = range(1, self.size)
        fork = multiprocessing.get_context("fork" if ranks else None)
        others = [fork.Process(target=self._follow, args=(work, rank), daemon=True) for rank in ranks]
        for other in others:
            other.start()
        Thread(target=self._abort_with, args=(others,), daemon=True).start()
        try:
            yield
        except BrokenBarrierError:
            raise InterplanError("a process of the training has ended; go on with --resume") from None
        finally:
            for other in others:
                other.terminate()
                other.join()

    def part(self, rows: Ints) -> Ints:
        """The rows of a batch that this process looks at."""
        return rows[self.rank :: self.size]

    def agree(self, share: float) -> None:
        """Make everybody's gradients those of the whole batch, of which this process has seen a share."""
        if self.size == 1:
            return
        for each, place in zip(self._parameters, self._gradients[self.rank].split(self._counts), strict=True):
            place.copy_(torch.zeros_like(place) if each.grad is None else share * each.grad.flatten())
        self._meeting.wait()
        mean = self._gradients.sum(dim=0)
        self._meeting.wait()
        for each, gradient in zip(self._parameters, mean.split(self._counts), strict=True):
            each.grad = gradient.view_as(each)

    def _follow(self, work: Callable[[], None], rank: int) -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        Thread(target=_end_with_parent, daemon=True).start()
        self.rank = rank
        work()

    def _abort_with(self, others: Sequence[BaseProcess]) -> None:
        """Let nobody wait for who has failed; who is done leaves, for the last steps are those of all."""
        while at_work := [other for other in others if other.exitcode is None]:
            wait([other.sentinel for other in at_work])
            if any(other.exitcode for other in others):
                self._meeting.abort()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
