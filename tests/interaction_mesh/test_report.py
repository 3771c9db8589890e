"""Reference: measurements that follow by hand from motions changed on purpose."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pacmo_core.interaction_mesh import Scene
from pacmo_core.interaction_mesh import report as module
from pacmo_core.interaction_mesh.energy import build_energy
from pacmo_core.interaction_mesh.mesh import hinge_joints
from pacmo_core.interaction_mesh.report import (
    acceleration_ratios,
    bend_flip_fraction,
    measure_distances,
    measure_motions,
    near_distance_error,
)
from pacmo_core.interaction_mesh.scene import naive_scaling
from tests.interaction_mesh.scenes import SETTINGS, scene, touching_scene


def report(source, points):
    is_support = build_energy(source, SETTINGS).is_support
    measurements = measure_motions(source, SETTINGS, is_support, points[..., None])
    return SimpleNamespace(**{name: values[0] for name, values in measurements.items()})


def test_distance_errors_equal_a_loop_over_pairs():
    source = touching_scene(0, 9)
    points = source.points + np.random.default_rng(0).normal(scale=0.05, size=source.points.shape)
    near, far, preserved, depth = [], [], [], 0.0
    for before, after in zip(source.points, points, strict=True):
        for i in range(6):
            for j in range(6, 12):
                was = np.linalg.norm(before[i] - before[j])
                now = np.linalg.norm(after[i] - after[j])
                (near if was < 0.25 else far).append(abs(now - was))
                preserved += [now < 0.12] if was < 0.1 else []
                depth = max(depth, min(was, 0.1) - now)
    assert preserved and depth > 0
    result = measure_distances(source, SETTINGS, points[..., None])
    assert result.near[0] == pytest.approx(np.mean(near), rel=1e-4)
    assert result.far[0] == pytest.approx(np.mean(far), rel=1e-4)
    assert result.contacts_preserved[0] == pytest.approx(np.mean(preserved))
    assert result.penetration[0] == pytest.approx(depth, abs=1e-5)


def test_a_translated_body_has_foot_skate_only_while_it_moves():
    source = scene(1, 12)
    is_support = build_energy(source, SETTINGS).is_support
    assert is_support[1:][is_support[:-1]].any()
    shifted = source.points + np.array([0.3, 0, 0])
    assert report(source, shifted).added_foot_skate == pytest.approx(0, abs=1e-9)
    stands = (is_support[1:] & is_support[:-1]).any(axis=0)
    still = source.points.copy()
    still[:, stands] = still[:1, stands]
    still_scene = Scene(
        tuple(np.split(still.astype(np.float32), 2, axis=1)), source.skeletons, source.fps
    )
    drift = still_scene.points + np.linspace(0, 0.11, 12)[:, None, None] * [1.0, 0, 0]
    assert report(still_scene, drift).added_foot_skate == pytest.approx(0.01 * 30, rel=1e-4)


def test_a_jump_is_an_acceleration_peak_and_the_source_has_none():
    source = scene(2, 60)
    assert report(source, source.points).acceleration_peak_ratio <= 1
    jumped = source.points.copy()
    jumped[30:] += np.array([0, 0.02, 0])
    assert report(source, jumped).acceleration_peak_ratio > 3
    assert acceleration_ratios(jumped[..., None])[:, 0].argmax() in (28, 29)


def test_an_elbow_bent_to_the_other_side_is_a_flip_and_one_bent_further_is_not():
    source = scene(3, 10)
    (parent, hinge, child), *_ = hinge_joints(source)
    upper = source.points[:, hinge] - source.points[:, parent]
    lower = source.points[:, child] - source.points[:, hinge]
    axis = upper / np.linalg.norm(upper, axis=1, keepdims=True)
    along = (lower * axis).sum(axis=1, keepdims=True) * axis
    flipped, further = source.points.copy(), source.points.copy()
    flipped[:4, child] = (source.points[:, hinge] + along - (lower - along))[:4]
    further[:, child] = source.points[:, hinge] + along + 1.2 * (lower - along)
    assert bend_flip_fraction(source, flipped[..., None])[0] == pytest.approx(0.4)
    assert bend_flip_fraction(source, further[..., None])[0] == 0


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


def test_near_distance_error_equals_that_of_all_pairs(monkeypatch):
    source = touching_scene(0, 11)
    random = np.random.default_rng(0)
    points = source.points[..., None] + 0.1 * random.normal(size=(*source.points.shape, 3))
    all_pairs = measure_distances(source, SETTINGS, points).near
    assert (all_pairs > 0).all()
    monkeypatch.setattr(module, "FRAMES_PER_BATCH", 4)
    np.testing.assert_allclose(near_distance_error(source, SETTINGS, points), all_pairs, rtol=1e-5)
    without_near_pairs = replace(SETTINGS, near_distance=0.0)
    assert near_distance_error(source, without_near_pairs, points).tolist() == [0, 0, 0]
