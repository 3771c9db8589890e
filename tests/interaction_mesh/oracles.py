"""Two slower solvers of the same problem by other methods, and the energy by its definition."""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation

from pacmo_core.interaction_mesh.body_parts import (
    RIGID,
    ancestor_bones,
    hinges,
    posture_weights,
    trunk_bends,
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
Indices = NDArray[np.intp]


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


def rigid_pairs(scene: Scene) -> Indices:
    """``(S, 2)``: the bones that keep their angle to each other."""
    pairs, kinds = trunk_bends(scene)
    chosen: Indices = pairs[kinds == RIGID]
    return chosen


NO_PAIRS: Indices = np.zeros((0, 2), dtype=np.intp)


def differences(scene: Scene, rigid: Indices = NO_PAIRS) -> csc_array:
    """Give the matrix from flat positions to flat differences, (3T(E + S), 3TN).

    Of bones, then of the outer ends of the bones of a rigid pair.
    """
    n_frames, n_points, _ = scene.points.shape
    rows = np.concatenate([scene.bones, scene.bones[rigid, 1]])
    t, e, c = np.indices((n_frames, len(rows), 3)).reshape(3, -1)
    row = 3 * (t * len(rows) + e) + c
    ends = [3 * (t * n_points + rows[e, end]) + c for end in (0, 1)]
    ones = np.ones(len(row))
    values = np.concatenate([-ones, ones])
    indices = (np.tile(row, 2), np.concatenate(ends))
    return csc_array((values, indices), shape=(len(row), 3 * n_frames * n_points))


def difference_lengths(scene: Scene, scales: Array, rigid: Indices) -> Array:
    """``(T, E + S)``: the lengths of ``differences`` that a body shall have."""
    vectors = scene.bone_vectors * scales[:, None]
    first, second = rigid.T
    lengths: Array = np.linalg.norm(
        np.concatenate([vectors, vectors[:, second] - vectors[:, first]], axis=1), axis=-1
    )
    return lengths


def banded(
    scene: Scene,
    energy: QuadraticEnergy,
    scales: Array,
    rigid: Indices = NO_PAIRS,
    *,
    n_rounds: int = 40,
) -> Array:
    """Solve by an augmented Lagrangian of Gauss-Newton steps on a banded matrix, from the source.

    Bones grow to their lengths in five morphs, without which steps overshoot. Rigid parts keep the
    distances of their bones' ends.

    Returns
    -------
    (T, N, 3) metres, U
    """
    hessian, rhs, bones = matrix(energy), right_side(energy, scales), differences(scene, rigid)
    source = scene.points.reshape(-1)
    width = 9 * scene.points.shape[1] - 1
    displacement, stiffness = np.zeros(len(source)), 300.0
    multiplier = np.zeros(bones.shape[0] // 3)
    fractions = np.concatenate([np.linspace(0.2, 1, 5), np.ones(n_rounds - 5)])
    for fraction in fractions:
        wanted = difference_lengths(scene, 1 + fraction * (scales - 1), rigid).reshape(-1)
        vectors = (bones @ (source + displacement)).reshape(-1, 3)
        current_lengths = np.linalg.norm(vectors, axis=-1)
        error = current_lengths - wanted
        along = csc_array(_along(vectors / current_lengths[:, None])) @ bones
        full = hessian + stiffness * along.T @ along
        slope = hessian @ displacement - fraction * rhs + along.T @ (stiffness * error + multiplier)
        displacement -= solveh_banded(_bands(full, width), slope, lower=True)
        vectors = (bones @ (source + displacement)).reshape(-1, 3)
        multiplier += stiffness * (np.linalg.norm(vectors, axis=-1) - wanted)
    return displacement.reshape(scene.points.shape)


def manifold(
    scene: Scene,
    energy: QuadraticEnergy,
    scales: Array,
    rigid: Indices = NO_PAIRS,
    *,
    n_rounds: int = 12,
) -> Array:
    """Solve by Gauss-Newton on the rotations of bones and rigid parts, and places of the roots.

    The bones are of their length at every step. A step turns each bone, or all of a rigid part, by
    a rotation vector, with a ridge for the turn of a bone about itself; the sphere's own curvature
    joins the matrix of a bone alone where it helps it stay positive.

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
    owner, is_alone = _turning(scene, rigid)
    turns = _turn_columns(owner, n_frames)
    for _ in range(n_rounds):
        vectors = target_lengths * directions
        positions = spread @ np.concatenate([vectors.reshape(-1), roots_now])
        slope = spread.T @ (hessian @ (positions - source) - rhs)
        bone_forces = slope[:n_bone_rows].reshape(-1, 3)
        tangent = _blocks(_across(vectors), n_bone_rows, len(slope)) @ turns
        curvatures = np.maximum(-(bone_forces * vectors).sum(axis=1), 0) * np.tile(
            is_alone, n_frames
        )
        ridge = np.concatenate([np.repeat(curvatures, 3) + 1e-9, np.zeros(len(roots_now))])
        full = tangent.T @ (spread.T @ hessian @ spread) @ tangent
        full += turns.T @ diags_array(ridge) @ turns
        step = -splu(csc_array(full)).solve(tangent.T @ slope)
        of_bones = (turns @ step)[:n_bone_rows].reshape(-1, 3)
        directions = Rotation.from_rotvec(of_bones).apply(directions)
        roots_now = roots_now + step[-len(roots_now) :]
    positions = spread @ np.concatenate([(target_lengths * directions).reshape(-1), roots_now])
    displacement: Array = (positions - source).reshape(scene.points.shape)
    return displacement


def _turning(scene: Scene, rigid: Indices) -> tuple[Indices, NDArray[np.bool_]]:
    """``(E,)`` each: what each bone turns with, from 0, and whether it turns alone."""
    owner = np.arange(len(scene.bones))
    for first, second in rigid:
        owner[owner == owner[second]] = owner[first]
    _, owner, counts = np.unique(owner, return_inverse=True, return_counts=True)
    return owner, counts[owner] == 1


def _turn_columns(owner: Indices, n_frames: int) -> csc_array:
    """Give the matrix from flat turns, then roots, to flat turns of all bones, then roots."""
    n_bones, n_own, n_roots = len(owner), owner.max() + 1, 6 * n_frames
    t, e, c = np.indices((n_frames, n_bones, 3)).reshape(3, -1)
    last = np.arange(n_roots)
    rows = np.concatenate([3 * (t * n_bones + e) + c, 3 * n_frames * n_bones + last])
    columns = np.concatenate([3 * (t * n_own + owner[e]) + c, 3 * n_frames * n_own + last])
    shape = (3 * n_frames * n_bones + n_roots, 3 * n_frames * n_own + n_roots)
    return csc_array((np.ones(len(rows)), (rows, columns)), shape=shape)


def _across(vectors: Array) -> Array:
    """``(n, 3, 3)``: from a rotation vector to the change of each vector, ``w x v``."""
    x, y, z = vectors.T
    none = np.zeros_like(x)
    matrices: Array = np.array([[none, z, -y], [-z, none, x], [y, -x, none]])
    return matrices.transpose(2, 0, 1)


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


def _blocks(frames: Array, n_bone_rows: int, n_rows: int) -> csc_array:
    """Set 3 x 3 matrices on the diagonal; the roots' rows follow as they are."""
    b, i, j = np.indices(frames.shape).reshape(3, -1)
    roots = np.arange(n_bone_rows, n_rows)
    rows, columns = np.concatenate([3 * b + i, roots]), np.concatenate([3 * b + j, roots])
    values = np.concatenate([frames.reshape(-1), np.ones(len(roots))])
    return csc_array((values, (rows, columns)), shape=(n_rows, n_rows))
