"""Give a two-person motion other bodies: prepare a source once, then vary it at will."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pacmo_core.interaction_mesh.admm import Solver
from pacmo_core.interaction_mesh.blocks import AXES, in_blocks
from pacmo_core.interaction_mesh.energy import Quadratic, energy_terms, quadratic, target_of
from pacmo_core.interaction_mesh.factor import factorise
from pacmo_core.interaction_mesh.finish import exact, raw_residual
from pacmo_core.interaction_mesh.report import Report, figures_of
from pacmo_core.interaction_mesh.rows import bone_rows, guarded_rows
from pacmo_core.interaction_mesh.scene import Array, Scene, Single, check_scales
from pacmo_core.interaction_mesh.settings import Limits, Rung, Settings
from pacmo_core.interaction_mesh.whole import scale_scene, scene_scale

# Bodies at once; batches are filled up to a multiple of the width. Products of matrices of odd
# widths round otherwise, and a variation must not depend on its company.
BATCH = 48
WIDTH = 16

# A motion (T, N, 3) and its report, once there is one.
Held = tuple[Array, Report] | None


@dataclass(frozen=True)
class Source:
    """A scene with all that does not depend on the bodies it will get.

    Parameters
    ----------
    scene, settings : as given to ``prepare``
    energy : its matrices
    solvers : by penalties, made when first wanted
    """

    scene: Scene
    settings: Settings
    energy: Quadratic
    solvers: dict[tuple[float, float], Solver] = field(default_factory=dict)


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


def prepare(scene: Scene, settings: Settings) -> Source:
    """Build graph, weights and factorisation of a source."""
    source = Source(scene, settings, quadratic(scene, settings))
    _solver(source, settings.rungs[0])
    return source


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
    waiting: dict[int, Held] = dict.fromkeys(range(len(scales)))
    for number in range(len(source.settings.rungs)):
        rows = list(waiting)
        for first in range(0, len(rows), BATCH):
            batch = rows[first : first + BATCH]
            _climb(source, own, number, batch, waiting)
            done = [row for row in batch if _is_done(source.settings, number, waiting[row])]
            if done:
                yield _taken(source.scene, whole, done, waiting)


def _climb(
    source: Source, scales: Array, number: int, batch: list[int], waiting: dict[int, Held]
) -> None:
    """Try a rung on some rows, and keep the better of this try and the last."""
    tried, found = _try(source, scales[batch], number)
    for row, motion, report in zip(batch, tried, found, strict=True):
        held = waiting[row]
        if held is None or _better(report, held[1], source.settings.limits):
            waiting[row] = (motion, report)


def _taken(scene: Scene, whole: Array, done: list[int], waiting: dict[int, Held]) -> Variations:
    """Take rows from those that wait."""
    taken = [held for row in done if (held := waiting.pop(row)) is not None]
    points = scale_scene(scene, np.stack([motion for motion, _ in taken]), whole[done])
    return Variations(np.array(done, dtype=np.intp), points, tuple(report for _, report in taken))


def _better(report: Report, held: Report, limits: Limits) -> bool:
    """Prefer the later of two tries within the limits: it had more iterations."""
    return report.badness(limits) <= max(1, held.badness(limits))


def _is_done(settings: Settings, number: int, held: Held) -> bool:
    last = number + 1 == len(settings.rungs)
    if held is None or last:
        return last
    report = held[1]
    return report.badness(settings.limits) <= 1 and report.last_step <= settings.rungs[number].step


def _try(source: Source, scales: Array, number: int) -> tuple[Array, list[Report]]:
    scene, energy, rung = source.scene, source.energy, source.settings.rungs[number]
    filled = np.ones((-(-len(scales) // WIDTH) * WIDTH, scales.shape[1]))
    filled[: len(scales)] = scales
    target = target_of(energy, scales)
    pull = np.zeros((len(filled), *target.shape[1:]))
    pull[: len(scales)] = energy.laplacians.transpose(0, 2, 1) @ target
    solution = _solver(source, rung).solve(in_blocks(pull), filled, rung.iterations)
    points = scene.points + _motions(solution.change, scene, len(scales))
    residual = raw_residual(scene, points, scales)
    placed = exact(scene, points, _motions(solution.bones, scene, len(scales)), scales)
    terms = energy_terms(energy, placed - scene.points, target)
    figures = figures_of(scene, source.settings, energy.standing, placed, scales)
    return placed, [
        Report(
            rung=number,
            raw_residual=float(residual[v]),
            last_step=float(solution.step[v]),
            energy={name: float(term[v]) for name, term in terms.items()},
            **figures[v],
        )
        for v in range(len(scales))
    ]


def _motions(rows: Single, scene: Scene, n_bodies: int) -> Array:
    """Turn (2K, R, 3, V) into (V, T, R, 3) float64."""
    kept = rows[: len(scene.points), :, AXES, :n_bodies]
    return np.ascontiguousarray(kept.transpose(3, 0, 1, 2), dtype=np.float64)


def _solver(source: Source, rung: Rung) -> Solver:
    penalties = (rung.penalty, rung.apart)
    if penalties not in source.solvers:
        scene, settings = source.scene, source.settings
        rows = bone_rows(scene, rung.penalty)
        if rung.apart:
            rows = guarded_rows(scene, rows, rung.apart, settings.guarded, settings.clearance)
        source.solvers[penalties] = Solver(
            factorise(source.energy, rows.penalty),
            rows,
            n_bones=len(scene.bones),
            relaxation=settings.relaxation,
        )
    return source.solvers[penalties]
