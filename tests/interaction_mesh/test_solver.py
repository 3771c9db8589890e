"""Trusted: the energy summed by its definition, and two solvers that go other ways."""

from dataclasses import replace

import numpy as np
import pytest

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.interaction_mesh import prepare, vary
from pacmo_core.interaction_mesh.energy import energy_terms, quadratic, target_of
from pacmo_core.interaction_mesh.source import BATCH
from tests.interaction_mesh.oracles import (
    banded,
    differences,
    energy_by_definition,
    manifold,
    matrix,
    right_side,
)
from tests.interaction_mesh.scenes import ARM, SETTINGS, scene, thorough

LEG = Skeleton("leg", ("hip", "left_knee", "left_foot"), (-1, 0, 1))


def some_scales(n_bones: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.75, 1.25, size=(3, n_bones))


def value(energy, change, scales) -> float:
    return energy_by_definition(energy, change, target_of(energy, scales[None])[..., 0])


def test_the_terms_add_up_to_the_energy_by_its_definition():
    source = scene()
    energy = quadratic(source, SETTINGS)
    assert energy.standing.any() and not energy.standing.all()
    scales = some_scales(10)
    change = np.random.default_rng(1).normal(scale=0.1, size=(*source.points.shape, 3))
    target = target_of(energy, scales)
    terms = sum(energy_terms(energy, change, target).values())
    expected = [energy_by_definition(energy, change[..., v], target[..., v]) for v in range(3)]
    np.testing.assert_allclose(terms, expected, rtol=1e-10)


def test_the_target_is_the_laplacian_of_the_source_with_its_bones_scaled_one_by_one():
    source = scene()
    energy = quadratic(source, SETTINGS)
    scales = some_scales(10)[0]
    expected = np.zeros(source.points.shape)
    weights = -energy.laplacians[:, :12] * (1 - np.eye(12))
    for i in range(12):
        for j in range(12):
            apart = source.points[:, i] - source.points[:, j]
            for scale, (parent, child) in zip(scales, source.bones, strict=True):
                if {i, j} == {parent, child}:
                    expected[:, i] += weights[:, i, j, None] * (scale - 1) * apart
    found = target_of(energy, scales[None])[:, :12, :, 0]
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_the_oracles_matrix_is_that_of_the_energy():
    source = scene(n_frames=6)
    energy = quadratic(source, SETTINGS)
    scales = some_scales(10)[0]
    random = np.random.default_rng(2)
    for _ in range(3):
        change = random.normal(size=source.points.shape)
        flat = change.reshape(-1)
        target = target_of(energy, scales[None])[..., 0]
        by_matrix = flat @ (matrix(energy) @ flat) / 2 - flat @ right_side(energy, scales)
        by_matrix += np.sum(target**2) / 2
        assert by_matrix == pytest.approx(value(energy, change, scales), rel=1e-9)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("oracle", [banded, manifold])
def test_the_oracles_end_with_bones_of_their_lengths_and_no_force_but_along_them(seed, oracle):
    source = scene(seed, n_frames=8)
    energy = quadratic(source, SETTINGS)
    scales = some_scales(10, seed)[0]
    change = oracle(source, energy, scales)
    vectors = (differences(source) @ (source.points + change).reshape(-1)).reshape(-1, 3)
    lengths = np.linalg.norm(vectors, axis=1)
    wanted = (np.linalg.norm(source.vectors, axis=-1) * scales).reshape(-1)
    np.testing.assert_allclose(lengths, wanted, rtol=1e-5)
    slope = matrix(energy) @ change.reshape(-1) - right_side(energy, scales)
    along = differences(source).toarray().reshape(len(lengths), 3, -1)
    along = np.einsum("bi,bij->bj", vectors / lengths[:, None], along)
    left = slope - along.T @ np.linalg.lstsq(along.T, slope, rcond=None)[0]
    assert np.abs(left).max() < 1e-4 * np.abs(right_side(energy, scales)).max()


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_it_ends_where_both_oracles_do(seed):
    source = scene(seed, n_frames=9)
    energy = quadratic(source, SETTINGS)
    scales = some_scales(10, seed)
    # So that neither the whole scene nor a ladder comes between.
    scales[:, :5] = 1
    found = vary(prepare(source, thorough()), scales)
    for points, own in zip(found.points, scales, strict=True):
        ours = value(energy, points - source.points, own)
        for oracle in (banded, manifold):
            theirs = value(energy, oracle(source, energy, own), own)
            assert ours == pytest.approx(theirs, rel=1e-3)


@pytest.mark.parametrize("n_frames", [1, 2, 3, 4, 15])
def test_its_energy_is_within_half_a_percent_after_the_usual_iterations(n_frames):
    source = scene(3, n_frames)
    energy = quadratic(source, SETTINGS)
    scales = np.ones((2, 10))
    scales[0, 5:], scales[1, 7] = 0.8, 1.25
    found = vary(prepare(source, SETTINGS), scales)
    for points, own in zip(found.points, scales, strict=True):
        ours = value(energy, points - source.points, own)
        theirs = value(energy, manifold(source, energy, own), own)
        assert ours <= 1.005 * theirs


def test_uneven_skeletons_end_where_the_oracle_does():
    source = scene(4, 8, skeletons=(ARM, LEG))
    energy = quadratic(source, SETTINGS)
    scales = np.ones((1, 7))
    scales[0, 5:] = 1.2
    found = vary(prepare(source, thorough()), scales)
    ours = value(energy, found.points[0] - source.points, scales[0])
    theirs = value(energy, manifold(source, energy, scales[0]), scales[0])
    assert ours == pytest.approx(theirs, rel=1e-3)


def test_the_reported_energy_is_that_of_the_motion():
    source = scene(5)
    scales = np.ones((1, 10))
    scales[0, 2] = 0.8
    prepared = prepare(source, SETTINGS)
    found = vary(prepared, scales)
    expected = value(prepared.energy, found.points[0] - source.points, scales[0])
    assert sum(found.reports[0].energy.values()) == pytest.approx(expected, rel=1e-5)


def test_a_variation_has_the_same_bytes_alone_as_in_company():
    source = scene(6)
    scales = np.random.default_rng(0).uniform(0.8, 1.2, size=(BATCH + 5, 10))
    prepared = prepare(source, SETTINGS)
    together = vary(prepared, scales)
    for number in (0, 7, BATCH - 1, BATCH + 4):
        alone = vary(prepared, scales[[number]])
        assert alone.points.tobytes() == together.points[[number]].tobytes()
        assert alone.reports[0] == together.reports[number]


def test_no_body_asked_for_is_none_given():
    found = vary(prepare(scene(), SETTINGS), np.ones((0, 10)))
    assert found.points.shape == (0, 15, 12, 3)
    assert found.reports == ()


def test_delaunay_ties_fewer_points_and_ends_where_the_oracle_does():
    source = scene(7, 8)
    settings = replace(thorough(), graph="delaunay")
    energy = quadratic(source, settings)
    assert (energy.laplacians != 0).sum() < (quadratic(source, SETTINGS).laplacians != 0).sum()
    scales = np.ones((1, 10))
    scales[0, 5:] = 0.85
    found = vary(prepare(source, settings), scales)
    ours = value(energy, found.points[0] - source.points, scales[0])
    theirs = value(energy, manifold(source, energy, scales[0]), scales[0])
    assert ours == pytest.approx(theirs, rel=1e-3)
