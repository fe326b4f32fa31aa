"""What a model does with examples it did not learn from: the loss of their tokens, and the choices it makes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from scipy.stats import binomtest
from torch import Tensor
from torch.nn import functional

from tools.tune_llm.chat import ChatTokens
from tools.tune_llm.examples import TokenSample, in_batches
from tools.tune_llm.model import TunedModel

BATCH = 16


@dataclass(frozen=True, slots=True)
class Ratio:
    """So many of so many."""

    count: int
    of: int

    @property
    def value(self) -> float:
        return self.count / self.of

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's 95 % interval of the share that a larger sample would have."""
        interval = binomtest(self.count, self.of).proportion_ci(method="wilson")
        return float(interval.low), float(interval.high)


@dataclass(frozen=True, slots=True)
class HeldOut:
    """A model on held-out examples."""

    loss: float
    """Mean over the tokens of the answers and of the ends of their turns, in nats."""
    agreement: Ratio | None
    """Where the choice is the right one; None without choices."""
    decisive: Ratio | None
    """The same where the other choices would have been worse; None where that is nowhere known."""


def judged(model: TunedModel, chat: ChatTokens, samples: Sequence[TokenSample]) -> HeldOut:
    """Loss over all samples, agreement over those with choices."""
    offered = [sample for sample in samples if sample.example.choices is not None]
    made = choices_made(model, chat, offered)
    right = [(choice == each.example.answer, each.example.decisive) for choice, each in zip(made, offered, strict=True)]
    return HeldOut(mean_loss(model, samples), *_shares(right))


def first_offered(samples: Sequence[TokenSample]) -> tuple[Ratio | None, Ratio | None]:
    """The agreement of whoever always takes the first option, everywhere and where it is decisive; None as above."""
    examples = [sample.example for sample in samples]
    return _shares([(each.answer == each.choices[0], each.decisive) for each in examples if each.choices])


def chance(samples: Sequence[TokenSample]) -> float | None:
    """The agreement that a fair die would have; None without choices."""
    shares = [1.0 / len(sample.example.choices) for sample in samples if sample.example.choices is not None]
    return sum(shares) / len(shares) if shares else None


def answer_losses(model: TunedModel, samples: Sequence[TokenSample]) -> Tensor:
    """The loss of each token of the answers of one batch, one after the other."""
    logits = model.logits([sample.read for sample in samples], [len(sample.answer) for sample in samples])
    targets = torch.tensor([token for sample in samples for token in sample.answer])
    return functional.cross_entropy(logits, targets, reduction="none")


@torch.no_grad()
def mean_loss(model: TunedModel, samples: Sequence[TokenSample]) -> float:
    """Over all tokens of all answers, in nats."""
    batches = ([samples[index] for index in batch] for batch in in_batches(samples, BATCH))
    return float(torch.cat([answer_losses(model, batch) for batch in batches]).double().mean())


@torch.no_grad()
def choices_made(model: TunedModel, chat: ChatTokens, samples: Sequence[TokenSample]) -> list[str]:
    """What the model chooses where a grammar of the choices holds it and it takes the likeliest token each time.

    A token is allowed that goes on with at least one choice, however it cuts
    it into pieces; the end of the turn where a choice is complete.
    """
    states = [_Choosing(sample, chat) for sample in samples]
    while waiting := [state for state in states if state.choice is None]:
        waiting.sort(key=lambda state: len(state.tokens))
        for at in range(0, len(waiting), BATCH):
            batch = waiting[at : at + BATCH]
            following = model.logits([each.tokens for each in batch], [1] * len(batch))
            for state, logits in zip(batch, following, strict=True):
                state.take(logits)
    return [state.choice or "" for state in states]


def _shares(right: Sequence[tuple[bool, bool]]) -> tuple[Ratio | None, Ratio | None]:
    """Of what is right, of all and of what is decisive; the latter only if some is and some is not."""
    decisive = [each for each, decides in right if decides]
    everywhere = Ratio(sum(each for each, _ in right), len(right)) if right else None
    return everywhere, Ratio(sum(decisive), len(decisive)) if 0 < len(decisive) < len(right) else None


class _Choosing:
    """A choice that is being written."""

    def __init__(self, sample: TokenSample, chat: ChatTokens) -> None:
        self.tokens = list(sample.prompt)
        self._chat = chat
        self._rests = {choice: chat.letters(choice) for choice in sample.example.choices or ()}
        self.choice: str | None = None
        self._settle()

    def take(self, logits: Tensor) -> None:
        """Write the likeliest token that is allowed."""
        allowed = self._allowed()
        best = max(allowed, key=lambda token: float(logits[token]))
        self.tokens.append(best)
        written = allowed[best]
        going_on = {choice: rest for choice, rest in self._rests.items() if rest.startswith(written)}
        self._rests = {choice: rest[len(written) :] for choice, rest in going_on.items()}
        if not written:
            self._rests = {choice: rest for choice, rest in self._rests.items() if not rest}
        self._settle()

    def _allowed(self) -> dict[int, str]:
        """Tokens that may come, with what they write."""
        beginnings = {rest[:length] for rest in self._rests.values() for length in range(1, len(rest) + 1)}
        numbers = self._chat.numbers
        allowed = {numbers[beginning]: beginning for beginning in sorted(beginnings) if beginning in numbers}
        return allowed | ({self._chat.end_of_turn: ""} if "" in self._rests.values() else {})

    def _settle(self) -> None:
        self.choice = next(iter(self._rests)) if len(self._rests) == 1 else None
