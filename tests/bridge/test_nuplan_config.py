"""YAML files of constructor arguments: nuPlan's form, and nothing but classes of packages that are meant."""

from __future__ import annotations

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


def written(folder: Path, text: str) -> Path:
    path = folder / "planner.yaml"
    path.write_text(dedent(text))
    return path


@pytest.mark.parametrize(
    ("text", "made"),
    [
        ("offsets: [-1.0, 1.0]\nradius: 50\nname: null", {"offsets": [-1.0, 1.0], "radius": 50, "name": None}),
        (f"_target_: {PLANNER}\nradius: 50", {"radius": 50}),
        ("a: 1e-4\nb: -2.5E+3\nc: 1.0e-4\nd: 1e", {"a": 1e-4, "b": -2500.0, "c": 1e-4, "d": "1e"}),  # as hydra does
    ],
)
def test_plain_arguments_are_themselves(tmp_path: Path, text: str, made: dict[str, object]) -> None:
    assert arguments(written(tmp_path, text), PLANNER) == made


def test_a_single_argument_that_is_an_object_is_an_argument_and_made_at_every_reading(tmp_path: Path) -> None:
    path = written(tmp_path, f"sampling: {{_target_: {THIS}.Sampling, num_poses: 3}}")
    one, other = (arguments(path, PLANNER)["sampling"] for _ in range(2))
    assert one.num_poses == other.num_poses == 3
    assert one is not other


def test_nuplans_own_form_is_read_as_it_is(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        f"""
        my_planner:
          _target_: {PLANNER}
          _convert_: 'all'
          sampling:
            _target_: {THIS}.Sampling
            _convert_: 'all'
            num_poses: 80
          lists: [{{_target_: {THIS}.Sampling, num_poses: 3}}]
    """,
    )
    got = arguments(path, PLANNER)
    assert set(got) == {"sampling", "lists"}
    assert (got["sampling"].num_poses, got["sampling"].interval_length) == (80, 0.1)
    assert got["lists"][0].num_poses == 3


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("_target_: nuplan.other.Planner\nradius: 50", r"planner\.yaml: is for nuplan\.other\.Planner, not for"),
        ("a: {_target_: os.system, command: ls}", r"a: 'os\.system' is not a class of nuplan, tuplan_garage, "),
        ("a: {_target_: Sampling}", "'Sampling' is not a class of"),
        (f"a: {{_target_: {THIS}.dedent}}", "is not a class"),
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
def test_what_is_wrong_with_a_file_is_said_in_one_line(tmp_path: Path, text: str, complaint: str) -> None:
    with pytest.raises(PlannerLoadError, match=complaint) as caught:
        arguments(written(tmp_path, text), PLANNER)
    assert "\n" not in str(caught.value)
    with pytest.raises(PlannerLoadError, match=r"cannot read .*absent\.yaml: No such file"):
        arguments(tmp_path / "absent.yaml", PLANNER)
