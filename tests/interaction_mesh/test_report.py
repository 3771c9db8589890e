"""Trusted: figures that follow by hand from motions changed on purpose."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pacmo_core.data.skeleton import DUET15, INTERHUMAN22, NTU25, SBU15
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
    standing = build_energy(source, SETTINGS).is_support
    figures = measure_motions(source, SETTINGS, standing, points[..., None])
    return SimpleNamespace(**{name: values[0] for name, values in figures.items()})


def test_distances_are_those_of_a_loop_over_pairs():
    source = touching_scene(0, 9)
    points = source.points + np.random.default_rng(0).normal(scale=0.05, size=source.points.shape)
    near, far, kept, depth = [], [], [], 0.0
    for before, after in zip(source.points, points, strict=True):
        for i in range(6):
            for j in range(6, 12):
                was = np.linalg.norm(before[i] - before[j])
                now = np.linalg.norm(after[i] - after[j])
                (near if was < 0.25 else far).append(abs(now - was))
                kept += [now < 0.12] if was < 0.1 else []
                depth = max(depth, min(was, 0.1) - now)
    assert kept and depth > 0
    found = measure_distances(source, SETTINGS, points[..., None])
    assert found.near[0] == pytest.approx(np.mean(near), rel=1e-4)
    assert found.far[0] == pytest.approx(np.mean(far), rel=1e-4)
    assert found.contacts_preserved[0] == pytest.approx(np.mean(kept))
    assert found.penetration[0] == pytest.approx(depth, abs=1e-5)


def test_a_body_pushed_aside_slides_only_where_it_moves():
    source = scene(1, 12)
    standing = build_energy(source, SETTINGS).is_support
    assert standing[1:][standing[:-1]].any()
    aside = source.points + np.array([0.3, 0, 0])
    assert report(source, aside).added_foot_skate == pytest.approx(0, abs=1e-9)
    stands = (standing[1:] & standing[:-1]).any(axis=0)
    still = source.points.copy()
    still[:, stands] = still[:1, stands]
    held = Scene(tuple(np.split(still.astype(np.float32), 2, axis=1)), source.skeletons, source.fps)
    drift = held.points + np.linspace(0, 0.11, 12)[:, None, None] * [1.0, 0, 0]
    assert report(held, drift).added_foot_skate == pytest.approx(0.01 * 30, rel=1e-4)


def test_a_jump_shows_as_a_seam_and_the_source_has_none():
    source = scene(2, 60)
    assert report(source, source.points).acceleration_peak_ratio <= 1
    jumped = source.points.copy()
    jumped[30:] += np.array([0, 0.02, 0])
    assert report(source, jumped).acceleration_peak_ratio > 3
    assert acceleration_ratios(jumped[..., None])[:, 0].argmax() in (28, 29)


@pytest.mark.parametrize(
    ("skeleton", "middle"),
    [
        (NTU25, "left_elbow left_knee right_elbow right_knee"),
        (SBU15, "left_elbow left_knee right_elbow right_knee"),
        (DUET15, "left_elbow left_knee right_elbow right_knee"),
        (INTERHUMAN22, "left_elbow left_knee right_elbow right_knee"),
    ],
)
def test_hinges_are_elbows_and_knees(skeleton, middle):
    assert found_hinges(skeleton) == sorted(middle.split())


def found_hinges(skeleton):
    """Lay a grown-up's bones along a line of the tree and name the hinges of person a."""
    source = person(skeleton)
    found = hinge_joints(source)[:, 1]
    return sorted(skeleton.joints[i] for i in found if i < len(skeleton.joints))


def person(skeleton):
    long = {"elbow": 0.28, "wrist": 0.25, "knee": 0.42, "ankle": 0.42, "hip": 0.12, "foot": 0.15}
    if skeleton is SBU15:
        long |= {"hand": 0.25, "foot": 0.42, "hip": 0.3}
    random = np.random.default_rng(0)
    pose = np.zeros((1, len(skeleton.joints), 3))
    for joint in skeleton.order[1:]:
        direction = random.normal(size=3)
        name = skeleton.joints[joint].rpartition("_")[2]
        length = long.get(name, 0.1)
        pose[:, joint] = pose[:, skeleton.parents[joint]] + length * direction / np.linalg.norm(
            direction
        )
    motion = pose.astype(np.float32)
    return Scene((motion, motion + np.float32(1)), (skeleton, skeleton), 30.0)


def test_an_elbow_bent_back_is_a_flip_and_one_bent_further_is_none():
    source = scene(3, 10)
    (parent, hinge, child), *_ = hinge_joints(source)
    upper = source.points[:, hinge] - source.points[:, parent]
    lower = source.points[:, child] - source.points[:, hinge]
    axis = upper / np.linalg.norm(upper, axis=1, keepdims=True)
    along = (lower * axis).sum(axis=1, keepdims=True) * axis
    back, further = source.points.copy(), source.points.copy()
    back[:4, child] = (source.points[:, hinge] + along - (lower - along))[:4]
    further[:, child] = source.points[:, hinge] + along + 1.2 * (lower - along)
    assert bend_flip_fraction(source, back[..., None])[0] == pytest.approx(0.4)
    assert bend_flip_fraction(source, further[..., None])[0] == 0


def test_naive_scaling_keeps_directions_roots_and_the_ground():
    source = scene(4, 9)
    scales = np.random.default_rng(0).uniform(0.75, 1.25, size=(2, 10))
    found = naive_scaling(source, scales).transpose(3, 0, 1, 2)
    parent, child = source.bones.T
    vectors = found[:, :, child] - found[:, :, parent]
    np.testing.assert_allclose(
        vectors, scales[:, None, :, None] * source.bone_vectors, rtol=0, atol=1e-12
    )
    for first, last in ((0, 6), (6, 12)):
        lowest = found[:, :, first:last, 1].min(axis=2)
        expected = np.broadcast_to(source.points[:, first:last, 1].min(axis=1), lowest.shape)
        np.testing.assert_allclose(lowest, expected, atol=1e-12)
        np.testing.assert_allclose(found[0, :, first, ::2], source.points[:, first, ::2])


def test_near_pairs_alone_come_to_what_all_pairs_say_of_them(monkeypatch):
    source = touching_scene(0, 11)
    random = np.random.default_rng(0)
    points = source.points[..., None] + 0.1 * random.normal(size=(*source.points.shape, 3))
    whole = measure_distances(source, SETTINGS, points).near
    assert (whole > 0).all()
    monkeypatch.setattr(module, "FRAMES_PER_BATCH", 4)
    np.testing.assert_allclose(near_distance_error(source, SETTINGS, points), whole, rtol=1e-5)
    nowhere = replace(SETTINGS, near_distance=0.0)
    assert near_distance_error(source, nowhere, points).tolist() == [0, 0, 0]
