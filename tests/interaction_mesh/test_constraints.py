"""Closed forms: the bounds of pairs by their distance in the source."""

from dataclasses import replace

import numpy as np

from pacmo_core.interaction_mesh.constraints import Rows, contact_rows
from pacmo_core.interaction_mesh.scene import Array, Scene
from tests.interaction_mesh.scenes import SETTINGS, touching_scene


def test_a_contact_may_not_open_beyond_the_contact_distance_however_wide_it_was() -> None:
    source = touching_scene()
    rows = contact_rows(source, SETTINGS)
    closest = np.sort(_distances(source, rows), axis=None)[:20]
    for distance in closest.tolist():  # a contact that is about to open
        settings = replace(SETTINGS, contact_distance=distance * (1 + 1e-6))
        rows = contact_rows(source, settings)
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
