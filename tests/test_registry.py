"""What packages add by entry point: found by name, imported when asked for, said in one line when it does not work."""

from __future__ import annotations

from importlib.metadata import EntryPoint, EntryPoints

import pytest

from interplan_sumo import registry
from interplan_sumo.errors import InputError, UnknownNameError
from interplan_sumo.registry import Registry

NUMBER = 3


def things(monkeypatch: pytest.MonkeyPatch, **values: str) -> Registry[int]:
    points = EntryPoints([EntryPoint(name, value, "test.things") for name, value in values.items()])
    monkeypatch.setattr(registry, "entry_points", lambda group: points.select(group=group))
    return Registry("test.things", "thing", int)


def test_a_name_gives_what_its_entry_point_names(monkeypatch: pytest.MonkeyPatch) -> None:
    found = things(monkeypatch, three=f"{__name__}:NUMBER")
    assert found["three"] == 3
    assert "three" in found
    assert "four" not in found


def test_names_are_listed_in_order_and_nothing_is_imported_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    assert list(things(monkeypatch, b="no.such.module:X", a="no.such.module:Y")) == ["a", "b"]


def test_an_unknown_name_gets_the_nearest_one(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UnknownNameError, match=r"no thing named 'tree'\. Did you mean 'three'"):
        things(monkeypatch, three=f"{__name__}:NUMBER")["tree"]


def test_what_cannot_be_imported_is_said_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=r"thing 'a' of .* cannot be imported: ModuleNotFoundError: .*no_such"):
        things(monkeypatch, a="no_such:X")["a"]


def test_a_thing_of_another_kind_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=r"thing 'a' of .* is a str, expected a int"):
        things(monkeypatch, a=f"{__name__}:__name__")["a"]


def test_a_name_that_two_packages_claim_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    points = EntryPoints([EntryPoint("a", value, "test.things") for value in ("one:X", "two:X")])
    monkeypatch.setattr(registry, "entry_points", lambda group: points.select(group=group))
    with pytest.raises(InputError, match="thing name 'a' is claimed by one:X and by two:X; uninstall one"):
        list(Registry("test.things", "thing"))
