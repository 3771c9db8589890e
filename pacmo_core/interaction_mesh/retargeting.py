"""Retargets a two-person motion: prepares a source once, then solves for any number of bodies.

The scale that both bodies have in common is divided out and applied to the whole scene at the end.
A long source is solved in windows that overlap and are faded into each other: memory is that of a
window.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pacmo_core.interaction_mesh.attempt import (
    PreparedWindow,
    Quality,
    batch_size,
    prepare_window,
    project_bone_lengths,
    solve_bodies,
)
from pacmo_core.interaction_mesh.linear_algebra import padded_columns, single_blas_thread
from pacmo_core.interaction_mesh.mesh import ground_supports, support_weights
from pacmo_core.interaction_mesh.report import Report, measure_limited, measure_unlimited
from pacmo_core.interaction_mesh.scene import (
    Array,
    Scene,
    check_scales,
    common_scale,
    scale_scene,
)
from pacmo_core.interaction_mesh.settings import Settings

# Seconds of a window, and those that it shares with the next. Within the middle half of these the
# one is faded into the other: what is near an end of a window is not felt there.
WINDOW_SECONDS = 40.0
OVERLAP_SECONDS = 4.0


@dataclass(frozen=True)
class PreparedSource:
    """A scene and the settings with which it is retargeted.

    Parameters
    ----------
    scene, settings : arguments of ``prepare``
    windows : frames of each window; a source of a single window is prepared once for all bodies
    """

    scene: Scene
    settings: Settings
    windows: tuple[slice, ...]

    @cached_property
    def only_window(self) -> PreparedWindow:
        """The window of a source that has one."""
        return prepare_window(self.scene, self.settings)

    @cached_property
    def is_support(self) -> NDArray[np.bool_]:
        """``(T, N)``: whether a joint supports."""
        return ground_supports(self.scene, self.settings.support)


@dataclass(frozen=True)
class Variations:
    """Variations of a source.

    Parameters
    ----------
    rows : (V,), rows of the scales that were retargeted
    points : (V, T, N, 3) float64, metres: person a's joints, then person b's
    reports : of each
    """

    rows: NDArray[np.intp]
    points: Array
    reports: tuple[Report, ...]


def prepare(scene: Scene, settings: Settings) -> PreparedSource:
    """Prepare a source: build and factorise its energy, unless it is longer than a window."""
    source = PreparedSource(scene, settings, window_slices(len(scene.points), scene.fps))
    if len(source.windows) == 1:
        source.only_window  # noqa: B018  # built now, so that ``retarget`` only solves
    return source


def window_slices(n_frames: int, fps: float) -> tuple[slice, ...]:
    """Divide frames into windows of equal length, which share ``OVERLAP_SECONDS`` each."""
    overlap = round(OVERLAP_SECONDS * fps)
    n_windows = max(1, -(-(n_frames - overlap) // max(1, round(WINDOW_SECONDS * fps) - overlap)))
    if n_windows == 1:
        return (slice(0, n_frames),)
    edges = np.linspace(0, n_frames - overlap, n_windows + 1).round().astype(int).tolist()
    return tuple(slice(a, b + overlap) for a, b in pairwise(edges))


def retarget(source: PreparedSource, scales: Array) -> Variations:
    """Retarget a source to other bodies.

    Parameters
    ----------
    scales : (V, E), lengths of the bones of person a, then of person b, relative to the source

    Raises
    ------
    ValueError
        If the scales are not positive numbers of that shape.
    """
    batches = list(retarget_in_batches(source, scales))
    rows = np.concatenate([np.zeros(0, dtype=np.intp), *(batch.rows for batch in batches)])
    points = np.zeros((len(scales), *source.scene.points.shape))
    for batch in batches:
        points[batch.rows] = batch.points
    reports = [report for batch in batches for report in batch.reports]
    return Variations(np.sort(rows), points, tuple(reports[i] for i in np.argsort(rows)))


def retarget_in_batches(source: PreparedSource, scales: Array) -> Iterator[Variations]:
    """Retarget as ``retarget``, and yield variations as they are solved; each row comes once."""
    check_scales(scales, len(source.scene.bones))
    common = common_scale(source.scene, scales)
    relative = scales / common[:, None]
    if len(source.windows) == 1:
        for rows, results in solve_bodies(source.only_window, relative, common):
            motions = np.stack([result.motion for result in results], axis=-1)
            qualities = [result.quality for result in results]
            yield _variations(source, scales, np.array(rows), motions, qualities)
        return
    size = batch_size(len(source.scene.points))
    for first in range(0, len(scales), size):
        rows_of_batch = np.arange(first, min(first + size, len(scales)))
        motions, qualities = _solve_windows(source, relative[rows_of_batch], common[rows_of_batch])
        yield _variations(source, scales, rows_of_batch, motions, qualities)


def _solve_windows(
    source: PreparedSource, scales: Array, common: Array
) -> tuple[Array, list[Quality]]:
    """Solve window by window; return motions (T, N, 3, V) and, of each body, its worst window's."""
    scene = source.scene
    total = np.zeros((*scene.points.shape, len(scales)))
    qualities: list[list[Quality]] = [[] for _ in scales]
    for number, frames in enumerate(source.windows):
        window = prepare_window(scene.frames(frames), source.settings)
        weights = _fade(source.windows, number, scene.fps)[:, None, None]
        for rows, results in solve_bodies(window, scales, common):
            for row, result in zip(rows, results, strict=True):
                total[frames, ..., row] += weights * result.motion
                qualities[row].append(result.quality)
    displacement = (total - scene.points[..., None]).astype(np.float32)
    vectors = total[:, scene.bones[:, 1]] - total[:, scene.bones[:, 0]]
    limits = source.settings.limits
    worst = [max(parts, key=lambda q: q.excess(limits)) for parts in qualities]
    columns = padded_columns(len(scales))
    padded = scales[columns]
    displacement, vectors = displacement.take(columns, axis=-1), vectors.take(columns, axis=-1)
    supports = support_weights(source.is_support, scene.fps, source.settings.support.fade_time)
    motions = project_bone_lengths(scene, displacement, vectors, padded, supports)
    with single_blas_thread():
        whole = measure_limited(scene, source.settings, padded, motions)
    return motions[..., : len(scales)], [
        Quality(**(asdict(quality) | {name: float(values[v]) for name, values in whole.items()}))
        for v, quality in enumerate(worst)
    ]


def _fade(windows: tuple[slice, ...], number: int, fps: float) -> Array:
    """``(F,)``: weight of the frames of a window; those of all windows sum to one."""
    window = windows[number]
    frames = np.arange(window.start, window.stop)
    weights = np.ones(len(frames))
    length = OVERLAP_SECONDS * fps
    for begin, sign in ((number, 1), (number + 1, -1)):
        if 0 < begin < len(windows):
            start = windows[begin].start + length / 4
            ramp = ((frames - start) / (length / 2)).clip(0, 1)
            smooth = ramp * ramp * (3 - 2 * ramp)
            weights *= smooth if sign > 0 else 1 - smooth
    return weights


def _variations(
    source: PreparedSource,
    scales: Array,
    rows: NDArray[np.intp],
    motions: Array,
    qualities: list[Quality],
) -> Variations:
    """Scale motions (T, N, 3, V) as a whole, and measure them."""
    scene, settings = source.scene, source.settings
    columns = padded_columns(len(rows))
    padded, motions = scales[rows][columns], motions.take(columns, axis=-1)
    common = common_scale(scene, padded)
    with single_blas_thread():
        measured = measure_unlimited(
            scene, settings, source.is_support, padded / common[:, None], motions
        )
    points = scale_scene(scene, motions, common)
    reports = tuple(
        Report(**(asdict(quality) | {name: float(values[v]) for name, values in measured.items()}))
        for v, quality in enumerate(qualities)
    )
    ordered = np.moveaxis(points[..., : len(rows)], -1, 0)
    return Variations(rows.astype(np.intp), np.ascontiguousarray(ordered), reports)
