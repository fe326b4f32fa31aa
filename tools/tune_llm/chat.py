"""From messages to tokens, exactly as llama.cpp does it: the file's chat template and its byte-pair encoding."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

from jinja2 import TemplateError
from jinja2.sandbox import ImmutableSandboxedEnvironment

from interplan_llm.models.protocol import Message
from interplan_sumo.errors import InputError

SPLITTINGS = {"gpt-2": False, "smollm": True}
"""Ways of cutting text before merging that are known here, and whether each digit stands alone."""

_NORMAL, _BYTE = 1, 6
_WORDS = re.compile(
    r"'s|'t|'re|'ve|'m|'ll|'d| ?[A-Za-z]+| ?[0-9]+| ?[^\sA-Za-z0-9]+|\s+(?!\S)|\s+",
    re.ASCII,
)
"""GPT-2's words, for text whose characters beyond ASCII were replaced by ASCII ones of their class."""


@dataclass(frozen=True, slots=True)
class Vocabulary:
    """The tokens of a model and how text becomes them, as in the metadata of a GGUF file."""

    tokens: tuple[str, ...]
    """In the letters of byte-level encoding; those of control tokens as they are."""
    kinds: tuple[int, ...]
    """1 for normal tokens, 6 for single bytes; whatever else can be written into a prompt by its name."""
    merges: tuple[str, ...]
    """Pairs with a blank between, the most important first."""
    splitting: str
    template: str
    """Jinja, over `messages` and `add_generation_prompt`."""
    end_of_turn: int
    begin: int | None = None
    """A token before every prompt."""


class ChatTokens:
    """Prompts and answers of a model as tokens."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        """InputError for a way of splitting text that is unknown here."""
        if vocabulary.splitting not in SPLITTINGS:
            known = ", ".join(SPLITTINGS)
            raise InputError(f"the model splits text as {vocabulary.splitting!r}; known here: {known}")
        self.end_of_turn = vocabulary.end_of_turn
        self._begin = [] if vocabulary.begin is None else [vocabulary.begin]
        self._digits_alone = SPLITTINGS[vocabulary.splitting]
        self._number = {token: number for number, token in enumerate(vocabulary.tokens)}
        self._rank = {tuple(pair.split(" ", 1)): rank for rank, pair in enumerate(vocabulary.merges)}
        named = [
            token
            for token, kind in zip(vocabulary.tokens, vocabulary.kinds, strict=True)
            if kind not in (_NORMAL, _BYTE) and token
        ]
        self._special = re.compile("|".join(map(re.escape, sorted(named, key=len, reverse=True))) or r"(?!)")
        environment = ImmutableSandboxedEnvironment(trim_blocks=True, lstrip_blocks=True)
        self._template = environment.from_string(vocabulary.template, {"raise_exception": _refuse})
        self._merged = lru_cache(maxsize=50_000)(self._merge)
        self.numbers = _numbers(vocabulary)
        """The normal token that writes some bytes."""

    def prompt_text(self, messages: Sequence[Message]) -> str:
        """What the model reads before it answers. InputError if the template refuses the messages."""
        turns = [{"role": message.role, "content": message.text} for message in messages]
        try:
            return self._template.render(messages=turns, add_generation_prompt=True)
        except TemplateError as error:
            raise InputError(f"the model's chat template refuses these messages: {error}") from None

    def prompt(self, messages: Sequence[Message]) -> list[int]:
        """The tokens of the prompt; names of control tokens count as those, also in what people wrote."""
        text = self.prompt_text(messages)
        tokens, done = list(self._begin), 0
        for name in self._special.finditer(text):
            tokens += [*self.plain(text[done : name.start()]), self._number[name.group()]]
            done = name.end()
        return tokens + self.plain(text[done:])

    def plain(self, text: str) -> list[int]:
        """Tokens of a text in which nothing is a control token, such as an answer."""
        return [token for word in _words(text, digits_alone=self._digits_alone) for token in self._merged(word)]

    def _merge(self, word: str) -> tuple[int, ...]:
        """The tokens of a word: pairs are joined in the order of the merges."""
        parts = [_LETTERS[byte] for byte in word.encode("utf-8", "replace")]
        while len(parts) > 1:
            ranks = [self._rank.get(pair, len(self._rank)) for pair in pairwise(parts)]
            best = min(ranks)
            if best == len(self._rank):
                break
            at = ranks.index(best)
            parts[at : at + 2] = [parts[at] + parts[at + 1]]
        return tuple(
            self._number[letters]
            for part in parts
            for letters in ([part] if part in self._number else part)
            if letters in self._number
        )


def _words(text: str, *, digits_alone: bool) -> Iterator[str]:
    stand_in = "".join(map(_ascii_of_class, text))
    pieces = re.finditer(r"[0-9]|[^0-9]+", stand_in) if digits_alone else re.finditer(r"(?s).+", stand_in)
    for piece in pieces:
        for word in _WORDS.finditer(piece.group()):
            yield text[piece.start() + word.start() : piece.start() + word.end()]


def _ascii_of_class(letter: str) -> str:
    """An ASCII character that GPT-2's splitting treats alike: a letter, a number, a blank, or something else."""
    if letter.isascii():
        return letter
    match unicodedata.category(letter)[0]:
        case "L":
            return "a"
        case "N":
            return "0"
        case _:
            return "\t" if letter.isspace() else "!"


def _byte_letters() -> list[str]:
    """The letter that stands for each byte in byte-level vocabularies: printable ones for themselves."""
    printable = {*range(33, 127), *range(161, 173), *range(174, 256)}
    others = iter(range(256, 512))
    return [chr(byte) if byte in printable else chr(next(others)) for byte in range(256)]


_LETTERS = _byte_letters()
_BYTES = {letter: byte for byte, letter in enumerate(_LETTERS)}


def _numbers(vocabulary: Vocabulary) -> dict[bytes, int]:
    return {
        bytes(_BYTES[letter] for letter in token): number
        for number, (token, kind) in enumerate(zip(vocabulary.tokens, vocabulary.kinds, strict=True))
        if kind == _NORMAL and token and all(letter in _BYTES for letter in token)
    }


def _refuse(why: str) -> None:
    raise TemplateError(why)
