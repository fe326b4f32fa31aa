"""One text that names a model, short enough for a command line and safe inside a planner's options.

| text | model |
|---|---|
| `embedded` | the default GGUF file, in this process |
| `embedded:PATH` | any GGUF file |
| `embedded+tuned:NAME` | the default one with an adapter that comes with the package: `hybrid`, `waypoints` |
| `embedded[:PATH]+lora:PATH[@SCALE]` | either with LoRA adapters, of scale 1 if none is given |
| `http[s]://HOST[:PORT]/v1#MODEL` | a model of an OpenAI-compatible server |
| `replay:FILE[#MODEL]` | the answers that a file holds, of the one model in it or of the one named |
| `scripted:TEXT[,TEXT...]` | these texts in turn |

In paths, texts and names of models `%XX` stands for a character, as in a URL:
`%26` for `&`, `%20` for a blank, `%23` for `#`, `%40` for `@`, `%25` for `%`.
"""

from __future__ import annotations

import os
import re
from importlib.resources import files
from pathlib import Path
from urllib.parse import unquote

from interplan_llm.models.chat_url import ChatUrl
from interplan_llm.models.embedded import Adapter, EmbeddedModel
from interplan_llm.models.fetch import default_model
from interplan_llm.models.protocol import LanguageModel
from interplan_llm.models.scripted import always
from interplan_llm.models.store import MODES, AnswerStore, Mode, StoredModel
from interplan_sumo.errors import InputError, UnknownNameError, clean_line

KINDS = ("embedded", "http", "https", "replay", "scripted")

ADAPTERS = ("hybrid", "waypoints")
"""Those that come with the package: the default model tuned for one planner each, as its card beside it tells."""

_SCALED = re.compile(r"(?P<path>.*)@(?P<scale>[+-]?\d+(\.\d+)?)")


def open_model(spec: str, *, store: str | Path | None = None, mode: Mode = "record", threads: int = 1) -> LanguageModel:
    """The model that `spec` names, ready to be asked; InputError if it names none or it cannot run.

    With `store`, its answers are kept in that file, or come from it: see
    `Mode`; all but `record` need one. In mode `replay` the model itself is
    never opened. `threads` is for the embedded model.
    """
    if mode not in MODES:
        raise UnknownNameError("mode of a store", mode, MODES)
    if store == "":
        raise InputError("store is empty; name the file of the answers, or leave store away")
    file = None if store is None else Path(store).expanduser()
    kind, _, rest = spec.partition(":")
    if kind == "replay":
        if file is not None:
            raise InputError(f"{spec}: a replay needs no store beside the file that it names")
        if mode == "refresh":
            raise InputError(f"{spec}: a replay asks nobody anew; name a model, with this file as store")
        recorded, _, name = rest.partition("#")
        return _replay(_path(recorded, spec), unquote(name))
    if file is None:
        if mode != "record":
            raise InputError(f"{spec}: mode {mode} needs the file of the answers; name it as store")
        return _opened(spec, threads)
    if mode == "replay":
        return _replay(file, _recorded_name(spec))
    model = _opened(spec, threads)
    return StoredModel(model.name, AnswerStore(file), mode, model)


def _opened(spec: str, threads: int) -> LanguageModel:
    kind = re.split(r"[:+]", spec, maxsplit=1)[0]
    match kind:
        case "embedded":
            return _embedded(spec, threads)
        case "http" | "https":
            return _chat_url(spec)
        case "scripted":
            return _scripted(spec)
        case _:
            way_out = "Write for example embedded or http://HOST:PORT/v1#MODEL"
            raise UnknownNameError("kind of language model", kind, KINDS, way_out)


def _embedded(spec: str, threads: int) -> LanguageModel:
    base, *adapters = spec.split("+lora:")
    base, tuned, name = base.partition("+tuned:")
    kind, colon, file = base.partition(":")
    if kind != "embedded" or (tuned and colon):
        raise InputError(f"{spec}: write embedded, embedded+tuned:NAME or embedded:PATH, and +lora:PATH behind it")
    shipped = [Adapter(adapter_file(name))] if tuned else []
    path = _path(file, spec) if colon else default_model()
    return EmbeddedModel(path, [*shipped, *(_adapter(text, spec) for text in adapters)], threads=threads)


def adapter_file(name: str) -> Path:
    """The GGUF file of an adapter. UnknownNameError for a name that is none, InputError if the file is not there."""
    if name not in ADAPTERS:
        raise UnknownNameError("tuned adapter", name, ADAPTERS, "Write for example embedded+tuned:hybrid")
    path = Path(os.fspath(files("interplan_llm"))) / "adapters" / f"{name}.gguf"  # type: ignore[arg-type]
    if not path.is_file():
        raise InputError(
            f"this installation holds no tuned adapter {name!r} ({path}); "
            f"make one, see docs/language_models.md, and name it: embedded+lora:FILE"
        )
    return path


def _adapter(text: str, spec: str) -> Adapter:
    scaled = _SCALED.fullmatch(text)
    if scaled is None:
        return Adapter(_path(text, spec))
    return Adapter(_path(scaled["path"], spec), float(scaled["scale"]))


def _scripted(spec: str) -> LanguageModel:
    texts = spec.partition(":")[2]
    if not texts:
        raise InputError(f"{spec}: a text to say is missing; write for example scripted:follow")
    return always(*map(unquote, texts.split(",")))


def _chat_url(spec: str) -> LanguageModel:
    url, _, model = spec.partition("#")
    return ChatUrl(url, unquote(model))


def _replay(file: Path, wanted: str) -> LanguageModel:
    """The answers of the model in a file that is called as wanted, or else of the only one whose name begins so."""
    if not file.is_file():
        raise InputError(f"there are no recorded answers at {file}")
    answers = AnswerStore(file)
    names = [name for name in answers.models if name == wanted] or [
        name for name in answers.models if name.startswith(wanted)
    ]
    if len(names) == 1:
        return StoredModel(names[0], answers, "replay")
    if not names:
        raise InputError(f"{file} holds no answers of {wanted or 'any model'}; it holds: {_listed(answers.models)}")
    raise InputError(f"{file} holds answers of several models; name one as replay:{file}#MODEL: {_listed(names)}")


def _recorded_name(spec: str) -> str:
    """How the name of a model begins under which its answers are kept, as far as it is known without opening it."""
    if spec.startswith("embedded"):
        return "embedded:"
    if spec.startswith("scripted:"):
        return unquote(spec)
    url, hash_, model = spec.partition("#")
    return f"{url.rstrip('/')}#{unquote(model)}" if hash_ else spec


def _path(text: str, spec: str) -> Path:
    if not text:
        raise InputError(f"{spec}: a path is missing")
    return Path(unquote(text)).expanduser()


def _listed(names: tuple[str, ...] | list[str]) -> str:
    return ", ".join(map(clean_line, names)) or "none"
