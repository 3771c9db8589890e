"""Retargets a two-person motion: prepares a source once, then solves for any number of bodies.

A body gets several attempts of ADMM with growing penalties, until its result is within the limits.
The scale that both bodies have in common is divided out and applied to the whole scene at the end.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pacmo_core.interaction_mesh.admm import AdmmSolver, AdmmStart, build_solver, solve_admm
from pacmo_core.interaction_mesh.constraints import build_floor, build_rows
from pacmo_core.interaction_mesh.energy import (
    QuadraticEnergy,
    build_energy,
    energy_of,
    energy_rhs,
)
from pacmo_core.interaction_mesh.factorisation import bone_stiffness, factorise
from pacmo_core.interaction_mesh.linear_algebra import (
    AXIS_ORDER,
    COLUMN_WIDTH,
    padded_width,
    pair_frames,
    single_blas_thread,
)
from pacmo_core.interaction_mesh.report import (
    Report,
    measure_distances,
    measure_motions,
    near_distance_error,
)
from pacmo_core.interaction_mesh.scene import (
    Array,
    Scene,
    Single,
    check_scales,
    common_scale,
    naive_scaling,
    scale_scene,
)
from pacmo_core.interaction_mesh.settings import Attempt, AttemptLimits, Settings
from pacmo_core.interaction_mesh.warm_start import LinearResponse, linear_response

# Bodies solved together, and the sum of their frames: bounds memory.
MAX_BATCH = 48
MAX_BATCH_FRAMES = 40_000
# Metres, root mean square: bodies whose bones grow by less converge at once.
MIN_GROWTH_RMS = 1e-3
# Exponent by which the tolerance falls with the number of bones that share a body's growth. With
# this one, whole bodies and single bones end about equally far from the minimum of the energy.
GROWTH_SHARING_EXPONENT = 0.75


@dataclass(frozen=True)
class PreparedSource:
    """A scene with all that does not depend on the target bodies.

    Parameters
    ----------
    scene, settings : arguments of ``prepare``
    energy : of the scene
    stiffness : (T, E), of the bones; penalties are relative to it
    response : to the scale of each bone, for the warm start
    solvers : by penalties, built at first use
    """

    scene: Scene
    settings: Settings
    energy: QuadraticEnergy
    stiffness: Array
    response: LinearResponse
    solvers: dict[tuple[float, float], AdmmSolver] = field(default_factory=dict)

    @property
    def batch_size(self) -> int:
        """Number of bodies to solve together."""
        largest = MAX_BATCH_FRAMES // len(self.scene.points) // COLUMN_WIDTH * COLUMN_WIDTH
        return min(MAX_BATCH, max(COLUMN_WIDTH, largest))

    def squared_growth(self, scales: Array) -> Array:
        """``(V, E)`` square metres: squared change of each bone's length, summed over frames."""
        squares = np.square(self.scene.bone_vectors).sum(axis=(0, 2))
        growth: Array = np.square(scales - 1) * squares
        return growth

    def solver(self, attempt: Attempt) -> AdmmSolver:
        """Return the solver of an attempt."""
        penalties = (attempt.bone_penalty, attempt.pair_penalty)
        if penalties not in self.solvers:
            scene, settings = self.scene, self.settings
            rows = build_rows(scene, settings, attempt, self.stiffness)
            floor = build_floor(scene, settings.floor_penalty)
            factorisation = factorise(self.energy, rows, floor)
            source = rows.differences(scene.points)
            self.solvers[penalties] = build_solver(
                factorisation, rows, floor, source, settings.relaxation
            )
        return self.solvers[penalties]


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
    """Build and factorise the energy of a source, and compute its linear response."""
    with single_blas_thread():
        energy = build_energy(scene, settings)
        stiffness, response = bone_stiffness(energy, scene), linear_response(scene, energy)
        source = PreparedSource(scene, settings, energy, stiffness, response)
        source.solver(settings.attempts[0])
    return source


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
    """Retarget as ``retarget``, and yield variations as they are solved; each row comes once.

    Bodies that are not within the limits wait for the next attempt together, so that the many
    easy ones do not iterate with the few hard ones.
    """
    check_scales(scales, len(source.scene.bones))
    # Bodies of similar growth converge at about the same time.
    relative = scales / common_scale(source.scene, scales)[:, None]
    order = np.argsort(-source.squared_growth(relative).sum(axis=1))
    waiting: dict[int, AttemptResult | None] = dict.fromkeys(order.tolist())
    for number in range(len(source.settings.attempts)):
        rows = list(waiting)
        for first in range(0, len(rows), source.batch_size):
            batch = rows[first : first + source.batch_size]
            previous = [waiting[row] for row in batch]
            with single_blas_thread():
                results = run_attempt(source, scales[batch], number, previous)
            waiting |= dict(zip(batch, results, strict=True))
            done = [
                row
                for row, result in zip(batch, results, strict=True)
                if is_final(source, number, result)
            ]
            if done:
                yield _pop_variations(done, waiting)


@dataclass(frozen=True)
class AttemptResult:
    """The best motion of a variation so far, and the state from which the next attempt starts.

    Parameters
    ----------
    points : (T, N, 3) metres
    report : of that motion
    has_diverged : whether the last attempt, of which what follows is, has diverged
    displacement : (T, N, 3) float32 metres, of ADMM
    bones : (T, E, 3) float32 metres, bone vectors of the target lengths (z)
    bone_forces : (T, E, 3) float32, penalties times scaled dual variables (P u)
    """

    points: Array
    report: Report
    has_diverged: bool
    displacement: Single
    bones: Single
    bone_forces: Single


@dataclass(frozen=True)
class _AttemptSolution:
    """Solution of ADMM, frame by frame.

    Parameters
    ----------
    displacement : (T, N, 3, V) float32 metres
    bones, bone_forces : (T, E, 3, V), as in ``AttemptResult``
    residual, iterations : (V,)
    """

    displacement: Single
    bones: Single
    bone_forces: Single
    residual: Array
    iterations: NDArray[np.intp]


def run_attempt(
    source: PreparedSource, scales: Array, number: int, previous: list[AttemptResult | None]
) -> list[AttemptResult]:
    """Run an attempt for bodies with scales (V, E); return the better of it and the previous."""
    # Padded to full width: sums along few columns round differently, and the result of a body must
    # not depend on the others.
    columns = np.resize(np.arange(len(scales)), padded_width(len(scales)))
    scales = scales[columns]
    common = common_scale(source.scene, scales)
    relative = scales / common[:, None]
    start = _attempt_start(source, relative, common, number, previous)
    solution = _solve_attempt(source, start, number, columns)
    displacement = solution.displacement
    motions = project_bone_lengths(source.scene, displacement, solution.bones, relative)
    points = scale_scene(source.scene, motions, common)
    measurements = _measure(source, scales, motions, points, previous)
    measurements["primal_residual"] = primal_residual(source.scene, displacement, relative)
    measurements["fixed_point_residual"] = solution.residual
    projected = motions - source.scene.points[..., None]
    measurements["energy"] = energy_of(source.energy, projected, relative)
    limits, results = source.settings.limits, []
    for v, before in enumerate(previous):
        report = Report(
            attempt=number,
            iterations=int(solution.iterations[v]),
            **{name: float(values[v]) for name, values in measurements.items()},
        )
        result = AttemptResult(
            points=np.ascontiguousarray(points[..., v]),
            displacement=displacement[..., v],
            report=report,
            has_diverged=report.has_diverged(limits),
            bones=solution.bones[..., v],
            bone_forces=solution.bone_forces[..., v],
        )
        results.append(_select_better(limits, before, result))
    return results


def is_final(source: PreparedSource, number: int, result: AttemptResult) -> bool:
    """Whether a variation needs no further attempt."""
    attempts, report = source.settings.attempts, result.report
    has_converged = (
        report.attempt == number and report.fixed_point_residual <= attempts[number].tolerance
    )
    is_accepted = has_converged and report.limit_ratio(source.settings.limits) <= 1
    return number + 1 == len(attempts) or is_accepted


def step_scale(squared_growth: Array) -> Array:
    """Return the squared step that a residual of 1 stands for, (V,), from the growth, (V, E).

    The more bones share the growth of a body, the smaller: such bodies converge slowly as a whole,
    and are still far from the solution when their steps are short.
    """
    total = squared_growth.sum(axis=1)
    n_bones = total**2 / np.square(squared_growth).sum(axis=1)
    scale: Array = total / n_bones**GROWTH_SHARING_EXPONENT
    return scale


def primal_residual(scene: Scene, displacement: Single, scales: Array) -> Array:
    """Return the largest relative error of a bone length of the linear step, ``(V,)``.

    The projection on the bone lengths hides it: if ADMM cycles, its motions have exact bones too,
    and feet that slide.

    Parameters
    ----------
    displacement : (T, N, 3, V) float32 metres, of ADMM
    scales : (V, E)
    """
    source = scene.bone_vectors.astype(np.float32)
    lengths = np.linalg.norm(source, axis=-1)
    largest = np.zeros(len(scales))
    for bone, (parent, child) in enumerate(scene.bones):
        vector = displacement[:, child] - displacement[:, parent] + source[:, bone, :, None]
        length = np.sqrt(np.einsum("tcv,tcv->tv", vector, vector))
        ratio = length / (lengths[:, bone, None] * scales[:, bone].astype(np.float32))
        largest = np.maximum(largest, np.abs(ratio - 1).max(axis=0))
    return largest


def project_bone_lengths(
    scene: Scene, displacement: Single, directions: Single, scales: Array
) -> Array:
    """Return motions with the exact bone lengths, ``(T, N, 3, V)`` float64 metres.

    The bones follow ``directions``, each body's mean position the displacement.

    Parameters
    ----------
    displacement : (T, N, 3, V) float32 metres, of ADMM
    directions : (T, E, 3, V), of any length but zero
    scales : (V, E)
    """
    lengths = np.linalg.norm(scene.bone_vectors, axis=-1)
    motions = np.zeros(displacement.shape)
    first_joint = first_bone = 0
    for skeleton in scene.skeletons:
        joints = slice(first_joint, first_joint + len(skeleton.joints))
        body = motions[:, joints]
        bone_of = {child: row + first_bone for row, (_, child) in enumerate(skeleton.bones)}
        for joint in skeleton.order[1:]:
            bone = bone_of[joint]
            vector = directions[:, bone].astype(np.float64)
            norm = np.sqrt(np.einsum("tcv,tcv->tv", vector, vector))
            vector *= (lengths[:, bone, None] * scales[:, bone] / norm)[:, None]
            np.add(body[:, skeleton.parents[joint]], vector, out=body[:, joint])
        source_mean = scene.points[:, joints].mean(axis=1)[..., None]
        mean = source_mean + displacement[:, joints].mean(axis=1)
        body += (mean - body.mean(axis=1))[:, None]
        first_joint, first_bone = joints.stop, first_bone + len(skeleton.bones)
    return motions


def _select_better(
    limits: AttemptLimits, previous: AttemptResult | None, result: AttemptResult
) -> AttemptResult:
    """Return the better motion; the later of two within the limits, which had more iterations."""
    if previous is None:
        return result
    if result.report.limit_ratio(limits) <= max(1, previous.report.limit_ratio(limits)):
        return result
    return replace(result, points=previous.points, report=previous.report)


def _measure(
    source: PreparedSource,
    scales: Array,
    motions: Array,
    points: Array,
    previous: list[AttemptResult | None],
) -> dict[str, Array]:
    """Measure motions (T, N, 3, V), points as they are scaled, and naive scaling once.

    Parameters
    ----------
    motions : before the scene is scaled as a whole
    """
    scene, settings = source.scene, source.settings
    measurements = measure_motions(scene, settings, source.energy.is_support, scales, points)
    near, far = measure_distances(scene, settings, motions)
    known = [r.report.near_distance_error_naive for r in previous if r is not None]
    if known:
        naive = np.array(known)
    else:
        relative = scales / common_scale(scene, scales)[:, None]
        naive = near_distance_error(scene, settings, naive_scaling(scene, relative))
    return measurements | {
        "near_distance_error": near,
        "far_distance_error": far,
        "near_distance_error_naive": naive,
    }


def _attempt_start(
    source: PreparedSource,
    scales: Array,
    common: Array,
    number: int,
    previous: list[AttemptResult | None],
) -> AdmmStart:
    """Return the start of the V bodies of ``previous``.

    Parameters
    ----------
    scales, common : (W, E) relative to the common scale (W,), padded to W columns
    """
    attempt, n_bodies = source.settings.attempts[number], len(previous)
    solver = source.solver(attempt)
    rhs = _to_blocks(energy_rhs(source.energy, scales)[..., :n_bodies])
    penalties = (attempt.bone_penalty * source.stiffness[..., None]).astype(np.float32)
    vectors = source.scene.bone_vectors
    bones = source.response.warm_start(vectors, scales, penalties)[..., :n_bodies]
    scales = scales[:n_bodies].T
    min_growth = MIN_GROWTH_RMS**2 * len(source.stiffness)
    n_pairs = solver.rows.lower.shape[1] - len(scales)
    floor = solver.floor
    heights = np.repeat(floor.heights[..., None], n_bodies, axis=-1)
    differences = source.scene.points[..., None] + np.zeros(n_bodies)
    for v, result in enumerate(previous):
        if result is not None and not result.has_diverged:
            # v = z + u, with the dual rescaled to the penalties of this attempt.
            bones[..., v] = result.bones + result.bone_forces / penalties
            differences[..., v] += result.displacement
            heights[..., v] += result.displacement[:, floor.joints, 1]
    pairs = solver.rows.differences(differences)[:, len(scales) :]
    return AdmmStart(
        energy_rhs=rhs.reshape(len(rhs), -1, *rhs.shape[3:]),
        governing=_to_blocks(np.concatenate([bones, pairs], axis=1)),
        floor=pair_frames(heights.astype(np.float32)),
        scales=np.concatenate([scales, np.ones((n_pairs, n_bodies))]).astype(np.float32),
        lowest=(floor.lowest[:, None] / common[:n_bodies]).astype(np.float32),
        step_scale=step_scale(source.squared_growth(scales.T) + min_growth),
    )


def _to_blocks(columns: NDArray[np.floating]) -> Single:
    """Reshape (T, R, 3, V) to (K, 2, R, 3, V) float32, axes in ``AXIS_ORDER``."""
    return pair_frames(columns.astype(np.float32, copy=False)[:, :, AXIS_ORDER])


def _solve_attempt(
    source: PreparedSource, start: AdmmStart, number: int, columns: NDArray[np.intp]
) -> _AttemptSolution:
    """Run ADMM, and return its solution frame by frame for the padded columns."""
    attempt = source.settings.attempts[number]
    solution = solve_admm(
        source.solver(attempt),
        start,
        max_iterations=attempt.max_iterations,
        tolerance=attempt.tolerance,
    )
    n_frames, n_bones = source.stiffness.shape
    n_points = source.scene.points.shape[1]

    def from_blocks(blocks: Single, n_rows: int) -> Single:
        rows = blocks.reshape(-1, n_rows, 3, blocks.shape[-1])[:n_frames]
        return rows[:, :, AXIS_ORDER][..., columns]

    governing = solution.governing[:, :, :n_bones]
    bones = governing * solution.projection[:, :, :n_bones, None]
    penalties = (attempt.bone_penalty * source.stiffness[..., None, None]).astype(np.float32)
    return _AttemptSolution(
        displacement=from_blocks(solution.displacement, n_points),
        bones=from_blocks(bones, n_bones),
        bone_forces=from_blocks(governing - bones, n_bones) * penalties,
        residual=solution.residual,
        iterations=solution.iterations,
    )


def _pop_variations(
    rows: list[int], waiting: dict[int, AttemptResult | None]
) -> Variations:
    """Remove rows from those that wait, and return their variations."""
    results = [result for row in rows if (result := waiting.pop(row)) is not None]
    points = np.stack([result.points for result in results])
    reports = tuple(result.report for result in results)
    return Variations(np.array(rows, dtype=np.intp), points, reports)
