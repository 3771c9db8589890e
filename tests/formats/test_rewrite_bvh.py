"""Truth: our reader on what was written; a file that is written as it was read is what it was."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pacmo_core.formats.base import FormatError
from pacmo_core.formats.bvh import Bvh, read_bvh
from pacmo_core.formats.write_bvh import BvhTargets, rewrite_bvh
from tests.formats.real_files import real_folder

TEXT = """HIERARCHY
ROOT hips
{
  OFFSET 1 2 3
  CHANNELS 6 Yposition Xposition Zposition Yrotation Xrotation Zrotation
  JOINT chest
  {
    OFFSET 0 20 0
    CHANNELS 3 Xrotation Zrotation Yrotation
    JOINT hand
    {
      OFFSET 30 5 0
      CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
      End Site
      {
        OFFSET 0 4 0
      }
    }
    JOINT head
    {
      OFFSET 0 15 2
      CHANNELS 3 Zrotation Yrotation Xrotation
      End Site
      {
        OFFSET 0 10 0
      }
    }
  }
}
MOTION
Frames: 3
Frame Time: 0.0333333
"""


def small(folder: Path) -> tuple[Path, Bvh]:
    """Write a file with channels in several orders, and a hand that moves against its chest."""
    motion = np.random.default_rng(0).uniform(-60, 60, (3, 18))
    motion[:, 9:12] = [[30, 5, 0], [31, 5, 0], [30, 6, 1]]
    rows = "\n".join(" ".join(f"{value:.4f}" for value in row) for row in motion)
    file = folder / "small.bvh"
    file.write_text(TEXT + rows + "\n")
    return file, read_bvh(file)


def again(file: Path, bvh: Bvh, places: np.ndarray, scales: np.ndarray) -> tuple[Bvh, float]:
    joints = [j for j in range(len(bvh.joints)) if j not in bvh.end_sites]
    other = file.with_name("again.bvh")
    other.write_text(rewrite_bvh(file, bvh, targets(joints, places), scales))
    found = read_bvh(other)
    errors = np.linalg.norm(found.positions() - places, axis=-1)[:, joints]
    return found, float(errors.max())


def targets(joints: list[int], places: np.ndarray) -> BvhTargets:
    """Weigh all joints alike."""
    return BvhTargets(joints, places[:, joints], np.ones((len(places), len(joints))))


def test_a_file_written_as_it_was_read_is_what_it_was(tmp_path: Path) -> None:
    file, bvh = small(tmp_path)
    found, miss = again(file, bvh, bvh.positions(), np.ones(len(bvh.joints)))
    assert miss < 1e-4
    for name in ("joints", "parents", "channels", "end_sites"):
        assert getattr(found, name) == getattr(bvh, name)
    assert found.frame_time == pytest.approx(bvh.frame_time, rel=1e-8)
    np.testing.assert_allclose(found.offsets, bvh.offsets, atol=1e-6)
    np.testing.assert_allclose(found.motion, bvh.motion, atol=1e-5)


def test_a_root_that_has_an_offset_is_written_where_it_is(tmp_path: Path) -> None:
    file, bvh = small(tmp_path)
    written = []
    for offset in ([0.0, 0, 0], [0, 97, 0]):
        bvh.offsets[0] = offset
        found, miss = again(file, bvh, bvh.positions(), np.ones(len(bvh.joints)))
        assert miss < 1e-4
        assert found.offsets[0].tolist() == offset
        written.append(found.motion)
    np.testing.assert_allclose(written[0], written[1], atol=1e-6)


def test_a_body_that_grew_as_a_whole_is_met_with_the_same_turns(tmp_path: Path) -> None:
    file, bvh = small(tmp_path)
    places = 1.25 * bvh.positions()
    found, miss = again(file, bvh, places, np.array([1, *[1.25] * 5]))
    assert miss < 1e-4
    np.testing.assert_allclose(found.positions(), places, atol=1e-4)
    np.testing.assert_allclose(found.offsets[1:], 1.25 * bvh.offsets[1:], atol=1e-6)
    np.testing.assert_allclose(found.motion[:, 3:9], bvh.motion[:, 3:9], atol=1e-4)


def test_directions_of_the_rest_pose_are_those_of_the_file_for_any_motion(tmp_path: Path) -> None:
    file, bvh = small(tmp_path)
    places = bvh.positions() + np.random.default_rng(1).normal(scale=3, size=(3, 6, 3))
    scales = np.array([1, 1.2, 0.8, 0.8, 1, 1])
    found, miss = again(file, bvh, places, scales)
    assert miss > 1  # such places cannot be met
    np.testing.assert_allclose(found.offsets, bvh.offsets * scales[:, None], atol=1e-6)


def test_a_joint_that_cannot_turn_freely_is_refused_by_name(tmp_path: Path) -> None:
    file = tmp_path / "hinge.bvh"
    text = TEXT.replace("CHANNELS 3 Zrotation Yrotation Xrotation", "CHANNELS 1 Xrotation")
    rows = "\n".join(" ".join(["1"] * 16) for _ in range(3))
    file.write_text(text + rows + "\n")
    bvh = read_bvh(file)
    with pytest.raises(FormatError, match="head has 1 rotation axes; wanted three"):
        again(file, bvh, bvh.positions(), np.ones(6))
    still = TEXT.replace(
        "CHANNELS 6 Yposition Xposition Zposition Yrotation", "CHANNELS 3 Yrotation"
    )
    file.write_text(still + "\n".join(" ".join(["1"] * 15) for _ in range(3)) + "\n")
    bvh = read_bvh(file)
    with pytest.raises(FormatError, match="hips has no position channels"):
        again(file, bvh, bvh.positions(), np.ones(6))


@pytest.mark.parametrize(
    "name",
    [
        "duo_mocap/salsa/Easy_01_male_30fps.bvh",
        "cmu_18_19/18_19_rory/18_10_poses.bvh",
        "skeleton_priors/uniform-B/0000_0.75_retarget_C1.bvh",
    ],
)
def test_real_files_are_written_as_they_were_read(name: str, tmp_path: Path) -> None:
    folder, _, rest = name.partition("/")
    original = real_folder(folder) / rest
    whole = read_bvh(original)
    bvh = replace(whole, motion=whole.motion[:200])
    joints = [j for j in range(len(bvh.joints)) if j not in bvh.end_sites]
    places = bvh.positions()
    file = tmp_path / "written.bvh"
    ones = np.ones(len(bvh.joints))
    file.write_text(rewrite_bvh(original, bvh, targets(joints, places), ones))
    found = read_bvh(file)
    assert found.joints == bvh.joints
    np.testing.assert_allclose(found.positions(), places, atol=1e-4)
    np.testing.assert_allclose(found.motion, bvh.motion, atol=1e-3)
