"""Bundles: an honest one comes again and tells nothing it should not; whatever was done to one is one clear line."""

from __future__ import annotations

import hashlib
import random
import shutil
import struct
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from interplan_sumo.batch import bundle_zip
from interplan_sumo.batch.bundle import PlannerCard, open_bundle, public, read_card
from interplan_sumo.batch.bundle_zip import write_zip
from interplan_sumo.batch.judge import Judgement, judge
from interplan_sumo.batch.judged import Judged, read_judged
from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.run import run
from interplan_sumo.batch.run_folder import StoredRun, read_run
from interplan_sumo.batch.submit import submit
from interplan_sumo.batch.verified import verified_rows
from interplan_sumo.errors import InputError, RunFolderError, UnknownNameError
from interplan_sumo.report.leaderboard import Entry, make_leaderboard, ranked
from interplan_sumo.report.leaderboard_formats import leaderboard_json, leaderboard_page
from interplan_sumo.scenario.files import write_scenarios
from interplan_sumo.world.plans import PLAN_COLUMNS
from tests.batch.busy import PLAIN
from tests.commands import ran
from tests.records import asked, hashes, manifest, row

SCENES = tuple(replace(PLAIN, id=f"mine/{number}", duration_s=1.5) for number in range(2))
RAISES = "tests.batch.rude_planners:Raises"
HOSTILE = '<script>alert(1)</script>" onload="x [link=file:///]y'
Contents = dict[str, bytes]


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`run`, with two planners, and `bundle.zip` of one of them. Not to be changed."""
    place = tmp_path_factory.mktemp("home")
    write_scenarios(SCENES, place / "mine.yaml")
    run(RunOptions(("straight_ahead", RAISES), place / "run", scenarios=(str(place / "mine.yaml"),), workers=0))
    submit(read_run(place / "run"), place / "bundle.zip", "straight_ahead")
    return place


def judged(home: Path, bundle: Path, out: Path) -> Judgement:
    return judge(bundle, out, RunOptions(scenarios=(str(home / "mine.yaml"),), workers=0))


def contents(bundle: Path) -> Contents:
    with zipfile.ZipFile(bundle) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def forged(home: Path, place: Path, change: Callable[[Contents], object], *, hashes_too: bool = True) -> Path:
    """The bundle with something in it changed, and bundle.json made to agree."""
    held = contents(home / "bundle.zip")
    change(held)
    if hashes_too and "bundle.json" in held:
        about = msgspec.json.decode(held["bundle.json"])
        about["files"] = {name: hashlib.sha256(held[name]).hexdigest() for name in held if name != "bundle.json"}
        held["bundle.json"] = msgspec.json.encode(about) + b"\n"
    write_zip(place / "forged.zip", held.items())
    return place / "forged.zip"


def of_rows(change: Callable[[dict[str, Any]], object], scene: str = "mine/1") -> Callable[[Contents], None]:
    def changed(held: Contents) -> None:
        rows = [msgspec.json.decode(line) for line in held["results.jsonl"].splitlines()]
        for each in rows:
            if each["scenario_id"] == scene:
                change(each)
        held["results.jsonl"] = b"".join(msgspec.json.encode(each) + b"\n" for each in rows)

    return changed


def of_manifest(change: Callable[[dict[str, Any]], object]) -> Callable[[Contents], None]:
    def changed(held: Contents) -> None:
        document = msgspec.json.decode(held["manifest.json"])
        change(document)
        held["manifest.json"] = msgspec.json.encode(document) + b"\n"

    return changed


def plan_file(held: Contents) -> str:
    return next(name for name in sorted(held, reverse=True) if name.startswith("plans/"))


def steered(held: Contents) -> None:
    columns = np.frombuffer(held[plan_file(held)], "<f8").reshape(len(PLAN_COLUMNS), -1).copy()
    columns[3] += 0.02 * (columns[0] == 4)
    held[plan_file(held)] = columns.tobytes()


def better_at_something(row: dict[str, Any]) -> None:
    next(each for name, each in row["metrics"].items() if name in row["weights"]).update(score=0.123)


# --- what is handed in ---


def test_the_same_run_gives_the_same_bytes_without_folders_code_or_prints(home: Path, tmp_path: Path) -> None:
    shutil.copytree(home / "run", tmp_path / "elsewhere" / "run")
    made = submit(read_run(tmp_path / "elsewhere" / "run"), tmp_path / "again.zip", "straight_ahead")
    assert made.path.read_bytes() == (home / "bundle.zip").read_bytes()
    held = contents(made.path)
    assert sum(name.startswith("plans/") for name in held) == made.drives == 2
    for content in held.values():
        assert str(home).encode() not in content
    assert held.keys() - {name for name in held if name.startswith("plans/")} == {
        "bundle.json", "manifest.json", "results.jsonl",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("exec:/home/me/bin/drive --fast", "exec:drive --fast"),
        ("mine.planner:Best?weights=/data/w/best.pt&k=3", "mine.planner:Best?weights=best.pt&k=3"),
        ("raised OSError: '/home/me/x y/map' is gone", "raised OSError: 'x y/map' is gone"),
        (r"C:\Users\me\drive.exe and ~me/x/y", "drive.exe and y"),
        ("nudge/0 at https://there.org/a/b, 3/4", "nudge/0 at https://there.org/a/b, 3/4"),
    ],
)
def test_folders_of_absolute_paths_are_nobodys_business(text: str, told: str) -> None:
    assert public(text) == told


def test_several_planners_must_be_told_apart(home: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds 2 planners; name the one to hand in with --planner"):
        submit(read_run(home / "run"), tmp_path / "b.zip")
    with pytest.raises(UnknownNameError, match="no planner in"):
        submit(read_run(home / "run"), tmp_path / "b.zip", "idm")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"overrides": {"density": "high"}}, "was driven with density=high; hand in a suite as it is"),
        ({"profile": "mine@123456789012"}, "by a profile of your own"),
        ({"suite_hash": "0"}, "suite smoke==1 has changed since it was driven"),
        ({}, "have no score"),
    ],
)
def test_a_part_or_a_changed_suite_is_no_result(changes: dict[str, Any], words: str, tmp_path: Path) -> None:
    from interplan_sumo.batch.records import AppliedOverrides
    from interplan_sumo.scenario.suite import find_suite

    if "overrides" in changes:
        changes = {"overrides": AppliedOverrides(**changes["overrides"])}
    told = manifest(asked("idm", "nudge/0"), **({"suite_hash": find_suite("smoke==1").hash()} | changes))
    with pytest.raises(InputError, match=words):
        submit(StoredRun(tmp_path, told, {("nudge/0", "idm", 0): row("nudge/0")}), tmp_path / "b.zip")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("link: javascript:alert(1)", "its link is none that begins with http"),
        ('link: https://x.org/"onclick=', "its link is none"),
        ('name: "a\\x1b[2Jb"', "its name holds characters that are not printed"),
        ("notes: " + "x" * 301, "notes"),
        ("nmae: x", "nmae"),
        ("- a", "its fields are name, authors"),
        ("a: [", "its fields are"),
    ],
)
def test_what_is_no_card_is_one_line(text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "card.yaml").write_text(text)
    with pytest.raises(InputError, match=words) as told:
        read_card(tmp_path / "card.yaml")
    assert "\n" not in str(told.value)


# --- an honest one ---


def test_an_honest_bundle_comes_again_without_its_planner(home: Path, tmp_path: Path) -> None:
    card = PlannerCard(name="gone.away:Planner", authors=HOSTILE, link="https://example.org/a?b=1", data="none")
    submit(read_run(home / "run"), tmp_path / "b.zip", "straight_ahead", card)
    made = judged(home, tmp_path / "b.zip", tmp_path / "judged")
    assert (made.judged.equal, made.judged.drives, made.judged.others) == (2, 2, ())
    stored = made.found.run
    whole = {key[0]: value for key, value in hashes(read_run(home / "run")).items() if key[1] == "straight_ahead"}
    assert {key[0]: value for key, value in hashes(stored).items()} == whole
    assert {key[1] for key in verified_rows(stored)} == {"gone.away:Planner"}
    assert read_judged(stored.path).card == card
    before = (stored.path / "results.jsonl").read_bytes()
    assert judged(home, tmp_path / "b.zip", tmp_path / "judged").judged.equal == 2
    assert (stored.path / "results.jsonl").read_bytes() == before


def test_a_planner_that_failed_keeps_its_zero(home: Path, tmp_path: Path) -> None:
    submit(read_run(home / "run"), tmp_path / "b.zip", RAISES)
    made = judged(home, tmp_path / "b.zip", tmp_path)
    assert (made.judged.equal, made.judged.drives) == (2, 2)
    ended = [(each.score, each.fault and each.fault.kind) for each in made.found.run.rows.values()]
    assert ended == [(0.0, "planner")] * 2


def test_the_best_come_first_by_the_rare_scenes_whatever_they_do_in_ordinary_driving() -> None:
    def entry(planner: str, score: float, family: str = "nudge") -> Entry:
        rows = [row(f"{family}/{n}", score, planner=planner) for n in range(2)]
        held = StoredRun(
            Path(f"{planner}-{family}"), manifest(asked(planner, "a/0")), {each.key: each for each in rows}
        )
        return Entry(held, Judged(PlannerCard(name=planner), "", "", "", "", None, None, 2, 2, (), {}))

    a, b, c = entry("a", 0.3), entry("b", 0.6), entry("c", 0.95, "changing_lane")
    ordinary = entry("a", 0.9, "changing_lane")
    assert ranked([ordinary, a, c, b]) == [b, ordinary, a, c]


def test_how_often_a_drive_was_begun_is_judged_with_it(home: Path, tmp_path: Path) -> None:
    bundle = forged(home, tmp_path, of_rows(lambda row: row.update(tries=3)))
    rows = judged(home, bundle, tmp_path / "judged").found.run.rows
    assert [(each.scenario_id, each.tries) for each in rows.values()] == [("mine/0", 1), ("mine/1", 3)]


@pytest.mark.slow
def test_the_leaderboard_is_of_what_was_judged_and_shows_names_as_text(
    home: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    card = PlannerCard(name=HOSTILE, authors=HOSTILE, link="https://example.org/&x")
    submit(read_run(home / "run"), tmp_path / "a.zip", "straight_ahead", card)
    submit(read_run(home / "run"), tmp_path / "b.zip", RAISES)
    command = ("judge", tmp_path / "a.zip", tmp_path / "b.zip", tmp_path / "none.zip", "--out", tmp_path / "judged")
    code, _, err = ran(capsys, *command, "--scenarios", home / "mine.yaml", "--workers", 0, "--quiet")
    assert (code, "refused: cannot read" in err) == (2, True)
    board = make_leaderboard([tmp_path / "judged"])
    rows = leaderboard_json(board)["rows"]
    assert [each["planner"] for each in rows] == [HOSTILE, RAISES]
    assert [(each["verified"], each["bundles"][0]["equal"]) for each in rows] == [(2, 2), (2, 2)]
    assert rows[0]["bundles"][0]["card"]["authors"] == HOSTILE
    page = leaderboard_page(board)
    assert "alert(1)" in page
    assert "<script>alert" not in page
    assert 'onload="x' not in page
    assert 'href="https://example.org/&amp;x"' in page
    code, out, _ = ran(capsys, "leaderboard", tmp_path / "judged", "--html", tmp_path / "page.html")
    assert (code, "2 of 2" in out, "[link=" in out) == (0, True, True)
    assert (tmp_path / "page.html").read_text() == leaderboard_page(board, tmp_path / "page.html")
    with pytest.raises(RunFolderError, match="no judged bundle in"):
        make_leaderboard([home / "run"])
    with pytest.raises(RunFolderError, match=r"no judged bundle in .*run; .* or leave it out"):
        make_leaderboard([tmp_path / "judged", home / "run"])


# --- lies: they are found by driving ---


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (of_rows(lambda row: row.update(score=0.25)), "the same drive, but its score was 0.25"),
        (of_rows(lambda row: row.update(trace_hash="0" * 64)), "another drive than that of its hash"),
        (steered, "another drive than that of its hash"),
        (of_rows(better_at_something), "the same drive and score, but its metric"),
        (lambda held: held.update({plan_file(held): b""}), "now it ends in a planner fault"),
        (
            of_rows(lambda row: row.update(score=0.0, fault={"class": "planner", "message": "late"}, trace_hash=None)),
            "another drive than until its fault",
        ),
    ],
)
def test_lies_do_not_come_again(change: Callable[[Contents], None], words: str, home: Path, tmp_path: Path) -> None:
    made = judged(home, forged(home, tmp_path, change), tmp_path / "judged")
    (other,) = made.judged.others
    assert (made.judged.equal, other.scenario_id) == (1, "mine/1")
    assert words in other.reason
    assert made.found.run.rows["mine/1", "straight_ahead", 0].score != 0.25
    assert len(verified_rows(made.found.run)) == 1


# --- what is refused before anything is driven ---


def as_the_other_scene(held: Contents) -> None:
    held["results.jsonl"] = held["results.jsonl"].replace(b"mine/1", b"mine/0")


def without_a_drive(held: Contents) -> None:
    of_manifest(lambda told: told["requests"][0].update(scenarios=["mine/0"]))(held)
    del held[plan_file(held)]
    held["results.jsonl"] = held["results.jsonl"].splitlines(keepends=True)[0]


def with_seeds(held: Contents) -> None:
    of_manifest(lambda told: told["requests"][0].update(seeds=21))(held)
    held["results.jsonl"] *= 21


REFUSED: dict[str, tuple[Callable[[Contents], object], str]] = {
    "a plan is missing": (lambda held: held.pop(plan_file(held)), r"plans/mine_1-.*f64 is missing"),
    "no rows": (lambda held: held.pop("results.jsonl"), r"results\.jsonl is missing"),
    "no manifest": (lambda held: held.pop("manifest.json"), r"manifest\.json is missing"),
    "no bundle.json": (lambda held: held.pop("bundle.json"), r"bundle\.json is missing"),
    "one too many": (lambda held: held.update({"evil.pkl": b"x"}), r"evil\.pkl is none of its files"),
    "outside": (lambda held: held.update({"../evil": b"x"}), "'../evil' would lie outside of it"),
    "absolute": (lambda held: held.update({"/etc/passwd": b"x"}), "'/etc/passwd' would lie outside of it"),
    "backslashes": (lambda held: held.update({"..\\evil": b"x"}), "would lie outside of it"),
    "a drive letter": (lambda held: held.update({"C:evil": b"x"}), "would lie outside of it"),
    "a scenario changed": (of_rows(lambda row: row.update(scenario_hash="0")), "scenario mine/1 was another one"),
    "another suite": (of_manifest(lambda told: told.update(suite_hash="0")), "was driven on other scenarios"),
    "another traffic": (of_manifest(lambda told: told.update(traffic_version=1)), "was driven in traffic 1"),
    "other density": (of_manifest(lambda told: told["overrides"].update(density="low")), "other versions or overrides"),
    "a part": (without_a_drive, "does not hold all drives of mine.yaml"),
    "one scene twice": (as_the_other_scene, "its plans are not named as|are not those that"),
    "more seeds than rows": (
        of_manifest(lambda told: told["requests"][0].update(seeds=9999)), "asks for 19998 drives",
    ),
    "seeds without end": (with_seeds, "holds 21 seeds; at most 20 are judged"),
    "a score of 2": (of_rows(lambda row: row.update(score=2.0)), r"results\.jsonl, line 2: .*score"),
    "no score": (of_rows(lambda row: row.update(score=None)), r"line 2"),
    "a fault without its class": (of_rows(lambda row: row.update(fault={"message": "x"})), r"line 2"),
    "plans elsewhere": (of_rows(lambda row: row.update(trace="../../x")), "its plans are not named as"),
    "escapes": (of_rows(lambda row: row.update(site="\x1b[2J")), "characters that are not printed"),
    "a bidirectional override": (of_rows(lambda row: row.update(site="a\u202eb")), "characters that are not printed"),
    "a row of a megabyte": (of_rows(lambda row: row.update(site="x" * 2**20)), "longer than any row"),
    "other versions in a row": (of_rows(lambda row: row["versions"].update(sumo="0")), "other versions or overrides"),
    "not JSON": (lambda held: held.update({"manifest.json": b"["}), r"manifest\.json"),
    "deep JSON": (lambda held: held.update({"manifest.json": b"[" * 100_000}), r"manifest\.json"),
    "half a number": (lambda held: held.update({plan_file(held): b"123"}), "3 bytes are not 5 columns of numbers"),
    "not a number": (lambda held: held.update({plan_file(held): b"\xff" * 80}), "holds no plans"),
    "frames out of order": (
        lambda held: held.update({plan_file(held): np.repeat([[1.0], [0.0], [0.0], [0.0], [0.0]], 2, 1).tobytes()}),
        "do not count up from 0",
    ),
    "a million frames at once": (
        lambda held: held.update({plan_file(held): np.array([[0.0, 1e15], *[[0.0, 1.0]] * 4]).tobytes()}),
        "do not count up from 0",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_bundle_is_refused_in_one_line(name: str, home: Path, tmp_path: Path) -> None:
    change, words = REFUSED[name]
    with pytest.raises(InputError, match=words) as told:
        judged(home, forged(home, tmp_path, change), tmp_path / "judged")
    assert len(str(told.value)) < 700
    assert str(told.value).isprintable()
    assert not list((tmp_path / "judged").glob("*/results/*"))


def test_what_bundle_json_does_not_say_was_changed(home: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"was changed: plans/.* is not the file that bundle\.json says"):
        judged(home, forged(home, tmp_path, steered, hashes_too=False), tmp_path / "judged")


def test_an_official_suite_is_not_taken_for_a_file_and_no_file_for_a_suite(home: Path, tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="no suite named"):
        judge(home / "bundle.zip", tmp_path, RunOptions(workers=0))
    write_scenarios(SCENES[:1], tmp_path / "other.yaml")
    with pytest.raises(InputError, match=r"was driven on other scenarios .* give another file as --scenarios"):
        judge(home / "bundle.zip", tmp_path, RunOptions(scenarios=(str(tmp_path / "other.yaml"),), workers=0))


# --- archives ---


def test_no_bundle_is_written_that_a_judge_would_refuse(
    home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = tmp_path / "bundle.zip"
    for module, limit, words in (
        ("bundle", "MOST_PLANS", "MiB of plans, at most"), ("bundle_zip", "MOST_BYTES", "larger than what is taken"),
        ("bundle_zip", "MOST_UNPACKED", "larger than what is taken"), ("bundle_zip", "MOST_FILES", "larger than what"),
    ):  # fmt: skip
        with monkeypatch.context() as patch:
            patch.setattr(f"interplan_sumo.batch.{module}.{limit}", 1)
            with pytest.raises(InputError, match=words):
                submit(read_run(home / "run"), place, "straight_ahead")
        assert not place.exists()


def refused(path: Path, words: str) -> None:
    with pytest.raises(InputError, match=words) as told, open_bundle(path):
        pass
    assert str(told.value).isprintable()


def test_bombs_are_refused_by_what_they_say_of_themselves(
    home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bundle_zip, "MOST_UNPACKED", 1 << 20)
    bomb = tmp_path / "bomb.zip"
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("bundle.json", b"0" * (2 << 20))
    assert bomb.stat().st_size < 3000
    refused(bomb, "would unpack to 0.0 GiB")
    monkeypatch.undo()
    refused(bomb, r"bundle\.json: .*|is no bundle")
    monkeypatch.setattr(bundle_zip, "MOST_FILES", 4)
    refused(home / "bundle.zip", "holds 5 files, at most 4 are taken")
    monkeypatch.setattr(bundle_zip, "MOST_BYTES", 100)
    refused(home / "bundle.zip", "GiB, at most 0 are taken")


def test_a_size_that_is_a_lie_gets_no_more_than_it_says(home: Path, tmp_path: Path) -> None:
    whole = (home / "bundle.zip").read_bytes()
    at = whole.index(b"PK\1\2")
    size = struct.unpack_from("<I", whole, at + 24)[0]
    for said in (0, size - 1, 2**31):
        lying = tmp_path / "lying.zip"
        lying.write_bytes(whole[: at + 24] + struct.pack("<I", said) + whole[at + 28 :])
        refused(lying, r"is no bundle|at most|would unpack")


def test_directories_beyond_memory_are_not_read(home: Path, tmp_path: Path) -> None:
    whole = (home / "bundle.zip").read_bytes()
    path = tmp_path / "b.zip"
    path.write_bytes(whole[:-10] + struct.pack("<I", 2**32 - 1) + whole[-6:])
    refused(path, "is no bundle")
    path.write_bytes(whole[:-22] + b"PK\6\7" + bytes(16) + whole[-22:])
    refused(path, "does not end as a bundle does")
    path.write_bytes(whole[:-2] + b"\1\0x")
    refused(path, "does not end as a bundle does")


def test_files_packed_otherwise_or_twice_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "b.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_LZMA) as archive:
        archive.writestr("bundle.json", b"{}")
    refused(path, "is packed in another way")
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("bundle.json", b"{}")
        with pytest.warns(UserWarning, match="Duplicate name"):
            archive.writestr("bundle.json", b"{}")
    refused(path, "is in it twice")
    refused(tmp_path, "is no bundle|cannot read")
    (tmp_path / "empty.zip").write_bytes(b"")
    refused(tmp_path / "empty.zip", "there is no archive")


def test_hundreds_of_mutations_end_in_a_bundle_or_in_one_line(home: Path, tmp_path: Path) -> None:
    whole = (home / "bundle.zip").read_bytes()
    chance = random.Random(28)
    path = tmp_path / "mutated.zip"
    said: list[str] = []
    for _ in range(300):
        content = bytearray(whole)
        for _ in range(chance.randint(1, 4)):
            first = chance.choice((0, len(content) - 600))  # the end is where an archive says what is in it
            content[chance.randrange(first, len(content))] = chance.randrange(256)
        cut = chance.random()
        path.write_bytes(bytes(content[: chance.randrange(len(content))]) if cut < 0.2 else bytes(content))
        try:
            with open_bundle(path) as bundle:
                for key in bundle.rows:
                    bundle.plans(key)
        except InputError as error:
            said.append(str(error))
    assert len(said) > 200
    assert all(each.isprintable() for each in said)
