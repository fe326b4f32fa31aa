"""interPlan's configuration files: names and details, in one file, beside it, or somewhere in a folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from interplan_sumo.errors import InputError
from interplan_sumo.scenario.original_config import known_tokens, read_configuration

FILTER = """
_target_: some.Filter
defaults:
  - modifications: details
scenario_tokens:  # those of the paper
  - 71f182558ee95100-s0
  - 7000000000000000-dhgloa
  - 71f182558ee95100-s0
log_names: ['2021.05.25.12.30.39_veh-25_00321_01196']
num_scenarios_per_type: ${oc.select:nothing, 10}
"""
DETAILS = """
modification_details_dictionary:
  71f182558ee95100:
    goal: {left: null, right: "1.5, 2"}
  7000000000000000: {}
"""


def beside(folder: Path, name: str = "interplan10", text: str = FILTER) -> Path:
    """The files as interPlan has them."""
    (folder / "modifications").mkdir(parents=True, exist_ok=True)
    (folder / "modifications" / "details.yaml").write_text(DETAILS)
    file = folder / f"{name}.yaml"
    file.write_text(text)
    return file


def test_names_are_read_once_and_details_are_found_beside_the_file(tmp_path: Path) -> None:
    found = read_configuration(beside(tmp_path))
    assert found.names == ("71f182558ee95100-s0", "7000000000000000-dhgloa")
    assert found.details["71f182558ee95100"]["goal"] == {"left": "null", "right": "1.5, 2"}
    assert found.logs == {"2021.05.25.12.30.39_veh-25_00321_01196"}
    assert known_tokens(found.names) == ("71f182558ee95100", "7000000000000000")


def test_a_folder_means_its_only_filter_or_the_published_one(tmp_path: Path) -> None:
    file = beside(tmp_path / "deep" / "inside", "mine")
    assert read_configuration(tmp_path).names == read_configuration(file).names
    (file.parent / "other.yaml").write_text("scenario_tokens: [a]\n")
    with pytest.raises(InputError, match=r"expected one scenario filter, found deep/inside/mine.yaml, "):
        read_configuration(tmp_path)
    beside(file.parent, "interplan10", FILTER.replace("s0", "s5"))
    assert read_configuration(tmp_path).names[0] == "71f182558ee95100-s5"
    (file.parent / "broken.yaml").write_text("a: [")
    assert len(read_configuration(tmp_path).names) == 2


def test_names_and_details_may_stand_in_one_file(tmp_path: Path) -> None:
    file = tmp_path / "one.yaml"
    file.write_text("scenario_tokens: [71f182558ee95100-s0]\n" + DETAILS)
    assert set(read_configuration(file).details) == {"71f182558ee95100", "7000000000000000"}
    file.write_text("scenario_tokens: [71f182558ee95100-s0]\nmodifications:" + DETAILS.replace("\n", "\n  "))
    assert set(read_configuration(file).details) == {"71f182558ee95100", "7000000000000000"}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: [", "this is not YAML"),
        ("- 1", "scenario_tokens is no list of names"),
        ("scenario_tokens: []", "scenario_tokens is no list of names"),
        ("scenario_tokens: [[a]]", "scenario_tokens is no list of names"),
        ("scenario_tokens: [a-s0]", "no modification_details_dictionary in it, nor in"),
        ("a: &x [1]\nb: *x", "line 2: an alias, which no configuration of interPlan has"),
        ("[" * 60 + "]" * 60, "more than 50 levels"),
    ],
)
def test_files_that_cannot_be_used_are_one_line(text: str, said: str, tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    file.write_text(text)
    with pytest.raises(InputError) as error:
        read_configuration(file)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_missing_and_binary_files_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot read"):
        read_configuration(tmp_path / "nowhere.yaml")
    (tmp_path / "a.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="this is not YAML"):
        read_configuration(tmp_path / "a.yaml")
    with pytest.raises(InputError, match="expected one scenario filter, found none"):
        read_configuration(tmp_path)


def test_a_name_that_leads_out_of_the_folder_is_not_followed(tmp_path: Path) -> None:
    file = beside(tmp_path, text=FILTER.replace("modifications: details", "modifications: ../modifications/details"))
    with pytest.raises(InputError, match="no modification_details_dictionary"):
        read_configuration(file)
