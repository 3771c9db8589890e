"""Reference: symmetries of the problem, target lengths, and two other solvers (``oracles``)."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacmo_core.data.skeleton import DUET15, EXPI18, INTERHUMAN22, NTU25, SBU15
from pacmo_core.interaction_mesh import Attempt, AttemptLimits, Scene, prepare, retarget
from pacmo_core.interaction_mesh.energy import build_energy
from pacmo_core.interaction_mesh.retargeting import GROWTH_SHARING_EXPONENT, MAX_BATCH, step_scale
from tests.interaction_mesh.oracles import (
    banded,
    energy_value,
    manifold,
)
from tests.interaction_mesh.scenes import (
    ARM,
    LEG,
    SETTINGS,
    random_scales,
    scene,
    thorough,
    touching_scene,
)

FEW = settings(derandomize=True, deadline=None, max_examples=10)


def transformed(source: Scene, angle: float, by: list[float]) -> Scene:
    cos, sin = np.cos(angle), np.sin(angle)
    rotation = np.array([[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]])
    motions = tuple((motion @ rotation + by).astype(np.float32) for motion in source.motions)
    return Scene(motions, source.skeletons, source.fps)


def lengths_of(source: Scene, points: np.ndarray) -> np.ndarray:
    parent, child = source.bones.T
    return np.linalg.norm(points[:, :, child] - points[:, :, parent], axis=-1)


@FEW
@given(st.integers(0, 1000), st.integers(1, 12))
def test_scales_of_one_give_the_source(seed, n_frames):
    source = scene(seed, n_frames)
    result = retarget(prepare(source, SETTINGS), np.ones((1, 10)))
    np.testing.assert_allclose(result.points[0], source.points, atol=1e-6)
    report = result.reports[0]
    assert report.primal_residual < 1e-5 and report.near_distance_error < 1e-5
    assert report.contacts_preserved == 1 and report.bend_flip_fraction == 0
    assert sum(report.energy.values()) < 1e-9


@FEW
@given(st.integers(0, 1000), st.data())
def test_every_bone_has_its_target_length(seed, data):
    source = scene(seed, 7)
    scales = np.array([data.draw(st.lists(st.floats(0.75, 1.25), min_size=10, max_size=10))])
    result = retarget(prepare(source, SETTINGS), scales)
    target_lengths = scales[:, None] * np.linalg.norm(source.bone_vectors, axis=-1)
    np.testing.assert_allclose(
        lengths_of(source, result.points), target_lengths, rtol=0, atol=1e-12
    )


@pytest.mark.parametrize("skeleton", [NTU25, SBU15, DUET15, EXPI18, INTERHUMAN22])
def test_any_two_skeletons_can_be_retargeted(skeleton):
    source = scene(1, 4, skeletons=(skeleton, ARM), distance=0.6)
    scales = np.ones((1, len(source.bones)))
    scales[0, 0], scales[0, -1] = 0.8, 1.2
    result = retarget(prepare(source, SETTINGS), scales)
    target_lengths = scales[:, None] * np.linalg.norm(source.bone_vectors, axis=-1)
    np.testing.assert_allclose(
        lengths_of(source, result.points), target_lengths, rtol=0, atol=1e-12
    )
    assert result.reports[0].primal_residual < 1e-2


@FEW
@given(st.integers(0, 1000), st.floats(-3, 3), st.floats(-2, 2))
def test_retargeting_commutes_with_rotation_and_translation(seed, angle, by):
    source = scene(seed, 7)
    scales = np.ones((1, 10))
    scales[0, 5:] = 0.85
    moved_source = transformed(source, angle, [by, 0.3, -by])
    before = retarget(prepare(source, thorough(300)), scales).points[0]
    after = retarget(prepare(moved_source, thorough(300)), scales).points[0]
    bodies = tuple(np.split(before.astype(np.float32), 2, axis=1))
    expected = transformed(Scene(bodies, source.skeletons, source.fps), angle, [by, 0.3, -by])
    np.testing.assert_allclose(after, expected.points, atol=2e-3)


@pytest.mark.parametrize("scale", [0.8, 1.2])
def test_a_scale_of_both_bodies_scales_the_scene(scale):
    source = scene(2, 9)
    result = retarget(prepare(source, SETTINGS), np.full((1, 10), scale))
    middle = source.points.mean(axis=(0, 1))
    middle[1] = source.ground_height
    expected = middle + scale * (source.points - middle)
    np.testing.assert_allclose(result.points[0], expected, atol=1e-5)


def test_retargeting_commutes_with_swapping_the_people():
    source = scene(3, 9)
    scales = np.ones((1, 10))
    scales[0, :5] = 0.85
    swapped = Scene(source.motions[::-1], source.skeletons[::-1], source.fps)
    one = retarget(prepare(source, thorough(300)), scales).points[0]
    other = retarget(prepare(swapped, thorough(300)), np.roll(scales, 5, axis=1)).points[0]
    np.testing.assert_allclose(np.roll(other, 6, axis=1), one, atol=1e-3)


def test_near_distances_change_less_than_by_naive_scaling():
    source = touching_scene(4, 9)
    distances = np.linalg.norm(source.points[:, :6, None] - source.points[:, None, 6:], axis=-1)
    assert (distances < SETTINGS.near_distance).any()
    scales = np.ones((1, 10))
    scales[0, 5:] = 0.8
    (report,) = retarget(prepare(source, SETTINGS), scales).reports
    assert report.near_distance_error < report.near_distance_error_naive


def test_separation_constraints_prevent_penetration():
    source = touching_scene(5, 9)
    scales = np.ones((1, 10))
    scales[0, :5] = 1.25
    without_constraints = replace(
        thorough(300),
        weights=replace(SETTINGS.weights, contact=0),
        clearance=0.25,
        n_separation_pairs=36,
        limits=AttemptLimits(primal_residual=1, penetration=1, acceleration_peak_ratio=100),
    )
    constrained = replace(
        without_constraints,
        attempts=(
            Attempt(bone_penalty=15, max_iterations=600, separation_penalty=40, tolerance=0),
        ),
    )
    (unconstrained,) = retarget(prepare(source, without_constraints), scales).reports
    (separated,) = retarget(prepare(source, constrained), scales).reports
    assert unconstrained.penetration > 0.02
    assert separated.penetration < 0.005
    assert separated.primal_residual < 1e-2


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_retargeting_converges_to_the_energy_of_both_oracles(seed):
    source = scene(seed, n_frames=9)
    energy = build_energy(source, SETTINGS)
    scales = random_scales(10, seed)
    # One body only: the energy is compared before the scene is scaled as a whole.
    scales[:, :5] = 1
    result = retarget(prepare(source, thorough()), scales)
    for points, body_scales in zip(result.points, scales, strict=True):
        ours = energy_value(energy, points - source.points, body_scales)
        for oracle in (banded, manifold):
            theirs = energy_value(energy, oracle(source, energy, body_scales), body_scales)
            assert ours == pytest.approx(theirs, rel=1e-3)


@pytest.mark.parametrize("n_frames", [1, 2, 3, 4, 15])
def test_the_energy_is_within_half_a_percent_of_the_minimum(n_frames):
    source = scene(3, n_frames)
    energy = build_energy(source, SETTINGS)
    scales = np.ones((2, 10))
    scales[0, 5:], scales[1, 7] = 0.8, 1.25
    result = retarget(prepare(source, SETTINGS), scales)
    for points, body_scales in zip(result.points, scales, strict=True):
        ours = energy_value(energy, points - source.points, body_scales)
        theirs = energy_value(energy, manifold(source, energy, body_scales), body_scales)
        assert ours <= 1.005 * theirs


def test_different_skeletons_converge_to_the_energy_of_the_oracle():
    source = scene(4, 8, skeletons=(ARM, LEG))
    energy = build_energy(source, SETTINGS)
    scales = np.ones((1, 7))
    scales[0, 5:] = 1.2
    result = retarget(prepare(source, thorough()), scales)
    ours = energy_value(energy, result.points[0] - source.points, scales[0])
    theirs = energy_value(energy, manifold(source, energy, scales[0]), scales[0])
    assert ours == pytest.approx(theirs, rel=1e-3)


def test_the_reported_energy_is_that_of_the_motion():
    source = scene(5)
    scales = np.ones((1, 10))
    scales[0, 2] = 0.8
    prepared = prepare(source, SETTINGS)
    result = retarget(prepared, scales)
    expected = energy_value(prepared.energy, result.points[0] - source.points, scales[0])
    assert sum(result.reports[0].energy.values()) == pytest.approx(expected, rel=1e-5)


def test_a_variation_has_the_same_bytes_in_any_batch():
    source = scene(6)
    scales = np.random.default_rng(0).uniform(0.8, 1.2, size=(MAX_BATCH + 5, 10))
    prepared = prepare(source, SETTINGS)
    together = retarget(prepared, scales)
    for number in (0, 7, MAX_BATCH - 1, MAX_BATCH + 4):
        alone = retarget(prepared, scales[[number]])
        assert alone.points.tobytes() == together.points[[number]].tobytes()
        assert alone.reports[0] == together.reports[number]


def test_no_target_bodies_give_no_variations():
    result = retarget(prepare(scene(), SETTINGS), np.ones((0, 10)))
    assert result.points.shape == (0, 15, 12, 3)
    assert result.reports == ()


def test_the_delaunay_graph_has_fewer_edges_and_converges_to_the_oracle():
    source = scene(7, 8)
    settings = replace(thorough(), graph="delaunay")
    energy = build_energy(source, settings)
    assert (energy.laplacians != 0).sum() < (build_energy(source, SETTINGS).laplacians != 0).sum()
    scales = np.ones((1, 10))
    scales[0, 5:] = 0.85
    result = retarget(prepare(source, settings), scales)
    ours = energy_value(energy, result.points[0] - source.points, scales[0])
    theirs = energy_value(energy, manifold(source, energy, scales[0]), scales[0])
    assert ours == pytest.approx(theirs, rel=1e-3)


def test_the_step_scale_of_one_bone_is_its_growth() -> None:
    growth = np.zeros((1, 9))
    growth[0, 4] = 0.3
    np.testing.assert_allclose(step_scale(growth), [0.3])


def test_the_step_scale_falls_with_the_number_of_bones() -> None:
    np.testing.assert_allclose(step_scale(np.full((2, 7), 0.2)), 1.4 / 7**GROWTH_SHARING_EXPONENT)


def test_the_step_scale_is_homogeneous() -> None:
    growth = np.random.default_rng(0).uniform(size=(3, 5))
    np.testing.assert_allclose(step_scale(100 * growth), 100 * step_scale(growth))
