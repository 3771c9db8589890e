"""Truth: files of bodies whose unit and axes are known."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pacmo_core.data.posture import CMU_UNIT
from pacmo_core.formats.base import to_y_up
from pacmo_core.formats.bvh_pairs import BvhPairs
from pacmo_core.formats.inference import implausible, infer_settings, states_unit_or_axis
from pacmo_core.formats.joint_names import UNSTATED, StatedNames
from pacmo_core.formats.ntu import Ntu
from pacmo_core.formats.registry import read_partner
from pacmo_core.formats.resample import from_y_up
from pacmo_core.formats.table import Table
from pacmo_core.formats.write_bvh import format_bvh
from pacmo_core.formats.write_tables import PEOPLE
from tests.formats.real_files import real_folder
from tests.formats.rigged import mixamo, people

CLIP = people()


def write_bvh(file: Path, unit: float, up: str) -> Path:
    file.write_text(
        format_bvh((from_y_up(CLIP.person_a, up) / unit).astype(np.float32), 30, CLIP.skeleton)
    )
    return file


@pytest.mark.parametrize(("unit", "up"), [(1.0, "z"), (0.01, "y"), (0.001, "z"), (0.0254, "y")])
def test_a_bvh_file_gets_what_it_does_not_state(tmp_path: Path, unit: float, up: str) -> None:
    file = write_bvh(tmp_path / "x.bvh", unit, up)
    found = infer_settings(file, "bvh", {})
    assert found.settings == {"unit": unit, "up": up}
    assert found.stature == pytest.approx(1.6, abs=0.3)
    assert infer_settings(file, "bvh", {"unit": 1.0}).settings == {"up": up}
    assert infer_settings(file, "bvh", {"preset": "duo_mocap"}).settings == {}
    person = read_partner(file, "bvh", found.settings, person=None, clip="")
    rows = person.skeleton.indices(CLIP.skeleton.joints)
    far = np.linalg.norm(person.motion[:, rows] - CLIP.person_a, axis=-1)
    assert np.median(far) < 0.05  # constant bones


def test_a_table_gets_what_it_lacks(tmp_path: Path) -> None:
    arrays = dict(zip(PEOPLE, (100 * CLIP.person_a, 100 * CLIP.person_b), strict=True))
    facts = {"joints": CLIP.skeleton.joints, "parents": CLIP.skeleton.parents, "fps": 30}
    np.savez(tmp_path / "x.npz", **arrays, **facts)
    assert infer_settings(tmp_path / "x.npz", "table", {}).settings == {"unit": 0.01, "up": "y"}
    np.savez(tmp_path / "y.npz", **arrays, **facts, unit=0.01, up="y")
    assert infer_settings(tmp_path / "y.npz", "table", {}).settings == {}


def test_a_body_that_is_not_recognised_shows_nothing(tmp_path: Path) -> None:
    facts = {"joints": ["hub", "head"], "parents": [-1, 0], "fps": 30}
    np.savez(tmp_path / "x.npz", person_a=np.ones((5, 2, 3)), **facts)
    found = infer_settings(tmp_path / "x.npz", "table", {})
    assert found.settings == {"unit": None, "up": None}


def test_cmu_files_are_in_the_unit_of_cmu() -> None:
    file = real_folder("cmu_raw") / "cmu_60_01.bvh"
    found = infer_settings(file, "bvh", {})
    assert found.settings == {"unit": CMU_UNIT, "up": "y"}


def test_other_joints_may_be_in_the_unit_of_cmu_too_where_inches_make_a_toddler(
    tmp_path: Path,
) -> None:
    skeleton, (a, _) = mixamo(CLIP)
    for unit, wanted in ((CMU_UNIT, CMU_UNIT), (0.0254, 0.0254), (0.01, 0.01)):
        file = tmp_path / "x.bvh"
        file.write_text(format_bvh((a / unit).astype(np.float32), 30, skeleton))
        assert infer_settings(file, "bvh", {}).settings == {"unit": wanted, "up": "y"}


# Mixamo's joints by the bones of CMU that begin there; and hips that have the name of a shin.
BONES = {"Hips": "hip", "Spine1": "thorax", "Neck": "upperneck", "Head": "head"} | {
    f"{Side}{joint}": f"{side}{bone}"
    for Side, side in (("Left", "l"), ("Right", "r"))
    for joint, bone in (
        *(("UpLeg", "femur"), ("Leg", "tibia"), ("Foot", "foot"), ("ToeBase", "toes")),
        *(("Arm", "humerus"), ("ForeArm", "radius"), ("Hand", "wrist"), ("HandMiddle1", "fingers")),
    )
}
SHINS = {"LeftUpLeg": "LeftShinTop", "RightUpLeg": "RightShinTop"}
HIPS = {"left_hip": ("LeftShinTop",), "right_hip": ("RightShinTop",)}


@pytest.mark.parametrize(
    ("renamed", "stated"),
    [(BONES, StatedNames("cmu_bones")), (SHINS, StatedNames("", HIPS))],
)
def test_the_stature_is_that_of_the_joints_by_their_stated_names(
    tmp_path: Path, renamed: dict[str, str], stated: StatedNames
) -> None:
    skeleton, (a, _) = mixamo(CLIP, prefix="")
    joints = tuple(renamed.get(joint, joint) for joint in skeleton.joints)
    file = tmp_path / "x.bvh"
    file.write_text(format_bvh(a, 30, skeleton))
    right = infer_settings(file, "bvh", {}).stature
    assert right is not None
    file.write_text(format_bvh(a, 30, replace(skeleton, joints=joints)))
    wrong, found = (infer_settings(file, "bvh", {}, names) for names in (UNSTATED, stated))
    assert wrong.stature is not None and wrong.stature < 0.8 * right
    assert found.stature == pytest.approx(right, abs=1e-3)
    unnamed = infer_settings(file, "bvh", {}, StatedNames("kinect25"))
    assert unnamed.stature == wrong.stature  # names of another rig tell nothing


def test_a_person_whom_a_wrong_unit_makes_is_found_with_a_unit_that_would_not() -> None:
    skeleton, (a, b) = mixamo(CLIP)
    up = ["y", "y"]
    assert implausible([(skeleton, a), (skeleton, b)], up) is None
    inches = b / np.float32(0.0254)
    number, reason = implausible([(skeleton, a), (skeleton, inches)], up) or (-1, "")
    assert number == 1
    assert "wanted 0.5 to 2.6 m; 0.0254 times the unit would give" in reason
    _, reason = implausible([(skeleton, a * np.float32(0.01))], ["y"]) or (-1, "")
    assert "a person of 0.0" in reason


def test_someone_who_is_carried_by_an_upright_person_is_no_fault() -> None:
    skeleton, (a, b) = mixamo(CLIP)
    # As of a wrong axis: what is upright lies, and walks along what is taken for up.
    walk = 0.2 * np.sin(np.arange(len(b)) / 9)[:, None, None] * np.array([0.0, 1.0, 0.0])
    turned = (from_y_up(b, "z") + walk).astype(np.float32)
    fault = implausible([(skeleton, turned)], ["y"])
    assert fault is not None
    assert fault[1] == "y was taken for up, but the trunk of a person is along z throughout"
    assert implausible([(skeleton, a), (skeleton, turned)], ["y", "y"]) is None
    unknown = implausible([(skeleton, turned)], [None])
    assert unknown is not None
    assert unknown[1].endswith("with the upward axis that the file states")


def test_two_who_lie_side_by_side_to_a_few_centimetres_stand_on_another_axis() -> None:
    skeleton, people_of_clip = mixamo(CLIP)
    still = [np.repeat(motion[:1], 40, axis=0) for motion in people_of_clip]
    assert implausible([(skeleton, motion) for motion in still], ["y", "y"]) is None
    a, b = (from_y_up(motion, "z").astype(np.float32) for motion in still)
    fault = implausible([(skeleton, a), (skeleton, b)], ["y", "y"])
    assert fault == (0, "y was taken for up, but the trunk of a person is along z throughout")
    lower = b + np.float32([0, 0, 0.4])  # who lies there, with the feet farther down
    head_to_toe = b * np.float32([1, 1, -1])
    for other in (lower, head_to_toe):
        assert implausible([(skeleton, a), (skeleton, other)], ["y", "y"]) is None
    assert implausible([(skeleton, a)], ["y"]) is None  # one alone may lie


def test_the_axis_that_is_found_is_one_of_the_file() -> None:
    skeleton, (a, _) = mixamo(CLIP)
    walk = 0.2 * np.sin(np.arange(len(a)) / 9)[:, None, None] * np.array([0.0, 0.0, 1.0])
    in_file = a + walk
    for up, wanted in (("z", "y"), ("y", "")):
        found = implausible([(skeleton, to_y_up(in_file.astype(np.float32), up))], [up])
        text = f"z was taken for up, but the trunk of a person is along {wanted} throughout"
        assert found == ((0, text) if wanted else None)


def test_only_formats_whose_unit_or_axis_someone_states_are_checked() -> None:
    assert states_unit_or_axis(BvhPairs)
    assert states_unit_or_axis(Table())
    assert not states_unit_or_axis(Ntu)
