"""From messages to tokens, exactly as llama.cpp does it: the file's chat template and its byte-pair encoding."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, cast

from jinja2 import TemplateError
from tokenizers import pre_tokenizers
from tokenizers.pre_tokenizers import ByteLevel, Digits
from transformers.models.auto.tokenization_auto import AutoTokenizer

from interplan_llm.models.protocol import Message
from interplan_sumo.errors import InputError
from tools.tune_llm.model import UNREADABLE, metadata

SPLITTINGS: Final[dict[str, Any]] = {
    "gpt-2": ByteLevel(add_prefix_space=False),
    "smollm": pre_tokenizers.Sequence([Digits(individual_digits=True), ByteLevel(add_prefix_space=False)]),
}
"""llama.cpp's names for ways of cutting text before merging."""


class ChatTokens:
    """Prompts and answers of a model as tokens."""

    def __init__(self, path: Path) -> None:
        """Of a GGUF file. InputError for files as in `metadata`, and for a way of splitting text unknown here."""
        fields = metadata(path)
        splitting = fields.get("tokenizer.ggml.pre", "default")
        if splitting not in SPLITTINGS:
            raise InputError(f"{path} splits text as {splitting!r}; known here: {', '.join(SPLITTINGS)}")
        try:
            read = AutoTokenizer.from_pretrained(path.parent, gguf_file=path.name, local_files_only=True)
            self._tokenizer = cast("Any", read)
            self.end_of_turn = int(fields["tokenizer.ggml.eos_token_id"])
            self._tokenizer.chat_template = fields["tokenizer.chat_template"]
            self._begin = [fields["tokenizer.ggml.bos_token_id"]] if fields.get("tokenizer.ggml.add_bos_token") else []
        except UNREADABLE as error:
            raise InputError(f"cannot read the tokenizer of {path}: {' '.join(str(error).split())}") from None
        self._tokenizer.backend_tokenizer.pre_tokenizer = SPLITTINGS[splitting]
        self.numbers: dict[str, int] = self._tokenizer.get_vocab()
        """The token that writes some bytes, in the letters of `letters`."""

    def prompt_text(self, messages: Sequence[Message]) -> str:
        """What the model reads before it answers. InputError if the template refuses the messages."""
        turns = [{"role": message.role, "content": message.text} for message in messages]
        try:
            return self._tokenizer.apply_chat_template(turns, tokenize=False, add_generation_prompt=True)
        except TemplateError as error:
            raise InputError(f"the model's chat template refuses these messages: {error}") from None

    def prompt(self, messages: Sequence[Message]) -> list[int]:
        """The tokens of the prompt; names of control tokens count as those, also in what people wrote."""
        text = self.prompt_text(messages)
        return [*self._begin, *self._tokenizer(text, add_special_tokens=False)["input_ids"]]

    def plain(self, text: str) -> list[int]:
        """Tokens of a text in which nothing is a control token, such as an answer."""
        return self._tokenizer(text, add_special_tokens=False, split_special_tokens=True)["input_ids"]

    def letters(self, text: str) -> str:
        """The letters that stand for the bytes of a text in the vocabulary, one for each."""
        pieces = ByteLevel(add_prefix_space=False, use_regex=False).pre_tokenize_str(text)
        return "".join(letters for letters, _ in pieces)
