"""Truth: bodies bent by hand."""

import numpy as np
import pytest

from pacmo_core.augmentation.segments import segments
from pacmo_core.augmentation.shape import trunk_change
from pacmo_core.data.skeleton import NTU25


def standing() -> np.ndarray:
    """Give a Kinect body, (5, 25, 3), that stands and walks ahead."""
    random = np.random.default_rng(0)
    pose = random.uniform(-0.5, 0.5, (25, 3))
    places = {"spine_base": 0.9, "spine_mid": 1.1, "spine_shoulder": 1.3}
    for name, height in places.items():
        pose[NTU25.joints.index(name)] = [0, height, 0]
    for side, sign in (("left", 1), ("right", -1)):
        pose[NTU25.joints.index(f"{side}_hip")] = [0.15 * sign, 0.9, 0]
        pose[NTU25.joints.index(f"{side}_shoulder")] = [0.2 * sign, 1.3, 0]
    return (pose + np.linspace(0, 1, 5)[:, None, None] * [0, 0, 1]).astype(np.float32)


def test_a_body_that_is_scaled_in_place_has_not_changed() -> None:
    body = standing()
    assert trunk_change(body, body, NTU25, np.ones(24)) == pytest.approx(0, abs=1e-6)
    assert trunk_change(body, 0.8 * body, NTU25, np.full(24, 0.8)) == pytest.approx(0, abs=1e-6)


def test_hips_that_fold_are_seen_and_arms_that_reach_are_not() -> None:
    body = standing()
    folded, reaching = body.copy(), body.copy()
    for side in ("left", "right"):
        # Bones of the same length, forwards: the hips are 0 apart instead of 0.3.
        folded[:, NTU25.joints.index(f"{side}_hip")] = body[:, 0] + np.float32([0, 0, 0.15])
        for joint in ("elbow", "wrist", "hand"):
            reaching[:, NTU25.joints.index(f"{side}_{joint}")] += 0.3
    reaching[:, NTU25.joints.index("head")] += 0.2
    assert trunk_change(body, folded, NTU25, np.ones(24)) == pytest.approx(1, abs=1e-6)
    assert trunk_change(body, reaching, NTU25, np.ones(24)) == pytest.approx(0, abs=1e-6)


def test_a_longer_spine_is_what_was_asked_for() -> None:
    body = standing()
    longer, scales = body.copy(), np.ones(24)
    for row, segment in enumerate(segments(NTU25)):
        if segment.name == "spine_mid":
            scales[row] = 1.5
    legs = ("spine_base", "hip", "knee", "ankle", "foot")
    for joint, name in enumerate(NTU25.joints):
        if not name.endswith(legs):
            longer[:, joint, 1] += 0.1
    assert trunk_change(body, longer, NTU25, scales) == pytest.approx(0, abs=1e-6)
    assert trunk_change(body, longer, NTU25, np.ones(24)) > 0.2
