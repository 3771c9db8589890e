"""Truth: the solver's own call; files that our own readers read back."""

import json
import re
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ruamel.yaml import YAML
from typer.testing import CliRunner, Result

from pacmo_core.augmentation.run import scene_from
from pacmo_core.commands.augment import read_solver_section, saying_that_it_runs
from pacmo_core.commands.captures import read_file, read_two_people
from pacmo_core.commands.cli import app
from pacmo_core.commands.reading import ReadOptions
from pacmo_core.data.interaction import Interaction, bone_lengths
from pacmo_core.data.segments import segments
from pacmo_core.data.skeleton import SBU15
from pacmo_core.formats.base import RawSequence
from pacmo_core.formats.bvh import Bvh, read_bvh
from pacmo_core.formats.bvh_channels import format_file
from pacmo_core.formats.bvh_pairs import BvhPairs
from pacmo_core.formats.resample import resample, sample_times
from pacmo_core.formats.write_bvh import format_bvh
from pacmo_core.formats.write_tables import TABLE_WRITERS, JointTable
from pacmo_core.interaction_mesh import prepare, retarget
from pacmo_core.store.motions import stream_motions, write_motions
from tests.figures.samples import unpack_motion
from tests.formats.real_files import real_folder
from tests.reaction.problems import delayed_mirror

PARAMS = Path("params.yaml").absolute()
FOREARM = [s.name for s in segments(SBU15)].index("left_forearm")


def standing(n_frames: int = 20) -> Interaction:
    """Give two people constant bones and a height."""
    clip = delayed_mirror(1, np.arange(n_frames) / 15)
    random = np.random.default_rng(0)
    still = [motion.mean(axis=0) for motion in (clip.person_a, clip.person_b)]
    sway = 0.02 * random.standard_normal((2, n_frames, 1, 3)).cumsum(axis=1)
    motions = [
        (pose + random.normal(0, 0.02, pose.shape) + move).astype(np.float32)
        for pose, move in zip(still, sway, strict=True)
    ]
    return Interaction(clip.skeleton, clip.times, *motions)


CLIP = standing()
UNIT = ["--from-unit", 1, "--from-up", "y"]
UNIT_AND_UP = {"unit": 1, "up": "y"}


@pytest.fixture
def files(tmp_path: Path) -> list[Path]:
    """Write a BVH file a person."""
    paths = [tmp_path / "duo_A.bvh", tmp_path / "duo_B.bvh"]
    for path, motion in zip(paths, (CLIP.person_a, CLIP.person_b), strict=True):
        path.write_text(format_bvh(motion, 15, SBU15))
    return paths


@pytest.fixture
def stored(tmp_path: Path) -> Path:
    with write_motions(tmp_path / "motions.parquet", SBU15) as writer:
        writer.add("one", CLIP)
    return tmp_path / "motions.parquet"


def pacmo(*words: object) -> Result:
    return CliRunner().invoke(app, ["augment", *map(str, words), "--params", str(PARAMS)])


def refused(said: Result, *texts: str) -> None:
    assert said.exit_code == 1, said.output
    assert said.stderr.count("\n") == 1
    for text in texts:
        assert text in said.stderr


def read(folder: Path, names: tuple[str, str] = ("duo_A.bvh", "duo_B.bvh")) -> Interaction:
    pairs = BvhPairs(
        preset="pair", unit=1, up="y", fps=None, end_sites=False, skip_frames=0,
        max_root_distance=None,
    )  # fmt: skip
    return pairs.read(RawSequence("duo", tuple(folder / name for name in names))).interaction


@pytest.mark.parametrize("ending", TABLE_WRITERS)
def test_a_table_gives_what_the_same_clip_of_the_store_gives(
    stored: Path, tmp_path: Path, ending: str
) -> None:
    table = JointTable(SBU15, CLIP.times, (CLIP.person_a, CLIP.person_b), "y", 1.0)
    (tmp_path / f"one{ending}").write_bytes(TABLE_WRITERS[ending](table))
    scale = ["--b-scale", "left_forearm=1.2", "--out"]
    assert pacmo(tmp_path / f"one{ending}", *scale, tmp_path / "table.parquet").exit_code == 0
    assert pacmo(stored, "--clip", "one", *scale, tmp_path / "clip.parquet").exit_code == 0
    ((name, made),) = stream_motions(tmp_path / "table.parquet")
    ((_, wanted),) = stream_motions(tmp_path / "clip.parquet")
    assert name == "one~b-left_forearm-1.2"
    np.testing.assert_allclose(made.person_b, wanted.person_b, atol=1e-5)


def test_parquet_comes_out_as_the_solver_gives_it(stored: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.parquet"
    said = pacmo(stored, "--clip", "one", "--b-scale", "left_forearm=1.2", "--out", out)
    assert said.exit_code == 0, said.output
    ((name, found),) = stream_motions(out)
    assert name == "one~b-left_forearm-1.2"
    assert f"in {out} as {name}; " in said.output
    assert "fitting" not in said.output  # of rotations, which Parquet has none of
    scales = np.ones((1, 28))
    scales[0, 14 + FOREARM] = 1.2
    wanted = retarget(prepare(scene_from(CLIP), read_solver_section(PARAMS).solver), scales).points[
        0
    ]
    np.testing.assert_array_equal(found.person_a, wanted[:, :15].astype(np.float32))
    np.testing.assert_array_equal(found.person_b, wanted[:, 15:].astype(np.float32))
    assert "contacts " in said.output


def test_bvh_comes_out_under_the_same_names_in_the_same_tree(
    files: list[Path], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    said = pacmo(*files, *UNIT, "--a-scale", "uniform=0.9", "--b-scale", "left_forearm=1.2",
                 "--out", out)  # fmt: skip
    assert said.exit_code == 0, said.output
    assert "fitting rotations of 15 and 15 joints" in said.output
    before, after = read(tmp_path), read(out)
    assert after.skeleton == before.skeleton
    body = before.skeleton
    forearm = [s.name for s in segments(body)].index("left_forearm")
    for motion, source, wanted in (
        (after.person_a, before.person_a, np.full(14, 0.9)),
        (after.person_b, before.person_b, np.where(np.arange(14) == forearm, 1.2, 1.0)),
    ):
        grown = bone_lengths(motion, body) / bone_lengths(source, body)
        np.testing.assert_allclose(grown, np.broadcast_to(wanted, grown.shape), atol=1e-4)


def test_a_single_name_makes_a_pair_and_a_profile_is_taken_by_name(
    files: list[Path], tmp_path: Path
) -> None:
    out = tmp_path / "x" / "small.bvh"
    assert pacmo(*files, *UNIT, "--profile", "b=long_arms", "--out", out).exit_code == 0
    names = sorted(path.name for path in out.parent.iterdir())
    assert names == ["small.html", "small_A.bvh", "small_B.bvh"]
    found = read(out.parent, ("small_A.bvh", "small_B.bvh"))
    forearm = [s.name for s in segments(found.skeleton)].index("left_forearm")
    before, after = (bone_lengths(m.person_b, m.skeleton)[0] for m in (read(tmp_path), found))
    assert after[forearm] / before[forearm] == pytest.approx(1.1, abs=1e-3)


def test_several_bodies_come_as_a_folder_each_as_if_alone(
    files: list[Path], tmp_path: Path
) -> None:
    words = [*files, *UNIT, "--a-scale", "head=1.1"]
    said = pacmo(*words, "--profile", "b=child,long_arms", "--out", tmp_path / "out")
    assert said.exit_code == 0, said.output
    assert "person a to head=1.1 and person b to child,long_arms ..." in said.output
    lines = said.output.splitlines()
    for number, name in enumerate(("child", "long_arms"), start=1):
        heading = lines.index(f"bodies {number} of 2, person b as {name}:")
        assert lines[heading + 1].startswith("written on the rig")
        out = tmp_path / name
        assert pacmo(*words, "--profile", f"b={name}", "--out", out).exit_code == 0
        alone, among = read(out), read(tmp_path / "out" / name)
        for one, other in ((alone.person_a, among.person_a), (alone.person_b, among.person_b)):
            np.testing.assert_allclose(other, one, atol=1e-4)
        assert (tmp_path / "out" / name / "duo_A.html").is_file()
    refused(pacmo(*words, "--profile", "b=child,long_arms", "--out", tmp_path / "x.parquet"),
            "wanted a folder for 2 pairs of bodies")  # fmt: skip
    refused(pacmo(*words, "--profile", "b=child,", "--out", out), "PERSON=NAME")


def played(page: Path) -> list[dict[str, Any]]:
    """Read the scenes of a page."""
    (text,) = re.findall(r'id="motions">(.*?)</script>', page.read_text(encoding="utf-8"))
    (scenes,) = json.loads(text)
    return list(scenes)


def test_a_page_plays_the_source_beside_the_written_variation(
    files: list[Path], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    said = pacmo(*files, *UNIT, "--b-scale", "uniform=0.8", "--out", out)
    page = out / "duo_A.html"
    assert f"beside the source in {page}" in said.output
    source, variation = played(page)
    assert (source["label"], variation["label"]) == ("source", "variation")
    for scene, clip in ((source, read(tmp_path)), (variation, read(out))):
        for text, motion in zip(scene["motions"], (clip.person_a, clip.person_b), strict=True):
            shown = unpack_motion(text, np.array(scene["origin"]), scene["step"])
            np.testing.assert_allclose(shown, motion.reshape(-1, 3), atol=1e-3)


def test_the_page_states_measurements_beside_limits(stored: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.parquet"
    words = [stored, "--clip", "one", "--b-scale", "left_forearm=1.2", "--out", out]
    params = YAML(typ="safe").load(PARAMS)
    params["augment"]["limits"]["elbow_change_p95"] = 1e-6
    (tmp_path / "strict.yaml").write_text(json.dumps(params))
    said = CliRunner().invoke(
        app, ["augment", *map(str, words), "--params", str(tmp_path / "strict.yaml")]
    )
    assert said.exit_code == 0, said.output
    assert re.search(
        r"beyond the limits of what looks natural .*:\n  elbows .*°, wanted at most 0° \(worst: "
        r"person b, left_elbow in frame \d+ \([\d.]+ s\)\)\n",
        said.output,
    )
    html = (tmp_path / "out.html").read_text(encoding="utf-8")
    at = html.index("Elbows ↓ °")
    assert re.match(r'[^/]*<small>[^/]*</small></th>\s*<td class="worst">', html[at:])
    assert "Near distances ↓ mm" in html and "_p95" not in html[html.index("<main>") :]


def test_two_bodies_of_different_skeletons_meet(files: list[Path], tmp_path: Path) -> None:
    short = SBU15.without(["left_foot", "right_foot"])
    rows = SBU15.indices(short.joints)
    files[1].write_text(format_bvh(CLIP.person_b[:, rows], 15, short))
    words = [*files, *UNIT, "--b-scale", "head=1.3", "--out"]
    assert pacmo(*words, tmp_path / "out").exit_code == 0
    labels = [scene["label"] for scene in played(tmp_path / "out" / "duo_A.html")]
    assert labels == ["source", "variation"]
    refused(pacmo(*words, tmp_path / "out.parquet"), "Parquet holds two people of one skeleton")


def test_joints_on_top_of_each_other_are_left_out_and_written_again(
    files: list[Path], tmp_path: Path
) -> None:
    text = files[0].read_text()
    at = text.index("JOINT left_hand")
    head, _, tail = text[at:].partition("OFFSET ")
    offset, _, rest = tail.partition("\n")
    doubled = text[:at] + head + "OFFSET 0 0 0\n" + rest
    assert offset
    files[0].write_text(doubled)
    said = pacmo(*files, *UNIT, "--a-scale", "uniform=1.1", "--out", tmp_path / "out")
    assert said.exit_code == 0, said.output
    assert read(tmp_path / "out").skeleton.joints == read(tmp_path).skeleton.joints


def test_what_cannot_be_done_is_one_line_that_names_file_and_segment(
    files: list[Path], stored: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    there = [*files, *UNIT, "--out", out]
    refused(pacmo(*there, "--b-scale", "left_tail=1.2"), "duo_A.bvh", "left_tail", "left_forearm")
    refused(pacmo(*there, "--b-scale", "left_forearm=0"), "left_forearm", "0.3 to 3", "got 0")
    refused(pacmo(*there, "--b-scale", "left_forearm=long"), "SEGMENT=SCALE", "left_forearm=long")
    refused(pacmo(*there, "--profile", "c=child"), "PERSON=NAME", "c=child")
    refused(pacmo(*there, "--profile", "b=giant"), "no profile 'giant'", "long_arms")
    refused(pacmo(*there), "nothing to change")
    scale = ["--b-scale", "uniform=0.9"]
    refused(pacmo(*files, "--from-unit", 100, *scale, "--out", out), "a person of 1", "--from-unit")
    refused(pacmo(files[0], *UNIT, *scale, "--out", out), "duo_A.bvh", "wanted two files")
    refused(pacmo(*files, *UNIT, *scale, "--out", tmp_path), "would overwrite", "duo_A.bvh")
    refused(pacmo(*files, *UNIT, *scale, "--out", tmp_path / "a.gif"), ".parquet")
    refused(pacmo(stored, *scale, "--out", tmp_path / "o.parquet"), "--clip")
    refused(pacmo(stored, "--clip", "one", *scale, "--out", stored), "would overwrite")
    refused(pacmo(stored, "--clip", "no", *scale, "--out", tmp_path / "o.parquet"), "no clip no")
    files[1].write_text(format_bvh(CLIP.person_b[:9], 15, SBU15))
    refused(pacmo(*there, *scale), "20 frames of one, 9 of the other")
    assert not out.exists()


def test_one_person_is_not_taken_for_two(files: list[Path], tmp_path: Path) -> None:
    out, scale = tmp_path / "out", ["--b-scale", "uniform=0.9"]
    twice = pacmo(files[0], files[0], *UNIT, *scale, "--out", out)
    refused(twice, "duo_A.bvh", "wanted the motions of two people; got the same motion twice")
    copy = tmp_path / "copy.bvh"
    copy.write_bytes(files[0].read_bytes())
    refused(pacmo(files[0], copy, *UNIT, *scale, "--out", out), "copy.bvh", "motion twice")
    # Fitted twice, as AMASS has a dancer of CMU's.
    copy.write_text(format_bvh(CLIP.person_a + np.float32([0.02, 0, 0]), 15, SBU15))
    said = pacmo(files[0], copy, *UNIT, *scale, "--out", out)
    refused(said, "twice: joints are 2.0 cm from their counterparts", "at least 10 cm")
    table = JointTable(SBU15, CLIP.times, (CLIP.person_a,), "y", 1.0)
    (tmp_path / "one.npz").write_bytes(TABLE_WRITERS[".npz"](table))
    refused(pacmo(tmp_path / "one.npz", *scale, "--out", out), "one.npz", "got one person")
    assert not out.exists()


def test_a_capture_of_ntu_of_one_person_is_refused(tmp_path: Path) -> None:
    file = next(iter(sorted((real_folder("ntu") / "single_person").glob("*.skeleton"))))
    said = pacmo(file, "--b-scale", "uniform=0.9", "--out", tmp_path / "out")
    refused(said, file.name, "wanted the motions of two people; got one person")


def test_a_flat_body_is_refused_by_name(stored: Path, tmp_path: Path) -> None:
    flat = CLIP.person_b.copy()
    flat[..., 2] = 0
    with write_motions(stored, SBU15) as writer:
        writer.add("one", Interaction(SBU15, CLIP.times, CLIP.person_a, flat))
    out = tmp_path / "o.parquet"
    said = pacmo(stored, "--clip", "one", "--a-scale", "uniform=0.9", "--out", out)
    refused(said, "motions.parquet", "person_b is flat")


def test_settings_are_read_from_a_file_that_has_them(stored: Path, tmp_path: Path) -> None:
    words = ["augment", str(stored), "--clip", "one", "--a-scale", "uniform=0.9", "--out", "o.bvh"]
    bad = tmp_path / "bad.yaml"
    bad.write_text("augment: {solver: {graph: complete}}\n")
    broken = tmp_path / "text.yaml"
    broken.write_text("a: [1\n%")
    for params, text in (
        (tmp_path / "none.yaml", "no "),
        (stored.with_name("bad.yaml"), "augment.solver"),
        (broken, "not YAML"),
    ):
        said = CliRunner().invoke(app, [*words, "--params", str(params)])
        refused(said, text)


def test_without_a_checkout_the_settings_are_those_of_the_package(
    stored: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    monkeypatch.chdir(folder)
    words = ["augment", str(stored), "--clip", "one", "--a-scale", "uniform=0.9"]
    said = CliRunner().invoke(app, [*words, "--out", "o.parquet"])
    assert said.exit_code == 0, said.output


def test_real_captures_of_sbu_are_varied(tmp_path: Path) -> None:
    file = next(iter(sorted(real_folder("sbu").rglob("skeleton_pos.txt"))))
    out = tmp_path / "out.parquet"
    words = ["--format", "sbu", "--b-scale", "uniform=1.1", "--out", out]
    said = pacmo(file, *words)
    assert said.exit_code == 0, said.output
    ((_, pair),) = stream_motions(out)
    assert pair.skeleton.joints == SBU15.joints


@pytest.mark.parametrize("scale", ["0.29", "3.1", "nan", "-1"])
def test_a_scale_of_no_body_is_refused_before_a_file_is_read(tmp_path: Path, scale: str) -> None:
    words = ["no_A.bvh", "no_B.bvh", "--b-scale", f"uniform={scale}", "--out", tmp_path / "out"]
    refused(pacmo(*words), f"uniform: wanted a scale of 0.3 to 3.0; got {scale}")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--profile", "b=child", "--profile", "b=tall_adult"], "wanted one --profile a person"),
        (["--profile", "b=child,child"], "wanted each body once"),
        (["--b-scale", "head=1.1", "--b-scale", "head=1.2"], "head: wanted one scale; got 1.1"),
    ],
)
def test_what_is_asked_for_twice_is_refused(
    files: list[Path], tmp_path: Path, words: list[str], said: str
) -> None:
    refused(pacmo(*files, *UNIT, *words, "--out", tmp_path / "o"), said)


def test_the_nearest_of_the_known_names_comes_first(files: list[Path], tmp_path: Path) -> None:
    there = [*files, "--out", tmp_path / "out"]
    said = pacmo(*there, *UNIT, "--b-scale", "left_forarm=1.2")
    refused(said, "no segment left_forarm; there are left_forearm, ")
    refused(
        pacmo(*there, *UNIT, "--profile", "b=long_arm"), "no profile 'long_arm'; there are long"
    )
    scale = ["--b-scale", "uniform=0.9"]
    wrong = pacmo(*there, *scale, "--preset", "skeleton_prior")
    refused(wrong, "--preset: wanted one of skeleton_priors, ", "got 'skeleton_prior'")


def test_a_clip_of_another_name_is_answered_with_the_nearest(stored: Path, tmp_path: Path) -> None:
    with write_motions(stored, SBU15) as writer:
        for name in ("hug01#0000", "push01#0000", "push01#0001"):
            writer.add(name, CLIP)
    words = ["--b-scale", "uniform=0.9", "--out", tmp_path / "o.parquet", "--clip"]
    refused(
        pacmo(stored, *words, "push01"), "no clip push01; the nearest: push01#0000, push01#0001"
    )
    refused(pacmo(stored, *words, "puhs01#0000"), "no clip puhs01#0000; the nearest: push01#0000")


def test_the_name_of_a_clip_is_refused_where_a_file_holds_one_capture(
    files: list[Path], tmp_path: Path
) -> None:
    words = ["--b-scale", "uniform=0.9", "--out", tmp_path / "out", "--clip", "x"]
    refused(pacmo(*files, *UNIT, *words), "duo_A.bvh: holds one capture; --clip is for .mat")
    table = JointTable(SBU15, CLIP.times, (CLIP.person_a, CLIP.person_b), "y", 1.0)
    (tmp_path / "one.npz").write_bytes(TABLE_WRITERS[".npz"](table))
    refused(pacmo(tmp_path / "one.npz", *words), "one.npz: holds one capture", "got x")


def test_the_command_says_what_it_does_and_whether_the_limits_hold(
    stored: Path, tmp_path: Path
) -> None:
    params = YAML(typ="safe").load(PARAMS)
    limits = params["augment"]["limits"]
    lower = {"contacts_kept", "contacts_kept_with_slack"}
    params["augment"]["limits"] = {name: 0.0 if name in lower else 1e6 for name in limits}
    (tmp_path / "loose.yaml").write_text(json.dumps(params))
    words = ["augment", stored, "--clip", "one", "--b-scale", "left_forearm=1.2"]
    words += ["--profile", "a=long_arms", "--out", tmp_path / "o.parquet", "--params"]
    lines = [
        CliRunner().invoke(app, [*map(str, words), str(tmp_path / name)]).output.splitlines()
        for name in ("loose.yaml", "strict.yaml")
        if (tmp_path / "strict.yaml").write_text(
            json.dumps({"augment": params["augment"] | {"limits": limits | {"seam_ratio": 1e-9}}})
        )
    ]
    for said in lines:
        assert said[0] == (
            "solving 20 frames of two people, person a to long_arms and person b to "
            "left_forearm=1.2 ..."
        )
    assert lines[0][-2].startswith("all within the limits of what looks natural")
    assert lines[1][-3].startswith("beyond the limits of what looks natural")
    assert re.match(r"  jumps .* \(worst: person [ab], \w+ in frame \d+ ", lines[1][-2])


def test_a_long_solve_is_said_to_run_and_no_more_once_it_ended() -> None:
    said: list[str] = []
    heard = threading.Event()

    def say(text: str) -> None:
        said.append(text)
        heard.set()

    before = threading.enumerate()
    with saying_that_it_runs(say, every=0.001):
        assert heard.wait(60)
    assert re.fullmatch(r"still solving, \d+ s \.\.\.", said[0])
    assert threading.enumerate() == before


def test_a_folder_of_settings_is_called_a_folder(stored: Path, tmp_path: Path) -> None:
    words = ["augment", str(stored), "--clip", "one", "--a-scale", "uniform=0.9", "--out", "o.bvh"]
    said = CliRunner().invoke(app, [*words, "--params", str(tmp_path)])
    refused(said, f"{tmp_path}: a folder; wanted a file, such as {tmp_path / 'params.yaml'}")


def bent(bvh: Bvh, joint: str, degrees: float, frame: int) -> Bvh:
    """Turn a joint by its first channel in one frame, such as a leaf and so its End Site."""
    row = bvh.joints.index(joint)
    column = sum(map(len, bvh.channels[:row]))
    motion = bvh.motion.copy()
    motion[frame, column : column + 3] = [degrees, 0, 0]
    motion[[frame - 1, frame + 1], column : column + 3] = 0
    return replace(bvh, motion=motion)


def test_end_sites_that_the_writer_makes_up_are_no_toes(stored: Path, tmp_path: Path) -> None:
    """A clip of a table that hardly changes: its own lowest joint is that of the file."""
    said = pacmo(stored, "--clip", "one", "--b-scale", "head=1.001", "--out", tmp_path / "out")
    (row,) = re.findall(r"\n +below the floor.*", said.output)
    assert re.search(r" 0(\.0\d*)? cm", row), row


def test_end_sites_of_the_files_count_for_turns_and_depths(
    files: list[Path], tmp_path: Path
) -> None:
    """Truth: a hand's End Site that turns by 80 degrees in a frame, a foot's of half a metre."""
    bvh = read_bvh(files[1])
    offsets = bvh.offsets.copy()
    offsets[bvh.joints.index("left_foot_end")] = [0, -0.5, 0]
    turned = bent(replace(bvh, offsets=offsets), "left_hand", 80, 9)
    files[1].write_text(format_file(turned, turned.motion))
    options = ReadOptions(unit=["1"], up=["y"])
    duo = read_two_people((files[0], files[1]), options, "")
    body = duo.whole[1]
    assert body.skeleton.joints[-len(bvh.end_sites) :] == tuple(
        bvh.joints[end] for end in bvh.end_sites
    )
    places = turned.positions()[:, [turned.joints.index(name) for name in body.skeleton.joints]]
    np.testing.assert_allclose(body.motion, places, atol=1e-5)
    heights = np.concatenate([person.motion[..., 1] for person in duo.whole], axis=1).min(axis=1)
    deep = [100 * (np.median(heights) - person.motion[..., 1].min()) for person in duo.whole]

    out = tmp_path / "out"
    said = pacmo(*files, *UNIT, "--b-scale", "left_forearm=1.2", "--out", out).output
    assert re.search(
        r"\n  the capture itself turns a bone of person b by [\d.]+° in frame (9|10) \(0.6[07] s\) "
        r"\(to left_hand_end, [\d.]+° in what was written\): if it jumps there, mend the capture\n",
        said,
    )
    assert any(
        f"from the capture's own lowest point, {max(0, depth):.2f} cm below its floor" in said
        for depth in deep
    )
    written, body = (
        read_bvh(out / files[1].name),
        read_file(out / files[1].name, UNIT_AND_UP, has_ends=True),
    )
    assert body.skeleton.joints[-len(written.end_sites) :] == tuple(
        written.joints[end] for end in written.end_sites
    )


def test_people_of_two_frame_rates_have_their_end_sites_at_the_same_times(
    files: list[Path], tmp_path: Path
) -> None:
    at = sample_times(CLIP.times, 30.0)
    files[1].write_text(format_bvh(resample(CLIP.person_b, CLIP.times, at), 30, SBU15))
    duo = read_two_people((files[0], files[1]), ReadOptions(unit=["1"], up=["y"]), "")
    for person, body in zip(duo.people, duo.whole, strict=True):
        np.testing.assert_array_equal(person.times, body.times)
        assert len(body.skeleton.joints) > len(person.skeleton.joints)
        on_joints = body.select_joints(person.skeleton)
        np.testing.assert_allclose(on_joints.motion, person.motion, atol=1e-6)
