"""One attempt of ADMM on a window of the source, and the attempts with ever more constraints.

A body gets several attempts, until the result is within the limits; bodies that need a further one
wait for it together, so that the many easy ones do not iterate with the few hard ones. All is
relative to the scale that both bodies have in common (``scene.common_scale``).
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pacmo_core.interaction_mesh.admm import AdmmSolver, AdmmStart, build_solver, solve_admm
from pacmo_core.interaction_mesh.body_parts import ancestor_bones, hinges
from pacmo_core.interaction_mesh.constraints import (
    angle_bounds,
    angle_scales,
    build_floor,
    build_rows,
)
from pacmo_core.interaction_mesh.energy import QuadraticEnergy, build_energy, energy_rhs
from pacmo_core.interaction_mesh.factorisation import bone_stiffness, factorise
from pacmo_core.interaction_mesh.linear_algebra import (
    COLUMN_WIDTH,
    from_blocks,
    padded_columns,
    pair_frames,
    single_blas_thread,
    to_blocks,
)
from pacmo_core.interaction_mesh.mesh import support_weights
from pacmo_core.interaction_mesh.report import limit_ratio, measure_limited
from pacmo_core.interaction_mesh.rigid_parts import rigid_parts
from pacmo_core.interaction_mesh.scene import Array, Scene, Single
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
# Times that legs are turned to their feet; more change foot skate by less than 0.05 cm/s.
LEG_TURNS = 2


@dataclass(frozen=True)
class PreparedWindow:
    """A scene with all that does not depend on the target bodies.

    Parameters
    ----------
    scene, settings : arguments of ``prepare_window``
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

    @cached_property
    def supports(self) -> Array:
        """``(T, N)``: how much each joint supports, 0 to 1."""
        fade_time = self.settings.support.fade_time
        return support_weights(self.energy.is_support, self.scene.fps, fade_time)

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
            parts = rigid_parts(scene, attempt.bone_penalty * self.stiffness)
            self.solvers[penalties] = build_solver(factorisation, rows, parts, floor, source)
        return self.solvers[penalties]


@dataclass(frozen=True)
class Quality:
    """What decides whether an attempt is accepted; names and units as in ``Report``."""

    attempt: int
    iterations: int
    fixed_point_residual: float
    primal_residual: float
    contacts_kept: float
    capsule_penetration: float
    trunk_change: float
    spine_bend: float
    seam_ratio: float

    def excess(self, limits: AttemptLimits) -> float:
        """Sum over measurements how far each is above its limit, relative to it; 0 if accepted.

        The sum, as a spine that folds to four times its limit looks worse than contacts alone that
        are as far beyond theirs.
        """
        return sum(
            max(limit_ratio(name, getattr(self, name), limit) - 1, 0.0)
            for name, limit in asdict(limits).items()
        )

    def has_diverged(self, limits: AttemptLimits) -> bool:
        """Whether more iterations of the same attempt will not help."""
        return self.primal_residual > limits.primal_residual or self.seam_ratio > limits.seam_ratio


@dataclass(frozen=True)
class AttemptResult:
    """The best motion of a variation so far, and the state from which the next attempt starts.

    Parameters
    ----------
    motion : (T, N, 3) metres
    quality : of that motion
    has_diverged : whether the last attempt, of which what follows is, has diverged
    displacement : (T, N, 3) float32 metres, of ADMM
    bones : (T, E, 3) float32 metres, bone vectors of the target lengths (z)
    bone_forces : (T, E, 3) float32, penalties times scaled dual variables (P u)
    """

    motion: Array
    quality: Quality
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


def prepare_window(scene: Scene, settings: Settings) -> PreparedWindow:
    """Build and factorise the energy of a window, and compute its linear response."""
    with single_blas_thread():
        energy = build_energy(scene, settings)
        stiffness, response = bone_stiffness(energy, scene), linear_response(scene, energy)
        window = PreparedWindow(scene, settings, energy, stiffness, response)
        window.solver(settings.attempts[0])
    return window


def batch_size(n_frames: int) -> int:
    """Return the number of bodies to solve together."""
    largest = MAX_BATCH_FRAMES // n_frames // COLUMN_WIDTH * COLUMN_WIDTH
    return min(MAX_BATCH, max(COLUMN_WIDTH, largest))


def solve_bodies(
    window: PreparedWindow, scales: Array, common: Array
) -> Iterator[tuple[list[int], list[AttemptResult]]]:
    """Yield rows of the scales as they are solved, with their results; each row comes once.

    Parameters
    ----------
    scales : (V, E), relative to the common scale
    common : (V,)
    """
    # Bodies of similar growth converge at about the same time.
    order = np.argsort(-window.squared_growth(scales).sum(axis=1), kind="stable")
    waiting: dict[int, AttemptResult | None] = dict.fromkeys(order.tolist())
    size = batch_size(len(window.scene.points))
    for number in range(len(window.settings.attempts)):
        rows = list(waiting)
        for first in range(0, len(rows), size):
            batch = rows[first : first + size]
            previous = [waiting[row] for row in batch]
            with single_blas_thread():
                results = run_attempt(window, scales[batch], common[batch], number, previous)
            done: dict[int, AttemptResult] = {}
            for row, result in zip(batch, results, strict=True):
                waiting[row] = result
                if is_final(window, number, result):
                    done[row] = result
                    del waiting[row]
            if done:
                yield list(done), list(done.values())


def run_attempt(
    window: PreparedWindow,
    scales: Array,
    common: Array,
    number: int,
    previous: list[AttemptResult | None],
) -> list[AttemptResult]:
    """Run an attempt for bodies (V, E); return the better of it and the previous."""
    columns = padded_columns(len(scales))
    scales = scales[columns]
    start = _attempt_start(window, scales, common, number, previous)
    solution = _solve_attempt(window, start, number, columns)
    displacement, scene = solution.displacement, window.scene
    motions = project_bone_lengths(scene, displacement, solution.bones, scales, window.supports)
    measurements = {
        "primal_residual": primal_residual(scene, displacement, scales),
        **measure_limited(scene, window.settings, scales, motions),
        "fixed_point_residual": solution.residual,
    }
    limits, results = window.settings.limits, []
    for v, before in enumerate(previous):
        values = {name: float(column[v]) for name, column in measurements.items()}
        quality = Quality(attempt=number, iterations=int(solution.iterations[v]), **values)
        result = AttemptResult(
            motion=np.ascontiguousarray(motions[..., v]),
            quality=quality,
            has_diverged=quality.has_diverged(limits),
            displacement=displacement[..., v],
            bones=solution.bones[..., v],
            bone_forces=solution.bone_forces[..., v],
        )
        results.append(_select_better(limits, before, result))
    return results


def is_final(window: PreparedWindow, number: int, result: AttemptResult) -> bool:
    """Whether a variation needs no further attempt."""
    attempts, quality = window.settings.attempts, result.quality
    has_converged = (
        quality.attempt == number and quality.fixed_point_residual <= attempts[number].tolerance
    )
    is_accepted = has_converged and quality.excess(window.settings.limits) == 0
    return number + 1 == len(attempts) or is_accepted


def _select_better(
    limits: AttemptLimits, previous: AttemptResult | None, result: AttemptResult
) -> AttemptResult:
    """Return the better motion: the later, which has more constraints, unless it has diverged."""
    if previous is None or not result.has_diverged:
        return result
    if result.quality.excess(limits) <= previous.quality.excess(limits):
        return result
    return replace(result, motion=previous.motion, quality=previous.quality)


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
    scene: Scene, displacement: Single, directions: Single, scales: Array, supports: Array
) -> Array:
    """Return motions with the exact bone lengths, ``(T, N, 3, V)`` float64 metres.

    The bones follow ``directions``, each body's mean position the displacement, and supporting feet
    too: a body that has not converged would slide otherwise.

    Parameters
    ----------
    displacement : (T, N, 3, V) float32 metres, of ADMM
    directions : (T, E, 3, V), of any length but zero
    scales : (V, E)
    supports : (T, N), how much each joint supports, 0 to 1
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
    for _ in range(LEG_TURNS):
        _turn_legs(scene, displacement, supports, motions)
    return motions


def _turn_legs(scene: Scene, displacement: Single, supports: Array, motions: Array) -> None:
    """Turn thighs and shins so that supporting feet come to where the displacement takes them.

    The rest of the body stays. A leg does not change its length where it is straight.
    """
    is_below = ancestor_bones(scene).T > 0
    for leg, name in zip(*hinges(scene), strict=True):
        if name != "knee":
            continue
        feet = np.flatnonzero(is_below[leg[1]])
        weights = supports[:, feet] / supports[:, feet].sum(axis=1, keepdims=True).clip(min=1)
        errors = scene.points[:, feet, :, None] + displacement[:, feet] - motions[:, feet]
        error = (weights[..., None, None] * errors).sum(axis=1)
        for bone in leg:
            parent, child = scene.bones[bone]
            vector = motions[:, child] - motions[:, parent]
            turned = vector + error / 2
            turned *= np.linalg.norm(vector, axis=1, keepdims=True) / np.linalg.norm(
                turned, axis=1, keepdims=True
            )
            motions[:, is_below[bone]] += (turned - vector)[:, None]


def _attempt_start(
    window: PreparedWindow,
    scales: Array,
    common: Array,
    number: int,
    previous: list[AttemptResult | None],
) -> AdmmStart:
    """Return the start of the V bodies of ``previous``.

    Parameters
    ----------
    scales : (W, E), padded to W columns
    common : (V,)
    """
    attempt, n_bodies = window.settings.attempts[number], len(previous)
    solver, scene = window.solver(attempt), window.scene
    rhs = to_blocks(energy_rhs(window.energy, scales)[..., :n_bodies])
    penalties = (attempt.bone_penalty * window.stiffness[..., None]).astype(np.float32)
    bones = window.response.warm_start(scene.bone_vectors, scales, penalties)[..., :n_bodies]
    scales, floor = scales[:n_bodies].T, solver.floor
    heights = np.repeat(floor.heights[..., None], n_bodies, axis=-1)
    points = np.repeat(scene.points[..., None], n_bodies, axis=-1)
    for v, result in enumerate(previous):
        if result is not None and not result.has_diverged:
            # v = z + u, with the dual rescaled to the penalties of this attempt.
            bones[..., v] = result.bones + result.bone_forces / penalties
            points[..., v] += result.displacement
            heights[..., v] += result.displacement[:, floor.joints, 1]
    others = solver.rows.differences(points, first_row=len(scales))
    angles = np.zeros((0, n_bodies))
    if attempt.pair_penalty:
        angles = angle_scales(scene, scales, angle_bounds(scene, window.settings))
    pairs = np.ones((others.shape[1] - len(angles), n_bodies))
    min_growth = MIN_GROWTH_RMS**2 * len(window.stiffness)
    return AdmmStart(
        energy_rhs=rhs.reshape(*rhs.shape[:2], -1, n_bodies),
        governing=to_blocks(np.concatenate([bones, others], axis=1)),
        floor=pair_frames(heights.astype(np.float32), repeat=True),
        scales=np.concatenate([scales, angles, pairs]).astype(np.float32),
        lowest=(floor.lowest[:, None] / common).astype(np.float32),
        step_scale=step_scale(window.squared_growth(scales.T) + min_growth),
        n_bones=len(scales),
    )


def _solve_attempt(
    window: PreparedWindow, start: AdmmStart, number: int, columns: NDArray[np.intp]
) -> _AttemptSolution:
    """Run ADMM, and return its solution frame by frame for the padded columns."""
    attempt = window.settings.attempts[number]
    solution = solve_admm(
        window.solver(attempt),
        start,
        max_iterations=attempt.max_iterations,
        tolerance=attempt.tolerance,
    )
    n_frames, n_bones = window.stiffness.shape
    governing, bones = solution.governing[:, :, :, :n_bones], solution.bones
    penalties = (attempt.bone_penalty * window.stiffness[..., None, None]).astype(np.float32)

    def frames(blocks: Single) -> Single:
        return from_blocks(blocks, n_frames)[..., columns]

    return _AttemptSolution(
        displacement=frames(solution.displacement.reshape(len(bones), 3, 2, -1, bones.shape[-1])),
        bones=frames(bones),
        bone_forces=frames(governing - bones) * penalties,
        residual=solution.residual,
        iterations=solution.iterations,
    )
