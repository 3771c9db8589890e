"""Truth: our reader's positions, turned and scaled; SciPy's slerp; a root with an offset."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from pacmo_core.formats.base import FormatError
from pacmo_core.formats.bvh import Bvh, read_bvh
from pacmo_core.formats.bvh_channels import format_file, local_rotations
from pacmo_core.formats.convert_bvh import change_axes, change_unit, move_root, resample_bvh
from pacmo_core.formats.resample import from_y_up
from tests.formats.test_rewrite_bvh import small


def again(folder: Path, bvh: Bvh) -> Bvh:
    file = folder / "again.bvh"
    file.write_text(format_file(bvh, bvh.motion))
    return read_bvh(file)


def test_a_file_with_another_axis_is_the_motion_and_the_rest_pose_turned(tmp_path: Path) -> None:
    file, bvh = small(tmp_path)
    found = again(tmp_path, change_axes(file, bvh, "y", "z"))
    np.testing.assert_allclose(found.positions(), from_y_up(bvh.positions(), "z"), atol=1e-4)
    np.testing.assert_allclose(found.offsets, from_y_up(bvh.offsets, "z"), atol=1e-6)
    assert found.channels == bvh.channels
    back = change_axes(file, found, "z", "y")
    np.testing.assert_allclose(back.motion, bvh.motion, atol=1e-4)
    np.testing.assert_allclose(back.offsets, bvh.offsets, atol=1e-6)
    assert change_axes(file, bvh, "z", "z") is bvh


def test_a_file_in_another_unit_is_scaled_as_a_whole(tmp_path: Path) -> None:
    _, bvh = small(tmp_path)
    found = again(tmp_path, change_unit(bvh, 0.01))
    np.testing.assert_allclose(found.positions(), 0.01 * bvh.positions(), atol=1e-5)
    np.testing.assert_allclose(found.offsets, 0.01 * bvh.offsets, atol=1e-6)


def test_a_root_that_moves_takes_all_along(tmp_path: Path) -> None:
    _, bvh = small(tmp_path)
    found = again(tmp_path, move_root(bvh, np.array([1.0, -2, 3])))
    np.testing.assert_allclose(
        found.positions(), bvh.positions() + np.array([1.0, -2, 3]), atol=1e-5
    )
    np.testing.assert_allclose(found.offsets, bvh.offsets, atol=1e-6)


def test_rotations_between_frames_are_on_the_slerp_and_those_of_frames_kept(
    tmp_path: Path,
) -> None:
    file, bvh = small(tmp_path)
    times, at = np.arange(3) / 30, np.arange(5) / 60
    found = again(tmp_path, resample_bvh(file, bvh, times, at))
    assert found.frame_time == pytest.approx(1 / 60, rel=1e-8)
    np.testing.assert_allclose(found.motion[::2], bvh.motion, atol=1e-6)
    np.testing.assert_allclose(found.offsets, bvh.offsets, atol=1e-6)
    np.testing.assert_allclose(
        found.motion[1::2, :3], (bvh.motion[1:, :3] + bvh.motion[:-1, :3]) / 2, atol=1e-5
    )
    was, now = local_rotations(bvh), local_rotations(found)
    for joint in range(len(bvh.joints)):
        wanted = Slerp(times, Rotation.from_matrix(was[:, joint]))(at).as_matrix()
        np.testing.assert_allclose(now[:, joint], wanted, atol=1e-6)
    # The other way, and the part of a file.
    np.testing.assert_allclose(
        resample_bvh(file, found, at, times[:2]).motion, bvh.motion[:2], atol=1e-6
    )


def test_what_channels_cannot_hold_is_refused_by_name(tmp_path: Path) -> None:
    file, bvh = small(tmp_path)
    hinge = replace(
        bvh, channels=(*bvh.channels[:4], ("xrotation",), ()), motion=bvh.motion[:, :16]
    )
    with pytest.raises(FormatError, match="head has 1 rotation axes; wanted three"):
        change_axes(file, hinge, "y", "z")
    with pytest.raises(FormatError, match="head has 1 rotation axes; wanted three"):
        resample_bvh(file, hinge, np.arange(3) / 30, np.arange(5) / 60)
    kept = resample_bvh(file, hinge, np.arange(3) / 30, np.arange(3) / 30)
    np.testing.assert_array_equal(kept.motion, hinge.motion)
    hand = bvh.joints.index("hand")
    channels = list(bvh.channels)
    channels[hand] = channels[hand][1:]
    slides = replace(bvh, channels=tuple(channels), motion=np.delete(bvh.motion, 9, axis=1))
    with pytest.raises(FormatError, match="hand has 2 position channels; wanted none or three"):
        change_axes(file, slides, "y", "z")
