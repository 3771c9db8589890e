"""A source made ready for the bodies that it will get."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pacmo_core.interaction_mesh.admm import AdmmSolver, AdmmStart, build_solver, solve_admm
from pacmo_core.interaction_mesh.energy import (
    QuadraticEnergy,
    build_energy,
    energy_target,
    energy_terms,
)
from pacmo_core.interaction_mesh.factorisation import (
    AXIS_ORDER,
    add_separation_constraints,
    bone_constraints,
    factorise,
    pair_frames,
    stiffness,
)
from pacmo_core.interaction_mesh.linear_algebra import (
    COLUMN_WIDTH,
    batched_product,
    padded_width,
    single_blas_thread,
)
from pacmo_core.interaction_mesh.report import Report, measure_motions, near_distance_error
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

# Bodies at once, and the frames of all of them together: what bounds the memory.
MAX_BATCH = 48
MAX_BATCH_FRAMES = 40_000


@dataclass(frozen=True)
class PreparedSource:
    """A scene with all that does not depend on the bodies it will get.

    Parameters
    ----------
    scene, settings : as given to ``prepare``
    energy : its matrices
    stiffness : (T, E), by which penalties are stated
    response : to each bone that grows, from which iterations start
    solvers : by penalties, made when first wanted
    """

    scene: Scene
    settings: Settings
    energy: QuadraticEnergy
    stiffness: Array
    response: LinearResponse
    solvers: dict[tuple[float, float], AdmmSolver] = field(default_factory=dict)

    @property
    def batch(self) -> int:
        """How many bodies to take at once."""
        most = MAX_BATCH_FRAMES // len(self.scene.points) // COLUMN_WIDTH * COLUMN_WIDTH
        return min(MAX_BATCH, max(COLUMN_WIDTH, most))

    def grown(self, scales: Array) -> Array:
        """``(V, E)`` square metres: by how much bones grow, summed over frames."""
        squares = np.square(self.scene.vectors).sum(axis=(0, 2))
        grown: Array = np.square(scales - 1) * squares
        return grown

    def solver(self, attempt: Attempt) -> AdmmSolver:
        """Give the solver of a attempt."""
        penalties = (attempt.bone_penalty, attempt.separation_penalty)
        if penalties not in self.solvers:
            scene, settings = self.scene, self.settings
            rows = bone_constraints(scene, attempt.bone_penalty * self.stiffness)
            if attempt.separation_penalty:
                rows = add_separation_constraints(
                    scene,
                    rows,
                    attempt.separation_penalty,
                    settings.n_separation_pairs,
                    settings.clearance,
                )
            self.solvers[penalties] = build_solver(
                factorise(self.energy, rows),
                rows,
                n_bones=len(scene.bones),
                relaxation=settings.relaxation,
            )
        return self.solvers[penalties]


def prepare(scene: Scene, settings: Settings) -> PreparedSource:
    """Build graph, weights and factorisation of a source."""
    with single_blas_thread():
        energy = build_energy(scene, settings)
        source = PreparedSource(
            scene, settings, energy, stiffness(energy, scene), linear_response(scene, energy)
        )
        source.solver(settings.attempts[0])
    return source


# FROM """From the solver's answer to motions whose bones have exactly the wanted lengths."""
def primal_residual(scene: Scene, change: Single, scales: Array) -> Array:
    """``(V,)``: by how much bones still miss their length before they are set to it, at worst.

    Setting them hides it: a solver that cycles gives exact bones too, with feet that slide.

    Parameters
    ----------
    change : (T, N, 3, V) float32 metres, the solver's
    scales : (V, E)
    """
    source = scene.vectors.astype(np.float32)
    wanted = np.linalg.norm(source, axis=-1)
    worst = np.zeros(len(scales))
    for bone, (parent, child) in enumerate(scene.bones):
        vector = change[:, child] - change[:, parent] + source[:, bone, :, None]
        length = np.sqrt(np.einsum("tcv,tcv->tv", vector, vector))
        share = length / (wanted[:, bone, None] * scales[:, bone].astype(np.float32))
        worst = np.maximum(worst, np.abs(share - 1).max(axis=0))
    return worst


def project_bone_lengths(scene: Scene, change: Single, directions: Single, scales: Array) -> Array:
    """``(T, N, 3, V)`` float64 metres: bones along ``directions``, each body where it went.

    Parameters
    ----------
    change : (T, N, 3, V) float32 metres, the solver's
    directions : (T, E, 3, V), of any length but zero
    scales : (V, E)
    """
    lengths = np.linalg.norm(scene.vectors, axis=-1)
    placed = np.zeros(change.shape)
    first_joint = first_bone = 0
    for skeleton in scene.skeletons:
        joints = slice(first_joint, first_joint + len(skeleton.joints))
        body = placed[:, joints]
        bone_of = {child: row + first_bone for row, (_, child) in enumerate(skeleton.bones)}
        for joint in skeleton.order[1:]:
            bone = bone_of[joint]
            along = directions[:, bone].astype(np.float64)
            long = np.sqrt(np.einsum("tcv,tcv->tv", along, along))
            along *= (lengths[:, bone, None] * scales[:, bone] / long)[:, None]
            np.add(body[:, skeleton.parents[joint]], along, out=body[:, joint])
        middle = scene.points[:, joints].mean(axis=1)[..., None] + change[:, joints].mean(axis=1)
        body += (middle - body.mean(axis=1))[:, None]
        first_joint, first_bone = joints.stop, first_bone + len(skeleton.bones)
    return placed


# FROM """The tries that a variation gets."""
# Metres, root mean square: bones that grow by less have settled at once.
MIN_GROWTH_RMS = 1e-6
# Power by which steps of bodies are to be shorter whose growth is shared by more bones. With this
# one, whole bodies and single bones end equally far from the least energy, about.
GROWTH_SHARING_POWER = 0.75


@dataclass(frozen=True)
class AttemptResult:
    """The best motion so far of a variation, and where the next try starts.

    Parameters
    ----------
    motion : (T, N, 3) metres
    report : its figures
    bones : (T, E, 3) float32 metres, of the wanted lengths
    pressed : (T, E, 3) float32, the forces they bear
    astray : whether the last try, of which these are, went astray
    """

    motion: Array
    report: Report
    astray: bool
    bones: Single
    pressed: Single


@dataclass(frozen=True)
class _AttemptSolution:
    """The change (T, N, 3, V), the bones (T, E, 3, V), the forces that these bear, and how."""

    change: Single
    bones: Single
    pressed: Single
    step: Array
    iterations: NDArray[np.intp]


def run_attempt(
    source: PreparedSource, scales: Array, number: int, held: list[AttemptResult | None]
) -> list[AttemptResult]:
    """Try a attempt on some bodies with scales (V, E), and keep the better of this and the last."""
    # Sums of few columns add up in another order: full ones, so that company makes no difference.
    columns = np.resize(np.arange(len(scales)), padded_width(len(scales)))
    scales = scales[columns]
    target = energy_target(source.energy, scales).astype(np.float32)
    start = _attempt_start(source, scales, target, number, held)
    solved = _solve_attempt(source, start, number, columns)
    change, bones, pressed = solved.change, solved.bones, solved.pressed
    motions = project_bone_lengths(source.scene, change, bones, scales)
    figures = _measure(source, scales, motions, held)
    figures["primal_residual"] = primal_residual(source.scene, change, scales)
    figures["fixed_point_residual"] = solved.step
    moved = (motions - source.scene.points[..., None]).astype(np.float32)
    terms = energy_terms(source.energy, moved, target)
    reports = [
        Report(
            attempt=number,
            iterations=int(solved.iterations[v]),
            energy={name: float(term[v]) for name, term in terms.items()},
            **{name: float(column[v]) for name, column in figures.items()},
        )
        for v in range(len(held))
    ]
    limits = source.settings.limits
    return [
        _select_better(
            limits,
            before,
            AttemptResult(
                motion=np.ascontiguousarray(motions[..., v]),
                report=reports[v],
                astray=reports[v].astray(limits),
                bones=bones[..., v],
                pressed=pressed[..., v],
            ),
        )
        for v, before in enumerate(held)
    ]


def is_final(source: PreparedSource, number: int, one: AttemptResult) -> bool:
    """Say whether a variation needs no further attempt."""
    attempts, report = source.settings.attempts, one.report
    settled = report.attempt == number and report.fixed_point_residual <= attempts[number].tolerance
    return number + 1 == len(attempts) or (settled and report.badness(source.settings.limits) <= 1)


def _select_better(
    limits: AttemptLimits, held: AttemptResult | None, new: AttemptResult
) -> AttemptResult:
    """Prefer the later of two tries within the limits: it had more iterations."""
    if held is None or new.report.badness(limits) <= max(1, held.report.badness(limits)):
        return new
    return replace(new, motion=held.motion, report=held.report)


def _measure(
    source: PreparedSource, scales: Array, motions: Array, held: list[AttemptResult | None]
) -> dict[str, Array]:
    """Measure the motions (T, N, 3, V), and naive scaling if that was not done before."""
    figures = measure_motions(source.scene, source.settings, source.energy.standing, motions)
    known = [one.report.near_distance_error_naive for one in held if one is not None]
    if known:
        return figures | {"near_distance_error_naive": np.array(known)}
    plain = naive_scaling(source.scene, scales)
    return figures | {
        "near_distance_error_naive": near_distance_error(source.scene, source.settings, plain)
    }


def _attempt_start(
    source: PreparedSource,
    scales: Array,
    target: Single,
    number: int,
    held: list[AttemptResult | None],
) -> AdmmStart:
    """Start those that are ``held``; scales (V, E) and target (T, N + M, 3, V) may hold more."""
    attempt, n_bodies = source.settings.attempts[number], len(held)
    laplacians = source.energy.laplacians.transpose(0, 2, 1).astype(np.float32)
    pull = batched_product(laplacians, target.reshape(*target.shape[:2], -1))
    pull = _to_blocks(pull.reshape(*pull.shape[:2], *target.shape[2:])[..., :n_bodies])
    bearing = (attempt.bone_penalty * source.stiffness[..., None]).astype(np.float32)
    bones = source.response.summed(source.scene.vectors, scales, bearing)[..., :n_bodies]
    scales = scales[:n_bodies]
    return AdmmStart(
        pull=pull.reshape(len(pull), -1, *pull.shape[3:]),
        point=_initial_governing(source, bones, bearing, number, held),
        scales=scales.T.astype(np.float32),
        asked=step_scale(source.grown(scales) + MIN_GROWTH_RMS**2 * len(source.stiffness)),
    )


def step_scale(grown: Array) -> Array:
    """Say what a body's steps are held against, (V,), by how its bones grow, (V, E).

    The more bones share its growth, the less: such bodies settle slowly as a whole, and are far
    from their end when their steps are short already.
    """
    whole = grown.sum(axis=1)
    n_bones = whole**2 / np.square(grown).sum(axis=1)
    asked: Array = whole / n_bones**GROWTH_SHARING_POWER
    return asked


def _initial_governing(
    source: PreparedSource,
    bones: Single,
    bearing: Single,
    number: int,
    held: list[AttemptResult | None],
) -> Single:
    """Start from the bones (T, E, 3, V), or from where the last try ended."""
    ends = source.solver(source.settings.attempts[number]).guarded
    pairs = np.repeat(_pair_vectors(source.scene.points, ends)[..., None], len(held), axis=-1)
    for v, one in enumerate(held):
        if one is not None and not one.astray:
            bones[..., v] = one.bones + one.pressed / bearing
            pairs[..., v] = _pair_vectors(one.motion, ends)
    return _to_blocks(np.concatenate([bones, pairs], axis=1))


def _pair_vectors(points: Array, ends: NDArray[np.intp]) -> Single:
    first, second = (np.take_along_axis(points, ends[..., end, None], axis=1) for end in (0, 1))
    vectors: Single = (second - first).astype(np.float32)
    return vectors


def _to_blocks(columns: NDArray[np.floating]) -> Single:
    """Turn (T, R, 3, V) into (K, 2, R, 3, V) float32."""
    return pair_frames(columns.astype(np.float32, copy=False)[:, :, AXIS_ORDER])


def _solve_attempt(
    source: PreparedSource, start: AdmmStart, number: int, columns: NDArray[np.intp]
) -> _AttemptSolution:
    """Iterate on a attempt; the solver's own arrays end here."""
    attempt = source.settings.attempts[number]
    solution = solve_admm(
        source.solver(attempt), start, iterations=attempt.max_iterations, step=attempt.tolerance
    )
    n_frames, n_bones = source.stiffness.shape
    n_points = source.scene.points.shape[1]

    def laid_out(blocks: Single, n_rows: int) -> Single:
        rows = blocks.reshape(-1, n_rows, 3, blocks.shape[-1])[:n_frames]
        return rows[:, :, AXIS_ORDER][..., columns]

    point = solution.point[:, :, :n_bones]
    bones = point * solution.share[:, :, :n_bones, None]
    weights = (attempt.bone_penalty * source.stiffness[..., None, None]).astype(np.float32)
    return _AttemptSolution(
        change=laid_out(solution.change, n_points),
        bones=laid_out(bones, n_bones),
        pressed=laid_out(point - bones, n_bones) * weights,
        step=solution.step,
        iterations=solution.iterations,
    )


# FROM """Give a two-person motion other bodies: prepare a source once, then vary it at will."""
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


def retarget(source: PreparedSource, scales: Array) -> Variations:
    """Give the source other bodies.

    Parameters
    ----------
    scales : (V, E), of each bone of person a, then of person b, against the source's

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
    """Do as ``vary``, and give variations as they are done, lest all stand in memory.

    Those that are not within the limits wait for the next attempt together, so that the many easy
    ones need not iterate with the few hard ones. Each row comes once.
    """
    check_scales(scales, len(source.scene.bones))
    whole = common_scale(source.scene, scales)
    own = scales / whole[:, None]
    # Like beside like: they settle at about the same time.
    in_order = np.argsort(-source.grown(own).sum(axis=1))
    waiting: dict[int, AttemptResult | None] = dict.fromkeys(in_order.tolist())
    for number in range(len(source.settings.attempts)):
        rows = list(waiting)
        for first in range(0, len(rows), source.batch):
            batch = rows[first : first + source.batch]
            with single_blas_thread():
                tries = run_attempt(source, own[batch], number, [waiting[row] for row in batch])
            waiting |= dict(zip(batch, tries, strict=True))
            done = [
                row for row, one in zip(batch, tries, strict=True) if is_final(source, number, one)
            ]
            if done:
                yield _pop_variations(source, whole, done, waiting)


def _pop_variations(
    source: PreparedSource, whole: Array, done: list[int], waiting: dict[int, AttemptResult | None]
) -> Variations:
    """Take rows from those that wait."""
    taken = [held for row in done if (held := waiting.pop(row)) is not None]
    points = scale_scene(source.scene, np.stack([one.motion for one in taken]), whole[done])
    return Variations(np.array(done, dtype=np.intp), points, tuple(one.report for one in taken))
