"""Trusted: symmetries that any answer must have, and the lengths that were asked for."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacmo_core.data.skeleton import DUET15, EXPI18, INTERHUMAN22, NTU25, SBU15
from pacmo_core.interaction_mesh import Limits, Rung, Scene, prepare, vary
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
    found = vary(prepare(source, SETTINGS), np.ones((1, 10)))
    np.testing.assert_allclose(found.points[0], source.points, atol=1e-6)
    report = found.reports[0]
    assert report.raw_residual < 1e-5 and report.near_error < 1e-5
    assert report.contacts_kept == 1 and report.flip_share == 0
    assert sum(report.energy.values()) < 1e-9


@few
@given(st.integers(0, 1000), st.data())
def test_every_bone_has_the_length_that_was_asked_for(seed, data):
    source = scene(seed, 7)
    scales = np.array([data.draw(st.lists(st.floats(0.75, 1.25), min_size=10, max_size=10))])
    found = vary(prepare(source, SETTINGS), scales)
    wanted = scales[:, None] * np.linalg.norm(source.vectors, axis=-1)
    np.testing.assert_allclose(lengths_of(source, found.points), wanted, rtol=0, atol=1e-12)


@pytest.mark.parametrize("skeleton", [NTU25, SBU15, DUET15, EXPI18, INTERHUMAN22])
def test_it_takes_any_skeleton_and_two_that_differ(skeleton):
    source = scene(1, 4, skeletons=(skeleton, ARM), apart=0.6)
    scales = np.ones((1, len(source.bones)))
    scales[0, 0], scales[0, -1] = 0.8, 1.2
    found = vary(prepare(source, SETTINGS), scales)
    wanted = scales[:, None] * np.linalg.norm(source.vectors, axis=-1)
    np.testing.assert_allclose(lengths_of(source, found.points), wanted, rtol=0, atol=1e-12)
    assert found.reports[0].raw_residual < 1e-2


@few
@given(st.integers(0, 1000), st.floats(-3, 3), st.floats(-2, 2))
def test_a_turned_and_shifted_scene_gives_the_turned_and_shifted_variation(seed, turn, by):
    source = scene(seed, 7)
    scales = np.ones((1, 10))
    scales[0, 5:] = 0.85
    there = moved(source, turn, [by, 0.3, -by])
    before = vary(prepare(source, thorough(300)), scales).points[0]
    after = vary(prepare(there, thorough(300)), scales).points[0]
    bodies = tuple(np.split(before.astype(np.float32), 2, axis=1))
    expected = moved(Scene(bodies, source.skeletons, source.fps), turn, [by, 0.3, -by])
    np.testing.assert_allclose(after, expected.points, atol=2e-3)


@pytest.mark.parametrize("scale", [0.8, 1.2])
def test_two_bodies_that_grow_alike_are_the_whole_scene_grown(scale):
    source = scene(2, 9)
    found = vary(prepare(source, SETTINGS), np.full((1, 10), scale))
    middle = source.points.mean(axis=(0, 1))
    middle[1] = source.ground
    expected = middle + scale * (source.points - middle)
    np.testing.assert_allclose(found.points[0], expected, atol=1e-5)


def test_who_is_a_and_who_is_b_does_not_matter():
    source = scene(3, 9)
    scales = np.ones((1, 10))
    scales[0, :5] = 0.85
    swapped = Scene(source.motions[::-1], source.skeletons[::-1], source.fps)
    one = vary(prepare(source, thorough(300)), scales).points[0]
    other = vary(prepare(swapped, thorough(300)), np.roll(scales, 5, axis=1)).points[0]
    np.testing.assert_allclose(np.roll(other, 6, axis=1), one, atol=1e-3)


def test_a_tie_of_contact_keeps_touching_joints_together():
    source = touching_scene(4, 9)
    apart = np.linalg.norm(source.points[:, :6, None] - source.points[:, None, 6:], axis=-1)
    assert (apart < SETTINGS.near).any()
    scales = np.ones((1, 10))
    scales[0, 5:] = 0.8
    (report,) = vary(prepare(source, SETTINGS), scales).reports
    assert report.near_error < report.near_error_naive


def test_bodies_kept_apart_come_no_closer_than_the_source_or_the_clearance():
    source = touching_scene(5, 9)
    scales = np.ones((1, 10))
    scales[0, :5] = 1.25
    free = replace(
        thorough(300),
        weights=replace(SETTINGS.weights, contact=0),
        clearance=0.25,
        guarded=36,
        limits=Limits(residual=1, penetration=1, seam=100),
    )
    kept = replace(free, rungs=(Rung(penalty=15, iterations=600, apart=40, step=0),))
    (loose,) = vary(prepare(source, free), scales).reports
    (held,) = vary(prepare(source, kept), scales).reports
    assert loose.penetration > 0.02
    assert held.penetration < 0.005
    assert held.raw_residual < 1e-2
