"""Reference: a search over both segments, and capsules whose depth follows by hand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacmo_core.data.interaction import closest_points
from pacmo_core.interaction_mesh import Scene
from pacmo_core.interaction_mesh.body_parts import capsule_radii
from pacmo_core.interaction_mesh.proximity import (
    capsule_penetration,
    closest_fractions,
    segment_differences,
)
from tests.interaction_mesh.scenes import scene


@settings(derandomize=True, deadline=None, max_examples=50)
@given(st.integers(0, 10_000), st.sampled_from(["any", "parallel", "crossing"]))
def test_the_closest_points_are_those_of_a_search(seed, kind):
    random = np.random.default_rng(seed)
    p, u, q, v = random.normal(size=(4, 3))
    if kind == "parallel":
        v = u * random.uniform(-2, 2)
    if kind == "crossing":
        q = p + random.uniform() * u - random.uniform() * v
    s, t, distance = closest_points((p, u), (q, v))
    grid = np.linspace(0, 1, 201)
    gaps = (p + grid[:, None, None] * u) - (q + grid[:, None] * v)
    assert distance <= np.linalg.norm(gaps, axis=-1).min() + 1e-9
    assert distance >= np.linalg.norm(gaps, axis=-1).min() - 0.02 * (
        np.linalg.norm(u) + np.linalg.norm(v)
    )
    assert np.linalg.norm(p + s * u - q - t * v) == pytest.approx(distance, abs=1e-9)


def test_a_difference_is_between_the_closest_points():
    source = scene(0, 4)
    first, second, distances = closest_fractions(source)
    bones = np.stack(np.divmod(np.arange(25), 5), axis=-1) + np.array([0, 5])
    bones = np.broadcast_to(bones, (4, 25, 2))
    points, coefficients = segment_differences(source, bones, first, second)
    frames = np.arange(4)[:, None]
    total = sum(
        coefficients[..., end, None] * source.points[frames, points[..., end]] for end in range(4)
    )
    np.testing.assert_allclose(np.linalg.norm(total, axis=-1), distances, atol=1e-9)


def test_bodies_that_are_moved_into_each_other_are_deeper_by_that():
    source = scene(1, 3, distance=0.5)
    radii = capsule_radii(source)
    reach = (radii[:5, None] + radii[5:]).reshape(-1)
    depths = []
    for closer in (0.0, 0.2, 0.4):
        motions = (source.motions[0], source.motions[1] - np.float32([0, 0, closer]))
        moved = Scene(motions, source.skeletons, source.fps)
        depth = (reach - closest_fractions(moved)[2]).max(axis=1).clip(min=0)
        depths.append(depth)
        measured = capsule_penetration(source, moved.points[..., None])[0]
        assert measured == pytest.approx((depth - depths[0]).max(), abs=1e-6)
    assert depths[-1].max() > 0.01
