"""Truth: the published skeletons; bodies whose joints are known on two rigs; NITE's definitions."""

import json
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacmo_core.data.posture import CMU_UNIT
from pacmo_core.data.skeleton import (
    DUET15,
    EXPI18,
    INTERHUMAN22,
    NTU25,
    SBU15,
    Skeleton,
    mirror_by_name,
)
from pacmo_core.finish.turns import turned
from pacmo_core.formats.joint_names import (
    HAND_REACH,
    StatedNames,
    name_joints,
    parse_joints,
)
from pacmo_core.formats.registry import read_partner
from pacmo_core.formats.rigs import RIGS, fitting_rigs, plain_name, plain_names, rig_of_model
from tests.formats.real_files import real_folder
from tests.formats.rigged import mixamo, people

PUBLISHED = ("kinect25", "kinect15", "duetdance", "expi")
TIPS = ["left_hand_tip", "left_thumb", "right_hand_tip", "right_thumb"]
NTU21 = NTU25.without(TIPS)
SIDES = "UpLeg Leg Foot ToeBase Shoulder Arm ForeArm Hand"


def star(text: str) -> Skeleton:
    """Hang joints on the first."""
    joints = tuple(text.split())
    return Skeleton("star", joints, (-1, *[0] * (len(joints) - 1)), mirror_by_name(joints))


def both(words: str, left: str = "Left", right: str = "Right", prefix: str = "") -> str:
    return " ".join(f"{prefix}{side}{word}" for side in (left, right) for word in words.split())


def after(words: str, *sides: str) -> str:
    return " ".join(f"{word}{side}" for side in sides for word in words.split())


CAPTURES = {
    "mixamo": star("Hips Spine Spine1 Spine2 Neck Head " + both(SIDES)),
    "optitrack": star(
        "Bob_Hip Bob_Ab Bob_Chest Bob_Neck Bob_Head "
        + both("Thigh Shin Foot Toe Shoulder UArm FArm Hand", "L", "R", "Bob_")
    ),
    "optitrack_bvh": star("Hips Spine Spine1 Neck Head " + both(SIDES)),
    "cmu_bvh": star("Hips LowerBack Spine Spine1 Neck Neck1 Head " + both(f"{SIDES} FingerBase")),
    "smpl": star(
        "Pelvis Spine1 Spine2 Spine3 Neck Head "
        + both("Hip Knee Ankle Foot Collar Shoulder Elbow Wrist Hand", "L_", "R_")
    ),
    "unreal": star(
        "root pelvis spine_01 spine_02 spine_03 neck_01 head "
        + after("thigh calf foot ball clavicle upperarm lowerarm hand", "_l", "_r")
    ),
    "unreal5": star(
        "pelvis spine_01 spine_02 spine_03 spine_04 spine_05 neck_01 neck_02 head "
        + after("thigh calf foot ball clavicle upperarm lowerarm hand middle_01", "_l", "_r")
    ),
    "biped": star(
        "Bip01 Bip01_Pelvis Bip01_Spine Bip01_Spine1 Bip01_Neck Bip01_Head "
        + both("Thigh Calf Foot Toe0 Clavicle UpperArm Forearm Hand Finger2", "L_", "R_", "Bip01_")
    ),
    "blender": star(
        "spine spine.001 spine.002 spine.003 spine.004 spine.005 spine.006 "
        + after("pelvis thigh shin foot toe shoulder upper_arm forearm hand", ".L", ".R")
    ),
    "unity": star(
        "Hips Spine Chest Neck Head "
        + after("UpperLeg LowerLeg Foot Toes Shoulder UpperArm LowerArm Hand", "_L", "_R")
    ),
    "unity_upper_chest": star(
        "Hips Spine Chest UpperChest Neck Head "
        + both("UpperLeg LowerLeg Foot Toes Shoulder UpperArm LowerArm Hand")
    ),
    "biovision_bones": star(
        "Hips Chest Neck Head " + both("Collar UpArm LowArm Hand UpLeg LowLeg Foot")
    ),
    "biovision": star("Hips Chest Neck Head " + both("Collar Shoulder Elbow Wrist Hip Knee Ankle")),
    "xsens": star(
        "Hips Chest Chest2 Chest3 Chest4 Neck Head "
        + both("Collar Shoulder Elbow Wrist Hip Knee Ankle Toe")
    ),
    "kinect25": NTU25,
    "kinect15": SBU15,
    "duetdance": DUET15,
    "expi": EXPI18,
}


@pytest.mark.parametrize("name", CAPTURES)
def test_exactly_one_preset_fits_a_capture_of_its_rig(name: str) -> None:
    assert [rig.name for rig in fitting_rigs(plain_names(CAPTURES[name].joints))] == [name]


@pytest.mark.parametrize("name", [name for name in CAPTURES if name not in PUBLISHED])
def test_a_capture_of_a_programs_rig_has_every_joint_of_the_models(name: str) -> None:
    """The knee of the model is the joint of the capture between its thigh and its shin."""
    capture = CAPTURES[name]
    for model in (NTU21, SBU15):
        names = name_joints(capture, model, StatedNames(), estimates=True)
        np.testing.assert_allclose(names.weights.sum(axis=1), 1)
        for left, right in model.left_right:
            mirror = dict(capture.left_right) | {r: a for a, r in capture.left_right}
            mirrored = [mirror.get(joint, joint) for joint in range(len(capture.joints))]
            np.testing.assert_allclose(names.weights[left], names.weights[right][mirrored])
    bones = dict(
        zip(
            NTU21.joints,
            name_joints(capture, NTU21, StatedNames(), estimates=True).weights,
            strict=True,
        )
    )
    knee = capture.joints[int(bones["left_knee"].argmax())]
    assert bones["left_knee"].max() == 1
    assert any(word in knee.lower() for word in ("leg", "calf", "shin", "knee"))


def test_a_rig_with_more_than_mixamos_joints_is_said_to_have_them() -> None:
    more = star(
        "mixamorig:Hips mixamorig:Spine mixamorig:Spine1 mixamorig:Spine2 mixamorig:Spine3 "
        "mixamorig:Neck mixamorig:Head "
        + both(f"{SIDES} HandEnd HandThumb1", "Left", "Right", "mixamorig:")
    )
    said = name_joints(more, SBU15, StatedNames()).description
    assert said.startswith("joints named by the preset duo_mocap (mixamo's and more)")
    plain = name_joints(CAPTURES["mixamo"], SBU15, StatedNames()).description
    assert plain.startswith("joints named by the preset mixamo")
    assert "and more" not in plain


def test_names_are_compared_whatever_their_case_prefix_and_side() -> None:
    assert plain_name("mixamorig:LeftUpLeg") == plain_name("left_up_leg") == "leftupleg"
    assert plain_name("L_Hip") == plain_name("HipLeft") == plain_name("left hip") == "lefthip"
    assert plain_name("lowerback") == "lowerback"
    assert plain_names(["Sk_1_Hip", "Sk_1_L_Knee"]) == ["hip", "leftknee"]
    assert plain_name("Bip01 L UpperArm") == plain_name("upper_arm.L") == "leftupperarm"
    assert plain_names(["left_hip", "left_knee"]) == ["lefthip", "leftknee"]


def test_every_rig_names_each_joint_for_one_place() -> None:
    for rig in RIGS.values():
        for joint in rig.required:
            assert len(rig.points_of(joint)) <= 1, (rig.name, joint)


@pytest.mark.parametrize("prefix", ["", "mixamorig:", "mixamorig_", "Armature|mixamorig:"])
def test_a_mixamo_body_has_the_joints_of_kinect_where_they_are(prefix: str) -> None:
    clip = people()
    skeleton, (motion, _) = mixamo(clip, prefix)
    names = name_joints(skeleton, NTU21, StatedNames())
    found = names.apply(motion)
    at = {joint: i for i, joint in enumerate(NTU21.joints)}
    original = clip.person_a[:, clip.skeleton.indices(NTU21.joints)]
    for joint in (
        j for j in NTU21.joints if j not in ("left_hand", "right_hand", "spine_shoulder")
    ):
        np.testing.assert_allclose(found[:, at[joint]], original[:, at[joint]], atol=1e-5)
    shoulders = original[:, [at["left_shoulder"], at["right_shoulder"]]].mean(axis=1)
    np.testing.assert_allclose(found[:, at["spine_shoulder"]], shoulders, atol=1e-5)
    assert "preset mixamo" in names.description
    assert f"spine_shoulder = {prefix}LeftArm + {prefix}RightArm" in names.description


def test_what_a_rig_lacks_is_taken_from_near_only_where_a_line_says_so() -> None:
    names = name_joints(CAPTURES["mixamo"], NTU21, StatedNames())
    assert "put a third of the last bone beyond it: left_hand = LeftHand" in names.description
    np.testing.assert_allclose(names.weights.sum(axis=1), 1)
    at = dict(zip(NTU21.joints, names.weights, strict=True))
    hand, wrist, elbow = (at[f"left_{joint}"] for joint in ("hand", "wrist", "elbow"))
    np.testing.assert_allclose(hand - wrist, HAND_REACH * (wrist - elbow))


@pytest.mark.parametrize("words", [[], ["left_wrist=LeftForeArm"]], ids=["no wrist", "stated"])
def test_a_hand_at_the_wrist_is_not_said_to_be_beyond_it(words: list[str]) -> None:
    # SBU's model has no wrist, or the user names another joint for it.
    model = NTU21 if words else SBU15
    names = name_joints(CAPTURES["mixamo"], model, parse_joints(words))
    at = dict(zip(model.joints, names.weights, strict=True))
    np.testing.assert_array_equal(np.nonzero(at["left_hand"])[0],
                                  CAPTURES["mixamo"].indices(["LeftHand"]))  # fmt: skip
    assert "at the nearest joint: left_hand = LeftHand" in names.description
    beyond = "put a third of the last bone beyond it: right_hand = RightHand"
    assert (beyond in names.description) == bool(words)


def test_equal_names_need_no_preset_and_say_nothing() -> None:
    names = name_joints(NTU25, NTU21, StatedNames())
    assert names.description == ""
    motion = people().person_a
    np.testing.assert_array_equal(names.apply(motion), motion[:, NTU25.indices(NTU21.joints)])


def test_missing_joints_are_listed_with_the_nearest() -> None:
    with pytest.raises(ValueError, match="names no joint for 7 of the model's 21") as fault:
        name_joints(SBU15, NTU21, StatedNames())
    assert "left_wrist (nearest: left_elbow)" in str(fault.value)
    assert "--joints" in str(fault.value)
    assert "left_foot (its left_foot is the left_ankle)" in str(fault.value)
    with pytest.raises(ValueError, match="6 of the model's 21"):
        name_joints(EXPI18.without(["left_head"]), NTU21, StatedNames())


@pytest.mark.parametrize("capture", [SBU15, DUET15, EXPI18])
def test_joints_that_a_capture_lacks_are_estimated_within_some_centimetres(
    capture: Skeleton,
) -> None:
    """The default's bodies, seen in the joints of a capture that has fewer."""
    captured = people().person_a
    at = {joint: captured[:, i].astype(np.float64) for i, joint in enumerate(NTU25.joints)}
    seen = {joint: at.get(joint) for joint in capture.joints}
    seen |= {"neck": at["spine_shoulder"], "torso": at["spine_mid"], "pelvis": at["spine_base"]}
    seen |= {"back": at["spine_mid"], "head_front": at["head"]}
    for side in ("left", "right"):
        toe, ankle = at[f"{side}_foot"], at[f"{side}_ankle"]
        heel = ankle - 0.3 * (toe - ankle)
        heel[:, 1] = toe[:, 1]
        seen |= {f"{side}_head": at["head"], f"{side}_heel": heel, f"{side}_toe": toe}
        if capture is SBU15:
            seen[f"{side}_foot"] = ankle
    motion = np.stack([seen[joint] for joint in capture.joints], axis=1).astype(np.float32)
    names = name_joints(capture, NTU21, StatedNames(), estimates=True)
    assert "estimated from the joints around them: spine_base, spine_mid, neck" in names.description
    off = np.linalg.norm(names.apply(motion) - captured[:, NTU25.indices(NTU21.joints)], axis=-1)
    assert np.median(off, axis=0).max() < 0.07, off.mean(axis=0)
    np.testing.assert_allclose(names.weights.sum(axis=1), 1)


def test_joints_that_sbu_lacks_are_put_by_the_body_whichever_way_it_faces() -> None:
    body = np.zeros((2, 15, 3))
    rows = {joint: row for row, joint in enumerate(SBU15.joints)}
    for side, sign in (("left", 1), ("right", -1)):
        for joint, x, y in (("hip", 0.1, 0.9), ("foot", 0.1, 0.08), ("shoulder", 0.2, 1.4)):
            body[:, rows[f"{side}_{joint}"]] = sign * x, y, 0
        body[:, rows[f"{side}_elbow"]] = sign * 0.5, 1.4, 0
        body[:, rows[f"{side}_hand"]] = sign * 0.8, 1.4, 0
    body[:, rows["head"]] = 0, 1.7, 0
    names = name_joints(SBU15, NTU21, StatedNames(), estimates=True)
    for yaw in (0.0, 1.2):
        seen = names.apply(turned(body, np.full(2, yaw)).astype(np.float32))
        found = turned(seen.astype(np.float64), np.full(2, -yaw))[0]
        joint = dict(zip(NTU21.joints, found, strict=True))
        np.testing.assert_allclose(joint["left_foot"], [0.1, 0.04, 0.12], atol=1e-6)
        np.testing.assert_allclose(joint["right_wrist"], [-0.746, 1.4, 0], atol=1e-6)
        np.testing.assert_allclose(joint["spine_mid"], [0, 1.2, 0], atol=1e-6)


def test_names_can_be_stated_one_by_one_and_in_files(tmp_path: Path) -> None:
    capture = star("hub chest skull l_palm r_palm sole")
    model = star("root head hands")
    names = {"root": "hub", "head": "skull", "hands": ["l_palm", "r_palm"]}
    (tmp_path / "n.json").write_text(json.dumps(names))
    (tmp_path / "n.toml").write_text('root = "hub"\nhead = "skull"\nhands = ["l_palm", "r_palm"]\n')
    (tmp_path / "n.csv").write_text("# model,capture\nroot,hub\nhead,skull\nhands,l_palm,r_palm\n")
    wanted = np.array([[1, 0, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0], [0, 0, 0, 0.5, 0.5, 0]])
    words = ["root=hub", "head=skull", "hands=l_palm+r_palm"]
    for stated in (words, *([str(tmp_path / f"n.{kind}")] for kind in ("json", "toml", "csv"))):
        found = name_joints(capture, model, parse_joints(stated))
        np.testing.assert_array_equal(found.weights, wanted)
    # A word overrides the preset.
    hand = parse_joints(["mixamo", "left_hand=LeftShoulder"])
    row = name_joints(CAPTURES["mixamo"], NTU21, hand).weights[NTU21.joints.index("left_hand")]
    assert row[CAPTURES["mixamo"].joints.index("LeftShoulder")] == 1


@pytest.mark.parametrize(
    ("words", "texts"),
    [
        (["mixamo", "smpl"], "one preset"),
        (["maya"], "no preset of joints 'maya'"),
        (["tail=Tail"], "the model has no joint 'tail'"),
        (["head=Skull"], "the capture has no joint 'Skull'"),
    ],
)
def test_what_is_stated_wrongly_is_refused(words: list[str], texts: str) -> None:
    with pytest.raises(ValueError, match=texts):
        name_joints(CAPTURES["mixamo"], NTU21, parse_joints(words))


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("n.json", "[1]"),
        ("n.json", "{"),
        ("n.json", '{"a": 1}'),
        ("n.toml", "a = "),
        ("n.csv", "left_hand\n"),
    ],
)
def test_a_file_that_is_no_mapping_is_refused_by_name(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(ValueError, match=name):
        parse_joints([str(tmp_path / name)])


def test_smpl_has_every_joint_of_interhuman_and_the_other_way_round() -> None:
    assert rig_of_model(plain_names(INTERHUMAN22.joints)) is RIGS["smpl"]
    assert name_joints(CAPTURES["smpl"], INTERHUMAN22, StatedNames()).description


def test_the_neck_and_torso_of_the_first_kinect_are_the_mid_points_of_the_preset() -> None:
    file = min(real_folder("sbu").rglob("skeleton_pos.txt"))
    person = read_partner(file, "sbu", {}, person="a", clip="")
    renamed = star(" ".join("x" + joint for joint in SBU15.joints))
    joints = {joint: (f"x{joint}",) for joint in SBU15.joints}
    joints["neck"] = ("xleft_shoulder", "xright_shoulder")
    joints["torso"] = ("xleft_shoulder", "xright_shoulder", "xleft_hip", "xright_hip")
    found = name_joints(renamed, SBU15, StatedNames(joints=joints)).apply(person.motion)
    far = np.linalg.norm(found - person.motion, axis=-1)
    assert np.median(far[:, SBU15.joints.index("neck")]) < 1e-3
    assert np.median(far[:, SBU15.joints.index("torso")]) < 5e-3


@pytest.mark.parametrize(
    ("folder", "pattern", "form", "settings"),
    [
        ("handover", "*.npz", "table", {}),
        ("duo_mocap", "salsa/*.bvh", "bvh", {"preset": "duo_mocap"}),
        ("cmu_18_19", "18_19_rory/*.bvh", "bvh", {"preset": "cmu_18_19"}),
        ("cmu_raw", "*.amc", "cmu", {}),
        ("cmu_raw", "18_01.bvh", "bvh", {"unit": CMU_UNIT, "up": "y"}),
    ],
)
def test_real_captures_of_five_rigs_have_the_joints_of_kinect_near_a_body(
    folder: str, pattern: str, form: str, settings: dict[str, object]
) -> None:
    file = min(real_folder(folder).glob(pattern))
    who = "b" if form == "table" else None
    person = read_partner(file, form, settings, person=who, clip="")
    # Of equal names, those of ``cmu`` are at the other end of the bone.
    stated = StatedNames("cmu_bones" if form == "bvh" and "unit" in settings else "")
    found = name_joints(person.skeleton, NTU21, stated).apply(person.motion)
    at = {joint: i for i, joint in enumerate(NTU21.joints)}
    lengths = {
        bone: float(np.median(np.linalg.norm(found[:, at[a]] - found[:, at[b]], axis=-1)))
        for bone, a, b in (
            ("thigh", "left_hip", "left_knee"),
            ("shin", "left_knee", "left_ankle"),
            ("upper arm", "left_shoulder", "left_elbow"),
            ("forearm", "left_elbow", "left_wrist"),
            ("trunk", "spine_base", "spine_shoulder"),
        )
    }
    assert all(0.18 < length < 0.6 for length in lengths.values()), lengths
    # The spine is in order, and the head above it.
    spine = [at[j] for j in ("spine_base", "spine_mid", "spine_shoulder", "head")]
    heights = np.median(found[:, spine, 1], axis=0)
    assert (np.diff(heights) > 0.04).all(), heights


def test_a_rig_without_what_the_model_does_not_need_is_taken_if_it_is_the_only_one() -> None:
    toeless = CAPTURES["mixamo"].without(["LeftToeBase", "RightToeBase"])
    assert fitting_rigs(plain_names(toeless.joints)) == []
    assert "preset mixamo" in name_joints(toeless, SBU15, StatedNames()).description
    # Two presets that know as many of its joints, and put the spine elsewhere.
    spine = NTU21.without([j for j in NTU21.joints if j not in ("spine_base", "spine_mid", "head")])
    few = star("Hips Spine Spine1 Head")
    with pytest.raises(ValueError, match="all fit the capture's joints; name one by --joints"):
        name_joints(few, spine, StatedNames())
    assert name_joints(few, spine, StatedNames("mixamo")).weights.shape == (3, 4)


@given(content=st.binary(max_size=80), kind=st.sampled_from(["json", "toml", "csv"]))
def test_any_file_is_a_mapping_or_refused(
    content: bytes, kind: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    file = tmp_path_factory.mktemp("names") / f"n.{kind}"
    file.write_bytes(content)
    with suppress(ValueError):  # any other error fails
        found = parse_joints([str(file)]).joints
        assert found
        assert all(isinstance(part, str) for parts in found.values() for part in parts)


@pytest.mark.parametrize(("kind", "text"), [("json", "[" * 100_000), ("toml", "a=" + "[" * 9999)])
def test_a_file_of_many_levels_is_refused(tmp_path: Path, kind: str, text: str) -> None:
    (tmp_path / f"n.{kind}").write_text(text)
    with pytest.raises(ValueError, match="no mapping of joints"):
        parse_joints([str(tmp_path / f"n.{kind}")])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["left_hand=RightHand"], "left_hand and right_hand would both be RightHand"),
        (["left_hand=LeftUpLeg"], "left_hand and left_hip would both be LeftUpLeg"),
        (["left_hand=LeftHand", "left_hand=LeftArm"], "left_hand is stated twice, .* as LeftArm"),
    ],
)
def test_names_that_contradict_each_other_are_refused(words: list[str], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        name_joints(CAPTURES["mixamo"], SBU15, parse_joints(words))
