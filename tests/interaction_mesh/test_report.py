"""Reference: measurements that follow by hand from motions changed on purpose."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pacmo_core.data.skeleton import NTU25
from pacmo_core.interaction_mesh import Scene
from pacmo_core.interaction_mesh import proximity as module
from pacmo_core.interaction_mesh.mesh import ground_supports
from pacmo_core.interaction_mesh.report import (
    bend_flips,
    mean_accelerations,
    measure_motions,
    near_distance_error,
    seam_ratios,
    trunk_change,
)
from pacmo_core.interaction_mesh.scene import naive_scaling, scale_scene
from tests.interaction_mesh.scenes import SETTINGS, scene, touching_scene


def report(source, points):
    is_support = ground_supports(source, SETTINGS.support)
    scales = np.ones((1, len(source.bones)))
    measurements = measure_motions(source, SETTINGS, is_support, scales, points[..., None])
    return SimpleNamespace(**{name: values[0] for name, values in measurements.items()})


def test_distance_errors_equal_a_loop_over_pairs(monkeypatch):
    source = touching_scene(0, 9)
    points = source.points + np.random.default_rng(0).normal(scale=0.05, size=source.points.shape)
    near, kept, kept_with_slack = [], [], []
    for before, after in zip(source.points, points, strict=True):
        for i in range(6):
            for j in range(6, 12):
                was = np.linalg.norm(before[i] - before[j])
                now = np.linalg.norm(after[i] - after[j])
                near += [abs(now - was)] if was < 0.25 else []
                kept += [now < 0.1] if was < 0.1 else []
                kept_with_slack += [now < 0.12] if was < 0.1 else []
    assert kept and not all(kept)
    monkeypatch.setattr(module, "FRAMES_PER_BATCH", 4)
    measured = report(source, points)
    assert measured.near_distance_error == pytest.approx(np.mean(near))
    assert measured.contacts_kept == pytest.approx(np.mean(kept))
    assert measured.contacts_kept_with_slack == pytest.approx(np.mean(kept_with_slack))


def test_each_measurement_is_of_the_person_for_whom_it_is_worse():
    source = scene(1, 12)
    points = source.points.copy()
    points[:, 6:, 1] -= 0.2  # person b alone sinks
    measured = report(source, points)
    assert measured.below_floor == pytest.approx(0.2)
    assert measured.pelvis_height_error == pytest.approx(0.2)
    assert measured.peak_acceleration_ratio == pytest.approx(1)


def test_a_bent_knee_is_measured_in_degrees_and_apart():
    source = walkers()
    knee, ankle = (NTU25.joints.index(f"left_{name}") for name in ("knee", "ankle"))
    foot = NTU25.joints.index("left_foot")
    points = source.points.copy()
    axis = np.array([1.0, 0, 0])
    for joint in (ankle, foot):
        lever = source.points[:, joint] - source.points[:, knee]
        points[:, joint] = source.points[:, knee] + Rotation.from_rotvec(
            np.radians(20) * axis
        ).apply(lever)
    measured = report(source, points)
    # Of two knees, one changes by 20 degrees.
    assert measured.knee_change == pytest.approx(10, abs=0.1)
    assert measured.knee_change_p95 == pytest.approx(20, abs=0.1)
    assert measured.knee_change_apart == measured.knee_change
    assert measured.elbow_change == pytest.approx(0, abs=1e-5)
    assert measured.trunk_change == pytest.approx(0, abs=1e-5)


def test_a_folded_hip_changes_the_trunk_and_a_scaled_one_does_not():
    source = walkers()
    hip, base = NTU25.joints.index("left_hip"), NTU25.joints.index("spine_base")
    folded = source.points.copy()
    folded[:, hip] = folded[:, NTU25.joints.index("right_hip")]
    assert report(source, folded).trunk_change == pytest.approx(1, abs=1e-5)
    scales = np.full((1, len(source.bones)), 0.8)
    scaled = source.points[:, [base]] + 0.8 * (source.points - source.points[:, [base]])
    assert trunk_change(source, scales, scaled[..., None])[0] == pytest.approx(0, abs=1e-6)


def test_a_spine_that_bends_at_one_joint_is_measured_there():
    source = walkers()
    middle, top = (NTU25.joints.index(name) for name in ("spine_mid", "spine_shoulder"))
    axis, upper = np.array([0, 0, 1.0]), [middle]
    while len(upper) < len(
        more := [j for j in range(25) if j in upper or NTU25.parents[j] in upper]
    ):
        upper = more
    points = source.points.copy()
    lever = source.points[2, upper] - source.points[2, middle]
    points[2, upper] = source.points[2, middle] + Rotation.from_rotvec(np.radians(25) * axis).apply(
        lever
    )
    assert top in upper
    measured = report(source, points)
    assert measured.spine_bend == pytest.approx(25, abs=0.5)
    assert report(source, source.points).spine_bend == pytest.approx(0, abs=1e-5)


def walkers() -> Scene:
    """Two people who stand 3 m apart, with bent knees and elbows."""
    heights = {"spine_base": 0.95, "spine_mid": 1.2, "spine_shoulder": 1.45, "neck": 1.5}
    heights |= {"head": 1.65}
    sides = {
        "shoulder": (0.2, 1.42, 0), "elbow": (0.25, 1.15, -0.05), "wrist": (0.25, 0.95, 0.1),
        "hand": (0.25, 0.9, 0.15), "hand_tip": (0.25, 0.85, 0.18), "thumb": (0.22, 0.9, 0.2),
        "hip": (0.1, 0.93, 0), "knee": (0.11, 0.5, 0.08), "ankle": (0.11, 0.1, 0),
        "foot": (0.12, 0.03, 0.15),
    }  # fmt: skip
    pose = np.zeros((25, 3))
    for name, height in heights.items():
        pose[NTU25.joints.index(name)] = [0, height, 0.01 * height]
    for name, (x, y, z) in sides.items():
        for side, sign in (("left", 1), ("right", -1)):
            pose[NTU25.joints.index(f"{side}_{name}")] = [sign * x, y, z]
    motion = (pose + np.zeros((5, 1, 1))).astype(np.float32)
    return Scene((motion, motion + np.float32([0, 0, 3])), (NTU25, NTU25), 30.0)


def test_a_translated_body_has_foot_skate_only_while_it_moves():
    source = scene(1, 12)
    is_support = ground_supports(source, SETTINGS.support)
    assert is_support[1:][is_support[:-1]].any()
    shifted = source.points + np.array([0.3, 0.02, 0])
    assert report(source, shifted).support_height_error == pytest.approx(0.02)
    assert report(source, shifted).added_foot_skate == pytest.approx(0, abs=1e-9)
    stands = (is_support[1:] & is_support[:-1]).any(axis=0)
    still = source.points.copy()
    still[:, stands] = still[:1, stands]
    still_scene = Scene(
        tuple(np.split(still.astype(np.float32), 2, axis=1)), source.skeletons, source.fps
    )
    drift = still_scene.points + np.linspace(0, 0.11, 12)[:, None, None] * [1.0, 0, 0]
    assert report(still_scene, drift).added_foot_skate == pytest.approx(0.01 * 30, rel=1e-4)


def test_a_scene_that_is_scaled_as_a_whole_has_no_fault():
    source = touching_scene(0, 20)
    is_support = ground_supports(source, SETTINGS.support)
    for factor in (0.7, 1.4):
        scales = np.full((1, len(source.bones)), factor)
        points = scale_scene(source, source.points[..., None], np.array([factor]))
        measured = measure_motions(source, SETTINGS, is_support, scales, points)
        for name in ("added_foot_skate", "support_height_error", "below_floor", "knee_change"):
            assert measured[name][0] == pytest.approx(0, abs=1e-6), name
        for name in ("peak_acceleration_ratio", "contacts_kept"):
            assert measured[name][0] == pytest.approx(1, abs=1e-6), name


def test_a_jump_is_a_seam_and_the_source_has_none():
    source = scene(2, 60)
    assert report(source, source.points).seam_ratio <= 1 + 1e-9
    assert report(source, source.points).peak_acceleration_ratio == pytest.approx(1)
    jumped = source.points.copy()
    jumped[30:] += np.array([0, 0.02, 0])
    assert report(source, jumped).seam_ratio > 3
    accelerations = mean_accelerations(jumped[..., None])
    assert seam_ratios(accelerations, 10)[:, 0].argmax() in (28, 29)


def test_an_elbow_bent_to_the_other_side_is_a_flip_and_one_bent_further_is_not():
    source = walkers()
    joints = [NTU25.joints.index(f"left_{name}") for name in ("shoulder", "elbow", "wrist")]
    parent, hinge, child = joints
    upper = source.points[:, hinge] - source.points[:, parent]
    lower = source.points[:, child] - source.points[:, hinge]
    axis = upper / np.linalg.norm(upper, axis=1, keepdims=True)
    along = (lower * axis).sum(axis=1, keepdims=True) * axis
    flipped, further = source.points.copy(), source.points.copy()
    flipped[:2, child] = (source.points[:, hinge] + along - (lower - along))[:2]
    further[:, child] = source.points[:, hinge] + along + 1.2 * (lower - along)
    assert bend_flips(source, flipped[..., None], 0)["elbow"][0] == pytest.approx(0.4)
    assert bend_flips(source, flipped[..., None], 1)["elbow"][0] == 0
    assert bend_flips(source, further[..., None], 0)["elbow"][0] == 0


def test_an_arm_that_is_raised_as_a_whole_is_no_flip_and_one_that_turns_about_itself_is():
    source = walkers()
    shoulder, elbow, wrist = (
        NTU25.joints.index(f"left_{name}") for name in ("shoulder", "elbow", "wrist")
    )
    upper = source.points[:, elbow] - source.points[:, shoulder]
    upper /= np.linalg.norm(upper, axis=1, keepdims=True)
    normal = np.cross(upper, source.points[:, wrist] - source.points[:, elbow])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)

    def flips(axis, degrees):
        rotations, points = Rotation.from_rotvec(np.radians(degrees) * axis), source.points.copy()
        origin = points[:, shoulder].copy()
        for joint in (elbow, wrist):
            points[:, joint] = origin + rotations.apply(points[:, joint] - origin)
        return bend_flips(source, points[..., None], 0)["elbow"][0]

    for degrees in (60, 120, 170):
        assert flips(normal, degrees) == flips(np.cross(upper, normal), degrees) == 0
    assert flips(upper, 85) == 0
    assert flips(upper, 95) == 1


def test_naive_scaling_preserves_directions_roots_and_lowest_heights():
    source = scene(4, 9)
    scales = np.random.default_rng(0).uniform(0.75, 1.25, size=(2, 10))
    result = naive_scaling(source, scales).transpose(3, 0, 1, 2)
    parent, child = source.bones.T
    vectors = result[:, :, child] - result[:, :, parent]
    np.testing.assert_allclose(
        vectors, scales[:, None, :, None] * source.bone_vectors, rtol=0, atol=1e-12
    )
    for first, last in ((0, 6), (6, 12)):
        lowest = result[:, :, first:last, 1].min(axis=2)
        expected = np.broadcast_to(source.points[:, first:last, 1].min(axis=1), lowest.shape)
        np.testing.assert_allclose(lowest, expected, atol=1e-12)
        np.testing.assert_allclose(result[0, :, first, ::2], source.points[:, first, ::2])


def test_without_near_pairs_their_error_is_zero():
    source = touching_scene(0, 11)
    points = np.repeat(source.points[..., None], 3, axis=-1) + 0.1
    assert near_distance_error(source, points, 0.0).tolist() == [0, 0, 0]
