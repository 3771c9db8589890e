"""Closed forms: the bounds of pairs by their distance in the source, those of angles."""

from dataclasses import replace

import numpy as np
import pytest

from pacmo_core.data.skeleton import NTU25, Skeleton
from pacmo_core.interaction_mesh import prepare, retarget
from pacmo_core.interaction_mesh.body_parts import NECK, RIGID, trunk_bends
from pacmo_core.interaction_mesh.body_parts import SPINE as SPINE_BENDS
from pacmo_core.interaction_mesh.constraints import (
    MAX_WHOLE_BEND,
    AngleBounds,
    Rows,
    angle_bounds,
    angle_rows,
    angle_scales,
    contact_rows,
)
from pacmo_core.interaction_mesh.scene import Array, Scene
from pacmo_core.interaction_mesh.settings import Attempt
from tests.interaction_mesh.scenes import SETTINGS, scene, touching_scene

SPINE = Skeleton(
    "spine",
    ("root", "spine", "chest", "left_arm", "left_elbow", "right_arm", "right_elbow"),
    (-1, 0, 1, 2, 3, 2, 5),
    ((3, 5), (4, 6)),
)
ARMS = Skeleton(
    "arms",
    (
        *("root", "chest", "left_shoulder", "left_elbow", "left_wrist"),
        *("right_shoulder", "right_elbow", "right_wrist"),
    ),
    (-1, 0, 1, 2, 3, 1, 5, 6),
    ((2, 5), (3, 6), (4, 7)),
)
FRAME = Skeleton("frame", ("root", "first", "second", "third"), (-1, 0, 1, 0))


def test_a_contact_may_not_open_beyond_the_contact_distance_however_wide_it_was() -> None:
    source = touching_scene()
    rows = contact_rows(source, SETTINGS, 60)
    closest = np.sort(_distances(source, rows), axis=None)[:20]
    for distance in closest.tolist():  # a contact that is about to open
        settings = replace(SETTINGS, contact_distance=distance * (1 + 1e-6))
        rows = contact_rows(source, settings, 60)
        distances = _distances(source, rows)
        touch = distances < settings.contact_distance
        assert touch.any()
        assert (rows.upper[touch] < settings.contact_distance).all()
        assert (rows.upper[~touch] > 0.9 * settings.contact_distance).all()
        assert (rows.upper[distances > 1] > 1).all()  # a pair apart stays free


def _distances(source: Scene, rows: Rows) -> Array:
    first, second = np.moveaxis(rows.points[..., :2], -1, 0)
    frames = np.arange(len(source.points))[:, None]
    vectors = source.points[frames, second] - source.points[frames, first]
    distances: Array = np.linalg.norm(vectors, axis=-1)
    return distances


def bounds_of(source: Scene) -> AngleBounds:
    """Allow a spine to bend by 20 degrees more than in the source, a hinge by 150 in all."""
    return angle_bounds(source, replace(SETTINGS, max_spine_bend=20, max_hinge_bend=150))


def test_the_rows_of_a_spine_hold_angles_within_their_range() -> None:
    source = scene(2, 5, skeletons=(SPINE, SPINE))
    pairs, kinds = trunk_bends(source)
    bends = pairs[kinds != RIGID]
    rows = angle_rows(source, np.ones((5, len(source.bones))), bounds_of(source))
    assert rows.n_body_rows == 6
    np.testing.assert_array_equal(rows.points[0, : len(bends), 1], source.bones[bends[:, 1], 1])
    vectors, distances = source.bone_vectors, _distances(source, rows)
    assert (rows.lower <= distances + 1e-9).all() and np.isinf(rows.upper).all()
    first, second = bends[0]
    a, b = (np.linalg.norm(vectors[:, bone], axis=-1) for bone in (first, second))
    # The angle between two bones that follow each other is pi less the angle of the triangle.
    bend = np.arccos((vectors[:, first] * vectors[:, second]).sum(axis=-1) / (a * b))
    more = np.minimum(bend + np.radians(20), np.pi)
    np.testing.assert_allclose(
        rows.lower[:, 0], np.sqrt(a**2 + b**2 + 2 * a * b * np.cos(more)), atol=1e-9
    )


def test_a_trunk_whose_bones_all_grow_alike_grows_alike() -> None:
    source = scene(2, 5, skeletons=(SPINE, SPINE))
    scales = np.full((len(source.bones), 2), [0.7, 1.2])
    factors = angle_scales(source, scales, bounds_of(source))
    np.testing.assert_allclose(factors, np.broadcast_to([0.7, 1.2], factors.shape))


def test_a_spine_of_bones_that_grow_differently_can_meet_its_bounds_in_every_frame() -> None:
    source = scene(7, 40, skeletons=(SPINE, SPINE))
    pairs, kinds = trunk_bends(source)
    pairs = pairs[kinds != RIGID]
    scales = np.ones((len(source.bones), 1))
    scales[::2] = 0.6
    bounds = bounds_of(source)
    rows = angle_rows(source, np.ones((40, len(source.bones))), bounds)
    lower = (rows.lower * angle_scales(source, scales, bounds)[:, 0])[:, : len(pairs)]
    lengths = np.linalg.norm(source.bone_vectors, axis=-1) * scales[:, 0]
    longest = lengths[:, pairs].sum(axis=-1)  # of a straight spine
    assert (lower <= longest + 1e-9).all()


def held_arm(bends: list[float]) -> Scene:
    """Build a person whose left elbow bends by these degrees; the other is at both its ends."""
    person = np.zeros((len(bends), 8, 3))
    person[:] = [
        *([0, 0.9, 0], [0, 1.4, 0], [0.2, 1.4, 0], [0.2, 1.1, 0], [0, 0, 0]),
        *([-0.2, 1.4, 0], [-0.2, 1.1, 0], [-0.2, 0.85, 0.1]),
    ]
    bend = np.radians(bends)
    forearm = 0.28 * np.stack([0 * bend, -np.cos(bend), np.sin(bend)], axis=-1)
    person[:, 4] = person[:, 3] + forearm
    frame = person[:, [2, 2, 4, 2]] + [[0.3, 0, 0], [0, 0, 0.01], [0, 0, 0.01], [0.3, 0.2, 0.2]]
    motions = (person.astype(np.float32), frame.astype(np.float32))
    return Scene(motions, (ARMS, FRAME), 30.0)


def left_elbow_bend(points: Array) -> Array:
    """Return degrees, (T,), of points (T, N, 3)."""
    upper, lower = points[:, 3] - points[:, 2], points[:, 4] - points[:, 3]
    cosine = (upper * lower).sum(axis=-1)
    bend: Array = np.degrees(np.arctan2(np.linalg.norm(np.cross(upper, lower), axis=-1), cosine))
    return bend


def test_an_elbow_that_is_pulled_to_176_degrees_stops_at_its_largest_bend() -> None:
    source = held_arm([140.0] * 5)
    scales = np.ones((1, len(source.bones)))
    scales[0, source.n_bones[0] + 1] = 0.1  # the wrist is pulled to 2 cm from the shoulder
    weights = replace(SETTINGS.weights, contact=300, contact_range=0.05, interaction_range=0.05)
    attempt = Attempt(bone_penalty=25, max_iterations=400, pair_penalty=60, tolerance=0)
    settings = replace(SETTINGS, attempts=(attempt,), n_pairs=0, weights=weights)
    free, bounded = (
        retarget(prepare(source, replace(settings, max_hinge_bend=bend)), scales).points[0]
        for bend in (180, 150)
    )
    assert left_elbow_bend(free).min() > 176
    np.testing.assert_allclose(left_elbow_bend(bounded), 150, atol=0.1)


def test_a_hinge_may_bend_to_its_limit_or_as_far_as_in_that_frame_of_the_source() -> None:
    source = held_arm([30.0, 140.0, 160.0])
    bounds = bounds_of(source)
    (row,) = np.flatnonzero((bounds.pairs == [2, 3]).all(axis=-1))
    np.testing.assert_allclose(np.degrees(bounds.least[:, row]), [30, 30, 20], atol=1e-3)
    scales = np.ones((len(source.bones), 1))
    scales[2], scales[3] = 0.75, 1.25
    rows = angle_rows(source, np.ones((3, len(source.bones))), bounds)
    lower = rows.lower[:, row] * angle_scales(source, scales, bounds)[row, 0]
    a, b = 0.75 * 0.3, 1.25 * 0.28
    allowed = np.sqrt(a**2 + b**2 - 2 * a * b * np.cos(np.radians([30, 30, 20])))
    assert (lower <= allowed + 1e-6).all()
    assert np.isinf(rows.upper[:, row]).all()
    # A straight arm is far from its bound, and free.
    assert rows.penalties[0, row] < 0.01 and rows.penalties[1, row] > 0.99


@pytest.mark.parametrize(
    ("n_joints", "each"), [(1, 25), (2, 25), (4, MAX_WHOLE_BEND[SPINE_BENDS] / 4)]
)
def test_a_spine_of_many_joints_bends_no_more_as_a_whole(n_joints: int, each: float) -> None:
    names = ("root", *(f"spine_{i}" for i in range(n_joints)))
    arms = ("left_arm", "left_elbow", "right_arm", "right_elbow")
    parents = (*range(-1, n_joints), n_joints, n_joints + 1, n_joints, n_joints + 3)
    pairs = ((n_joints + 1, n_joints + 3), (n_joints + 2, n_joints + 4))
    body = Skeleton("chain", (*names, *arms), parents, pairs)
    source = scene(2, 5, skeletons=(body, SPINE))
    bounds = angle_bounds(source, replace(SETTINGS, max_spine_bend=25))
    chain, kinds = trunk_bends(source)
    chain, kinds = chain[kinds != RIGID], kinds[kinds != RIGID]
    first, second = (source.bone_vectors[:, chain[:, side]] for side in (0, 1))
    lengths = np.linalg.norm(first, axis=-1) * np.linalg.norm(second, axis=-1)
    # Between bones as they leave their joint; straight is a half turn.
    angles = np.pi - np.arccos((first * second).sum(axis=-1) / lengths)
    allowed = np.degrees(angles - bounds.least[:, : len(chain)])
    of_chain = (kinds == SPINE_BENDS) & (source.bones[chain[:, 0], 1] <= n_joints)
    is_free = angles > np.radians(each)
    np.testing.assert_allclose(allowed[:, of_chain][is_free[:, of_chain]], each, atol=1e-6)


def test_a_neck_begins_where_the_arms_leave_the_spine() -> None:
    source = scene(2, 5, skeletons=(NTU25, SPINE))
    pairs, kinds = trunk_bends(source)
    pairs, kinds = pairs[kinds != RIGID], kinds[kinds != RIGID]
    neck = pairs[kinds == NECK]
    joints = source.bones[neck]
    assert sorted([NTU25.joints[joint] for joint in pair.ravel()] for pair in joints) == [
        ["spine_mid", "spine_shoulder", "spine_shoulder", "neck"],
        ["spine_shoulder", "neck", "neck", "head"],
    ]
    bounds = angle_bounds(source, replace(SETTINGS, max_spine_bend=25))
    first, second = (source.bone_vectors[:, neck[:, side]] for side in (0, 1))
    lengths = np.linalg.norm(first, axis=-1) * np.linalg.norm(second, axis=-1)
    angles = np.pi - np.arccos((first * second).sum(axis=-1) / lengths)
    least = bounds.least[:, : len(pairs)][:, kinds == NECK]
    expected = np.maximum(angles - np.radians(MAX_WHOLE_BEND[NECK] / 2), 0)
    np.testing.assert_allclose(least, expected, atol=1e-6)
