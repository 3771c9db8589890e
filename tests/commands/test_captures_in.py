"""Captures of other rigs, units, axes and rates in every command. Truth: the same clip as it is."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from pacmo_core.api import save, synthesise, train
from pacmo_core.commands.captures import rate_text
from pacmo_core.commands.cli import app
from pacmo_core.commands.reading import ReadOptions, parse_unit, words_of
from pacmo_core.commands.view import read_named_clips
from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.skeleton import INTERHUMAN22, NTU25, Skeleton
from pacmo_core.formats.bvh import read_bvh
from pacmo_core.formats.joint_names import name_joints, parse_joints
from pacmo_core.formats.resample import from_y_up, resample
from pacmo_core.formats.write_bvh import format_bvh
from pacmo_core.project.workspace import CommandError
from pacmo_core.store.motions import stream_motions, write_motions
from tests.formats.real_files import real_folder
from tests.formats.rigged import mixamo, people
from tests.skeleton_prior.examples import START

TIPS = ["left_hand_tip", "left_thumb", "right_hand_tip", "right_thumb"]
CLIP = people().frames(60, 90)  # both are near each other, where the floor seems one


def pacmo(*words: object) -> Result:
    return CliRunner().invoke(app, [*map(str, words)])


def refused(said: Result, *texts: str) -> None:
    assert said.exit_code == 1, said.output
    assert said.stderr.count("\n") == 1
    for text in texts:
        assert text in said.stderr


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Train a model of Kinect's joints for an instant."""
    clips = [clip.without(TIPS) for clip in synthesise(4).values()]
    folder = tmp_path_factory.mktemp("weights")
    return save("regression", train("regression", clips, n_epochs=1, width=4), folder / "w")


def write(
    file: Path, skeleton: Skeleton, motion: Motion, unit: float = 0.01, up: str = "y"
) -> Path:
    in_units = (from_y_up(motion, up) / unit).astype(np.float32)
    file.write_text(format_bvh(in_units, 30, skeleton))
    return file


@pytest.fixture
def pair(tmp_path: Path) -> list[Path]:
    """Write two people on Mixamo's joints, in centimetres, y up."""
    skeleton, motions = mixamo(CLIP)
    return [
        write(tmp_path / f"duo_{name}.bvh", skeleton, motion)
        for name, motion in zip("AB", motions, strict=True)
    ]


def reaction(out: Path) -> Interaction:
    ((_, made),) = stream_motions(out)
    return made


def test_react_takes_mixamo_in_centimetres_and_says_what_it_found(
    pair: list[Path], weights: Path, tmp_path: Path
) -> None:
    out = tmp_path / "o.parquet"
    said = pacmo("react", pair[0], "--weights", weights, "--out", out)
    assert said.exit_code == 0, said.output
    assert f"inferred for {pair[0]} (1." in said.stdout
    assert "centimetres, y up; --from-unit and --from-up override" in said.stdout
    assert "preset mixamo; mid-points: left_hand = " in said.stdout
    made = reaction(out)
    at = NTU25.without(TIPS)
    elbow = made.person_a[:, at.joints.index("left_elbow")]
    far = np.linalg.norm(elbow - CLIP.person_a[:, NTU25.joints.index("left_elbow")], axis=-1)
    assert np.median(far) < 0.05  # the file has constant bones


def test_react_writes_in_the_unit_and_axes_asked_for(
    pair: list[Path], weights: Path, tmp_path: Path
) -> None:
    words = ["react", pair[0], "--weights", weights, "--out"]
    said = [
        pacmo(*words, tmp_path / f"{name}.bvh", *more).stdout
        for name, more in (("m", []), ("cm", ["--to-unit", "cm", "--to-up", "z"]))
    ]
    moved = [re.findall(r"off by ([\d.]+) mm on average", text) for text in said]
    assert float(moved[1][0]) == pytest.approx(float(moved[0][0]), abs=0.2)
    plain, other = (read_bvh(tmp_path / f"{name}_0_B.bvh").positions() for name in ("m", "cm"))
    x, y, z = np.moveaxis(100 * plain, -1, 0)
    np.testing.assert_allclose(other, np.stack([x, -z, y], axis=-1), atol=0.5)
    refused(pacmo(*words, tmp_path / "o.parquet", "--to-unit", "cm"), "always metres")
    refused(pacmo(*words, tmp_path / "o.bvh", "--to-unit", "ell"), "--to-unit", "ell")


def test_two_people_of_two_rigs_units_and_axes_meet(pair: list[Path], tmp_path: Path) -> None:
    other = write(tmp_path / "kinect.bvh", NTU25, CLIP.person_b, 0.0254, "z")
    scale = ["--b-scale", "left_forearm=1.1", "--out", tmp_path / "out"]
    told = ["--from-unit", "a=0.01", "--from-unit", "b=in", "--from-up", "y", "--from-up", "b=z"]
    said = pacmo("augment", pair[0], other, *told, *scale)
    assert said.exit_code == 0, said.output
    assert "inferred" not in said.stdout
    guessed = pacmo("augment", pair[0], other, *scale)
    assert guessed.exit_code == 0, guessed.output
    assert "inches, z up" in guessed.stdout
    assert "centimetres, y up" in guessed.stdout
    # As one file says of itself, so it is written.
    source, result = (read_bvh(f).positions() for f in (other, tmp_path / "out" / "kinect.bvh"))
    np.testing.assert_allclose(result[:, 0], source[:, 0], atol=3)


def test_two_people_of_two_formats_meet_and_each_takes_the_options_of_its_own(
    pair: list[Path], tmp_path: Path
) -> None:
    skeleton, (_, motion) = mixamo(CLIP)
    person_b = name_joints(skeleton, INTERHUMAN22, parse_joints([])).apply(motion)
    other = tmp_path / "b.npy"
    np.save(other, from_y_up(person_b, "z").reshape(len(motion), -1))
    (named,) = read_named_clips([f"{pair[0]}+{other}"], ReadOptions(unit=["cm"], preset="pair"))
    scene = named.scene
    assert scene.other == INTERHUMAN22
    assert np.ptp(scene.people[0][0, :, 1]) == pytest.approx(1.6, abs=0.4)
    np.testing.assert_allclose(scene.people[1], person_b, atol=1e-5)
    words = ["augment", pair[0], other, "--b-scale", "left_forearm=1.1", "--from-unit", "cm"]
    said = pacmo(*words, "--out", tmp_path / "out")
    assert said.exit_code == 0, said.output
    # As the BVH file was; metres where the file is of another format.
    sizes = [np.ptp(read_bvh(file).positions()[0, :, 1])
             for file in sorted((tmp_path / "out").glob("*.bvh"))]  # fmt: skip
    assert sizes == pytest.approx([160, 1.6], rel=0.25)
    export = ["export", f"{pair[0]}+{other}", "--out", tmp_path / "x.npz"]
    refused(pacmo(*export), "different skeletons", ".npz holds one", ".bvh, .glb")
    for name in ("x.glb", "x.bvh"):
        said = pacmo(*export[:2], "--out", tmp_path / name)
        assert said.exit_code == 0, said.output
    a, b = (read_bvh(tmp_path / f"x_{person}.bvh") for person in "AB")
    assert "mixamorig:LeftArm" in a.joints
    assert set(INTERHUMAN22.joints) <= set(b.joints)
    content = (tmp_path / "x.glb").read_bytes()
    document = json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")])
    nodes = document["nodes"]
    names = [[nodes[joint]["name"] for joint in skin["joints"]] for skin in document["skins"]]
    assert [len(of_person) for of_person in names] == [len(skeleton.joints), 22]
    assert all(name.startswith("b_") for name in names[1])
    assert nodes[document["skins"][1]["skeleton"]]["name"] == "person_b"
    refused(pacmo("view", pair[0], other, "--from-unit", "ell"), "--from-unit", "ell")


@pytest.mark.parametrize("command", ["view", "react", "augment", "vary", "export"])
def test_a_unit_or_an_axis_that_makes_no_person_is_refused_in_every_command(
    command: str, pair: list[Path], weights: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    skeleton, (motion, _) = mixamo(people())
    walk = 0.3 * np.sin(np.arange(len(motion)) / 20)[:, None, None] * np.array([0.0, 0.0, 1.0])
    walks = [write(file, skeleton, (motion + walk).astype(np.float32)) for file in pair]
    files = {
        "view": ["--no-open", "+".join(map(str, walks))],
        "export": ["+".join(map(str, walks)), "--out", "x.npz"],
        "react": [walks[0], "--weights", weights, "--out", "x.bvh"],
        "vary": [*walks, "--weights", prior(tmp_path), "--out", "varied"],
        "augment": [*walks, "--b-scale", "uniform=0.9", "--out", "varied"],
    }[command]
    before = sorted(tmp_path.iterdir())
    refused(pacmo(command, *files, "--from-unit", 1), "duo_A.bvh", "a person of 1", "0.01 times")
    refused(
        pacmo(command, *files, "--from-up", "z"),
        "duo_A.bvh",
        "z was taken for up, but",
        "is along y",
    )
    assert sorted(tmp_path.iterdir()) == before


def prior(folder: Path) -> Path:
    """Write an untrained skeleton prior of Kinect's joints."""
    import torch  # noqa: PLC0415

    from pacmo_core.models import build_skeleton_prior  # noqa: PLC0415
    from pacmo_core.skeleton_prior.kinematics import find_limbs  # noqa: PLC0415
    from pacmo_core.skeleton_prior.layers import initialise_weights  # noqa: PLC0415
    from pacmo_core.skeleton_prior.settings import PriorConfig  # noqa: PLC0415
    from pacmo_core.store.weights import write_weights  # noqa: PLC0415
    from pacmo_core.training.state import model_config, model_state  # noqa: PLC0415

    clip = CLIP.without(TIPS)
    limbs = find_limbs(clip.skeleton, clip.person_a)
    model = build_skeleton_prior(PriorConfig(clip.skeleton, limbs, "kinematic", 16, 3, 30.0, START))
    initialise_weights(model, torch.Generator().manual_seed(0))
    facts = {"model": "kinematic", "config": model_config(model)}
    write_weights(folder / "prior", facts, model_state(model))
    return folder / "prior"


def test_vary_takes_two_rigs_and_writes_the_joints_of_the_model(
    pair: list[Path], tmp_path: Path
) -> None:
    kinect = write(tmp_path / "kinect.bvh", NTU25, CLIP.person_b)
    words = ["vary", pair[0], kinect, "--weights", prior(tmp_path), "--out", tmp_path / "varied"]
    said = pacmo(*words, "--b-scale", "left_forearm=1.2")
    assert said.exit_code == 0, said.output
    assert "duo_A.bvh: joints named by the preset mixamo" in said.stdout
    assert "kinect.bvh: joints" not in said.stdout
    for name in ("duo_A.bvh", "kinect.bvh"):
        written = read_bvh(tmp_path / "varied" / name)
        assert {"spine_base", "left_hand"} <= set(written.joints)
        assert abs(written.positions()).max() < 10  # metres
    assert "written with the joints of the model" in said.stdout
    assert "on no rig of the capture, in metres, y up (--to-unit, --to-up)" in said.stdout
    plain = read_bvh(tmp_path / "varied" / "duo_A.bvh").positions()
    other = pacmo(*words, "--b-scale", "left_forearm=1.2", "--to-unit", "cm", "--to-up", "z")
    assert "in centimetres, z up" in other.stdout
    x, y, z = np.moveaxis(100 * plain, -1, 0)
    in_cm = read_bvh(tmp_path / "varied" / "duo_A.bvh").positions()
    np.testing.assert_allclose(in_cm, np.stack([x, -z, y], axis=-1), atol=0.5)
    stated = pacmo(*words, "--joints", "a=mixamo", "--joints", "b=kinect25")
    assert stated.exit_code == 0, stated.output
    refused(pacmo(*words, "--joints", "mixamo"), "kinect.bvh", "names no joint for")


def test_files_on_the_rig_of_the_capture_take_no_other_unit(
    pair: list[Path], tmp_path: Path
) -> None:
    words = ["augment", *pair, "--b-scale", "left_forearm=1.2", "--out"]
    said = pacmo(*words, tmp_path / "same")
    assert "written on the rig of the capture, in its unit and axes" in said.stdout
    refused(pacmo(*words, tmp_path / "x", "--to-unit", "m"), "in its unit and axes", "leave out")
    refused(pacmo(*words, tmp_path / "x.parquet", "--to-up", "z"), "always metres, y up")


def test_joints_that_a_rig_lacks_are_named_by_the_user(weights: Path, tmp_path: Path) -> None:
    skeleton, (motion, _) = mixamo(CLIP)
    odd = replace(skeleton, joints=tuple(j.replace("Leg", "Limb") for j in skeleton.joints))
    file = write(tmp_path / "odd.bvh", odd, motion)
    words = ["react", file, "--weights", weights, "--from-unit", "cm", "--from-up", "y"]
    words += ["--out", tmp_path / "o.bvh"]
    refused(pacmo(*words), "odd.bvh", "left_hip (nearest", "--joints")
    names = {"left_hip": "mixamorig:LeftUpLimb", "left_knee": "mixamorig:LeftLimb"}
    (tmp_path / "names.json").write_text(json.dumps(names))
    stated = ["--joints", "mixamo", "--joints", tmp_path / "names.json"]
    stated += ["--joints", "right_hip=mixamorig:RightUpLimb"]
    refused(pacmo(*words, *stated), "for 1 of the model's 21", "right_knee")
    said = pacmo(*words, *stated, "--joints", "right_knee=mixamorig:RightLimb")
    assert said.exit_code == 0, said.output


def test_people_of_two_rates_meet_at_the_lower(pair: list[Path], tmp_path: Path) -> None:
    skeleton, (_, motion) = mixamo(CLIP)
    times = np.arange(len(motion)) / 30
    fast = resample(motion, times, np.arange(4 * len(motion) - 3) / 120)
    (tmp_path / "fast.bvh").write_text(format_bvh((100 * fast).astype("f4"), 120, skeleton))
    both = [f"{pair[0]}+{file}" for file in (pair[1], tmp_path / "fast.bvh")]
    for word, name in zip(both, ("same", "fast"), strict=True):
        said = pacmo("export", word, "--out", tmp_path / f"{name}.npz")
        assert said.exit_code == 0, said.output
    assert "30 and 120 frames a second: both at 30" in said.stdout
    stated = {"0.0333333": "30", "0.033333": "30", "0.008333": "120", "0.0083417": "119.88",
              "0.016667": "60", "0.0333667": "29.97", "0.041708": "23.9762"}  # fmt: skip
    for frame_time, rate in stated.items():
        assert rate_text(1 / float(frame_time)).startswith(rate)
    with np.load(tmp_path / "same.npz") as same, np.load(tmp_path / "fast.npz") as other:
        np.testing.assert_allclose(other["person_b"], same["person_b"], atol=1e-2)
    # A rate that is stated for one.
    told = ["--from-fps", "b=30", "--out", tmp_path / "x.npz"]
    refused(pacmo("export", both[1], *told), "30 frames of one, 117 of the other")


def test_an_option_that_a_format_does_not_take_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x.skeleton").write_text("1\n")
    words = ["export", tmp_path / "x.skeleton", "--out", tmp_path / "x.npz"]
    refused(pacmo(*words, "--from-unit", "cm"), "captures of format ntu take no --from-unit")


def test_words_are_for_both_people_or_for_one() -> None:
    options = ReadOptions(unit=["cm", "b=0.5"], up=["a=z"])
    assert options.settings("bvh", "a") == {"unit": 0.01, "up": "z"}
    assert options.settings("bvh", "b") == {"unit": 0.5}
    assert words_of(["mixamo", "a=left_hand=X", "b=n.json", "neck=Y"], "a") == [
        "mixamo", "left_hand=X", "neck=Y",
    ]  # fmt: skip
    assert [parse_unit(word, "--to-unit") for word in ("m", "cm", "mm", "in", "2")] == [
        1, 0.01, 0.001, 0.0254, 2,
    ]  # fmt: skip
    with pytest.raises(CommandError, match="one value a person"):
        ReadOptions(unit=["1", "2"]).settings("bvh", "a")


@pytest.mark.parametrize(
    ("command", "option"),
    [(c, o) for c in ("react", "vary", "augment", "view", "export") for o in ("unit", "up", "fps")]
    + [("react", "partner-fps")],
)
def test_the_names_of_options_before_are_gone_and_the_new_are_everywhere(
    command: str, option: str
) -> None:
    said = pacmo(command, "--help").stdout
    assert f" --{option} " not in said
    assert f"--from-{option.removeprefix('partner-')}" in said
    if command in ("react", "export"):
        assert f"--to-{option.removeprefix('partner-')}" in said


def test_clips_of_the_store_take_no_options_of_files(weights: Path, tmp_path: Path) -> None:
    with write_motions(tmp_path / "m.parquet", NTU25) as writer:
        writer.add("one", CLIP)
    words = ["react", tmp_path / "m.parquet", "--clip", "one", "--person", "a"]
    words += ["--weights", weights, "--out", tmp_path / "o.bvh"]
    assert pacmo(*words).exit_code == 0
    refused(pacmo(*words, "--from-up", "y"), "no option of other formats")


def lying(motion: Motion) -> Motion:
    """Lay a person down: the trunk along z, the head first."""
    x, y, z = np.moveaxis(motion - motion[:, :1].min(axis=(0, 1)), -1, 0)
    return np.stack([x, -z, y], axis=-1).astype(np.float32)


@pytest.mark.parametrize("command", ["augment", "view", "export"])
def test_a_person_who_lies_beside_one_who_stands_is_not_stood_up(
    pair: list[Path], tmp_path: Path, command: str
) -> None:
    skeleton, (_, motion) = mixamo(CLIP)
    write(pair[1], skeleton, lying(motion))
    words: list[object] = [pair[0], pair[1], "--b-scale", "left_forearm=1.1", "--out", "o"]
    if command != "augment":
        words = [f"{pair[0]}+{pair[1]}", "--out", tmp_path / "o.glb"]
    said = pacmo(command, *words)
    refused(said, "different axes", f"y for {pair[0]}", f"z for {pair[1]}", "give --from-up")
    refused(pacmo(command, *words, "--from-up", "a=y"), "different axes", "give --from-up")


def test_of_two_rigs_each_has_the_axis_of_its_program(pair: list[Path], tmp_path: Path) -> None:
    # Which of two rigs has which axis is no question of who lies, whatever is stated of one.
    kinect = write(tmp_path / "kinect.bvh", CLIP.skeleton, CLIP.person_b, up="z")
    told = ["--from-unit", "a=cm", "--from-up", "a=y"]
    said = pacmo("export", f"{pair[0]}+{kinect}", *told, "--out", tmp_path / "o.glb")
    assert said.exit_code == 0, said.output
    assert f"inferred for {kinect}" in said.stdout and "z up" in said.stdout


def test_of_one_rig_that_is_stated_in_full_a_second_axis_is_still_refused(
    pair: list[Path], tmp_path: Path
) -> None:
    skeleton, (_, motion) = mixamo(CLIP)
    write(pair[1], skeleton, lying(motion))
    told = ["--from-unit", "a=cm", "--from-up", "a=y"]
    said = pacmo("export", f"{pair[0]}+{pair[1]}", *told, "--out", tmp_path / "o.glb")
    refused(said, "different axes", f"y for {pair[0]}", f"z for {pair[1]}", "give --from-up")


def test_a_person_who_lies_is_read_with_the_axis_that_is_told(
    pair: list[Path], tmp_path: Path
) -> None:
    skeleton, (_, motion) = mixamo(CLIP)
    write(pair[1], skeleton, lying(motion))
    out = tmp_path / "o.npz"
    said = pacmo("export", f"{pair[0]}+{pair[1]}", "--from-up", "y", "--out", out)
    assert said.exit_code == 0, said.output
    table = dict(np.load(out))
    joints = table["joints"].tolist()
    spine = table["person_b"][:, joints.index("mixamorig:Neck")] - table["person_b"][:, 0]
    assert (np.abs(spine[:, 2]) > 2 * np.abs(spine[:, 1])).all()


@pytest.mark.parametrize(
    ("preset", "hint"),
    [("mixamo", "--joints mixamo"), ("Kinect", "--joints kinect15 or kinect25"), ("fbx", "")],
)
def test_a_rig_is_no_preset_of_files(pair: list[Path], preset: str, hint: str) -> None:
    said = pacmo("view", f"{pair[0]}+{pair[1]}", "--preset", preset)
    refused(said, "--preset: wanted one of ", f"got {preset!r}", hint)
    assert ("a rig" in said.stderr) == bool(hint)


def test_a_stream_takes_no_options_of_files(weights: Path) -> None:
    said = pacmo("react", "--weights", weights, "--stream", "--clip", "x", "--from-unit", "cm")
    refused(said, "--stream reads frames", "leave out --clip, --from-unit")


def test_captures_of_sbu_are_named_by_their_folders(weights: Path, tmp_path: Path) -> None:
    file = min(real_folder("sbu").rglob("skeleton_pos.txt"))
    out = tmp_path / "o.parquet"
    words = [file, "--format", "sbu", "--person", "a", "--weights", weights, "--out", out]
    said = pacmo("react", *words)
    assert said.exit_code == 0, said.output
    assert list(dict(stream_motions(out))) == ["_".join(file.parts[-4:-1]) + "#0000"]
