"""Reference: invalid scenes, scales and settings, by name."""

import re
from dataclasses import replace

import numpy as np
import pytest

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.interaction_mesh import Scene, prepare, retarget
from tests.interaction_mesh.scenes import ARM, SETTINGS, scene


def edited_scene(edit) -> Scene:
    source = scene()
    motion = source.motions[1].copy()
    edit(motion)
    return Scene((source.motions[0], motion), source.skeletons, source.fps)


def test_a_flat_body_is_refused():
    with pytest.raises(ValueError, match="person_b is flat"):
        edited_scene(lambda motion: motion.__setitem__((..., 2), 0))


def test_joints_that_coincide_are_refused_with_their_names_and_the_frame():
    with pytest.raises(ValueError, match="person_b: left_arm and left_hand coincide in frame 3"):
        edited_scene(lambda motion: motion.__setitem__((3, 3), motion[3, 2]))


def test_a_joint_that_is_not_finite_is_refused():
    with pytest.raises(ValueError, match="person_b must be finite; frame 2, joint chest is not"):
        edited_scene(lambda motion: motion.__setitem__((2, 1, 0), np.nan))


@pytest.mark.parametrize("scale", [0.0, -1.0, np.nan, np.inf])
def test_a_scale_that_is_not_positive_is_refused(scale):
    scales = np.ones((2, 10))
    scales[1, 4] = scale
    with pytest.raises(ValueError, match=re.escape(f"variation 1, bone 4 has {scale}")):
        retarget(prepare(scene(n_frames=3), SETTINGS), scales)


def test_scales_of_another_shape_are_refused():
    with pytest.raises(ValueError, match=re.escape("scales must be (V, 10); got (1, 9)")):
        retarget(prepare(scene(n_frames=3), SETTINGS), np.ones((1, 9)))


def test_a_disconnected_skeleton_is_refused():
    with pytest.raises(ValueError, match="skeleton torn: parents must form one tree"):
        Skeleton("torn", ARM.joints, (-1, 0, 3, 2, 1, 4))


def test_motions_of_wrong_shape_or_rate_are_refused():
    source = scene()
    with pytest.raises(ValueError, match=re.escape("the same frames; got [15, 14]")):
        Scene((source.motions[0], source.motions[1][1:]), source.skeletons, 30.0)
    with pytest.raises(ValueError, match=re.escape("person_a must be (15, 6, 3) float32")):
        float64_motions = (source.motions[0].astype(np.float64), source.motions[1])
        Scene(float64_motions, source.skeletons, 30.0)
    with pytest.raises(ValueError, match="fps must be positive; got 0"):
        Scene(source.motions, source.skeletons, 0.0)


def test_invalid_settings_are_refused():
    with pytest.raises(ValueError, match="attempts must not be empty"):
        replace(SETTINGS, attempts=())
