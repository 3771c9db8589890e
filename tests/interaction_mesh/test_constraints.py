"""Closed forms: the bounds of pairs by their distance in the source, those of trunks by angles."""

from dataclasses import replace

import numpy as np

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.interaction_mesh import prepare, retarget
from pacmo_core.interaction_mesh.body_parts import trunk_bends
from pacmo_core.interaction_mesh.constraints import Rows, contact_rows, trunk_rows, trunk_scales
from pacmo_core.interaction_mesh.scene import Array, Scene
from pacmo_core.interaction_mesh.settings import Attempt
from tests.interaction_mesh.scenes import SETTINGS, scene, touching_scene

SPINE = Skeleton(
    "spine",
    ("root", "spine", "chest", "left_arm", "left_elbow", "right_arm", "right_elbow"),
    (-1, 0, 1, 2, 3, 2, 5),
    ((3, 5), (4, 6)),
)


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


def test_the_rows_of_a_trunk_hold_angles_within_their_range() -> None:
    source = scene(2, 5, skeletons=(SPINE, SPINE))
    pairs, is_rigid = trunk_bends(source)
    assert is_rigid.tolist().count(True) == 2 and is_rigid.tolist().count(False) == 6
    rows = trunk_rows(source, np.ones((5, len(source.bones))), max_bend=20)
    vectors, distances = source.bone_vectors, _distances(source, rows)
    assert (rows.lower <= distances + 1e-9).all() and (distances <= rows.upper + 1e-9).all()
    assert np.isinf(rows.upper[:, ~is_rigid]).all()
    np.testing.assert_allclose(rows.lower[:, is_rigid], distances[:, is_rigid], atol=1e-9)
    np.testing.assert_allclose(rows.upper[:, is_rigid], distances[:, is_rigid], atol=1e-9)
    (first, second), row = pairs[~is_rigid][0], np.flatnonzero(~is_rigid)[0]
    a, b = (np.linalg.norm(vectors[:, bone], axis=-1) for bone in (first, second))
    # The angle between two bones that follow each other is pi less the angle of the triangle.
    bend = np.arccos((vectors[:, first] * vectors[:, second]).sum(axis=-1) / (a * b))
    more = np.minimum(bend + np.radians(20), np.pi)
    np.testing.assert_allclose(
        rows.lower[:, row], np.sqrt(a**2 + b**2 + 2 * a * b * np.cos(more)), atol=1e-9
    )


def test_a_trunk_whose_bones_all_grow_alike_grows_alike() -> None:
    source = scene(2, 5, skeletons=(SPINE, SPINE))
    scales = np.full((len(source.bones), 2), [0.7, 1.2])
    expected = np.broadcast_to([0.7, 1.2], trunk_scales(source, scales, 20).shape)
    np.testing.assert_allclose(trunk_scales(source, scales, 20), expected)


def test_a_chest_keeps_its_shape_where_the_other_body_pulls_at_it() -> None:
    source = scene(5, 9, skeletons=(SPINE, SPINE), distance=0.2)
    weights = replace(SETTINGS.weights, contact=300, contact_range=0.5, trunk_shape=0)
    scales = np.ones((1, len(source.bones)))
    scales[0, 6:] = 0.6
    left, right = (7 + SPINE.joints.index(f"{side}_arm") for side in ("left", "right"))
    before = np.linalg.norm(source.points[:, left] - source.points[:, right], axis=-1)
    errors = []
    for penalty in (0, 60):
        attempt = Attempt(bone_penalty=6, max_iterations=400, pair_penalty=penalty, tolerance=0)
        settings = replace(SETTINGS, attempts=(attempt,), n_pairs=0, weights=weights)
        points = retarget(prepare(source, settings), scales).points[0]
        width = np.linalg.norm(points[:, left] - points[:, right], axis=-1)
        errors.append(np.abs(width / (0.6 * before) - 1).max())
    assert errors[1] < 0.005 and errors[0] > 3 * errors[1]


def test_a_spine_of_bones_that_grow_differently_can_meet_its_bounds_in_every_frame() -> None:
    source = scene(7, 40, skeletons=(SPINE, SPINE))
    pairs, is_rigid = trunk_bends(source)
    scales = np.ones((len(source.bones), 1))
    scales[::2] = 0.6
    rows = trunk_rows(source, np.ones((40, len(source.bones))), max_bend=20)
    lower = rows.lower * trunk_scales(source, scales, 20)[:, 0]
    lengths = np.linalg.norm(source.bone_vectors, axis=-1) * scales[:, 0]
    longest = lengths[:, pairs].sum(axis=-1)  # of a straight spine
    assert (lower[:, ~is_rigid] <= longest[:, ~is_rigid] + 1e-9).all()
