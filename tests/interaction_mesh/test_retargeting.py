"""Trusted: symmetries that any answer must have, and the lengths that were asked for."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacmo_core.data.skeleton import DUET15, EXPI18, INTERHUMAN22, NTU25, SBU15, Skeleton
from pacmo_core.interaction_mesh import Attempt, AttemptLimits, Scene, prepare, retarget
from pacmo_core.interaction_mesh.energy import build_energy, energy_target, energy_terms
from pacmo_core.interaction_mesh.retargeting import GROWTH_SHARING_EXPONENT, MAX_BATCH, step_scale
from tests.interaction_mesh.oracles import (
    banded,
    differences,
    energy_by_definition,
    manifold,
    matrix,
    right_side,
)
from tests.interaction_mesh.scenes import ARM, SETTINGS, scene, thorough, touching_scene

few = settings(derandomize=True, deadline=None, max_examples=10)


def moved(source: Scene, turn: float, by: list[float]) -> Scene:
    cos, sin = np.cos(turn), np.sin(turn)
    rotation = np.array([[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]])
    motions = tuple((motion @ rotation + by).astype(np.float32) for motion in source.motions)
    return Scene(motions, source.skeletons, source.fps)


def lengths_of(source: Scene, points: np.ndarray) -> np.ndarray:
    parent, child = source.bones.T
    return np.linalg.norm(points[:, :, child] - points[:, :, parent], axis=-1)


@few
@given(st.integers(0, 1000), st.integers(1, 12))
def test_the_source_on_its_own_bodies_is_the_source(seed, n_frames):
    source = scene(seed, n_frames)
    found = retarget(prepare(source, SETTINGS), np.ones((1, 10)))
    np.testing.assert_allclose(found.points[0], source.points, atol=1e-6)
    report = found.reports[0]
    assert report.primal_residual < 1e-5 and report.near_distance_error < 1e-5
    assert report.contacts_preserved == 1 and report.bend_flip_fraction == 0
    assert sum(report.energy.values()) < 1e-9


@few
@given(st.integers(0, 1000), st.data())
def test_every_bone_has_the_length_that_was_asked_for(seed, data):
    source = scene(seed, 7)
    scales = np.array([data.draw(st.lists(st.floats(0.75, 1.25), min_size=10, max_size=10))])
    found = retarget(prepare(source, SETTINGS), scales)
    wanted = scales[:, None] * np.linalg.norm(source.bone_vectors, axis=-1)
    np.testing.assert_allclose(lengths_of(source, found.points), wanted, rtol=0, atol=1e-12)


@pytest.mark.parametrize("skeleton", [NTU25, SBU15, DUET15, EXPI18, INTERHUMAN22])
def test_it_takes_any_skeleton_and_two_that_differ(skeleton):
    source = scene(1, 4, skeletons=(skeleton, ARM), apart=0.6)
    scales = np.ones((1, len(source.bones)))
    scales[0, 0], scales[0, -1] = 0.8, 1.2
    found = retarget(prepare(source, SETTINGS), scales)
    wanted = scales[:, None] * np.linalg.norm(source.bone_vectors, axis=-1)
    np.testing.assert_allclose(lengths_of(source, found.points), wanted, rtol=0, atol=1e-12)
    assert found.reports[0].primal_residual < 1e-2


@few
@given(st.integers(0, 1000), st.floats(-3, 3), st.floats(-2, 2))
def test_a_turned_and_shifted_scene_gives_the_turned_and_shifted_variation(seed, turn, by):
    source = scene(seed, 7)
    scales = np.ones((1, 10))
    scales[0, 5:] = 0.85
    there = moved(source, turn, [by, 0.3, -by])
    before = retarget(prepare(source, thorough(300)), scales).points[0]
    after = retarget(prepare(there, thorough(300)), scales).points[0]
    bodies = tuple(np.split(before.astype(np.float32), 2, axis=1))
    expected = moved(Scene(bodies, source.skeletons, source.fps), turn, [by, 0.3, -by])
    np.testing.assert_allclose(after, expected.points, atol=2e-3)


@pytest.mark.parametrize("scale", [0.8, 1.2])
def test_two_bodies_that_grow_alike_are_the_whole_scene_grown(scale):
    source = scene(2, 9)
    found = retarget(prepare(source, SETTINGS), np.full((1, 10), scale))
    middle = source.points.mean(axis=(0, 1))
    middle[1] = source.ground_height
    expected = middle + scale * (source.points - middle)
    np.testing.assert_allclose(found.points[0], expected, atol=1e-5)


def test_who_is_a_and_who_is_b_does_not_matter():
    source = scene(3, 9)
    scales = np.ones((1, 10))
    scales[0, :5] = 0.85
    swapped = Scene(source.motions[::-1], source.skeletons[::-1], source.fps)
    one = retarget(prepare(source, thorough(300)), scales).points[0]
    other = retarget(prepare(swapped, thorough(300)), np.roll(scales, 5, axis=1)).points[0]
    np.testing.assert_allclose(np.roll(other, 6, axis=1), one, atol=1e-3)


def test_a_tie_of_contact_keeps_touching_joints_together():
    source = touching_scene(4, 9)
    apart = np.linalg.norm(source.points[:, :6, None] - source.points[:, None, 6:], axis=-1)
    assert (apart < SETTINGS.near_distance).any()
    scales = np.ones((1, 10))
    scales[0, 5:] = 0.8
    (report,) = retarget(prepare(source, SETTINGS), scales).reports
    assert report.near_distance_error < report.near_distance_error_naive


def test_bodies_kept_apart_come_no_closer_than_the_source_or_the_clearance():
    source = touching_scene(5, 9)
    scales = np.ones((1, 10))
    scales[0, :5] = 1.25
    free = replace(
        thorough(300),
        weights=replace(SETTINGS.weights, contact=0),
        clearance=0.25,
        n_separation_pairs=36,
        limits=AttemptLimits(primal_residual=1, penetration=1, acceleration_peak_ratio=100),
    )
    kept = replace(
        free,
        attempts=(
            Attempt(bone_penalty=15, max_iterations=600, separation_penalty=40, tolerance=0),
        ),
    )
    (loose,) = retarget(prepare(source, free), scales).reports
    (held,) = retarget(prepare(source, kept), scales).reports
    assert loose.penetration > 0.02
    assert held.penetration < 0.005
    assert held.primal_residual < 1e-2


# FROM """Trusted: the energy summed by its definition, and two solvers that go other ways."""
LEG = Skeleton("leg", ("hip", "left_knee", "left_foot"), (-1, 0, 1))


def some_scales(n_bones: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.75, 1.25, size=(3, n_bones))


def value(energy, change, scales) -> float:
    return energy_by_definition(energy, change, energy_target(energy, scales[None])[..., 0])


def test_the_terms_add_up_to_the_energy_by_its_definition():
    source = scene()
    energy = build_energy(source, SETTINGS)
    assert energy.is_support.any() and not energy.is_support.all()
    scales = some_scales(10)
    change = np.random.default_rng(1).normal(scale=0.1, size=(*source.points.shape, 3))
    target = energy_target(energy, scales)
    terms = sum(energy_terms(energy, change, target).values())
    expected = [energy_by_definition(energy, change[..., v], target[..., v]) for v in range(3)]
    np.testing.assert_allclose(terms, expected, rtol=1e-10)


def test_the_target_is_the_laplacian_of_the_source_with_its_bones_scaled_one_by_one():
    source = scene()
    energy = build_energy(source, SETTINGS)
    scales = some_scales(10)[0]
    expected = np.zeros(source.points.shape)
    weights = -energy.laplacians[:, :12] * (1 - np.eye(12))
    for i in range(12):
        for j in range(12):
            apart = source.points[:, i] - source.points[:, j]
            for scale, (parent, child) in zip(scales, source.bones, strict=True):
                if {i, j} == {parent, child}:
                    expected[:, i] += weights[:, i, j, None] * (scale - 1) * apart
    found = energy_target(energy, scales[None])[:, :12, :, 0]
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_the_oracles_matrix_is_that_of_the_energy():
    source = scene(n_frames=6)
    energy = build_energy(source, SETTINGS)
    scales = some_scales(10)[0]
    random = np.random.default_rng(2)
    for _ in range(3):
        change = random.normal(size=source.points.shape)
        flat = change.reshape(-1)
        target = energy_target(energy, scales[None])[..., 0]
        by_matrix = flat @ (matrix(energy) @ flat) / 2 - flat @ right_side(energy, scales)
        by_matrix += np.sum(target**2) / 2
        assert by_matrix == pytest.approx(value(energy, change, scales), rel=1e-9)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("oracle", [banded, manifold])
def test_the_oracles_end_with_bones_of_their_lengths_and_no_force_but_along_them(seed, oracle):
    source = scene(seed, n_frames=8)
    energy = build_energy(source, SETTINGS)
    scales = some_scales(10, seed)[0]
    change = oracle(source, energy, scales)
    vectors = (differences(source) @ (source.points + change).reshape(-1)).reshape(-1, 3)
    lengths = np.linalg.norm(vectors, axis=1)
    wanted = (np.linalg.norm(source.bone_vectors, axis=-1) * scales).reshape(-1)
    np.testing.assert_allclose(lengths, wanted, rtol=1e-5)
    slope = matrix(energy) @ change.reshape(-1) - right_side(energy, scales)
    along = differences(source).toarray().reshape(len(lengths), 3, -1)
    along = np.einsum("bi,bij->bj", vectors / lengths[:, None], along)
    left = slope - along.T @ np.linalg.lstsq(along.T, slope, rcond=None)[0]
    assert np.abs(left).max() < 1e-4 * np.abs(right_side(energy, scales)).max()


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_it_ends_where_both_oracles_do(seed):
    source = scene(seed, n_frames=9)
    energy = build_energy(source, SETTINGS)
    scales = some_scales(10, seed)
    # So that neither the whole scene nor a ladder comes between.
    scales[:, :5] = 1
    found = retarget(prepare(source, thorough()), scales)
    for points, own in zip(found.points, scales, strict=True):
        ours = value(energy, points - source.points, own)
        for oracle in (banded, manifold):
            theirs = value(energy, oracle(source, energy, own), own)
            assert ours == pytest.approx(theirs, rel=1e-3)


@pytest.mark.parametrize("n_frames", [1, 2, 3, 4, 15])
def test_its_energy_is_within_half_a_percent_after_the_usual_iterations(n_frames):
    source = scene(3, n_frames)
    energy = build_energy(source, SETTINGS)
    scales = np.ones((2, 10))
    scales[0, 5:], scales[1, 7] = 0.8, 1.25
    found = retarget(prepare(source, SETTINGS), scales)
    for points, own in zip(found.points, scales, strict=True):
        ours = value(energy, points - source.points, own)
        theirs = value(energy, manifold(source, energy, own), own)
        assert ours <= 1.005 * theirs


def test_uneven_skeletons_end_where_the_oracle_does():
    source = scene(4, 8, skeletons=(ARM, LEG))
    energy = build_energy(source, SETTINGS)
    scales = np.ones((1, 7))
    scales[0, 5:] = 1.2
    found = retarget(prepare(source, thorough()), scales)
    ours = value(energy, found.points[0] - source.points, scales[0])
    theirs = value(energy, manifold(source, energy, scales[0]), scales[0])
    assert ours == pytest.approx(theirs, rel=1e-3)


def test_the_reported_energy_is_that_of_the_motion():
    source = scene(5)
    scales = np.ones((1, 10))
    scales[0, 2] = 0.8
    prepared = prepare(source, SETTINGS)
    found = retarget(prepared, scales)
    expected = value(prepared.energy, found.points[0] - source.points, scales[0])
    assert sum(found.reports[0].energy.values()) == pytest.approx(expected, rel=1e-5)


def test_a_variation_has_the_same_bytes_alone_as_in_company():
    source = scene(6)
    scales = np.random.default_rng(0).uniform(0.8, 1.2, size=(MAX_BATCH + 5, 10))
    prepared = prepare(source, SETTINGS)
    together = retarget(prepared, scales)
    for number in (0, 7, MAX_BATCH - 1, MAX_BATCH + 4):
        alone = retarget(prepared, scales[[number]])
        assert alone.points.tobytes() == together.points[[number]].tobytes()
        assert alone.reports[0] == together.reports[number]


def test_no_body_asked_for_is_none_given():
    found = retarget(prepare(scene(), SETTINGS), np.ones((0, 10)))
    assert found.points.shape == (0, 15, 12, 3)
    assert found.reports == ()


def test_delaunay_ties_fewer_points_and_ends_where_the_oracle_does():
    source = scene(7, 8)
    settings = replace(thorough(), graph="delaunay")
    energy = build_energy(source, settings)
    assert (energy.laplacians != 0).sum() < (build_energy(source, SETTINGS).laplacians != 0).sum()
    scales = np.ones((1, 10))
    scales[0, 5:] = 0.85
    found = retarget(prepare(source, settings), scales)
    ours = value(energy, found.points[0] - source.points, scales[0])
    theirs = value(energy, manifold(source, energy, scales[0]), scales[0])
    assert ours == pytest.approx(theirs, rel=1e-3)


# FROM """What a body's steps are held against: closed forms."""
def test_a_body_of_one_bone_is_asked_what_that_grows() -> None:
    grown = np.zeros((1, 9))
    grown[0, 4] = 0.3
    np.testing.assert_allclose(step_scale(grown), [0.3])


def test_of_equal_bones_each_asks_the_less_the_more_they_are() -> None:
    np.testing.assert_allclose(step_scale(np.full((2, 7), 0.2)), 1.4 / 7**GROWTH_SHARING_EXPONENT)


def test_the_unit_of_length_makes_no_difference() -> None:
    grown = np.random.default_rng(0).uniform(size=(3, 5))
    np.testing.assert_allclose(step_scale(100 * grown), 100 * step_scale(grown))
