"""Inverse kinematics of a tree of rigid joints: rotations that reach targets.

Bones that leave one joint keep their angles to each other, so that not every pose can be reached.
``aim_bones`` points bones at the targets, and ``inverse_kinematics`` spreads what is left over the
body by weighted least squares.

Positions leave the twist of a limb undetermined: see ``twist``.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from pacmo_core.data.interaction import Motion

Array = NDArray[np.float64]

# Weight that keeps a joint's present rotation, relative to squared bone length: it only determines
# what positions leave undetermined.
ROTATION_REGULARISATION = 1e-6
N_STEPS = 10
# Weight of each joint's squared turn in radians from its initial rotation, relative to the squared
# size of the skeleton. Positions alone hardly resist the kink of a spine, whose bones are short.
STIFFNESS = 2e-3
# Of a rotation, relative to the squared size of the skeleton: in the first step, at least, and the
# factors by which it changes after a step that was better, and one that was not.
DAMPING, LEAST_DAMPING, EASE, TIGHTEN = 1e-3, 1e-5, 0.25, 16.0
# Change of a frame's cost in a step, relative to the cost, below which the frame is solved.
LEAST_CHANGE = 1e-6
FRAMES_PER_BATCH = 128  # bounds memory

# Weights of targets near the other person or the ground, in addition to 1, and the distances in
# metres at which they have fallen to 1/e. They change smoothly with the motion: a step in a weight
# would cause a jerk.
CONTACT_WEIGHT, CONTACT_RANGE = 8.0, 0.15
GROUND_WEIGHT, GROUND_RANGE = 8.0, 0.12

# Bodies that are near are solved to the limit of contact, where an error of a millimetre in a file
# parts them: pairs within about CONTACT_BAND of the limit are aimed nearer by up to CONTACT_MARGIN.
CONTACT_DISTANCE = 0.1  # metres between joints of two people in contact
CONTACT_MARGIN, CONTACT_BAND = 0.006, 0.006  # metres


def proximity_weights(a: Motion, b: Motion) -> tuple[Array, Array]:
    """Weight joints near the other person or the ground: the squared error of each counts so often.

    ``w = 1 + 8 exp(-(d / 0.15 m)^2) + 8 exp(-(h / 0.12 m)^2)`` with d the distance to the nearest
    joint of the other person, and h the height above the ground.

    Parameters
    ----------
    a, b : (T, J, 3) float32, metres, y up; J may differ

    Returns
    -------
    (T, J) of a, and of b
    """
    ground = float(np.median(np.minimum(a[..., 1].min(axis=1), b[..., 1].min(axis=1))))
    return _proximity_weights(a, b, ground), _proximity_weights(b, a, ground)


def _proximity_weights(motion: Motion, other: Motion, ground: float) -> Array:
    # Joint by joint: all differences at once would take three times the memory of the distances.
    distances = np.stack(
        [np.linalg.norm(other - joint[:, None], axis=-1).min(axis=1)
         for joint in np.moveaxis(motion, 1, 0)],
        axis=1,
    )  # fmt: skip
    heights = motion[..., 1] - ground
    weights: Array = (
        1.0
        + CONTACT_WEIGHT * np.exp(-np.square(distances / CONTACT_RANGE))
        + GROUND_WEIGHT * np.exp(-np.square(heights / GROUND_RANGE))
    ).astype(np.float64)
    return weights


def contact_targets(a: Motion, b: Motion) -> tuple[Motion, Motion]:
    """Move joints at the limit of contact towards each other, as a margin for the error of a file.

    Each joint of a pair at distance d moves by half of
    ``0.006 m exp(-((d - 0.1 m) / 0.006 m)^2)``; of several pairs a joint moves by the weighted
    mean. Other joints stay. The shift changes smoothly with the motion.

    Parameters
    ----------
    a, b : (T, J, 3) float32, metres; J may differ

    Returns
    -------
    targets of a, and of b
    """
    shift_a, shift_b = np.zeros(a.shape), np.zeros(b.shape)
    total_b = np.zeros(b.shape[:2])
    for joint in range(a.shape[1]):
        away = b.astype(np.float64) - a[:, joint, None]
        distances = np.linalg.norm(away, axis=-1)
        weights = np.exp(-np.square((distances - CONTACT_DISTANCE) / CONTACT_BAND))
        half = (0.5 * CONTACT_MARGIN * weights / np.maximum(distances, CONTACT_BAND))[..., None]
        shift_a[:, joint] = (half * away).sum(axis=1) / np.maximum(1, weights.sum(axis=1))[:, None]
        shift_b -= half * away
        total_b += weights
    shift_b /= np.maximum(1, total_b)[..., None]
    return (a + shift_a).astype(np.float32), (b + shift_b).astype(np.float32)


def forward_kinematics(
    parents: Sequence[int], root: Array, offsets: Array, local: Array
) -> tuple[Array, Array]:
    """Compute joint positions (T, J, 3) and world rotations (T, J, 3, 3).

    Parameters
    ----------
    parents : each before its children
    root : (T, 3)
    offsets : (T, J, 3) from the parent, in the parent's frame
    local : (T, J, 3, 3), rotations against the parent
    """
    positions, rotations_world = np.zeros_like(offsets), np.zeros_like(local)
    positions[:, 0], rotations_world[:, 0] = root, local[:, 0]
    for joint, parent in enumerate(parents):
        if parent >= 0:
            positions[:, joint] = positions[:, parent] + rotate_vectors(
                rotations_world[:, parent], offsets[:, joint]
            )
            rotations_world[:, joint] = rotations_world[:, parent] @ local[:, joint]
    return positions, rotations_world


def aim_bones(
    parents: Sequence[int],
    targets: dict[int, Array],
    offsets: Array,
    local: Array,
) -> tuple[Array, Array]:
    """Rotate joints from the root outwards so that their bones point to the targets (Kabsch).

    Beyond a joint without a target, a bone points to the nearest joints that have one, as if all
    joints between were stiff. A root without a target is where these joints come nearest theirs.

    Parameters
    ----------
    targets : (T, 3) positions of some joints
    local : (T, J, 3, 3), which determine what positions leave undetermined

    Returns
    -------
    root : (T, 3)
    local : (T, J, 3, 3)
    """
    positions, rotations_world, solution = (
        np.zeros_like(offsets),
        np.zeros_like(local),
        np.zeros_like(local),
    )
    for joint, parent in enumerate(parents):
        parent_rotation = rotations_world[:, parent] if parent >= 0 else np.eye(3)[None]
        chains = _chains_to_targets(parents, targets, joint)
        rotations_world[:, joint] = parent_rotation @ local[:, joint]
        levers, ends = np.zeros((len(local), 0, 3)), np.zeros((len(local), 0, 3))
        if chains:
            levers = np.stack([_lever(chain, offsets, local) for chain in chains], axis=1)
            ends = np.stack([targets[chain[-1]] for chain in chains], axis=1)
        if parent >= 0:
            positions[:, joint] = positions[:, parent] + rotate_vectors(
                parent_rotation, offsets[:, joint]
            )
        elif joint in targets:
            positions[:, joint] = targets[joint]
        else:
            middle, end = levers.mean(axis=1), ends.mean(axis=1)
            rotations_world[:, joint] = _nearest_rotations(
                ends - end[:, None], levers - middle[:, None], local[:, joint]
            )
            positions[:, joint] = end - rotate_vectors(rotations_world[:, joint], middle)
        if chains:
            rotations_world[:, joint] = _nearest_rotations(
                ends - positions[:, joint, None], levers, rotations_world[:, joint]
            )
        solution[:, joint] = np.swapaxes(parent_rotation, -1, -2) @ rotations_world[:, joint]
    return positions[:, 0], solution


def _chains_to_targets(
    parents: Sequence[int], targets: Collection[int], joint: int
) -> list[tuple[int, ...]]:
    """List the joints on the way from a joint to each of the nearest below that have a target."""
    chains: list[tuple[int, ...]] = []
    for child in [c for c, parent in enumerate(parents) if parent == joint]:
        below = [()] if child in targets else _chains_to_targets(parents, targets, child)
        chains += [(child, *chain) for chain in below]
    return chains


def _lever(chain: Sequence[int], offsets: Array, local: Array) -> Array:
    """``(T, 3)``: from a joint to the end of a chain below it, in the joint's frame."""
    lever = offsets[:, chain[-1]]
    for joint in reversed(chain[:-1]):
        lever = offsets[:, joint] + rotate_vectors(local[:, joint], lever)
    return lever


@dataclass(frozen=True)
class PointTargets:
    """Where K points of the body shall be.

    Parameters
    ----------
    shares : (K, J) of each joint's position in each point's; a row sums to 1
    positions : (T, K, 3)
    weights : (T, K), of the squared distances
    stiffness : of joints, the weights of squared angles in radians from ``rest``
    rest : (J, 3, 3) local rotations, or (T, J, 3, 3) of each frame; those of joints without a
        stiffness are not used
    """

    shares: Array
    positions: Array
    weights: Array
    stiffness: Mapping[int, float] = field(default_factory=dict)
    rest: Array = field(default_factory=lambda: np.zeros((0, 3, 3)))

    def frames(self, part: slice | NDArray[np.intp]) -> "PointTargets":
        """Select frames."""
        rest = self.rest[part] if self.rest.ndim == np.ndim(self.positions) + 1 else self.rest
        return replace(self, positions=self.positions[part], weights=self.weights[part], rest=rest)

    def bends(self, local: Array) -> Array:
        """``(T, S, 3)`` radians: rotation vectors from ``rest`` of the joints with a stiffness."""
        joints = list(self.stiffness)
        turned = np.swapaxes(self.rest[..., joints, :, :], -1, -2) @ local[:, joints]
        bends: Array = Rotation.from_matrix(turned.reshape(-1, 3, 3)).as_rotvec()
        return bends.reshape(*turned.shape[:2], 3)

    def gaps(self, positions: Array) -> Array:
        """``(T, K, 3)``: from the points of a body whose joints are at (T, J, 3)."""
        gaps: Array = self.positions - self.shares @ positions
        return gaps

    def of_joints(self) -> dict[int, Array]:
        """``(T, 3)`` of each joint: where it is if all points are met, as far as points tell."""
        known: dict[int, Array] = {}
        for row in np.argsort((self.shares != 0).sum(axis=1), kind="stable"):
            parts = np.flatnonzero(self.shares[row]).tolist()
            unknown = [joint for joint in parts if joint not in known]
            if len(unknown) == 1:
                others = [self.shares[row, j] * known[j] for j in parts if j in known]
                rest = self.positions[:, row] - np.sum(others, axis=0)
                known[unknown[0]] = rest / self.shares[row, unknown[0]]
        return known


def inverse_kinematics(
    parents: Sequence[int],
    targets: dict[int, Array],
    weights: Array,
    offsets: Array,
    initial: tuple[Array, Array],
) -> tuple[Array, Array]:
    """Pose the tree by least squares of the weighted distances of joints to their targets.

    Joints are stiff: turns from the initial rotations cost a little.

    Parameters
    ----------
    targets : (T, 3) positions of K joints
    weights : (T, K), of the squared distances, in the order of ``targets``
    offsets, initial : as of ``reach_points``
    """
    shares = np.eye(len(parents))[list(targets)]
    positions = np.stack(list(targets.values()), axis=1)
    centred = positions - positions.mean(axis=1, keepdims=True)
    stiffness = STIFFNESS * float(np.square(centred).sum(axis=(1, 2)).mean())
    inner = sorted({a for joint in targets for a in ancestors(parents, joint)})
    points = PointTargets(
        shares, positions, weights, dict.fromkeys(inner, stiffness), rest=initial[1]
    )
    return reach_points(parents, points, offsets, initial)


def reach_points(
    parents: Sequence[int], targets: PointTargets, offsets: Array, initial: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Pose the tree by least squares of the weighted distances of points to their targets.

    Levenberg-Marquardt (Marquardt 1963), each frame with its own damping: where bones are shorter
    or longer than the targets want, plain Gauss-Newton steps may lead away from the targets.

    Parameters
    ----------
    targets : of the points
    offsets : (T, J, 3) from the parent, in the parent's frame
    initial : root and local rotations, as ``aim_bones`` gives them
    """
    root, local = initial[0].copy(), initial[1].copy()
    for first in range(0, len(root), FRAMES_PER_BATCH):
        frames = np.arange(first, min(first + FRAMES_PER_BATCH, len(root)))
        aims, bones, pose = targets.frames(frames), offsets[frames], (root[frames], local[frames])
        cost, damping = _cost(parents, aims, bones, pose), np.full(len(frames), DAMPING)
        for _ in range(N_STEPS):
            trial = _damped_step(parents, aims, bones, pose, damping)
            trial_cost = _cost(parents, aims, bones, trial)
            better = trial_cost < cost
            root[frames[better]], local[frames[better]] = trial[0][better], trial[1][better]
            # Frames that hardly change any more are left as they are.
            moves = np.abs(cost - trial_cost) > LEAST_CHANGE * cost
            damping = np.maximum(damping * np.where(better, EASE, TIGHTEN), LEAST_DAMPING)
            cost = np.minimum(cost, trial_cost)
            frames, cost, damping = frames[moves], cost[moves], damping[moves]
            if not len(frames):
                break
            aims, bones = aims.frames(np.flatnonzero(moves)), bones[moves]
            pose = root[frames], local[frames]
    return root, local


def steady_rotations(
    parents: Sequence[int], local: Array, joints: Collection[int], smoothing: float
) -> Array:
    """Filter the world rotations of some joints over time; all others keep theirs.

    Parameters
    ----------
    local : (T, J, 3, 3), rotations against the parent
    smoothing : frames, standard deviation of the Gaussian filter

    Returns
    -------
    (T, J, 3, 3) against the parent
    """
    _, world = forward_kinematics(
        parents, np.zeros((len(local), 3)), np.zeros((*local.shape[:2], 3)), local
    )
    steady = world.copy()
    for joint in joints:
        filtered = gaussian_filter1d(world[:, joint], smoothing, axis=0, mode="nearest")
        steady[:, joint] = _nearest_rotations(
            filtered.swapaxes(1, 2), np.broadcast_to(np.eye(3), filtered.shape), world[:, joint]
        )
    result = steady.copy()
    for joint, parent in enumerate(parents):
        if parent >= 0:
            result[:, joint] = steady[:, parent].swapaxes(1, 2) @ steady[:, joint]
    return result


def _cost(
    parents: Sequence[int], targets: PointTargets, offsets: Array, pose: tuple[Array, Array]
) -> Array:
    """``(T,)``: the weighted squared distances to the targets, and angles from the rest."""
    positions, _ = forward_kinematics(parents, pose[0], offsets, pose[1])
    squared = np.square(targets.gaps(positions)).sum(axis=-1)
    cost: Array = (targets.weights * squared).sum(axis=1)
    if targets.stiffness:
        weights = np.array(list(targets.stiffness.values()))
        cost += (weights * np.square(targets.bends(pose[1])).sum(axis=-1)).sum(axis=1)
    return cost


def rotate_vectors(frames: Array, vectors: Array) -> Array:
    """``(T, 3)``: vectors given in frames, in the world."""
    solution: Array = (frames @ vectors[..., None])[..., 0]
    return solution


def _damped_step(
    parents: Sequence[int],
    targets: PointTargets,
    offsets: Array,
    pose: tuple[Array, Array],
    damping: Array,
) -> tuple[Array, Array]:
    """Return the pose after a Gauss-Newton step; ``damping`` (T,) is of each frame's rotations."""
    root, local = pose
    positions, rotations_world = forward_kinematics(parents, root, offsets, local)
    inner = _inner_joints(parents, targets)
    normal, gradient = _normal_equations(parents, targets, positions, inner)
    scale = np.square(positions - positions.mean(axis=1, keepdims=True)).sum(axis=-1).mean(axis=1)
    diagonal = np.concatenate([np.zeros(3), np.ones(3 * len(inner))])
    normal += np.eye(len(diagonal)) * (damping * scale)[:, None, None] * diagonal
    bends = targets.bends(local) if targets.stiffness else np.zeros((len(root), 0, 3))
    for number, (joint, stiffness) in enumerate(targets.stiffness.items()):
        if joint in inner:
            # A small rotation in the world changes the rotation vector, in the joint's frame, by
            # itself: the angles from the rest are small.
            part = slice(3 + 3 * inner.index(joint), 6 + 3 * inner.index(joint))
            normal[:, part, part] += stiffness * np.eye(3)
            gradient[:, part] -= stiffness * rotate_vectors(
                rotations_world[:, joint], bends[:, number]
            )
    solution: Array = np.linalg.solve(normal, gradient[..., None])[..., 0].astype(np.float64)
    moved, turned = root + solution[:, :3], local.copy()
    rotation = rotation_matrices(solution[:, 3:].reshape(-1, 3)).reshape(len(root), -1, 3, 3)
    # Turned in the world: against the parent, whose rotation is that of the joint without its own.
    world = rotations_world[:, inner]
    turned[:, inner] = local[:, inner] @ world.swapaxes(-1, -2) @ rotation @ world
    return moved, turned


def ancestors(parents: Sequence[int], joint: int) -> list[int]:
    """List the joints above a joint, the nearest first."""
    above = []
    while (joint := parents[joint]) >= 0:
        above.append(joint)
    return above


def _inner_joints(parents: Sequence[int], targets: PointTargets) -> list[int]:
    """List the I joints whose rotations move a point."""
    rows = np.flatnonzero(targets.shares.any(axis=0)).tolist()
    return sorted({a for joint in rows for a in ancestors(parents, joint)})


def _normal_equations(
    parents: Sequence[int], targets: PointTargets, positions: Array, inner: list[int]
) -> tuple[Array, Array]:
    """Return the normal matrix and the gradient of the points, by the root and by rotations.

    A small rotation ``w`` of an inner joint moves a point by ``w x c``, with the lever ``c`` of the
    part of the point below the joint. Of two joints with levers ``a`` and ``b`` the block is the
    weighted sum of ``(a b) I - b a^T``, so that products of levers are all that is needed.

    Returns
    -------
    (T, 3 + 3 I, 3 + 3 I) and (T, 3 + 3 I)
    """
    n_frames, size = len(positions), len(inner)
    below = np.zeros((size, len(parents)))
    for joint in range(len(parents)):
        below[[inner.index(a) for a in ancestors(parents, joint) if a in inner], joint] = 1
    parts = targets.shares[:, None] * below
    n_points = len(parts)
    levers = positions.swapaxes(1, 2) @ parts.reshape(n_points * size, -1).T
    levers = levers.reshape(n_frames, 3, n_points, size)
    levers -= parts.sum(axis=-1) * positions[:, inner].transpose(0, 2, 1)[:, :, None]
    # (T, K, 3 I): rows are points, columns first by axis.
    levers = levers.transpose(0, 2, 1, 3).reshape(n_frames, n_points, 3 * size)
    transposed = (targets.weights[..., None] * levers).swapaxes(1, 2)
    products = (transposed @ levers).reshape(n_frames, 3, size, 3, size)
    normal = np.zeros((n_frames, 1 + size, 3, 1 + size, 3))
    normal[:, 1:, :, 1:] = -products.transpose(0, 2, 3, 4, 1)
    for axis in range(3):
        normal[:, 1:, axis, 1:, axis] += products[:, [0, 1, 2], :, [0, 1, 2]].sum(axis=0)
    normal[:, 0, :, 0] = targets.weights.sum(axis=1)[:, None, None] * np.eye(3)
    summed = transposed.sum(axis=2).reshape(n_frames, 3, size).swapaxes(1, 2)
    to_root = -_cross(summed.reshape(-1, 3)).reshape(n_frames, size, 3, 3)
    normal[:, 0, :, 1:] = to_root.transpose(0, 2, 1, 3)
    normal[:, 1:, :, 0] = to_root.transpose(0, 1, 3, 2)
    gaps = targets.gaps(positions)
    moments = (transposed @ gaps).reshape(n_frames, 3, size, 3)
    gradient = np.zeros((n_frames, 1 + size, 3))
    gradient[:, 0] = (targets.weights[..., None] * gaps).sum(axis=1)
    for axis in range(3):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        gradient[:, 1:, axis] = moments[:, i, :, j] - moments[:, j, :, i]
    width = 3 * (1 + size)
    return normal.reshape(n_frames, width, width), gradient.reshape(n_frames, width)


def _cross(vectors: Array) -> Array:
    """``(T, 3, 3)``: the matrix that multiplies by a vector's cross product."""
    x, y, z = vectors.T
    none = np.zeros_like(x)
    return np.array([[none, -z, y], [z, none, -x], [-y, x, none]]).transpose(2, 0, 1)


def rotation_matrices(vectors: Array) -> Array:
    """``(T, 3, 3)``: the rotation about each vector by its length in radians (Rodrigues)."""
    angle = np.linalg.norm(vectors, axis=-1)[:, None, None]
    cross = _cross(vectors / np.maximum(angle[:, 0], np.finfo(np.float64).tiny))
    rotations_world: Array = (
        np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross)
    )
    return rotations_world


def _nearest_rotations(directions: Array, offsets: Array, fallback: Array) -> Array:
    """``(T, 3, 3)``: rotate offsets nearest to directions, both (T, n, 3) (Kabsch).

    What they leave undetermined is that of ``fallback``.
    """
    scale = np.maximum(np.square(offsets).sum(axis=(1, 2)), np.finfo(np.float64).tiny)
    covariance = directions.swapaxes(1, 2) @ offsets / scale[:, None, None]
    u, _, right = np.linalg.svd(covariance + ROTATION_REGULARISATION * fallback)
    u[..., -1] *= np.linalg.det(u @ right)[:, None]
    nearest: Array = u @ right
    return nearest
