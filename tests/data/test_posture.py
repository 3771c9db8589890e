"""Truth: bodies of known stature, turned and scaled; real captures of known unit and axes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacmo_core.data.posture import (
    CMU_UNIT,
    UNITS,
    infer_unit,
    infer_up,
    lying_fault,
    measure_posture,
)
from pacmo_core.data.skeleton import SBU15, Skeleton
from pacmo_core.formats.registry import read_partner
from pacmo_core.formats.resample import from_y_up
from tests.formats.real_files import real_folder
from tests.formats.rigged import people

CLIP = people()


def test_a_stature_follows_from_the_legs_whatever_the_posture() -> None:
    joints = SBU15.joints
    pose = np.zeros((3, len(joints), 3))
    for side, x in (("left", 0.1), ("right", -0.1)):
        for name, y in (("hip", 0.9), ("knee", 0.9 - 0.245 * 1.8), ("foot", 0.9 - 0.491 * 1.8)):
            pose[:, joints.index(f"{side}_{name}")] = x, y, 0
        for name, y in (("shoulder", 1.4), ("elbow", 1.1), ("hand", 0.8)):
            pose[:, joints.index(f"{side}_{name}")] = 2 * x, y, 0
    found = measure_posture(pose, SBU15)
    assert found is not None
    assert found.stature == pytest.approx(1.8)
    np.testing.assert_allclose(found.trunk, np.broadcast_to([0, 1, 0], (3, 3)), atol=1e-9)


@given(
    unit=st.sampled_from(sorted(UNITS.values())),
    size=st.floats(0.65, 1.35),
    up=st.sampled_from("yz"),
)
def test_unit_and_axis_of_a_standing_person_are_found(unit: float, size: float, up: str) -> None:
    posture = measure_posture(size * from_y_up(CLIP.person_a, up) / unit, CLIP.skeleton)
    assert posture is not None
    assert infer_unit(posture) == unit
    assert infer_up(posture) == up


def test_a_body_without_legs_is_not_measured() -> None:
    hub = Skeleton("hub", ("hips", "head"), (-1, 0))
    assert measure_posture(np.ones((4, 2, 3)), hub) is None
    assert measure_posture(np.ones((4, 15, 3)), SBU15) is None  # no extent


def test_cmu_units_are_only_those_of_cmu() -> None:
    posture = measure_posture(CLIP.person_a / CMU_UNIT, CLIP.skeleton)
    assert posture is not None
    assert infer_unit(posture) != CMU_UNIT
    assert infer_unit(posture, of_cmu=True) == CMU_UNIT


REAL = [
    ("duo_mocap", "acts/*.bvh", "duo_mocap"),
    ("duo_mocap", "salsa*/*.bvh", "duo_mocap"),
    ("duo_mocap_embraces", "*.bvh", "duo_mocap"),
    ("cmu_18_19", "18_19_*/*.bvh", "cmu_18_19"),
]


@pytest.mark.parametrize(("folder", "pattern", "preset"), REAL)
def test_unit_and_axis_of_real_captures_are_found_with_people_on_the_floor_too(
    folder: str, pattern: str, preset: str
) -> None:
    for file in sorted(real_folder(folder).glob(pattern)):
        person = read_partner(file, "bvh", {"preset": preset}, person=None, clip="")
        for up in "yz":
            turned = from_y_up(person.motion, up) / 0.01
            posture = measure_posture(turned, person.skeleton)
            assert posture is not None
            assert (infer_unit(posture), infer_up(posture)) == (0.01, up), file
        right = measure_posture(person.motion, person.skeleton)
        assert right is not None
        assert lying_fault(right) == "", file


@pytest.mark.parametrize(("folder", "pattern", "preset"), REAL[1:2] + REAL[3:])
def test_real_people_of_a_wrong_axis_lie_or_are_upside_down(
    folder: str, pattern: str, preset: str
) -> None:
    files = sorted(real_folder(folder).glob(pattern))
    faults, inversions = [], []
    for file in files:
        person = read_partner(file, "bvh", {"preset": preset}, person=None, clip="")
        x, y, z = np.moveaxis(person.motion, -1, 0)
        lying = measure_posture(np.stack([x, z, -y], axis=-1), person.skeleton)
        inverted = measure_posture(np.stack([x, -y, -z], axis=-1), person.skeleton)
        assert lying is not None
        assert inverted is not None
        faults.append(lying_fault(lying))
        inversions.append(lying_fault(inverted))
    # A few stand still, or bend too much to be clear.
    assert np.mean([fault == "lying while standing" for fault in faults]) >= 0.75, faults
    assert np.mean([fault == "upside down" for fault in inversions]) >= 0.75, inversions


def test_push_ups_are_no_fault_and_do_not_decide_the_axis() -> None:
    file = real_folder("duo_mocap") / "acts" / "push_up001_S1_30fps.bvh"
    if not file.exists():
        pytest.skip(f"no {file}")
    person = read_partner(file, "bvh", {"preset": "duo_mocap"}, person=None, clip="")
    posture = measure_posture(person.motion, person.skeleton)
    assert posture is not None
    on_floor = np.abs(posture.trunk[:, 1]) < 0.5
    assert on_floor.mean() > 0.5
    # The frames on the floor alone: the trunk is never upright.
    lying = measure_posture(person.motion[on_floor], person.skeleton)
    assert lying is not None
    assert lying_fault(lying) == ""
