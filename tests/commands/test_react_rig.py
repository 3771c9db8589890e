"""Reactions on a person's rig. Truth: the rig's own file, and the Parquet file of a reaction."""

import json
import re
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner, Result

from pacmo_core.api import synthesise
from pacmo_core.commands.cli import app
from pacmo_core.data.interaction import Interaction, bone_lengths
from pacmo_core.data.segments import feet
from pacmo_core.data.skeleton import Skeleton, mirror_by_name
from pacmo_core.finish.stance import find_stance
from pacmo_core.formats.bvh import Bvh, read_bvh
from pacmo_core.formats.joint_names import StatedNames, name_joints
from pacmo_core.formats.resample import from_y_up
from pacmo_core.formats.write_bvh import format_bvh
from pacmo_core.reaction.inference import PACKAGED
from pacmo_core.store.motions import stream_motions
from tests.formats.rigged import mixamo, t_pose

CLIP = next(c for name, c in synthesise(4).items() if name.startswith("handshake"))
SIZES = (0.62, 0.9, 1.1)  # of the adult of ``t_pose``: a child, and two adults


def pacmo(*words: object) -> Result:
    return CliRunner().invoke(app, ["react", *map(str, words), "--weights", str(PACKAGED)])


def refused(said: Result, *texts: str) -> None:
    assert said.exit_code == 1, said.output
    assert said.stderr.count("\n") == 1, said.stderr
    for text in texts:
        assert text in said.stderr


@pytest.fixture
def captures(tmp_path: Path) -> list[Path]:
    """Write two people who shake hands on Mixamo's joints, in centimetres, y up."""
    skeleton, motions = mixamo(CLIP)
    files = [tmp_path / "anna.bvh", tmp_path / "ben.bvh"]
    for file, motion in zip(files, motions, strict=True):
        file.write_text(format_bvh(100 * motion, CLIP.fps, skeleton))
    return files


def read_reaction(file: Path) -> Interaction:
    ((_, made),) = stream_motions(file)
    return made


def model_joints(bvh: Bvh, model: Skeleton, unit: float) -> np.ndarray:
    """Return ``(T, J, 3)`` metres: the joints of the model in a file on Mixamo's rig."""
    names = tuple(name for i, name in enumerate(bvh.joints) if i not in bvh.end_sites)
    rows = [bvh.joints.index(name) for name in names]
    parents = tuple(names.index(bvh.joints[p]) if (p := bvh.parents[r]) >= 0 else -1 for r in rows)
    skeleton = Skeleton("rig", names, parents, mirror_by_name(names))
    found = name_joints(skeleton, model, StatedNames())
    return found.apply((unit * bvh.positions()[:, rows]).astype(np.float32))


def rotations(bvh: Bvh) -> dict[str, np.ndarray]:
    """Return the angles (T, 3) of each joint, in degrees about z, x and y."""
    names = [name for name, of in zip(bvh.joints, bvh.channels, strict=True) if of]
    first = range(3, bvh.motion.shape[1], 3)
    return {name: bvh.motion[:, c : c + 3] for name, c in zip(names, first, strict=True)}


def touches(made: Interaction, reaction: np.ndarray) -> np.ndarray:
    return np.linalg.norm(reaction[:, :, None] - made.person_a[:, None], axis=-1) < 0.1


def test_the_sole_of_a_rig_is_not_below_the_floor_and_its_toes_are(
    captures: list[Path], tmp_path: Path
) -> None:
    """Truth: End Sites of the feet, of 3 cm in the rig's T-pose."""
    rig = tmp_path / "rig.bvh"
    toe = re.compile(r"(ToeBase\n.*\n.*\n.*\n\s*End Site\n.*\n\s*OFFSET) [^\n]*")
    text, n = toe.subn(r"\1 0 -3 0", t_pose())
    assert n == 2, "both feet"
    rig.write_text(text)
    partner = read_bvh(captures[0])
    heights = partner.positions()[..., 1]
    sole = 3 - (np.delete(heights, partner.end_sites, axis=1).min() - heights.min())
    said = pacmo(captures[0], "--rig", rig, "--out", tmp_path / "x.bvh")
    assert said.exit_code == 0, said.output
    assert re.search(rf"below the partner's lowest point, cm +<= {1 + sole:.3g} ", said.stdout)
    # A Parquet file has no End Sites.
    said = pacmo(captures[0], "--rig", rig, "--out", tmp_path / "x.parquet")
    assert re.search(r"below the partner's lowest point, cm +<= 1 ", said.stdout)


@pytest.mark.parametrize("size", SIZES)
def test_a_reaction_is_on_the_rig_that_is_named(
    captures: list[Path], tmp_path: Path, size: float
) -> None:
    rig = tmp_path / "rig.bvh"
    rig.write_text(t_pose(size))
    for out in ("x.bvh", "x.parquet"):
        said = pacmo(captures[0], "--rig", rig, "--out", tmp_path / out)
        assert said.exit_code == 0, said.output
        (line,) = (line for line in said.stdout.splitlines() if re.match(r"\d+ x \d+ frames", line))
        assert str(rig) in line
        assert (f"joints of {rig} ..." in said.stdout) == (out == "x.bvh")
    wanted, found = read_bvh(rig), read_bvh(tmp_path / "x_0_B.bvh")
    for name in ("joints", "parents", "channels", "end_sites"):
        assert getattr(found, name) == getattr(wanted, name)
    np.testing.assert_allclose(found.offsets, wanted.offsets, atol=1e-5)
    made = read_reaction(tmp_path / "x.parquet")
    on_rig = model_joints(found, made.skeleton, 0.01)
    # Bones of the Parquet file are those of the rig, where the rig has one in their place.
    of_rig = bone_lengths(model_joints(wanted, made.skeleton, 0.01), made.skeleton)[0]
    lengths = bone_lengths(made.person_b, made.skeleton)
    np.testing.assert_allclose(lengths, np.tile(of_rig, (len(lengths), 1)), atol=1e-5)
    assert np.linalg.norm(on_rig - made.person_b, axis=-1).mean() < 0.018
    near = touches(made, made.person_b)
    assert near.sum() > 50  # hands meet, whatever the size
    assert (near & touches(made, on_rig)).sum() >= 0.9 * near.sum()
    stance = find_stance(made.person_b, made.fps, made.skeleton)
    for foot, stands in zip(feet(made.skeleton), stance, strict=True):
        off = on_rig[stands][:, list(foot)] - made.person_b[stands][:, list(foot)]
        assert np.linalg.norm(off, axis=-1).max() < 5e-3
    for joint, angles in rotations(found).items():
        if re.search(r"Hand(Thumb|Index|Ring)", joint):  # as in the rig
            np.testing.assert_allclose(angles, 0, atol=1e-4)
        assert np.abs(np.diff(angles, axis=0)).max() < 90  # no angle goes round


def test_legs_whose_joints_are_named_a_bone_too_high_are_refused(
    captures: list[Path], tmp_path: Path
) -> None:
    high = [("hip", "Hips"), ("knee", "LeftUpLeg"), ("ankle", "LeftLeg")]
    named = [
        word for joint, name in high for word in ("--joints", f"left_{joint}=mixamorig:{name}")
    ]
    of_rig = [word if word == "--joints" else f"b={word}" for word in named]
    out = ["--out", tmp_path / "x.bvh"]
    for words in (named, ["--rig", captures[1], *of_rig]):
        said = pacmo(captures[0], *words, *out)
        wrong = captures[0] if words is named else captures[1]
        refused(said, str(wrong), "a left thigh of 0.", "--joints left_knee=")
    assert not list(tmp_path.glob("x*"))


def test_knees_and_elbows_bend_about_the_axes_of_the_rig(
    captures: list[Path], tmp_path: Path
) -> None:
    rig = tmp_path / "rig.bvh"
    rig.write_text(t_pose())
    assert pacmo(captures[0], "--rig", rig, "--out", tmp_path / "x.bvh").exit_code == 0
    found = read_bvh(tmp_path / "x_0_B.bvh")
    angles_of, bent = rotations(found), []
    for joint, axis in (("ForeArm", 2), ("Leg", 1)):  # of Zrotation Xrotation Yrotation
        for side in ("Left", "Right"):
            angles = np.abs(angles_of[f"mixamorig:{side}{joint}"])
            bent.append(angles[:, axis].max())
            # Of a bend by about 90 degrees the first and the last angle are not determined.
            others = np.delete(angles[angles[:, axis] < 75], axis, axis=1)
            assert np.quantile(others, 0.95) < 15
    assert max(bent[:2]) > 40
    assert max(bent[2:]) > 20


def test_the_partner_is_the_capture_itself(captures: list[Path], tmp_path: Path) -> None:
    said = pacmo(captures[0], "--rig", captures[1], "--out", tmp_path / "x.bvh")
    assert said.exit_code == 0, said.output
    given, found = read_bvh(captures[0]), read_bvh(tmp_path / "x_0_A.bvh")
    assert found.joints == given.joints
    np.testing.assert_allclose(found.offsets, given.offsets, atol=1e-6)
    np.testing.assert_allclose(found.motion, given.motion, atol=1e-5)
    (named,) = (line for line in said.stdout.splitlines() if "joints named by" in line)
    assert named.startswith(f"{captures[0]} and {captures[1]}: joints named by the preset mixamo")
    assert found.frame_time == pytest.approx(given.frame_time, rel=1e-6)


def test_a_partner_of_few_joints_is_answered_with_a_rig_too(
    captures: list[Path], tmp_path: Path
) -> None:
    few = CLIP.skeleton.without(["left_foot", "right_foot"])
    motion = CLIP.person_a[:, CLIP.skeleton.indices(few.joints)]
    partner, out = tmp_path / "few.bvh", tmp_path / "o.bvh"
    partner.write_text(format_bvh(100 * motion, CLIP.fps, few))
    words = [partner, "--joints", "a=kinect25", "--from-unit", "a=cm", "--from-up", "a=y"]
    assert pacmo(*words, "--out", out).exit_code == 0
    said = pacmo(*words, "--rig", captures[1], "--out", out)
    assert said.exit_code == 0, said.output
    assert "on the joints of the model; the reaction in" in said.output


def test_the_frame_rate_of_the_partner_by_name_leaves_the_partner_as_captured(
    captures: list[Path], tmp_path: Path
) -> None:
    said = pacmo(captures[0], "--rig", captures[1], "--to-fps", 30, "--out", tmp_path / "o.bvh")
    assert CLIP.fps == pytest.approx(30) and "o_0_A.bvh, as captured" in said.output


def test_a_rig_whose_root_has_an_offset_stands_on_the_same_floor(
    captures: list[Path], tmp_path: Path
) -> None:
    rig, found = tmp_path / "rig.bvh", {}
    for height in ("0", "97"):
        rig.write_text(t_pose().replace("OFFSET 0 0 0", f"OFFSET 0 {height} 0", 1))
        out = tmp_path / f"{height}.bvh"
        said = pacmo(captures[0], "--rig", rig, "--to-unit", "m", "--to-up", "z", "--out", out)
        assert said.exit_code == 0, said.output
        found[height] = read_bvh(tmp_path / f"{height}_0_B.bvh")
    np.testing.assert_allclose(found["97"].offsets[0], [0, 0, 0.97], atol=1e-6)
    np.testing.assert_allclose(found["97"].positions(), found["0"].positions(), atol=1e-5)
    wanted = from_y_up(0.01 * read_bvh(rig).offsets, "z")
    np.testing.assert_allclose(found["97"].offsets, wanted, atol=1e-6)


@pytest.mark.parametrize("given", [[], ["--to-unit", "m", "--to-up", "z"]])
def test_files_are_in_the_unit_and_axes_of_the_rig_or_those_that_are_stated(
    captures: list[Path], tmp_path: Path, given: list[str]
) -> None:
    rig = tmp_path / "rig.bvh"
    rig.write_text(t_pose(0.95, has_reference=True))
    for out in ("x.bvh", "x.parquet"):
        words = given if out == "x.bvh" else []
        said = pacmo(captures[0], "--rig", rig, *words, "--to-fps", 15, "--out", tmp_path / out)
        assert said.exit_code == 0, said.output
    made = read_reaction(tmp_path / "x.parquet")
    unit, up = (1.0, "z") if given else (0.01, "y")
    wanted = from_y_up(made.person_b, up)
    found = read_bvh(tmp_path / "x_0_B.bvh")
    assert found.joints[0] == "mixamorig:Reference"
    on_rig = model_joints(found, made.skeleton, unit)
    assert np.linalg.norm(on_rig - wanted, axis=-1).mean() < 0.02
    # At another rate the partner is on the joints of the model.
    partner = read_bvh(tmp_path / "x_0_A.bvh")
    assert set(made.skeleton.joints) <= set(partner.joints)


def test_a_file_says_which_joints_it_has_in_which_order(
    captures: list[Path], tmp_path: Path
) -> None:
    out = tmp_path / "x.parquet"
    assert pacmo(captures[0], "--out", out).exit_code == 0
    skeleton = json.loads(pl.read_parquet_metadata(out)["skeleton"])
    made = read_reaction(out)
    assert tuple(skeleton["joints"]) == made.skeleton.joints
    assert len(skeleton["parents"]) == made.person_b.shape[1]


def test_a_rig_that_does_not_fit_is_one_line(captures: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "out.bvh"
    rig = tmp_path / "rig.bvh"
    rig.write_text(t_pose().replace("LeftHand\n", "Q7\n").replace("RightHand\n", "Q8\n"))
    refused(pacmo(captures[0], "--rig", rig, "--out", out), "rig.bvh", "left_wrist", "right_wrist")
    hands = [("left", "Q7"), ("right", "Q8")]
    named = [
        word
        for side, joint in hands
        for point in ("wrist", "hand")
        for word in ("--joints", f"b={side}_{point}=mixamorig:{joint}")
    ]
    said = pacmo(captures[0], "--rig", rig, *named, "--out", out)
    assert said.exit_code == 0, said.output
    refused(pacmo(captures[0], "--rig", tmp_path / "none.bvh", "--out", out), "none.bvh")
    refused(pacmo(captures[0], "--rig", tmp_path / "ben.fbx", "--out", out), "ben.fbx", ".bvh")
    refused(pacmo(captures[0], "--rig", rig, "--no-finish", "--out", out), "--no-finish")
    refused(pacmo("--stream", "--rig", rig), "--rig")
    rig.write_text(t_pose().replace("3 Zrotation Xrotation Yrotation", "1 Xrotation"))
    text = rig.read_text().splitlines()
    rows = [" ".join(row.split()[: 6 + text.count("CHANNELS 1 Xrotation")]) for row in text[-2:]]
    rig.write_text("\n".join([*text[:-2], *rows, ""]))
    refused(pacmo(captures[0], "--rig", rig, "--out", out), "wanted three to write")


def test_a_rig_whose_joints_are_not_named_asks_for_words_of_the_rig(
    captures: list[Path], tmp_path: Path
) -> None:
    rig = tmp_path / "rig.bvh"
    rig.write_text(t_pose().replace("LeftUpLeg", "Q7"))
    said = pacmo(captures[0], "--rig", rig, "--out", tmp_path / "out.parquet")
    refused(said, "rig.bvh: ", "left_hip", "words of the rig begin with b=")


@pytest.mark.parametrize(
    ("option", "value", "fault"),
    [
        ("--joints", "mixamo", "left_wrist"),
        ("--from-unit", "cm", "a person of 0.01"),
        ("--from-fps", "soon", "--from-fps: wanted a number"),
    ],
)
def test_words_for_both_that_only_the_rig_refuses_are_said_to_take_a_prefix(
    captures: list[Path], tmp_path: Path, option: str, value: str, fault: str
) -> None:
    rig, words = tmp_path / "rig.bvh", [captures[0], "--out", tmp_path / "out.parquet", "--rig"]
    rig.write_text(t_pose(0.01).replace("LeftHand\n", "Q7\n").replace("RightHand\n", "Q8\n"))
    said = pacmo(*words, rig, option, value)
    hint = f"; {option} {value}: for partner and rig alike; {option} a={value} is for the partner"
    if value == "soon":  # of the partner too: the rig is not read
        refused(said, fault)
        assert hint not in said.stderr
        return
    refused(said, f"{rig}: ", fault, hint)
    assert hint not in pacmo(*words, rig, option, f"b={value}").stderr
    rig.write_text(t_pose(0.01))
    said = pacmo(*words, rig, option, f"a={value}")
    assert said.exit_code == 0, said.output


def test_a_sample_on_a_rig_has_the_same_bytes_however_many_there_are(
    captures: list[Path], tmp_path: Path
) -> None:
    anna, ben = captures
    for samples in (1, 3):
        out = tmp_path / f"x{samples}.bvh"
        said = pacmo(anna, "--rig", ben, "--samples", samples, "--out", out)
        assert said.exit_code == 0, said.output
    first = [(tmp_path / f"x{samples}_0_B.bvh").read_bytes() for samples in (1, 3)]
    assert first[0] == first[1]
    assert first[0] != (tmp_path / "x3_1_B.bvh").read_bytes()
