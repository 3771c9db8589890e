"""Trusted: the manifold oracle on bodies that hardly differ, and the energy's matrix."""

from dataclasses import replace

import numpy as np
import pytest

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.interaction_mesh import Scene, warm_start
from pacmo_core.interaction_mesh import warm_start as module
from pacmo_core.interaction_mesh.energy import build_energy, energy_target, hessian_product
from pacmo_core.interaction_mesh.warm_start import linear_response
from tests.interaction_mesh.oracles import manifold, matrix
from tests.interaction_mesh.scenes import ARM, SETTINGS, scene

LEG = Skeleton("leg", ("hip", "left_knee", "left_foot"), (-1, 0, 1))
LITTLE = 1e-4


@pytest.mark.parametrize("n_frames", [1, 2, 3, 6])
def test_forces_are_those_of_the_energys_matrix(n_frames):
    source = scene(0, n_frames)
    energy = build_energy(source, SETTINGS)
    change = np.random.default_rng(0).normal(size=(*source.points.shape, 2))
    for v in range(2):
        expected = matrix(energy) @ change[..., v].reshape(-1)
        found = hessian_product(energy, change)[..., v].reshape(-1)
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("n_frames", [2, 7, 8])
def test_bones_that_hardly_grow_turn_as_the_oracle_turns_them(n_frames):
    source = scene(1, n_frames, skeletons=(ARM, LEG))
    energy = build_energy(source, SETTINGS)
    found = linear_response(source, energy)
    for bone in (0, 3, 6):
        scales = np.ones(7)
        scales[bone] += LITTLE
        change = manifold(source, energy, scales)
        parent, child = source.bones.T
        grown = (change[:, child] - change[:, parent]) / LITTLE
        grown[:, bone] -= source.bone_vectors[:, bone]
        np.testing.assert_allclose(found.displacements[..., bone], grown, atol=2e-3)


def test_tensions_are_what_keeps_joints_where_the_oracle_puts_them():
    source = scene(2, 6)
    energy = build_energy(source, SETTINGS)
    found = linear_response(source, energy)
    scales = 1 + LITTLE * np.random.default_rng(0).normal(size=10)
    change = manifold(source, energy, scales)[..., None]
    target = energy_target(energy, scales[None])[..., 0]
    left = energy.laplacians.transpose(0, 2, 1) @ target - hessian_product(energy, change)[..., 0]
    held = np.zeros_like(left)
    lengths = np.linalg.norm(source.bone_vectors, axis=-1, keepdims=True)
    pulls = (found.tensions @ (scales - 1))[..., None] * source.bone_vectors / lengths
    for bone, (parent, child) in enumerate(source.bones):
        held[:, child] += pulls[:, bone]
        held[:, parent] -= pulls[:, bone]
    np.testing.assert_allclose(left, held, atol=2e-2 * np.abs(left).max())


def test_the_start_of_a_body_has_its_lengths_where_nothing_bears_on_its_bones():
    source = scene(3, 5)
    found = linear_response(source, build_energy(source, SETTINGS))
    scales = np.random.default_rng(0).uniform(0.75, 1.25, size=(3, 10))
    rigid = np.full((5, 10, 1), np.inf, dtype=np.float32)
    bones = found.warm_start(source.bone_vectors, scales, rigid)
    wanted = np.linalg.norm(source.bone_vectors, axis=-1)[..., None] * scales.T
    np.testing.assert_allclose(np.linalg.norm(bones, axis=2), wanted, rtol=1e-5)


def test_a_motion_of_more_frames_a_second_is_answered_at_thirty_and_filled_in_between():
    drawn = scene(3, 9)
    source = Scene(drawn.motions, drawn.skeletons, fps=60.0)
    found = linear_response(source, build_energy(source, SETTINGS))
    assert found.stride == 2 and len(found.displacements) == len(found.tensions) == 5
    scales = np.full((1, 10), 1.1)
    bones = found.warm_start(source.bone_vectors, scales, np.ones((9, 10, 1), dtype=np.float32))[
        ..., 0
    ]
    along = bones / np.linalg.norm(bones, axis=-1, keepdims=True)
    sideways = np.zeros((9, 10, 3))
    sideways[::2] = found.displacements @ (scales[0] - 1)
    sideways[1::2] = (sideways[:-1:2] + sideways[2::2]) / 2
    expected = 1.1 * source.bone_vectors + sideways
    expected /= np.linalg.norm(expected, axis=-1, keepdims=True)
    np.testing.assert_allclose(along, expected, atol=1e-5)


def test_parts_of_a_long_motion_give_nearly_what_the_whole_does(monkeypatch):
    source = scene(4, 60)
    energy = build_energy(source, SETTINGS)
    whole = linear_response(source, energy).displacements
    monkeypatch.setattr(module, "SEGMENT_FRAMES", 20)
    monkeypatch.setattr(module, "OVERLAP_FRAMES", 20)
    parts = linear_response(source, energy).displacements
    assert parts.tobytes() != whole.tobytes()
    np.testing.assert_allclose(parts, whole, atol=0.05 * np.abs(whole).max())


@pytest.mark.parametrize(("anchor", "is_lost"), [(1e-3, False), (1e-7, True)])
def test_answers_are_those_of_float64_whether_float32_holds_the_anchor_or_not(
    anchor, is_lost, monkeypatch
):
    weights = replace(SETTINGS.weights, regularisation=anchor)
    source = scene(0, 20)
    energy = build_energy(source, replace(SETTINGS, weights=weights))
    precisions = []
    eliminate = warm_start._block_cholesky_solve

    def watched(energy, free, right):
        precisions.append(right.dtype)
        return eliminate(energy, free, right)

    monkeypatch.setattr(warm_start, "_block_cholesky_solve", watched)
    found = linear_response(source, energy).displacements
    assert precisions == [np.float32, np.float64][: 1 + is_lost]

    def exactly(energy, free, right):
        return eliminate(energy, free, right.astype(np.float64)).astype(np.float32)

    monkeypatch.setattr(module, "solve_reduced", exactly)
    np.testing.assert_allclose(found, linear_response(source, energy).displacements, atol=2e-5)
