"""The documentation does what it says: every block is run, every command is known, every link leads somewhere."""

from __future__ import annotations

import ast
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml
from docs_pages import Block, blocks_of, commands_of, drive_page, mentions_of

import interplan_sumo
from interplan_sumo.cli import command_line
from tests.quick import nightly
from tools.docs_site.links import without_outer_links

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
INDEX = ROOT / "docs" / "README.md"
RUNNING = [page for page in PAGES if any(block.runs for block in blocks_of(page))]
QUICK = [page for page in RUNNING if page.stem in ("language_models", "write_a_planner")]
"""Whose blocks run every time, but for those that are marked."""
OFTEN = ("python_api",)
"""Pages that every change must pass as wholes; the others take ten minutes, and few changes touch what they do."""

USAGE_ERROR: type[Exception] = next(kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "ClickException")

needs_bash = pytest.mark.skipif(shutil.which("bash") is None, reason="the pages' commands are for a POSIX shell")


def _name(page: Path) -> str:
    return str(page.relative_to(ROOT))


def problem_with(words: list[str]) -> str | None:
    """Why the command line would refuse these words; None if it takes them."""
    if words[:1] in (["--install-completion"], ["--show-completion"]):
        return None  # typer's own; parsed, they would be done
    command: Any = command_line()
    try:
        context = command.make_context("interplan-sumo", list(words), obj=[])
        while hasattr(context.command, "resolve_command"):
            name, command, rest = context.command.resolve_command(context, [*context._protected_args, *context.args])
            context = command.make_context(name, rest, parent=context)
    except typer.Exit:  # --help and --version
        return None
    except USAGE_ERROR as error:
        return str(error.format_message())  # type: ignore[attr-defined]
    return None


@pytest.mark.parametrize("page", PAGES, ids=_name)
def test_what_the_package_offers_is_imported_from_there(page: Path) -> None:
    found = re.findall(
        r"^from interplan_sumo\.[\w.]+ import ([\w, ]+)$", page.read_text(encoding="utf-8"), re.MULTILINE
    )
    assert not {name for names in found for name in names.split(", ")} & {*interplan_sumo.__all__}


# --- the reader of commands itself ---------------------------------------------------------------


@pytest.mark.parametrize(
    ("line", "problem"),
    [
        ("run --planner idm --suite smoke==1", None),
        ("scenarios list --suite smoke==1 --json", None),
        ("maps --help", None),
        ("run --plannr idm", "--plannr"),
        ("runn --planner idm", "runn"),
        ("scenarios lst", "lst"),
        ("run --seeds many", "--seeds"),
        ("scenarios export nudge/0", "FILE.yaml"),
    ],
)
def test_a_command_line_is_refused_as_the_program_would(line: str, problem: str | None) -> None:
    found = problem_with(line.split())
    assert found is None if problem is None else found is not None and problem in found


def test_listings_are_read_with_continuations_comments_and_several_commands_a_line(tmp_path: Path) -> None:
    (tmp_path / "page.md").write_text(
        "text: interplan-sumo run\n\n"
        "    interplan-sumo doctor     interplan-sumo maps list    # all is well\n"
        "    interplan-sumo run --planner idm \\\n        --seeds 2 | tail\n"
        "    other-program run\n\n"
        "```sh\ninterplan-sumo run --seeds N\n```\n```python\ninterplan-sumo no\n```\n"
    )
    assert commands_of(tmp_path / "page.md") == [
        (3, ["doctor"]),
        (3, ["maps", "list"]),
        (4, ["run", "--planner", "idm", "--seeds", "2"]),
        (9, ["run", "--seeds", "1"]),
    ]


def test_blocks_know_their_line_their_file_and_whether_they_are_slow(tmp_path: Path) -> None:
    (tmp_path / "page.md").write_text(
        "<!-- docs: slow -->\n```python\nx = 1\n```\n```python\n# mine.py\ny = 2\n```\n```xml\n<!-- cars.xml -->\n```\n"
        "<!-- docs: elsewhere -->\n```sh\ncurl http://localhost\n```\n"
    )
    slow, file, xml, elsewhere = blocks_of(tmp_path / "page.md")
    assert (elsewhere.slow, elsewhere.runs) == (False, False)
    assert (slow.line, slow.slow, slow.file, slow.runs) == (3, True, None, True)
    assert (file.line, file.slow, file.file, file.runs) == (6, False, "mine.py", True)
    assert (xml.file, xml.runs) == ("cars.xml", True)


# --- the pages -----------------------------------------------------------------------------------


@pytest.mark.parametrize("page", PAGES, ids=_name)
def test_every_command_of_a_page_is_one_that_the_program_takes(page: Path) -> None:
    problems = [
        f"{_name(page)}, line {line}: interplan-sumo {' '.join(words)}: {problem}"
        for line, words in commands_of(page)
        if (problem := problem_with(words)) is not None
    ]
    assert not problems, "\n".join(problems)


@pytest.mark.parametrize("page", PAGES, ids=_name)
def test_every_command_that_a_page_mentions_exists(page: Path) -> None:
    for words in mentions_of(page):
        problem = problem_with(words)
        assert problem is None or problem.startswith("Missing "), f"interplan-sumo {' '.join(words)}: {problem}"


@pytest.mark.parametrize("page", PAGES, ids=_name)
def test_every_python_block_of_a_page_compiles(page: Path) -> None:
    for block in blocks_of(page):
        if block.language == "python":
            compile("\n" * (block.line - 1) + block.text, _name(page), "exec")


def run_page(blocks: list[Block], folder: Path) -> None:
    done = drive_page([block for block in blocks if block.runs], folder)
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"


@pytest.mark.slow
@needs_bash
@pytest.mark.parametrize("page", QUICK, ids=_name)
def test_the_quick_part_of_a_page_does_what_it_says(page: Path, tmp_path: Path) -> None:
    run_page([block for block in blocks_of(page) if not block.slow], tmp_path)


@needs_bash
@pytest.mark.slow
@pytest.mark.parametrize(
    "page",
    [page if page.stem in OFTEN else nightly(page) for page in RUNNING],
    ids=_name,
)
def test_a_page_does_all_that_it_says(page: Path, tmp_path: Path) -> None:
    run_page(blocks_of(page), tmp_path)


@pytest.mark.parametrize("page", PAGES, ids=_name)
def test_every_link_of_a_page_leads_somewhere(page: Path) -> None:
    links = re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8"))
    missing = [
        link
        for link in links
        if not re.match(r"\w+:", link)
        and not link.startswith("#")
        and not (page.parent / link.partition("#")[0]).exists()
    ]
    assert not missing, f"{_name(page)} links to {missing}"


def test_the_index_names_every_page() -> None:
    text = INDEX.read_text(encoding="utf-8")
    assert [page.name for page in PAGES[1:] if page != INDEX and f"]({page.name})" not in text] == []


# --- the site ------------------------------------------------------------------------------------


def places(nav: Any) -> list[str]:
    """The pages of a navigation, in order."""
    if isinstance(nav, str):
        return [nav]
    return [page for part in (nav.values() if isinstance(nav, dict) else nav) for page in places(part)]


def test_the_site_has_every_page_once() -> None:
    held = sorted(path.relative_to(ROOT / "docs").as_posix() for path in (ROOT / "docs").rglob("*.md"))
    site = yaml.safe_load((ROOT / "mkdocs.yml").read_text())
    assert sorted(places(site["nav"])) == held


def test_links_out_of_the_pages_become_words_where_they_lead_to_something() -> None:
    page = (
        "see [the nets](../nets), [the score](../interplan_sumo/metrics/score.py#l1), [nothing](../nowhere), [a](b.md)"
    )
    assert without_outer_links(page, "maps.md") == "see the nets, the score, [nothing](../nowhere), [a](b.md)"
    assert without_outer_links("[up](../maps.md) [out](../../nets)", "reference/world.md") == "[up](../maps.md) out"


def test_the_reference_has_every_name_of_the_package_and_each_has_its_words() -> None:
    shown = [
        name
        for page in sorted((ROOT / "docs" / "reference").glob("*.md"))
        for name in re.findall(r"^::: (\S+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    ]
    assert set(interplan_sumo.__all__) <= {name.rpartition(".")[2] for name in shown}
    assert [name for name in shown if without_words(name)] == []


def without_words(name: str) -> list[str]:
    """Of a class or function, and of its public methods, those without a docstring."""
    module, _, own = name.rpartition(".")
    tree = ast.parse((ROOT / f"{module.replace('.', '/')}.py").read_text(encoding="utf-8"))
    (node,) = [each for each in tree.body if isinstance(each, (ast.ClassDef, ast.FunctionDef)) and each.name == own]
    parts = [each for each in node.body if isinstance(each, ast.FunctionDef)] if isinstance(node, ast.ClassDef) else []
    public = [each for each in parts if not each.name.startswith("_")]
    return [each.name for each in (node, *public) if not ast.get_docstring(each)]
