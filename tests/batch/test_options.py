"""Run options: declared once, checked where they are made, and the same for commands, API and environments."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from interplan_sumo.batch.options import RunOptions, settings_of
from interplan_sumo.batch.records import MOST_SEEDS
from interplan_sumo.errors import InputError, UnknownNameError


@pytest.mark.parametrize(
    ("pairs", "words"),
    [
        (["density"], "has no value"),
        (["density="], "has no value"),
        (["densty=high"], "Did you mean 'density'"),
        (["density=low", "density=high"], "twice"),
    ],
)
def test_a_setting_that_cannot_be_is_refused_with_the_way_out(pairs: list[str], words: str) -> None:
    with pytest.raises(InputError, match=words):
        settings_of(pairs)


def test_settings_are_options_by_name() -> None:
    assert settings_of(["density=high", "behaviour=mixed", "density=high"]) == {"density": "high", "behaviour": "mixed"}


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"seeds": 0}, "seeds is 0, expected 1 or more"),
        ({"seeds": MOST_SEEDS + 1}, f"expected at most {MOST_SEEDS}"),
        ({"seeds": "3"}, "seeds is '3', expected int"),
        ({"seeds": True}, "seeds is True, expected int"),
        ({"limit": 0}, "limit is 0, expected 1 or more"),
        ({"workers": -1}, r"workers is -1, expected 0 \(in this process\) or more"),
        ({"workers": "many"}, "'many' is no number of processes"),
        ({"plan_limit_s": -1.0}, "plan_limit_s is -1.0, expected 0 or more"),
        ({"memory_gb": "much"}, "memory_gb is 'much'"),
        ({"perception": "foggy"}, "no perception named 'foggy'. It is full, or some of occluded, noisy, late"),
        ({"density": "hihg"}, "Did you mean 'high'"),
        ({"behaviour": "mixed", "traffic": "my.xml"}, "give only one"),
        ({"scenarios": (3,)}, "scenarios is"),
    ],
)
def test_a_value_that_cannot_be_is_refused_where_the_options_are_made(given: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        RunOptions(**given)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "edge", [{"seeds": 1}, {"seeds": MOST_SEEDS}, {"limit": 1}, {"workers": 0}, {"plan_limit_s": 0}]
)
def test_the_edge_of_what_may_be_is_taken(edge: dict[str, Any]) -> None:
    assert RunOptions(**edge).seeds >= 1


@pytest.mark.parametrize(("memory_gb", "bytes"), [(0.0, None), ("inf", None), (1e300, None), (0.5, 2**29)])
def test_no_memory_is_too_much(memory_gb: Any, bytes: int | None) -> None:
    assert RunOptions(memory_gb=memory_gb).limits.memory_bytes == bytes


def test_perceptions_that_mean_the_same_are_one() -> None:
    assert RunOptions(perception="late+occluded").overrides == RunOptions(perception="occluded+late").overrides


def test_one_text_or_path_is_taken_where_several_may_be() -> None:
    options = RunOptions("idm", "runs/a", scenarios=Path("mine.yaml"))  # type: ignore[arg-type]
    assert (options.planners, options.out, options.scenarios) == (("idm",), Path("runs/a"), ("mine.yaml",))


def test_an_option_that_is_none_is_named_with_a_guess() -> None:
    with pytest.raises(UnknownNameError, match=r"no option named 'densty'\. Did you mean 'density'"):
        RunOptions.of({"densty": "high"})
    with pytest.raises(UnknownNameError, match="no option named 'workers'"):
        RunOptions.of({"workers": 1}, names=("seeds",))


def test_no_limit_is_zero() -> None:
    limits = RunOptions(plan_limit_s=0, job_limit_s=0, memory_gb=0).limits
    assert (limits.plan_s, limits.task_s, limits.memory_bytes) == (float("inf"), float("inf"), None)
    assert RunOptions(memory_gb=2).limits.memory_bytes == 2 << 30


@pytest.mark.parametrize(
    ("given", "processes", "isolated"),
    [
        ({"workers": 2}, 2, True),
        ({"workers": "ray"}, 0, True),
        ({"workers": 0}, 0, False),
        ({"in_process": True}, 0, False),
        ({"in_process": True, "workers": 2}, 2, False),
    ],
)
def test_planners_have_their_own_process_unless_they_share_ours(
    given: dict[str, Any], processes: int, isolated: bool
) -> None:
    options = RunOptions(**given)
    assert (options.who.processes, options.isolated) == (processes, isolated)
