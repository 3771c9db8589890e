"""Trusted: the stated size and memory of the camera's error, and that a camera moves nobody."""

import numpy as np
import pytest

from pacmo_core.data.skeleton import NTU25
from pacmo_core.synthesis.capture import (
    CAMERA_FPS,
    DEPTH_NOISE_RATIO,
    NOISE_CORRELATION_SECONDS,
    WHITE_NOISE_SHARE,
    joint_noise_scale,
    sample_noise,
    to_camera_frame,
)
from tests.synthesis.clips import clips


def test_the_error_has_the_stated_size_from_the_first_frame_to_the_last() -> None:
    random = np.random.default_rng(5)
    drawn = np.stack([sample_noise(random, 40) for _ in range(600)])
    for frame in (0, 1, 20, 39):
        spread = drawn[:, frame].std(axis=0)
        assert spread[:, :2] == pytest.approx(
            np.tile(joint_noise_scale()[:, None], (1, 2)), rel=0.12
        )
        assert spread[:, 2] == pytest.approx(DEPTH_NOISE_RATIO * joint_noise_scale(), rel=0.12)


def test_the_error_is_forgotten_at_the_stated_pace() -> None:
    drawn = (
        sample_noise(np.random.default_rng(5), 60000)
        / joint_noise_scale()[:, None]
        / [1, 1, DEPTH_NOISE_RATIO]
    )
    for lag in (1, 4):
        wanted = (1 - WHITE_NOISE_SHARE**2) * np.exp(
            -lag / (CAMERA_FPS * NOISE_CORRELATION_SECONDS)
        )
        assert (drawn[lag:] * drawn[:-lag]).mean() == pytest.approx(wanted, abs=0.02)


def test_hands_and_feet_are_seen_worse_than_the_trunk() -> None:
    size = dict(zip(NTU25.joints, joint_noise_scale(), strict=True))
    trunk = max(size[name] for name in ("spine_base", "spine_mid", "spine_shoulder", "neck"))
    assert trunk < min(size[name] for name in ("left_hand", "right_foot", "left_hand_tip"))
    assert 0.005 < np.mean(list(size.values())) < 0.012


def test_the_camera_keeps_distances_and_handedness() -> None:
    clip = clips("push")[0]
    seen = to_camera_frame(clip.motions[0], clip.script.view)
    parent, child = NTU25.bones.T
    lengths = [np.linalg.norm(m[:, child] - m[:, parent], axis=-1) for m in (seen, clip.motions[0])]
    assert lengths[0] == pytest.approx(lengths[1], abs=1e-9)
    sides = [
        np.linalg.det(np.stack([m[0, 4] - m[0, 0], m[0, 8] - m[0, 0], m[0, 3] - m[0, 0]]))
        for m in (seen, clip.motions[0])
    ]
    assert sides[0] == pytest.approx(sides[1])


def test_people_stand_upright_before_the_camera_within_its_range() -> None:
    for action in ("approach", "circle dance", "depart"):
        for clip in clips(action):
            for motion in clip.motions:
                seen = to_camera_frame(motion, clip.script.view)
                assert seen[..., 2].min() > 0.8
                assert seen[..., 2].max() < 6.2
                assert np.ptp(seen[0, :, 1]) == pytest.approx(np.ptp(motion[0, :, 1]), abs=0.1)
