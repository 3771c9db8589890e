"""Reference: the energy summed by its definition, and its matrix."""

from dataclasses import replace

import numpy as np
import pytest

from pacmo_core.interaction_mesh import prepare, retarget
from pacmo_core.interaction_mesh.energy import (
    build_energy,
    energy_target,
    energy_terms,
    hessian_product,
)
from pacmo_core.interaction_mesh.scene import naive_scaling
from tests.interaction_mesh.oracles import (
    banded,
    differences,
    energy_by_definition,
    energy_value,
    manifold,
    matrix,
    right_side,
)
from tests.interaction_mesh.scenes import SETTINGS, random_scales, scene


def test_the_trunk_term_is_zero_for_a_scaled_and_translated_trunk_and_positive_for_a_bent_one():
    source = scene(1)
    scales = np.random.default_rng(0).uniform(0.8, 1.2, size=(1, 10))
    energy = build_energy(source, SETTINGS)
    displacement = naive_scaling(source, scales) - source.points[..., None] + 0.3
    target = energy_target(energy, scales)
    assert energy_terms(energy, displacement, target)["trunk_shape"][0] == pytest.approx(
        0, abs=1e-20
    )
    displacement[:, 1] += 0.1  # the chest against the root
    expected = SETTINGS.weights.trunk_shape * len(source.points) * 2 * 0.05**2 * 3 / 2
    assert energy_terms(energy, displacement, target)["trunk_shape"][0] == pytest.approx(expected)


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

    assert bent(100) < 0.2 * bent(0)


def test_the_terms_sum_to_the_energy_by_definition():
    source = scene()
    energy = build_energy(source, SETTINGS)
    assert energy.is_support.any() and not energy.is_support.all()
    scales = random_scales(10)
    displacement = np.random.default_rng(1).normal(scale=0.1, size=(*source.points.shape, 3))
    target = energy_target(energy, scales)
    terms = sum(energy_terms(energy, displacement, target).values())
    expected = [
        energy_by_definition(energy, displacement[..., v], target[..., v]) for v in range(3)
    ]
    np.testing.assert_allclose(terms, expected, rtol=1e-10)


def test_the_target_is_the_laplacian_of_the_source_with_each_bone_scaled_alone():
    source = scene()
    energy = build_energy(source, SETTINGS)
    scales = random_scales(10)[0]
    expected = np.zeros(source.points.shape)
    weights = -energy.laplacians[:, :12] * (1 - np.eye(12))
    for i in range(12):
        for j in range(12):
            difference = source.points[:, i] - source.points[:, j]
            for scale, (parent, child) in zip(scales, source.bones, strict=True):
                if {i, j} == {parent, child}:
                    expected[:, i] += weights[:, i, j, None] * (scale - 1) * difference
    result = energy_target(energy, scales[None])[:, :12, :, 0]
    np.testing.assert_allclose(result, expected, atol=1e-12)


def test_the_oracles_matrix_is_that_of_the_energy():
    source = scene(n_frames=6)
    energy = build_energy(source, SETTINGS)
    scales = random_scales(10)[0]
    random = np.random.default_rng(2)
    for _ in range(3):
        displacement = random.normal(size=source.points.shape)
        flat = displacement.reshape(-1)
        target = energy_target(energy, scales[None])[..., 0]
        by_matrix = flat @ (matrix(energy) @ flat) / 2 - flat @ right_side(energy, scales)
        by_matrix += np.sum(target**2) / 2
        assert by_matrix == pytest.approx(energy_value(energy, displacement, scales), rel=1e-9)


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
