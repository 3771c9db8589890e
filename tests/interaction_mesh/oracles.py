"""Two slower solvers of the same problem by other methods, and the energy by its definition."""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import splu

from pacmo_core.interaction_mesh.body_parts import (
    ancestor_bones,
    hinges,
    posture_weights,
    trunk_joints,
    trunk_pairs,
)
from pacmo_core.interaction_mesh.energy import QuadraticEnergy, energy_of, energy_rhs
from pacmo_core.interaction_mesh.mesh import (
    contact_hessians,
    ground_supports,
    height_term,
    laplacian_matrices,
    root_term,
    support_weights,
)
from pacmo_core.interaction_mesh.scene import Scene
from pacmo_core.interaction_mesh.settings import Settings

Array = NDArray[np.float64]


def energy_by_definition(
    scene: Scene, settings: Settings, displacement: Array, scales: Array
) -> float:
    """Sum E over frames, bones and joints, one at a time, as the head of ``energy`` states it.

    Parameters
    ----------
    displacement : (T, N, 3) metres
    scales : (E,)
    """
    weights = settings.weights
    posture, smoothness = _posture_energy, _smoothness_energy
    return sum(
        part(scene, settings, displacement, scales - 1)
        for part in (_mesh_energy, posture, _trunk_energy, _place_energy, smoothness)
    ) + weights.regularisation * float(np.sum(displacement**2) / 2)


def _mesh_energy(scene: Scene, settings: Settings, displacement: Array, growth: Array) -> float:
    """Laplacian deformation and contact."""
    laplacians = laplacian_matrices(scene, settings.weights)
    closeness, total = -contact_hessians(scene, settings.weights), 0.0
    for t, moved in enumerate(displacement):
        target = np.zeros_like(moved)
        for e, (parent, child) in enumerate(scene.bones):
            grown = growth[e] * scene.bone_vectors[t, e]
            target[parent] += laplacians[t, parent, child] * grown
            target[child] -= laplacians[t, child, parent] * grown
        total += np.sum((laplacians[t] @ moved - target) ** 2) / 2
        for i in range(len(moved)):
            for j in range(i):
                total += closeness[t, i, j] * np.sum((moved[i] - moved[j]) ** 2) / 2
    return total


def _posture_energy(scene: Scene, settings: Settings, displacement: Array, growth: Array) -> float:
    """Directions of bones, and angles of hinges and of the trunk."""
    weights = settings.weights.posture
    posture, total = posture_weights(scene, weights), 0.0
    lengths = np.linalg.norm(scene.bone_vectors, axis=-1).mean(axis=0)
    limbs, names = hinges(scene)
    bends = [(pair, getattr(weights, name)) for pair, name in zip(limbs, names, strict=True)]
    bends += [(pair, weights.spine) for pair in trunk_pairs(scene)]
    for moved, vectors in zip(displacement, scene.bone_vectors, strict=True):
        excess = [
            moved[child] - moved[parent] - growth[e] * vectors[e]
            for e, (parent, child) in enumerate(scene.bones)
        ]
        for e, vector in enumerate(excess):
            total += posture[e] * (0.3 / lengths[e]) * np.sum(vector**2) / 2
        for (upper, lower), weight in bends:
            turn = 0.4 * (excess[lower] / lengths[lower] - excess[upper] / lengths[upper])
            total += weight * np.sum(turn**2) / 2
    return total


def _trunk_energy(scene: Scene, settings: Settings, displacement: Array, growth: Array) -> float:
    total = 0.0
    for moved, vectors in zip(displacement, scene.bone_vectors, strict=True):
        grown = ancestor_bones(scene) @ (growth[:, None] * vectors)
        for joints in trunk_joints(scene):
            rest = moved[joints] - grown[joints]
            total += settings.weights.trunk_shape * np.sum((rest - rest.mean(axis=0)) ** 2) / 2
    return total


def _place_energy(scene: Scene, settings: Settings, displacement: Array, growth: Array) -> float:
    """Places of the roots, and heights near the floor."""
    root_weights, root = root_term(scene, settings.weights)
    heights, total = height_term(scene, settings.weights, _supports(scene, settings)), 0.0
    for t, moved in enumerate(displacement):
        for i, point in enumerate(moved):
            wanted = np.array([0, root.targets[t, i] @ growth, 0])
            total += root_weights[t, i] * np.sum((point - wanted) ** 2) / 2
            total += heights.weights[t, i] * (point[1] - heights.targets[t, i] @ growth) ** 2 / 2
    return total


def _smoothness_energy(
    scene: Scene, settings: Settings, displacement: Array, _growth: Array
) -> float:
    """Acceleration, and the speed of supporting joints."""
    weights, rate = settings.weights, scene.fps / 30
    supports, total = _supports(scene, settings), 0.0
    for t in range(1, len(displacement)):
        step = np.sum((displacement[t] - displacement[t - 1]) ** 2, axis=-1)
        total += weights.stance * rate**2 * (supports[t] * supports[t - 1] @ step) / 2
    for t in range(1, len(displacement) - 1):
        second = displacement[t + 1] - 2 * displacement[t] + displacement[t - 1]
        total += weights.acceleration * rate**4 * np.sum(second**2) / 2
    return total


def _supports(scene: Scene, settings: Settings) -> Array:
    is_support = ground_supports(scene, settings.support)
    return support_weights(is_support, scene.fps, settings.support.fade_time)


def energy_value(energy: QuadraticEnergy, displacement: Array, scales: Array) -> float:
    """Return E for one body's scales (E,)."""
    return float(energy_of(energy, displacement[..., None], scales[None])[0])


def matrix(energy: QuadraticEnergy) -> csc_array:
    """Build H over all frames, joints and directions, (3TN, 3TN)."""
    n_frames, n_points = energy.height_weights.shape
    size = 3 * n_frames * n_points
    t, i, j, c = np.indices((n_frames, n_points, n_points, 3)).reshape(4, -1)
    rows, columns = 3 * (t * n_points + i) + c, 3 * (t * n_points + j) + c
    values = energy.frame_hessians[t, i, j] + ((i == j) & (c == 1)) * energy.height_weights[t, i]
    hessian = csc_array((values, (rows, columns)), shape=(size, size))
    step = 3 * n_points
    first = diags_array([-1.0, 1.0], offsets=[0, step], shape=(size - step, size))
    stance = diags_array(np.repeat(energy.step_weights.reshape(-1), 3))
    hessian = csc_array(hessian + energy.stance * first.T @ stance @ first)
    if n_frames > 2:
        second = diags_array(
            [1.0, -2.0, 1.0], offsets=[0, step, 2 * step], shape=(size - 2 * step, size)
        )
        hessian = csc_array(hessian + energy.acceleration * second.T @ second)
    return hessian


def right_side(energy: QuadraticEnergy, scales: Array) -> Array:
    """Give g for one body's scales (E,), flat."""
    rhs: Array = energy_rhs(energy, scales[None])[..., 0].reshape(-1).astype(np.float64)
    return rhs


def differences(scene: Scene) -> csc_array:
    """Give the matrix from flat positions to flat bone vectors, (3TE, 3TN)."""
    n_frames, n_points, _ = scene.points.shape
    n_bones = len(scene.bones)
    t, e, c = np.indices((n_frames, n_bones, 3)).reshape(3, -1)
    row = 3 * (t * n_bones + e) + c
    ends = [3 * (t * n_points + scene.bones[e, end]) + c for end in (0, 1)]
    ones = np.ones(len(row))
    values = np.concatenate([-ones, ones])
    indices = (np.tile(row, 2), np.concatenate(ends))
    return csc_array((values, indices), shape=(len(row), 3 * n_frames * n_points))


def banded(scene: Scene, energy: QuadraticEnergy, scales: Array, *, n_rounds: int = 40) -> Array:
    """Solve by an augmented Lagrangian of Gauss-Newton steps on a banded matrix, from the source.

    Bones grow to their lengths in five morphs, without which steps overshoot.

    Returns
    -------
    (T, N, 3) metres, U
    """
    hessian, rhs, bones = matrix(energy), right_side(energy, scales), differences(scene)
    source = scene.points.reshape(-1)
    lengths = np.linalg.norm(scene.bone_vectors, axis=-1)
    width = 9 * scene.points.shape[1] - 1
    displacement, multiplier, stiffness = np.zeros(len(source)), np.zeros(lengths.size), 300.0
    fractions = np.concatenate([np.linspace(0.2, 1, 5), np.ones(n_rounds - 5)])
    for fraction in fractions:
        morphed_scales = 1 + fraction * (scales - 1)
        vectors = (bones @ (source + displacement)).reshape(-1, 3)
        current_lengths = np.linalg.norm(vectors, axis=-1)
        error = current_lengths - (lengths * morphed_scales).reshape(-1)
        along = csc_array(_along(vectors / current_lengths[:, None])) @ bones
        full = hessian + stiffness * along.T @ along
        slope = hessian @ displacement - fraction * rhs + along.T @ (stiffness * error + multiplier)
        displacement -= solveh_banded(_bands(full, width), slope, lower=True)
        vectors = (bones @ (source + displacement)).reshape(-1, 3)
        error = np.linalg.norm(vectors, axis=-1) - (lengths * morphed_scales).reshape(-1)
        multiplier += stiffness * error
    return displacement.reshape(scene.points.shape)


def manifold(scene: Scene, energy: QuadraticEnergy, scales: Array, *, n_rounds: int = 12) -> Array:
    """Solve by Gauss-Newton on the directions of the bones and the places of the roots.

    The bones are of their length at every step. A step turns each direction in its tangent plane;
    the sphere's own curvature joins the matrix where it helps it stay positive.

    Returns
    -------
    (T, N, 3) metres, U
    """
    hessian, rhs = matrix(energy), right_side(energy, scales)
    source, spread = scene.points.reshape(-1), _spread(scene)
    n_frames, n_bones = scene.bone_vectors.shape[:2]
    target_lengths = (np.linalg.norm(scene.bone_vectors, axis=-1) * scales).reshape(-1, 1)
    n_bone_rows = 3 * n_frames * n_bones
    roots = np.concatenate([scene.points[:, :1], scene.points[:, scene.n_joints[0], None]], axis=1)
    directions = scene.bone_vectors.reshape(-1, 3) / np.linalg.norm(
        scene.bone_vectors, axis=-1
    ).reshape(-1, 1)
    roots_now = roots.reshape(-1)
    for _ in range(n_rounds):
        positions = spread @ np.concatenate([(target_lengths * directions).reshape(-1), roots_now])
        slope = spread.T @ (hessian @ (positions - source) - rhs)
        bone_forces = slope[:n_bone_rows].reshape(-1, 3)
        frames = _tangents(directions)
        tangent = _blocks(target_lengths[:, :, None] * frames, n_bone_rows, len(slope))
        curvatures = np.maximum(-(bone_forces * directions).sum(axis=1) * target_lengths[:, 0], 0)
        curvature = np.concatenate([np.repeat(curvatures, 2), np.zeros(len(roots_now))])
        full = tangent.T @ (spread.T @ hessian @ spread) @ tangent + diags_array(curvature)
        step = -splu(csc_array(full)).solve(tangent.T @ slope)
        rotated = directions + np.einsum(
            "bij,bj->bi", frames, step[: 2 * len(directions)].reshape(-1, 2)
        )
        directions = rotated / np.linalg.norm(rotated, axis=1, keepdims=True)
        roots_now = roots_now + step[2 * len(directions) :]
    positions = spread @ np.concatenate([(target_lengths * directions).reshape(-1), roots_now])
    displacement: Array = (positions - source).reshape(scene.points.shape)
    return displacement


def _along(units: Array) -> csc_array:
    n_rows = len(units)
    rows, columns = np.repeat(np.arange(n_rows), 3), np.arange(3 * n_rows)
    return csc_array((units.reshape(-1), (rows, columns)), shape=(n_rows, 3 * n_rows))


def _bands(full: csc_array, width: int) -> Array:
    """Lower bands of a symmetric matrix, as LAPACK wants them."""
    entries = full.tocoo()
    below = (entries.row >= entries.col) & (entries.data != 0)
    row, column = entries.row[below], entries.col[below]
    bands = np.zeros((width + 1, full.shape[0]))
    bands[row - column, column] = entries.data[below]
    return bands


def _spread(scene: Scene) -> csc_array:
    """Give the matrix from flat bone vectors, then flat roots of a and b, to flat positions."""
    n_frames, n_points, _ = scene.points.shape
    n_bones = len(scene.bones)
    bone_of = {int(child): row for row, (_, child) in enumerate(scene.bones)}
    parent_of = {int(child): int(parent) for parent, child in scene.bones}
    rows, columns = [], []
    t, c = np.indices((n_frames, 3)).reshape(2, -1)
    for point in range(n_points):
        joint = point
        while joint in parent_of:
            rows.append(3 * (t * n_points + point) + c)
            columns.append(3 * (t * n_bones + bone_of[joint]) + c)
            joint = parent_of[joint]
        body = int(joint >= scene.n_joints[0])
        rows.append(3 * (t * n_points + point) + c)
        columns.append(3 * n_frames * n_bones + 3 * (2 * t + body) + c)
    row, column = np.concatenate(rows), np.concatenate(columns)
    shape = (3 * n_frames * n_points, 3 * n_frames * (n_bones + 2))
    return csc_array((np.ones(len(row)), (row, column)), shape=shape)


def _tangents(directions: Array) -> Array:
    """Give two unit vectors across each direction, (n, 3, 2)."""
    helper = np.eye(3)[np.abs(directions).argmin(axis=1)]
    first = np.cross(directions, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(directions, first)], axis=-1)


def _blocks(frames: Array, n_bone_rows: int, n_rows: int) -> csc_array:
    """Set tangent frames on the diagonal; the roots' rows follow as they are."""
    n_bones, n_roots = len(frames), n_rows - n_bone_rows
    b, i, j = np.indices(frames.shape).reshape(3, -1)
    rows = np.concatenate([3 * b + i, n_bone_rows + np.arange(n_roots)])
    columns = np.concatenate([2 * b + j, 2 * n_bones + np.arange(n_roots)])
    values = np.concatenate([frames.reshape(-1), np.ones(n_roots)])
    return csc_array((values, (rows, columns)), shape=(n_rows, 2 * n_bones + n_roots))
