"""Reference: the manifold oracle for bodies that hardly change, and the energy's matrix."""

from dataclasses import replace

import numpy as np
import pytest

from pacmo_core.interaction_mesh import Scene, warm_start
from pacmo_core.interaction_mesh import warm_start as module
from pacmo_core.interaction_mesh.energy import build_energy, energy_rhs, hessian_product
from pacmo_core.interaction_mesh.warm_start import linear_response
from tests.interaction_mesh.oracles import manifold
from tests.interaction_mesh.scenes import ARM, LEG, SETTINGS, scene

SMALL = 1e-4


@pytest.mark.parametrize("n_frames", [2, 7, 8])
def test_the_linear_response_equals_the_oracle_for_small_growth(n_frames):
    source = scene(1, n_frames, skeletons=(ARM, LEG))
    energy = build_energy(source, SETTINGS)
    response = linear_response(source, energy)
    for bone in (0, 3, 6):
        scales = np.ones(7)
        scales[bone] += SMALL
        displacement = manifold(source, energy, scales)
        parent, child = source.bones.T
        per_growth = (displacement[:, child] - displacement[:, parent]) / SMALL
        per_growth[:, bone] -= source.bone_vectors[:, bone]
        np.testing.assert_allclose(response.displacements[..., bone], per_growth, atol=2e-3)


def test_tensions_balance_the_forces_on_the_joints_of_the_oracle():
    source = scene(2, 6)
    energy = build_energy(source, SETTINGS)
    response = linear_response(source, energy)
    scales = 1 + SMALL * np.random.default_rng(0).normal(size=10)
    displacement = manifold(source, energy, scales)[..., None]
    force = (energy_rhs(energy, scales[None]) - hessian_product(energy, displacement))[..., 0]
    tension_force = np.zeros_like(force)
    lengths = np.linalg.norm(source.bone_vectors, axis=-1, keepdims=True)
    pulls = (response.tensions @ (scales - 1))[..., None] * source.bone_vectors / lengths
    for bone, (parent, child) in enumerate(source.bones):
        tension_force[:, child] += pulls[:, bone]
        tension_force[:, parent] -= pulls[:, bone]
    np.testing.assert_allclose(force, tension_force, atol=2e-2 * np.abs(force).max())


def test_the_warm_start_has_the_target_lengths_at_infinite_penalty():
    source = scene(3, 5)
    response = linear_response(source, build_energy(source, SETTINGS))
    scales = np.random.default_rng(0).uniform(0.75, 1.25, size=(3, 10))
    rigid = np.full((5, 10, 1), np.inf, dtype=np.float32)
    bones = response.warm_start(source.bone_vectors, scales, rigid)
    target_lengths = np.linalg.norm(source.bone_vectors, axis=-1)[..., None] * scales.T
    np.testing.assert_allclose(np.linalg.norm(bones, axis=2), target_lengths, rtol=1e-5)


def test_the_response_at_a_higher_frame_rate_is_interpolated_from_thirty():
    drawn = scene(3, 9)
    source = Scene(drawn.motions, drawn.skeletons, fps=60.0)
    response = linear_response(source, build_energy(source, SETTINGS))
    assert response.stride == 2 and len(response.displacements) == len(response.tensions) == 5
    scales = np.full((1, 10), 1.1)
    bones = response.warm_start(source.bone_vectors, scales, np.ones((9, 10, 1), dtype=np.float32))[
        ..., 0
    ]
    along = bones / np.linalg.norm(bones, axis=-1, keepdims=True)
    sideways = np.zeros((9, 10, 3))
    sideways[::2] = response.displacements @ (scales[0] - 1)
    sideways[1::2] = (sideways[:-1:2] + sideways[2::2]) / 2
    expected = 1.1 * source.bone_vectors + sideways
    expected /= np.linalg.norm(expected, axis=-1, keepdims=True)
    np.testing.assert_allclose(along, expected, atol=1e-5)


@pytest.mark.parametrize(("anchor", "is_lost"), [(1e-3, False), (1e-7, True)])
def test_the_response_equals_that_of_float64_even_if_float32_loses_the_regularisation(
    anchor, is_lost, monkeypatch
):
    weights = replace(SETTINGS.weights, regularisation=anchor, root=0)
    source = scene(1, 20)
    energy = build_energy(source, replace(SETTINGS, weights=weights))
    precisions = []
    eliminate = warm_start._block_cholesky_solve

    def watched(energy, basis, rhs):
        precisions.append(rhs.dtype)
        return eliminate(energy, basis, rhs)

    monkeypatch.setattr(warm_start, "_block_cholesky_solve", watched)
    response = linear_response(source, energy).displacements
    assert precisions == [np.float32, np.float64][: 1 + is_lost]

    def exactly(energy, basis, rhs):
        return eliminate(energy, basis, rhs.astype(np.float64)).astype(np.float32)

    monkeypatch.setattr(module, "solve_reduced", exactly)
    np.testing.assert_allclose(response, linear_response(source, energy).displacements, atol=2e-5)
