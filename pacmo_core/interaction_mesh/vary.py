"""Give a two-person motion other bodies: prepare a source once, then vary it at will."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.interaction_mesh.ladder import Try, climb, is_done
from pacmo_core.interaction_mesh.report import Report
from pacmo_core.interaction_mesh.scene import Array, check_scales
from pacmo_core.interaction_mesh.source import Source
from pacmo_core.interaction_mesh.threads import one_thread
from pacmo_core.interaction_mesh.whole import scale_scene, scene_scale


@dataclass(frozen=True)
class Variations:
    """What came of varying.

    Parameters
    ----------
    rows : (V,), which of the scales that were given
    points : (V, T, N, 3) float64, metres: person a's joints, then person b's
    reports : of each
    """

    rows: NDArray[np.intp]
    points: Array
    reports: tuple[Report, ...]


def vary(source: Source, scales: Array) -> Variations:
    """Give the source other bodies.

    Parameters
    ----------
    scales : (V, E), of each bone of person a, then of person b, against the source's

    Raises
    ------
    ValueError
        If the scales are not positive numbers of that shape.
    """
    batches = list(vary_in_batches(source, scales))
    rows = np.concatenate([np.zeros(0, dtype=np.intp), *(batch.rows for batch in batches)])
    points = np.zeros((len(scales), *source.scene.points.shape))
    for batch in batches:
        points[batch.rows] = batch.points
    reports = [report for batch in batches for report in batch.reports]
    return Variations(np.sort(rows), points, tuple(reports[i] for i in np.argsort(rows)))


def vary_in_batches(source: Source, scales: Array) -> Iterator[Variations]:
    """Do as ``vary``, and give variations as they are done, lest all stand in memory.

    Those that are not within the limits wait for the next rung together, so that the many easy
    ones need not iterate with the few hard ones. Each row comes once.
    """
    check_scales(scales, len(source.scene.bones))
    whole = scene_scale(source.scene, scales)
    own = scales / whole[:, None]
    # Like beside like: they settle at about the same time.
    in_order = np.argsort(-source.grown(own).sum(axis=1))
    waiting: dict[int, Try | None] = dict.fromkeys(in_order.tolist())
    for number in range(len(source.settings.rungs)):
        rows = list(waiting)
        for first in range(0, len(rows), source.batch):
            batch = rows[first : first + source.batch]
            with one_thread():
                tries = climb(source, own[batch], number, [waiting[row] for row in batch])
            waiting |= dict(zip(batch, tries, strict=True))
            done = [
                row for row, one in zip(batch, tries, strict=True) if is_done(source, number, one)
            ]
            if done:
                yield _taken(source, whole, done, waiting)


def _taken(
    source: Source, whole: Array, done: list[int], waiting: dict[int, Try | None]
) -> Variations:
    """Take rows from those that wait."""
    taken = [held for row in done if (held := waiting.pop(row)) is not None]
    points = scale_scene(source.scene, np.stack([one.motion for one in taken]), whole[done])
    return Variations(np.array(done, dtype=np.intp), points, tuple(one.report for one in taken))
