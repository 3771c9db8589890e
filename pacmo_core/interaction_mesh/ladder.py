"""The tries that a variation gets."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pacmo_core.interaction_mesh.blocks import AXES, in_pairs
from pacmo_core.interaction_mesh.distances import near_error
from pacmo_core.interaction_mesh.energy import energy_terms, target_of
from pacmo_core.interaction_mesh.finish import exact, raw_residual
from pacmo_core.interaction_mesh.naive import naive
from pacmo_core.interaction_mesh.products import filled, product
from pacmo_core.interaction_mesh.report import Report, figures_of
from pacmo_core.interaction_mesh.scene import Array, Single
from pacmo_core.interaction_mesh.settings import Limits
from pacmo_core.interaction_mesh.solve import Start, solve
from pacmo_core.interaction_mesh.source import Source

# Metres, root mean square: bones that grow by less have settled at once.
NOTHING = 1e-6
# Power by which steps of bodies are to be shorter whose growth is shared by more bones. With this
# one, whole bodies and single bones end equally far from the least energy, about.
SHARED = 0.75


@dataclass(frozen=True)
class Try:
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
class _Solved:
    """The change (T, N, 3, V), the bones (T, E, 3, V), the forces that these bear, and how."""

    change: Single
    bones: Single
    pressed: Single
    step: Array
    iterations: NDArray[np.intp]


def climb(source: Source, scales: Array, number: int, held: list[Try | None]) -> list[Try]:
    """Try a rung on some bodies with scales (V, E), and keep the better of this and the last."""
    # Sums of few columns add up in another order: full ones, so that company makes no difference.
    columns = np.resize(np.arange(len(scales)), filled(len(scales)))
    scales = scales[columns]
    target = target_of(source.energy, scales).astype(np.float32)
    start = _start(source, scales, target, number, held)
    solved = _solve(source, start, number, columns)
    change, bones, pressed = solved.change, solved.bones, solved.pressed
    motions = exact(source.scene, change, bones, scales)
    figures = _figures(source, scales, motions, held)
    figures["raw_residual"] = raw_residual(source.scene, change, scales)
    figures["last_step"] = solved.step
    moved = (motions - source.scene.points[..., None]).astype(np.float32)
    terms = energy_terms(source.energy, moved, target)
    reports = [
        Report(
            rung=number,
            iterations=int(solved.iterations[v]),
            energy={name: float(term[v]) for name, term in terms.items()},
            **{name: float(column[v]) for name, column in figures.items()},
        )
        for v in range(len(held))
    ]
    limits = source.settings.limits
    return [
        _better(
            limits,
            before,
            Try(
                motion=np.ascontiguousarray(motions[..., v]),
                report=reports[v],
                astray=reports[v].astray(limits),
                bones=bones[..., v],
                pressed=pressed[..., v],
            ),
        )
        for v, before in enumerate(held)
    ]


def is_done(source: Source, number: int, one: Try) -> bool:
    """Say whether a variation needs no further rung."""
    rungs, report = source.settings.rungs, one.report
    settled = report.rung == number and report.last_step <= rungs[number].step
    return number + 1 == len(rungs) or (settled and report.badness(source.settings.limits) <= 1)


def _better(limits: Limits, held: Try | None, new: Try) -> Try:
    """Prefer the later of two tries within the limits: it had more iterations."""
    if held is None or new.report.badness(limits) <= max(1, held.report.badness(limits)):
        return new
    return replace(new, motion=held.motion, report=held.report)


def _figures(
    source: Source, scales: Array, motions: Array, held: list[Try | None]
) -> dict[str, Array]:
    """Measure the motions (T, N, 3, V), and naive scaling if that was not done before."""
    figures = figures_of(source.scene, source.settings, source.energy.standing, motions)
    known = [one.report.near_error_naive for one in held if one is not None]
    if known:
        return figures | {"near_error_naive": np.array(known)}
    plain = naive(source.scene, scales)
    return figures | {"near_error_naive": near_error(source.scene, source.settings, plain)}


def _start(
    source: Source, scales: Array, target: Single, number: int, held: list[Try | None]
) -> Start:
    """Start those that are ``held``; scales (V, E) and target (T, N + M, 3, V) may hold more."""
    rung, n_bodies = source.settings.rungs[number], len(held)
    laplacians = source.energy.laplacians.transpose(0, 2, 1).astype(np.float32)
    pull = product(laplacians, target.reshape(*target.shape[:2], -1))
    pull = _blocks(pull.reshape(*pull.shape[:2], *target.shape[2:])[..., :n_bodies])
    bearing = (rung.penalty * source.stiffness[..., None]).astype(np.float32)
    bones = source.answers.summed(source.scene.vectors, scales, bearing)[..., :n_bodies]
    scales = scales[:n_bodies]
    return Start(
        pull=pull.reshape(len(pull), -1, *pull.shape[3:]),
        point=_points(source, bones, bearing, number, held),
        scales=scales.T.astype(np.float32),
        asked=asked_of(source.grown(scales) + NOTHING**2 * len(source.stiffness)),
    )


def asked_of(grown: Array) -> Array:
    """Say what a body's steps are held against, (V,), by how its bones grow, (V, E).

    The more bones share its growth, the less: such bodies settle slowly as a whole, and are far
    from their end when their steps are short already.
    """
    whole = grown.sum(axis=1)
    n_bones = whole**2 / np.square(grown).sum(axis=1)
    asked: Array = whole / n_bones**SHARED
    return asked


def _points(
    source: Source, bones: Single, bearing: Single, number: int, held: list[Try | None]
) -> Single:
    """Start from the bones (T, E, 3, V), or from where the last try ended."""
    ends = source.solver(source.settings.rungs[number]).guarded
    pairs = np.repeat(_between(source.scene.points, ends)[..., None], len(held), axis=-1)
    for v, one in enumerate(held):
        if one is not None and not one.astray:
            bones[..., v] = one.bones + one.pressed / bearing
            pairs[..., v] = _between(one.motion, ends)
    return _blocks(np.concatenate([bones, pairs], axis=1))


def _between(points: Array, ends: NDArray[np.intp]) -> Single:
    first, second = (np.take_along_axis(points, ends[..., end, None], axis=1) for end in (0, 1))
    vectors: Single = (second - first).astype(np.float32)
    return vectors


def _blocks(columns: NDArray[np.floating]) -> Single:
    """Turn (T, R, 3, V) into (K, 2, R, 3, V) float32."""
    return in_pairs(columns.astype(np.float32, copy=False)[:, :, AXES])


def _solve(source: Source, start: Start, number: int, columns: NDArray[np.intp]) -> _Solved:
    """Iterate on a rung; the solver's own arrays end here."""
    rung = source.settings.rungs[number]
    solution = solve(source.solver(rung), start, iterations=rung.iterations, step=rung.step)
    n_frames, n_bones = source.stiffness.shape
    n_points = source.scene.points.shape[1]

    def laid_out(blocks: Single, n_rows: int) -> Single:
        rows = blocks.reshape(-1, n_rows, 3, blocks.shape[-1])[:n_frames]
        return rows[:, :, AXES][..., columns]

    point = solution.point[:, :, :n_bones]
    bones = point * solution.share[:, :, :n_bones, None]
    weights = (rung.penalty * source.stiffness[..., None, None]).astype(np.float32)
    return _Solved(
        change=laid_out(solution.change, n_points),
        bones=laid_out(bones, n_bones),
        pressed=laid_out(point - bones, n_bones) * weights,
        step=solution.step,
        iterations=solution.iterations,
    )
