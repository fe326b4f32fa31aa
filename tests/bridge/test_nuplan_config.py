"""YAML files of constructor arguments: nuPlan's form, and nothing but classes of packages that are meant."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from textwrap import dedent

import pytest

from interplan_sumo.bridge.nuplan.config import arguments
from interplan_sumo.errors import PlannerLoadError

THIS = __name__
PLANNER = f"{THIS}.Planner"


class Sampling:
    def __init__(self, num_poses: int, interval_length: float = 0.1) -> None:
        if num_poses < 1:
            raise ValueError("num_poses must be positive")
        self.num_poses, self.interval_length = num_poses, interval_length


class Planner:
    """Only its name matters."""


def a_function() -> None:
    """No class."""


Write = Callable[[str], Path]


@pytest.fixture
def written(tmp_path: Path) -> Write:
    """Writes a file of arguments."""

    def write(text: str) -> Path:
        path = tmp_path / "planner.yaml"
        path.write_text(dedent(text))
        return path

    return write


def test_plain_arguments_are_themselves(written: Write) -> None:
    assert arguments(written("offsets: [-1.0, 1.0]\nradius: 50\nname: null"), PLANNER) == {
        "offsets": [-1.0, 1.0],
        "radius": 50,
        "name": None,
    }


@pytest.mark.parametrize(("text", "value"), [("1e-4", 1e-4), ("-2.5E+3", -2500.0), ("1.0e-4", 1e-4), ("1e", "1e")])
def test_numbers_are_those_that_hydra_reads(written: Write, text: str, value: object) -> None:
    assert arguments(written(f"a: {text}"), PLANNER) == {"a": value}


def test_nuplans_own_form_is_read_as_it_is(written: Write) -> None:
    path = written(f"""
        my_planner:
          _target_: {PLANNER}
          _convert_: 'all'
          sampling:
            _target_: {THIS}.Sampling
            _convert_: 'all'
            num_poses: 80
          lists: [{{_target_: {THIS}.Sampling, num_poses: 3}}]
    """)
    got = arguments(path, PLANNER)
    assert set(got) == {"sampling", "lists"}
    assert (got["sampling"].num_poses, got["sampling"].interval_length) == (80, 0.1)
    assert got["lists"][0].num_poses == 3


def test_the_target_of_the_planner_may_stand_at_the_top(written: Write) -> None:
    assert arguments(written(f"_target_: {PLANNER}\nradius: 50"), PLANNER) == {"radius": 50}


def test_a_single_argument_that_is_an_object_is_an_argument(written: Write) -> None:
    got = arguments(written(f"sampling: {{_target_: {THIS}.Sampling, num_poses: 3}}"), PLANNER)
    assert got["sampling"].num_poses == 3


def test_every_reading_makes_objects_of_its_own(written: Write) -> None:
    path = written(f"sampling: {{_target_: {THIS}.Sampling, num_poses: 3}}")
    assert arguments(path, PLANNER)["sampling"] is not arguments(path, PLANNER)["sampling"]


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("_target_: nuplan.other.Planner\nradius: 50", r"planner\.yaml: is for nuplan\.other\.Planner, not for"),
        ("a: {_target_: os.system, command: ls}", r"a: 'os\.system' is not a class of nuplan, tuplan_garage, "),
        ("a: {_target_: Sampling}", "'Sampling' is not a class of"),
        (f"a: {{_target_: {THIS}.a_function}}", "is not a class"),
        (f"a: {{_target_: {THIS}.Nothing}}", "cannot import"),
        (f"a: {{_target_: {THIS}.Sampling, num_poses: 0}}", "cannot be built: ValueError: num_poses must be positive"),
        (f"a: {{_target_: {THIS}.Sampling, poses: 1}}", "cannot be built: TypeError"),
        (f"a: {{_target_: {THIS}.Sampling, _args_: [1]}}", "'_args_' is no argument"),
        ("a: {b: ['${radius}']}", r"a\.b\[0\]: '\$\{radius\}' is an interpolation"),
        ("- 1\n- 2", "holds no mapping"),
        ("a: [", "is not YAML"),
        ("a: !!python/object/apply:os.getcwd []", "is not YAML"),
    ],
)
def test_what_is_wrong_with_a_file_is_said_in_one_line(written: Write, text: str, complaint: str) -> None:
    with pytest.raises(PlannerLoadError, match=complaint) as caught:
        arguments(written(text), PLANNER)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(PlannerLoadError, match=r"cannot read .*absent\.yaml: No such file"):
        arguments(tmp_path / "absent.yaml", PLANNER)
