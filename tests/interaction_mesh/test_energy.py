"""Reference: the energy summed by its definition, and its matrix."""

from dataclasses import replace

import numpy as np
import pytest

from pacmo_core.interaction_mesh import Scene, prepare, retarget
from pacmo_core.interaction_mesh.energy import build_energy, energy_of, hessian_product
from tests.interaction_mesh.oracles import (
    banded,
    differences,
    energy_by_definition,
    manifold,
    matrix,
    right_side,
)
from tests.interaction_mesh.scenes import SETTINGS, random_scales, scene, touching_scene


def test_a_larger_trunk_weight_keeps_the_trunk_of_a_smaller_body_straighter():
    source = scene(2)
    scales = np.ones((1, 10))
    scales[0, :5] = 0.75

    def bent(weight: float) -> float:
        weights = replace(SETTINGS.weights, trunk_shape=weight)
        points = retarget(prepare(source, replace(SETTINGS, weights=weights)), scales).points[0]
        trunk = points[:, 1] - points[:, 0]
        target_lengths = 0.75 * source.bone_vectors[:, 0]
        return float(np.linalg.norm(trunk - target_lengths, axis=-1).mean())

    assert bent(1000) < 0.5 * bent(0)


def test_the_quadratic_form_is_the_energy_by_definition():
    source = touching_scene()
    energy = build_energy(source, SETTINGS)
    assert energy.is_support.any() and not energy.is_support.all()
    scales = random_scales(10)
    displacement = np.random.default_rng(1).normal(scale=0.1, size=(*source.points.shape, 3))
    expected = [
        energy_by_definition(source, SETTINGS, displacement[..., v], scales[v]) for v in range(3)
    ]
    np.testing.assert_allclose(energy_of(energy, displacement, scales), expected, rtol=1e-5)


def test_a_body_apart_grows_along_its_own_directions_on_the_same_ground():
    source = scene(1, distance=5.0)
    scales = np.ones((1, 10))
    scales[0, :5] = 0.8
    points = retarget(prepare(source, SETTINGS), scales).points[0]
    np.testing.assert_allclose(points[:, 6:], source.points[:, 6:], atol=2e-3)
    parent, child = source.bones[:5].T
    vectors = points[:, child] - points[:, parent]
    np.testing.assert_allclose(vectors, 0.8 * source.bone_vectors[:, :5], atol=2e-2)
    lowest = source.points[:, :6, 1].min(axis=1)
    np.testing.assert_allclose(points[:, :6, 1].min(axis=1), lowest, atol=2e-2)


def test_an_energy_at_half_the_rate_has_the_same_weights_in_time():
    source = scene(0, 9)
    energy = build_energy(source, SETTINGS).subsample(2)
    half = scene(0, 9)
    slow = Scene(tuple(m[::2] for m in half.motions), half.skeletons, half.fps / 2)
    again = build_energy(slow, replace(SETTINGS, weights=SETTINGS.weights))
    assert energy.acceleration == pytest.approx(again.acceleration)
    assert energy.stance == pytest.approx(again.stance)
    assert len(energy.step_weights) == len(energy.height_weights) - 1


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("oracle", [banded, manifold])
def test_the_oracles_converge_to_target_lengths_with_forces_along_bones_only(seed, oracle):
    source = scene(seed, n_frames=8)
    energy = build_energy(source, SETTINGS)
    scales = random_scales(10, seed)[0]
    displacement = oracle(source, energy, scales)
    vectors = (differences(source) @ (source.points + displacement).reshape(-1)).reshape(-1, 3)
    lengths = np.linalg.norm(vectors, axis=1)
    target_lengths = (np.linalg.norm(source.bone_vectors, axis=-1) * scales).reshape(-1)
    np.testing.assert_allclose(lengths, target_lengths, rtol=1e-5)
    slope = matrix(energy) @ displacement.reshape(-1) - right_side(energy, scales)
    along = differences(source).toarray().reshape(len(lengths), 3, -1)
    along = np.einsum("bi,bij->bj", vectors / lengths[:, None], along)
    residual_force = slope - along.T @ np.linalg.lstsq(along.T, slope, rcond=None)[0]
    assert np.abs(residual_force).max() < 1e-4 * np.abs(right_side(energy, scales)).max()


@pytest.mark.parametrize("n_frames", [1, 2, 3, 6])
def test_hessian_product_equals_the_energys_matrix(n_frames):
    source = scene(0, n_frames)
    energy = build_energy(source, SETTINGS)
    displacement = np.random.default_rng(0).normal(size=(*source.points.shape, 2))
    for v in range(2):
        expected = matrix(energy) @ displacement[..., v].reshape(-1)
        result = hessian_product(energy, displacement)[..., v].reshape(-1)
        np.testing.assert_allclose(result, expected, rtol=1e-9, atol=1e-9)
