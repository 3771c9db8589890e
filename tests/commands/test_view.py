"""Truth: the clips that were written; our own unpacking of what stands in the page."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from pacmo_core.commands.cli import app
from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import NTU25, SBU15
from pacmo_core.formats.write_bvh import format_bvh
from pacmo_core.formats.write_ntu import format_ntu
from pacmo_core.formats.write_tables import TABLE_WRITERS, JointTable
from pacmo_core.store.motions import write_motions
from pacmo_core.store.tables import VariationRecord, write_variations
from tests.commands.test_augment import standing
from tests.figures.samples import interaction, unpack_motion
from tests.formats.moving import moving
from tests.formats.real_files import real_folder

REAL = standing()
ANSWER = replace(REAL, person_a=REAL.person_b, person_b=REAL.person_a + np.float32(0.1))
BODY = {"head": 1.0}


@pytest.fixture(autouse=True)
def stores(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stand in a folder with a store of clips and one of reactions."""
    monkeypatch.chdir(tmp_path)
    for folder, name, clip in (("data/clips", "one", REAL), ("reactions", "one#a#0", ANSWER)):
        with write_motions(tmp_path / folder / "motions.parquet", SBU15) as writer:
            writer.add(name, clip)


def view(*words: object) -> Result:
    return CliRunner().invoke(app, ["view", "--no-open", *map(str, words)])


def packed(page: Path) -> list[dict]:
    found = re.search(r'id="motions">(.*?)</script>', page.read_text(encoding="utf-8"))
    assert found
    (scenes,) = json.loads(found[1])
    return list(scenes)


def motions(facts: dict) -> list[np.ndarray]:
    origin = np.array(facts["origin"])
    shape = (-1, len(facts["joints"]), 3)
    return [unpack_motion(text, origin, facts["step"]).reshape(shape) for text in facts["motions"]]


def refused(said: Result, *texts: str) -> None:
    assert said.exit_code == 1, said.output
    assert said.stderr.count("\n") == 1
    for text in texts:
        assert text in said.stderr


def test_a_clip_of_the_store_and_one_of_another_folder_stand_side_by_side(tmp_path: Path) -> None:
    assert view("one", "reactions:one#a#0", "--out", "page.html").exit_code == 0
    real, answer = packed(tmp_path / "page.html")
    assert [real["label"], answer["label"]] == ["one", "reactions · one#a#0"]
    np.testing.assert_allclose(motions(real)[0], REAL.person_a, atol=1e-4)
    # A reaction of person a: the file has the partner, person b, first.
    np.testing.assert_allclose(motions(answer)[0], ANSWER.person_b, atol=1e-4)


def test_a_variation_is_found_kept_or_not_and_what_was_not_made_says_why(tmp_path: Path) -> None:
    row = VariationRecord("a/b~kept", "a/b", "random", True, "", 0.5, {"attempt": 1.0}, BODY, BODY)
    failed = replace(
        row, variation="a/b~far", accepted=False, reason="near_distance_error", limit_ratio=2
    )
    none = replace(
        row, variation="c~x", clip="c", accepted=False, reason="refused: why", measurements={}
    )
    write_variations(tmp_path / "many/variations.parquet", [row, failed, none], list(BODY))
    for folder, name, clip in (
        ("motions", "a/b~kept", REAL),
        ("failed", "a/b~far", ANSWER),
        ("sources", "a/b", REAL),
    ):
        with write_motions(tmp_path / "many" / folder / "a%2Fb.parquet", SBU15) as writer:
            writer.add(name, clip)
    said = view("many:a/b", "many:a/b~kept", "many:a/b~far")
    assert said.exit_code == 0, said.output
    source, kept, far = packed(tmp_path / "view.html")
    assert [facts["label"] for facts in (source, kept, far)] == ["a/b", "a/b~kept", "a/b~far"]
    assert source["motions"] == kept["motions"] != far["motions"]
    refused(view("many:c~x"), "c~x", "refused: why")
    refused(view("many:a/b~other"), "many/variations.parquet", "a/b~other")
    # Those of the project by their names alone, which a list has.
    (tmp_path / "data/variations").mkdir()
    (tmp_path / "many").rename(tmp_path / "data/variations/default")
    assert view("a/b~kept").exit_code == 0
    assert packed(tmp_path / "view.html")[0]["motions"] == kept["motions"]
    exported = CliRunner().invoke(app, ["export", "a/b~far", "--out", "far.npz"])
    assert exported.exit_code == 0, exported.output
    np.testing.assert_allclose(np.load("far.npz")["person_a"], ANSWER.person_a, atol=1e-6)
    refused(view("c~x"), "c~x", "refused: why")
    refused(view("a/b~other"), "no clip a/b~other")
    listed = CliRunner().invoke(app, ["clips", "--variations", "--matching", "a/b"]).output
    lines = [line.split() for line in listed.splitlines()]
    assert lines[0] == ["variation", "kind", "accepted", "limit_ratio", "reason"]
    assert lines[1] == ["a/b~kept", "random", "True", "0.50"]
    assert lines[2] == ["a/b~far", "random", "False", "2.00", "near_distance_error"]
    assert lines[3] == ["2", "of", "3"]


def test_without_variations_the_list_says_what_makes_them() -> None:
    refused(CliRunner().invoke(app, ["clips", "--variations"]), "data/variations", "./run makes it")


def test_a_parquet_file_may_be_named_itself(tmp_path: Path) -> None:
    assert view("data/clips/motions.parquet:one").exit_code == 0
    assert len(packed(tmp_path / "view.html")) == 1


def test_two_captures_of_one_person_are_a_pair_and_one_stands_alone(tmp_path: Path) -> None:
    for person, motion in (("A", REAL.person_a), ("B", REAL.person_b)):
        (tmp_path / f"x_{person}.bvh").write_text(format_bvh(motion, 15, SBU15))
    unit = ["--from-unit", 1, "--from-up", "y"]
    assert view("x_A.bvh+x_B.bvh", "x_B.bvh", *unit).exit_code == 0
    pair, alone = packed(tmp_path / "view.html")
    assert (pair["label"], alone["label"]) == ("x_A + x_B", "x_B")
    assert (len(pair["motions"]), len(alone["motions"])) == (2, 1)
    assert pair["motions"][1] != pair["motions"][0]
    root = SBU15.root
    joint = alone["joints"].index(SBU15.joints[root])
    np.testing.assert_allclose(motions(alone)[0][:, joint], REAL.person_b[:, root], atol=1e-3)


def test_two_people_of_different_skeletons_are_a_pair(tmp_path: Path) -> None:
    other = moving(NTU25, 3, len(REAL.times))
    (tmp_path / "x.bvh").write_text(format_bvh(REAL.person_a, 15, SBU15))
    (tmp_path / "y.bvh").write_text(format_bvh(other, 15, NTU25))
    said = view("x.bvh+y.bvh", "--from-unit", 1, "--from-up", "y")
    assert said.exit_code == 0, said.output
    joints = f"{len(SBU15.joints)} and {len(NTU25.joints)} joints"
    frames = f"{len(REAL.times)} frames at 15 frames a second"
    assert f"x + y: 2 people of {joints}, {frames}" in said.output
    (facts,) = packed(tmp_path / "view.html")
    assert set(facts["joints"]) == set(SBU15.joints)
    assert set(facts["other"]["joints"]) == set(NTU25.joints)
    origin = np.array(facts["origin"])
    shape = (-1, len(NTU25.joints), 3)
    found = unpack_motion(facts["motions"][1], origin, facts["step"]).reshape(shape)
    order = [facts["other"]["joints"].index(joint) for joint in NTU25.joints]
    np.testing.assert_allclose(found[:, order], other, atol=5e-3)
    (tmp_path / "z.bvh").write_text(format_bvh(other[:-1], 15, NTU25))
    short = view("x.bvh+z.bvh", "--from-unit", 1, "--from-up", "y")
    refused(short, "x + z", f"{len(other)} frames of one, {len(other) - 1} of the other")


def test_options_apply_to_captures_that_need_them_beside_others(tmp_path: Path) -> None:
    for person, motion in (("A", REAL.person_a), ("B", REAL.person_b)):
        (tmp_path / f"x_{person}.bvh").write_text(
            format_bvh((100 * motion).astype(np.float32), 15, SBU15)
        )
    table = JointTable(SBU15, REAL.times, (REAL.person_a, REAL.person_b), "y", 1.0)
    (tmp_path / "x.npz").write_bytes(TABLE_WRITERS[".npz"](table))
    words = ["x_A.bvh+x_B.bvh", "x.npz", "one", "--from-unit", 0.01, "--from-up", "y"]
    said = view(*words)
    assert said.exit_code == 0, said.output
    for facts in packed(tmp_path / "view.html"):
        origin = np.array(facts["origin"])
        np.testing.assert_allclose(motions(facts)[0].mean(), REAL.person_a.mean(), atol=5e-3)
        assert np.abs(origin).max() < 10
    far = np.array([0, 0, 5], np.float32)  # before the camera
    seen = interaction(3, NTU25, 20, 30)
    seen = Interaction(NTU25, seen.times, seen.person_a + far, seen.person_b + far)
    (tmp_path / "x.skeleton").write_bytes(format_ntu(seen, (1, 2)))
    assert view("x.skeleton", *words, "--preset", "pair").exit_code == 0
    # An option that no capture takes is still wrong.
    refused(view("x.skeleton", "--preset", "pair"), "x.skeleton", "ntu take no --preset")
    mixed = view("x.skeleton", "x.npz", "--preset", "pair")
    refused(mixed, "x.skeleton, x.npz", "ntu or table take no --preset")
    refused(view("one", "--from-up", "y"), "take no --from-up")


def test_clips_have_names_of_their_own_and_those_that_are_asked_for(tmp_path: Path) -> None:
    for folder in ("new", "."):
        (tmp_path / folder).mkdir(exist_ok=True)
        for person, motion in (("A", REAL.person_a), ("B", REAL.person_b)):
            (tmp_path / folder / f"x_{person}.bvh").write_text(format_bvh(motion, 15, SBU15))
    words = ["x_A.bvh+x_B.bvh", "new/x_A.bvh+new/x_B.bvh", "--from-unit", 1, "--from-up", "y"]
    labels = lambda: [facts["label"] for facts in packed(tmp_path / "view.html")]  # noqa: E731
    assert view(*words).exit_code == 0
    assert labels() == ["x_A + x_B", "new/x_A + x_B"]
    assert view("one", "one").exit_code == 0
    assert labels() == ["one (1)", "one (2)"]
    assert view(*words, "--label", "source", "--label", "<b>variation").exit_code == 0
    assert labels() == ["source", "<b>variation"]
    refused(view(*words, "--label", "source"), "a --label for each of 2 clips; got 1")


def test_a_file_with_a_plus_in_its_name_is_shown(tmp_path: Path) -> None:
    (tmp_path / "a+b.bvh").write_text(format_bvh(moving(SBU15, 3), 15, SBU15))
    assert view("a+b.bvh", "--from-unit", 1, "--from-up", "y").exit_code == 0
    (shown,) = packed(tmp_path / "view.html")
    assert shown["label"] == "a+b"


def test_what_cannot_be_shown_is_told_in_one_line(tmp_path: Path) -> None:
    refused(view("two"), "no clip two")
    refused(view("nowhere:one"), "nowhere:one")
    (tmp_path / "a.bvh").write_text(format_bvh(moving(SBU15, 3), 15, SBU15))
    refused(view("a.bvh+b.bvh"), "pacmo: b.bvh: no such file")
    refused(view("data/clips:"), "name of a clip")
    refused(view("data/clips/motions.parquet"), "name the clip")
    refused(view(*["one"] * 7), "at most 6")
    (tmp_path / "x.bvh").write_text(format_bvh(moving(SBU15, 1), 15, SBU15))
    refused(view("x.bvh"), "x.bvh", "--from-up")
    refused(view("x.bvh+x.bvh+x.bvh", "--from-unit", 1, "--from-up", "y"), "at most two")
    (tmp_path / "x.txt").write_text("")
    refused(view("x.txt"), "suffix")
    refused(view("x.txt", "--format", "mp3"), "no format")
    before = Path("data/clips/motions.parquet").read_bytes()
    refused(view("one", "--out", "data/clips/motions.parquet"), "would overwrite")
    assert Path("data/clips/motions.parquet").read_bytes() == before
    refused(view("one", "--out", "page.parquet"), "wanted a suffix of .html")
    assert not (tmp_path / "view.html").exists()


def test_the_page_names_no_folder_of_the_machine(tmp_path: Path) -> None:
    (tmp_path / "x.bvh").write_text(format_bvh(REAL.person_a, 15, SBU15))
    assert view(tmp_path / "x.bvh", "--from-unit", 1, "--from-up", "y").exit_code == 0
    assert str(tmp_path) not in (tmp_path / "view.html").read_text()


@pytest.mark.parametrize(
    ("folder", "pattern", "options"),
    [
        ("sbu", "s01s02/*/*/skeleton_pos.txt", ["--format", "sbu"]),
        ("ntu", "**/*A05*.skeleton", []),
        ("cmu_raw", "**/*.bvh", ["--from-unit", 0.0564, "--from-up", "y"]),
    ],
)
def test_real_captures_are_shown(
    tmp_path: Path, folder: str, pattern: str, options: list[object], request: pytest.FixtureRequest
) -> None:
    root = request.config.rootpath / real_folder_from(request.config.rootpath, folder)
    files = sorted(root.glob(pattern))
    if not files:
        pytest.skip(f"no {pattern} in {root}")
    said = view(files[0], *options)
    assert said.exit_code == 0, said.output
    assert len(packed(tmp_path / "view.html")) == 1


def real_folder_from(root: Path, name: str) -> Path:
    """Name a folder of captures as seen from the checkout: the test stands elsewhere."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(root)
        return real_folder(name).resolve()


def test_interactions_of_two_rates_are_taken(tmp_path: Path) -> None:
    fast = Interaction(SBU15, REAL.times / 8, REAL.person_a, REAL.person_b)
    with write_motions(tmp_path / "fast" / "motions.parquet", SBU15) as writer:
        writer.add("one", fast)
    assert view("one", "fast:one").exit_code == 0


@pytest.mark.parametrize("command", [["view", "--no-open"], ["export"]])
def test_one_person_is_not_shown_as_two(tmp_path: Path, command: list[str]) -> None:
    for name in ("x.bvh", "copy.bvh"):
        (tmp_path / name).write_text(format_bvh(REAL.person_a, 15, SBU15))
    for pair in ("x.bvh+x.bvh", "x.bvh+copy.bvh"):
        words = [*command, pair, "--from-unit", "1", "--from-up", "y", "--out", "out.html"]
        words[-1] = "out.bvh" if command == ["export"] else "out.html"
        said = CliRunner().invoke(app, words)
        refused(said, "x.bvh", "wanted the motions of two people; got the same motion twice")
    assert not list(tmp_path.glob("out*"))


def test_clips_that_begin_with_an_unknown_name_are_listed(tmp_path: Path) -> None:
    with write_motions(tmp_path / "data/clips/motions.parquet", SBU15) as writer:
        for number in range(2):
            writer.add(f"push01#{number:04d}", REAL)
    refused(view("push01"), "no clip push01; the nearest: push01#0000, push01#0001")
    assert view("push01#0000").exit_code == 0
