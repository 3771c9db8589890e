"""Pelvis and chest turn as one: against Kabsch, and in motions that the other body presses."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pacmo_core.data.skeleton import INTERHUMAN22, Skeleton
from pacmo_core.interaction_mesh import Attempt, prepare, retarget
from pacmo_core.interaction_mesh.linear_algebra import from_blocks, to_blocks
from pacmo_core.interaction_mesh.rigid_parts import RigidParts, rigid_parts
from pacmo_core.interaction_mesh.scene import Array, Scene
from tests.interaction_mesh.scenes import ARM, SETTINGS, scene

# A root above the hips, as in most rigs: the pelvis is a flat pyramid.
PELVIS = Skeleton(
    "pelvis",
    (
        *("root", "left_hip", "left_knee", "left_ankle", "right_hip", "right_knee", "right_ankle"),
        *("spine", "left_arm", "left_hand", "right_arm", "right_hand"),
    ),
    (-1, 0, 1, 2, 0, 4, 5, 0, 7, 8, 7, 10),
    ((1, 4), (2, 5), (3, 6), (8, 10), (9, 11)),
)


def parts_of(source: Scene, penalties: Array | None = None) -> RigidParts:
    shape = source.bone_vectors.shape[:2]
    return rigid_parts(source, np.ones(shape) if penalties is None else penalties)


def nearest(parts: RigidParts, vectors: Array, scales: Array, n_times: int = 12) -> Array:
    """Project (T, E, 3, V) of which the parts' bones are returned, (T, Q, 3, V)."""
    blocks, turns = to_blocks(vectors), parts.unturned(vectors.shape[-1])
    for _ in range(n_times):
        result = parts.nearest(blocks, scales.astype(np.float32), turns)
    return from_blocks(result, len(vectors))


def test_the_parts_are_pelvis_and_chest_of_both() -> None:
    source = scene(1, 3, skeletons=(PELVIS, ARM))
    parts = parts_of(source)
    joints = [*PELVIS.joints, *(f"b {name}" for name in ARM.joints)]
    ends = [
        {joints[source.bones[bone, 1]] for bone, own in zip(*part, strict=True) if own}
        for part in zip(parts.bones, parts.is_bone, strict=True)
    ]
    expected = [
        {"left_hip", "right_hip", "spine"},
        {"left_arm", "right_arm"},
        {"b left_arm", "b right_arm"},
    ]
    assert sorted(map(sorted, ends)) == sorted(map(sorted, expected))


@settings(derandomize=True, deadline=None, max_examples=30)
@given(st.integers(0, 10**6), st.floats(0, 2.5))
def test_the_proximal_point_is_the_nearest_rotation_of_the_scaled_part(seed, angle) -> None:
    random = np.random.default_rng(seed)
    source = scene(seed % 100, 3, skeletons=(PELVIS, ARM))
    penalties = random.uniform(0.5, 2, source.bone_vectors.shape[:2])
    parts, scales = parts_of(source, penalties), random.uniform(0.7, 1.3, (len(source.bones), 4))
    turn = Rotation.from_rotvec(angle * random.normal(size=3) / np.sqrt(3)).as_matrix()
    noise = random.normal(0, 0.05, (*source.bone_vectors.shape, 4))
    vectors = (source.bone_vectors @ turn.T)[..., None] + noise
    found = nearest(parts, vectors, scales, n_times=30)
    columns = {int(row): column for column, row in enumerate(parts.rows)}
    for bones, is_bone in zip(parts.bones, parts.is_bone, strict=True):
        own = bones[is_bone]
        result = found[:, [columns[int(bone)] for bone in own]]
        for t, v in np.ndindex(3, 4):
            shape = source.bone_vectors[t, own] * scales[own, v, None]
            weights = penalties[t, own]
            best, _ = Rotation.align_vectors(vectors[t, own, :, v], shape, weights=weights)
            error = weights @ np.square(result[t, :, :, v] - vectors[t, own, :, v]).sum(axis=-1)
            least = weights @ np.square(best.apply(shape) - vectors[t, own, :, v]).sum(axis=-1)
            assert error == pytest.approx(least, rel=1e-4, abs=1e-7)
            lengths = np.linalg.norm(shape, axis=-1)
            np.testing.assert_allclose(np.linalg.norm(result[t, :, :, v], axis=-1), lengths, 1e-5)


def test_a_mirrored_part_is_not_taken_for_the_part() -> None:
    source = scene(3, 4, skeletons=(PELVIS, ARM))
    parts = parts_of(source)
    mirrored = (source.bone_vectors * [1.0, 1.0, -1.0])[..., None]
    found = nearest(parts, mirrored, np.ones((len(source.bones), 1)))
    before, after = source.bone_vectors[:, parts.rows], found[..., 0]
    np.testing.assert_allclose(_products(after), _products(before), atol=1e-5)
    pelvis = [0, 1, 2]
    np.testing.assert_allclose(
        np.linalg.det(after[:, pelvis]), np.linalg.det(before[:, pelvis]), atol=1e-6
    )


def test_bones_that_all_are_zero_stay_zero() -> None:
    source = scene(3, 4, skeletons=(PELVIS, ARM))
    still = np.zeros((*source.bone_vectors.shape, 2))
    parts = parts_of(source)
    empty = replace(parts, vectors=0 * parts.vectors, weighted=0 * parts.weighted)
    assert not nearest(empty, still, np.ones((len(source.bones), 2))).any()


@pytest.mark.parametrize("pair_penalty", [0, 60])
def test_a_pelvis_keeps_its_shape_where_the_other_body_pulls_at_it(pair_penalty) -> None:
    source = scene(5, 9, skeletons=(PELVIS, INTERHUMAN22), distance=0.2)
    weights = replace(SETTINGS.weights, contact=300, contact_range=0.5, trunk_shape=0)
    attempt = Attempt(bone_penalty=6, max_iterations=200, pair_penalty=pair_penalty, tolerance=0)
    scales = np.ones((1, len(source.bones)))
    scales[0, len(PELVIS.bones) :] = 0.6
    result = retarget(
        prepare(source, replace(SETTINGS, attempts=(attempt,), n_pairs=6, weights=weights)), scales
    ).points[0]
    first, second = source.bones.T
    parts = parts_of(source)
    for row, is_bone in zip(parts.bones, parts.is_bone, strict=True):
        bones = row[is_bone]
        grown = (source.bone_vectors * scales[0, :, None])[:, bones]
        now = (result[:, second] - result[:, first])[:, bones]
        np.testing.assert_allclose(_products(now), _products(grown), atol=1e-6)
        if len(bones) == 3:
            np.testing.assert_allclose(np.linalg.det(now), np.linalg.det(grown), atol=1e-6)


def _products(vectors: Array) -> Array:
    """``(T, 3, 3)``: scalar products of the first three vectors, which are lengths and angles."""
    products: Array = vectors[:, :3] @ vectors[:, :3].swapaxes(1, 2)
    return products
