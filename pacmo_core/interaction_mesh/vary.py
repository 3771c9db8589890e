"""Give a two-person motion other bodies: prepare a source once, then vary it at will."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from pacmo_core.interaction_mesh.admm import AXES, Solver, in_blocks
from pacmo_core.interaction_mesh.energy import Quadratic, energy_terms, quadratic, target_of
from pacmo_core.interaction_mesh.factor import factorise
from pacmo_core.interaction_mesh.finish import exact, raw_residual
from pacmo_core.interaction_mesh.report import Report, report_of
from pacmo_core.interaction_mesh.rows import bone_rows, guarded_rows
from pacmo_core.interaction_mesh.scene import Array, Scene, Single, check_scales
from pacmo_core.interaction_mesh.settings import Limits, Rung, Settings
from pacmo_core.interaction_mesh.whole import scale_scene, scene_scale

# Bodies at once. Every batch is filled up to it: products of matrices of another width may round
# otherwise, and a variation must not depend on its company.
BATCH = 24


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
    points : (V, T, N, 3) float64, metres: person a's joints, then person b's
    reports : of each
    """

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
    return Variations(
        np.concatenate([batch.points for batch in batches]),
        tuple(report for batch in batches for report in batch.reports),
    )


def vary_in_batches(source: Source, scales: Array) -> Iterator[Variations]:
    """Do as ``vary``, ``BATCH`` bodies at a time, lest a thousand motions stand in memory."""
    check_scales(scales, len(source.scene.bones))
    for first in range(0, max(1, len(scales)), BATCH):
        yield _climb(source, scales[first : first + BATCH])


def _climb(source: Source, scales: Array) -> Variations:
    """Try rung after rung on those that are not within the limits yet, and keep the better try."""
    whole = scene_scale(source.scene, scales)
    own = scales / whole[:, None]
    points = np.zeros((len(scales), *source.scene.points.shape))
    best: dict[int, Report] = {}
    waiting = np.arange(len(scales))
    for number, rung in enumerate(source.settings.rungs):
        if not len(waiting):
            break
        tried, found = _try(source, own[waiting], number)
        for place, motion, report in zip(waiting.tolist(), tried, found, strict=True):
            if place not in best or _better(report, best[place], source.settings.limits):
                points[place], best[place] = motion, report
        waiting = np.array(
            [place for place in waiting.tolist() if _goes_on(best[place], rung, source.settings)],
            dtype=np.intp,
        )
    placed = scale_scene(source.scene, points, whole)
    return Variations(placed, tuple(best[place] for place in range(len(scales))))


def _better(report: Report, held: Report, limits: Limits) -> bool:
    """Prefer the later of two tries within the limits: it had more iterations."""
    return report.badness(limits) <= max(1, held.badness(limits))


def _goes_on(report: Report, rung: Rung, settings: Settings) -> bool:
    return report.badness(settings.limits) > 1 or report.last_step > rung.step


def _try(source: Source, scales: Array, number: int) -> tuple[Array, list[Report]]:
    scene, energy, rung = source.scene, source.energy, source.settings.rungs[number]
    filled = np.ones((BATCH, scales.shape[1]))
    filled[: len(scales)] = scales
    target = target_of(energy, scales)
    pull = np.zeros((BATCH, *target.shape[1:]))
    pull[: len(scales)] = energy.laplacians.transpose(0, 2, 1) @ target
    solution = _solver(source, rung).solve(in_blocks(pull), filled, rung.iterations)
    points = scene.points + _motions(solution.change, scene, len(scales))
    residual = raw_residual(scene, points, scales)
    placed = exact(scene, points, _motions(solution.bones, scene, len(scales)), scales)
    terms = energy_terms(energy, placed - scene.points, target)
    reports = report_of(scene, source.settings, energy.standing, placed, scales)
    return placed, [
        replace(
            report,
            rung=number,
            raw_residual=float(residual[v]),
            last_step=float(solution.step[v]),
            energy={name: float(term[v]) for name, term in terms.items()},
        )
        for v, report in enumerate(reports)
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
