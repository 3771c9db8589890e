"""The energy whose least value, among motions with the new bones, is the variation.

With U the change of the joints' positions against the source,

    E(U) = 1/2 sum_t |L_t U_t - r_t|^2                                  the mesh keeps its shape
         + 1/2 shape sum_t sum_trunk |d_i - mean d|^2                   and so do trunks
         + 1/2 acceleration sum_t |U_t+1 - 2 U_t + U_t-1|^2             the change is smooth
         + 1/2 sum_t sum_pairs w_ij |U_i - U_j|^2                       what touches stays together
         + 1/2 stance sum_t h_t h_t-1 |U_t - U_t-1|^2                   what stands stays in place
         + 1/2 height sum_t h_t U_y^2                                   and on the ground
         + 1/2 anchor |U|^2

where r_t is what L does to the source when each bone is scaled alone and all else stays, d is U
less what scaling the trunk's bones where they point would do, w_ij are the ties of contact, and h_t
is 1 where a joint stands and fades around that.

Unlike Ho, Komura and Tai (2010), which penalises the acceleration of the motion, this penalises
that of the change: the source's own dynamics are free.

Inside the room, arrays of many bodies have them last: (T, N, 3, V), so that a matrix a frame meets
all directions and bodies at once.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from math import prod

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import Delaunay

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.interaction_mesh.linear_algebra import batched_product
from pacmo_core.interaction_mesh.scene import Array, Real, Scene
from pacmo_core.interaction_mesh.settings import Settings, Support, Weights

# The rate for which weights are stated.
REFERENCE_FPS = 30.0


@dataclass(frozen=True)
class QuadraticEnergy:
    """E as matrices: ``E(U) = 1/2 <U, H U> - <U, g> + 1/2 |r|^2``.

    Parameters
    ----------
    laplacians : (T, N + M, N), L, and below it the M joints of trunks beside their trunk's middle
    pulls : (3T(N + M), E), metres; what a bone of twice its length adds to r, and below to d
    standing : (T, N), which joints stand
    held : (T, N), h
    ties : (T, N, N), contact between joints
    acceleration, stance, height : weights at this scene's rate
    anchor : weight
    """

    laplacians: Array
    pulls: csr_array
    standing: NDArray[np.bool_]
    held: Array
    ties: Array
    acceleration: float
    stance: float
    stance_height: float
    regularisation: float

    @property
    def steps_held(self) -> Array:
        """``(T - 1, N)``: by how much either end of a step is held."""
        steps: Array = self.held[1:] * self.held[:-1]
        return steps

    def part(self, frames: slice) -> "QuadraticEnergy":
        """Take some frames, as if there were no others; fewer a second, if ``frames`` leaps."""
        leap = frames.step or 1
        size = len(self.laplacians)
        rows = np.arange(self.pulls.shape[0]).reshape(size, -1)[frames].reshape(-1)
        return replace(
            self,
            laplacians=self.laplacians[frames],
            pulls=self.pulls[rows],
            standing=self.standing[frames],
            held=self.held[frames],
            ties=self.ties[frames],
            acceleration=self.acceleration / leap**4,
            stance=self.stance / leap**2,
        )

    @cached_property
    def inside(self) -> Array:
        """``(T, N, N)``: ``within`` each frame."""
        return self.within(slice(None))

    def within(self, frames: slice) -> Array:
        """``(F, N, N)``: what H has within each of some frames from L, contact and anchor."""
        laplacians, ties = self.laplacians[frames], self.ties[frames]
        inside: Array = laplacians.transpose(0, 2, 1) @ laplacians - ties
        everyone = np.arange(ties.shape[1])
        inside[:, everyone, everyone] += ties.sum(axis=-1) + self.regularisation
        return inside


def build_energy(scene: Scene, settings: Settings) -> QuadraticEnergy:
    """Take the matrices of a source; they do not depend on the bodies that are wanted."""
    weights, rate = settings.weights, scene.fps / REFERENCE_FPS
    laplacians = laplacian_matrices(scene, weights, settings.graph)
    beside, stretched = trunk_shape_matrices(scene, weights.trunk_shape)
    trunks = np.broadcast_to(beside, (len(laplacians), *beside.shape))
    standing = support_contacts(scene, settings.support)
    return QuadraticEnergy(
        laplacians=np.concatenate([laplacians, trunks], axis=1),
        pulls=target_matrix(scene, laplacians, stretched),
        standing=standing,
        held=support_weights(standing, scene.fps, settings.support.fade_time),
        ties=contact_weights(scene, weights),
        acceleration=weights.acceleration * rate**4,
        stance=weights.stance * rate**2,
        stance_height=weights.stance_height,
        regularisation=weights.regularisation,
    )


def energy_terms(energy: QuadraticEnergy, change: Real, target: Real) -> dict[str, Array]:
    """Say what each term of the energy is, (V,) each; summed in float64 whatever is given.

    Parameters
    ----------
    change : (T, N, 3, V) metres, U
    target : (T, N + M, 3, V) metres, r, and below it what scaling the bones would do to trunks
    """
    kind, n_points = change.dtype, change.shape[1]
    rows = change.reshape(*change.shape[:2], -1)
    steps = np.diff(change, axis=0)
    missed = batched_product(energy.laplacians.astype(kind, copy=False), rows)
    missed -= target.reshape(missed.shape)
    springs = energy.ties.sum(axis=-1)[..., None].astype(kind) * rows
    springs -= batched_product(energy.ties.astype(kind, copy=False), rows)
    lifted = change[:, :, 1] * np.sqrt(energy.held)[..., None].astype(kind, copy=False)
    held = np.sqrt(energy.steps_held)[..., None, None].astype(kind, copy=False)
    return {
        "laplacian": _half_sum(missed[:, :n_points], change),
        "trunk_shape": _half_sum(missed[:, n_points:], change),
        "acceleration": energy.acceleration * _half_sum(np.diff(steps, axis=0), change),
        "contact": _half_sum(springs, change, rows),
        "stance": energy.stance * _half_sum(steps * held, change),
        "stance_height": energy.stance_height * _half_sum(lifted, change),
        "regularisation": energy.regularisation * _half_sum(change, change),
    }


def hessian_product(energy: QuadraticEnergy, change: Real) -> Real:
    """``H U``, (T, N, 3, V), of changes (T, N, 3, V)."""
    kind, rows = change.dtype, change.reshape(*change.shape[:2], -1)
    found = batched_product(energy.inside.astype(kind, copy=False), rows).reshape(change.shape)
    found[:, :, 1] += (energy.stance_height * energy.held[..., None]).astype(kind) * change[:, :, 1]
    steps = np.diff(change, axis=0)
    bends = energy.acceleration * np.diff(steps, axis=0)
    steps *= (energy.stance * energy.steps_held[..., None, None]).astype(kind)
    # The transposes of differences, in the order of time.
    found[1:] += steps
    found[:-1] -= steps
    for shift, weight in enumerate((1, -2, 1)):
        found[shift : len(bends) + shift] += weight * bends
    return found


def energy_target(energy: QuadraticEnergy, scales: Array) -> Array:
    """``(T, N + M, 3, V)`` metres: r for each body, and below it the same for trunks.

    Parameters
    ----------
    scales : (V, E)
    """
    target: Array = energy.pulls @ np.ascontiguousarray(scales.T - 1)
    return target.reshape(*energy.laplacians.shape[:2], 3, -1)


def _half_sum(values: Real, like: Real, others: Real | None = None) -> Array:
    """Sum squares, or products with ``others``, of all but the last axis of ``like``; halve."""
    # In full: motions of one or two frames have no accelerations to tell a -1 from.
    shape = (len(values), prod(values.shape[1:]) // like.shape[-1], like.shape[-1])
    rows = values.reshape(shape)
    beside = rows if others is None else others.reshape(shape)
    half: Array = np.einsum("trv,trv->tv", rows, beside).sum(axis=0, dtype=np.float64) / 2
    return half


# FROM """The interaction mesh: who is tied to whom in each frame, and how strongly.
# FROM
# FROM Laplacian coordinates after Ho, Komura and Tai (2010), *Spatial relationship preserving character
# FROM motion adaptation*; every pair of points between the two characters is joined, after section 1
# FROM of the supplement of Li et al. (2024).
# FROM """
def laplacian_matrices(scene: Scene, weights: Weights, graph: str) -> Array:
    """``(T, N, N)``: L with ``(L p)_i = p_i - sum_j w_ij p_j``; each row of w sums to one.

    Weights fall with the distance in the source: ``w_ij ~ 1 / (d_ij + softening) ** power``.
    """
    ties = (
        1
        / (_joint_distances(scene.points) + weights.distance_softening) ** weights.distance_exponent
    )
    ties *= complete_graph(scene) if graph == "complete" else delaunay_graph(scene)
    ties /= ties.sum(axis=-1, keepdims=True)
    laplacians: Array = np.eye(ties.shape[-1]) - ties
    return laplacians


def contact_weights(scene: Scene, weights: Weights) -> Array:
    """``(T, N, N)`` symmetric: what falls as ``exp(-(d / reach)^4)`` between the bodies.

    A joint that touches many shares its weight among them, ``w_ij = c_ij / sqrt(s_i s_j)`` with
    ``s_i`` the larger of 1 and the sum of ``c_ij``: a hand of many joints holds no harder than one.
    """
    closeness = np.exp(
        -np.square(np.square(_joint_distances(scene.points) / weights.contact_range))
    )
    closeness *= inter_body_mask(scene)
    shares = np.sqrt(closeness.sum(axis=-1).clip(min=1))
    ties: Array = weights.contact * closeness / (shares[:, :, None] * shares[:, None])
    return ties


def target_matrix(scene: Scene, laplacians: Array, stretched: Array) -> csr_array:
    """Scale one bone: each of its ends sees the other farther away, by that share of the bone."""
    parent, child = scene.bones.T
    n_frames, n_points, _ = scene.points.shape
    pulls = np.zeros((n_frames, n_points + len(stretched), len(parent)))
    bones = np.arange(len(parent))
    pulls[:, parent, bones] += laplacians[:, parent, child]
    pulls[:, child, bones] -= laplacians[:, child, parent]
    pulls[:, n_points:] = stretched
    frame, row, bone = np.nonzero(pulls)
    values = pulls[frame, row, bone, None] * scene.vectors[frame, bone]
    rows = 3 * (frame * pulls.shape[1] + row)[:, None] + np.arange(3)
    where = (rows.reshape(-1), np.repeat(bone, 3))
    return csr_array((values.reshape(-1), where), shape=(pulls[..., 0].size * 3, len(parent)))


def inter_body_mask(scene: Scene) -> Array:
    """``(N, N)`` ones where the two joints are of different bodies."""
    owner = np.repeat([0, 1], scene.n_joints)
    apart: Array = (owner[:, None] != owner).astype(np.float64)
    return apart


def complete_graph(scene: Scene) -> Array:
    """``(N, N)`` ones along bones and between the bodies."""
    edges = inter_body_mask(scene)
    parent, child = scene.bones.T
    edges[parent, child] = edges[child, parent] = 1
    return edges


def delaunay_graph(scene: Scene) -> Array:
    """``(T, N, N)`` ones along bones and the edges of each frame's Delaunay tetrahedra."""
    edges = np.zeros((*scene.points.shape[:2], scene.points.shape[1]))
    for frame, pose in zip(edges, scene.points, strict=True):
        cells = Delaunay(pose).simplices
        frame[cells[:, :, None], cells[:, None]] = 1
    parent, child = scene.bones.T
    edges[:, parent, child] = edges[:, child, parent] = 1
    everyone = np.arange(edges.shape[1])
    edges[:, everyone, everyone] = 0
    return edges


def _joint_distances(points: Array) -> Array:
    squares = np.zeros((len(points), points.shape[1], points.shape[1]))
    for axis in range(3):
        squares += np.square(points[:, :, None, axis] - points[:, None, :, axis])
    distances: Array = np.sqrt(squares, out=squares)
    return distances


# FROM """Which joints stand on the ground, and when: feet, and hands and knees where they bear weight."""
# Share of a joint's heights below the level that is taken for its lowest: noise, not level.
LOWEST_QUANTILE = 0.05


def support_contacts(scene: Scene, support: Support) -> NDArray[np.bool_]:
    """``(T, N)``: whether a joint is low, near the ground, and still."""
    heights = scene.points[..., 1]
    level = np.quantile(heights, LOWEST_QUANTILE, axis=0)
    low = (heights < level + support.height_tolerance) & (level < scene.ground + support.max_height)
    return low & (_joint_speeds(scene) < support.max_speed)


def support_weights(standing: NDArray[np.bool_], fps: float, fade: float) -> NDArray[np.float64]:
    """``(T, N)``: 1 where a joint stands; before and after that ``exp(-(seconds / fade)^2)``."""
    held = standing.astype(np.float64)
    for shift in range(1, min(len(held), int(3 * fade * fps) + 1)):
        share = np.exp(-((shift / fps / fade) ** 2))
        held[shift:] = np.maximum(held[shift:], share * standing[:-shift])
        held[:-shift] = np.maximum(held[:-shift], share * standing[shift:])
    return held


def support_steps(standing: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """``(T - 1, N)``: whether a joint stands at both ends of a step."""
    return standing[1:] & standing[:-1]


def _joint_speeds(scene: Scene) -> NDArray[np.float64]:
    """``(T, N)`` metres a second; the slower of the steps before and after."""
    paths = np.linalg.norm(np.diff(scene.points, axis=0), axis=-1) * scene.fps
    if not len(paths):
        return np.zeros(scene.points.shape[:2])
    before = np.concatenate([paths[:1], paths])
    after = np.concatenate([paths, paths[-1:]])
    slower: NDArray[np.float64] = np.minimum(before, after)
    return slower


# FROM """Elbows and knees, and whether they still bend the way they did."""
# A limb this straight, by the sine of its bend, has no side to which it bends.
MIN_BEND_SINE = 0.25


def hinge_joints(scene: Scene) -> NDArray[np.intp]:
    """``(H, 3)`` points (parent, hinge, child): the middle of every arm and leg of both bodies.

    Names differ from set to set, so limbs are found by shape: what hangs on a joint that has a
    mirror image, where its parent has none. The hinge lies between the limb's two long bones.
    """
    lengths = np.linalg.norm(scene.vectors, axis=-1).mean(axis=0)
    found, first_joint, first_bone = [], 0, 0
    for skeleton in scene.skeletons:
        own = lengths[first_bone : first_bone + len(skeleton.bones)]
        found += [first_joint + hinge for hinge in _hinges_of_body(skeleton, own)]
        first_joint += len(skeleton.joints)
        first_bone += len(skeleton.bones)
    return np.array(found, dtype=np.intp).reshape(-1, 3)


def bend_flip_fraction(scene: Scene, points: Array) -> Array:
    """``(V,)``: of frames in which a hinge is bent before and after, those where it bends back.

    Parameters
    ----------
    points : (T, N, 3, V) metres
    """
    chain = hinge_joints(scene)
    if not len(chain):
        return np.zeros(points.shape[-1])
    before, was_bent = _bend_normals(scene.points[..., None], chain)
    after, is_bent = _bend_normals(points, chain)
    back = was_bent & is_bent & ((before * after).sum(axis=2) < 0)
    share: Array = back.any(axis=1).mean(axis=0)
    return share


def _hinges_of_body(skeleton: Skeleton, lengths: Array) -> list[NDArray[np.intp]]:
    parents, mirrored = skeleton.parents, {i for pair in skeleton.left_right for i in pair}
    length = dict(zip(skeleton.bones[:, 1].tolist(), lengths.tolist(), strict=True))
    found: dict[int, tuple[float, list[int]]] = {}
    limb_of: dict[int, int] = {}
    for joint in skeleton.order[1:]:
        parent = parents[joint]
        if joint in mirrored:
            limb_of[joint] = limb_of.get(parent, joint)
        if parent in limb_of and joint in limb_of:
            limb = limb_of[joint]
            shorter = min(length[parent], length[joint])
            if limb not in found or shorter > found[limb][0]:
                found[limb] = (shorter, [parents[parent], parent, joint])
    return [np.array(chain, dtype=np.intp) for _, chain in found.values()]


def _bend_normals(points: Array, chain: NDArray[np.intp]) -> tuple[Array, NDArray[np.bool_]]:
    """Give the normal of the plane in which each hinge bends, and whether it bends at all."""
    first, middle, last = (points[:, chain[:, end]] for end in range(3))
    upper, lower = middle - first, last - middle
    normal = np.cross(upper, lower, axis=2)
    lengths = (np.linalg.norm(part, axis=2) for part in (upper, lower, normal))
    long, other, bent = lengths
    return normal, bent > MIN_BEND_SINE * long * other


# FROM """Trunks: what a body must not fold to make room.
# FROM
# FROM Bones that leave one joint turn freely against each other, and a mesh that wants a smaller body as
# FROM high as the larger one was would fold hips and shoulders together. So the trunk's joints are held
# FROM to the places that the trunk has when its bones are scaled where they point, wherever the trunk as a
# FROM whole goes.
# FROM """
def trunk_joints(scene: Scene) -> list[NDArray[np.intp]]:
    """List the points of each body from its root to where its limbs begin; no limbs, no trunk."""
    parent_of = {child: parent for parent, child in scene.bones.tolist()}
    found: tuple[set[int], set[int]] = (set(), set())
    for start, _, _ in hinge_joints(scene).tolist():
        joint, trunk = start, found[int(start >= scene.n_joints[0])]
        trunk.add(joint)
        while joint in parent_of:
            joint = parent_of[joint]
            trunk.add(joint)
    return [np.array(sorted(trunk), dtype=np.intp) for trunk in found]


def trunk_shape_matrices(scene: Scene, weight: float) -> tuple[Array, Array]:
    """Give what each joint of a trunk does beside its trunk's middle, times the weight's root.

    Returns
    -------
    ``(M, N)``, from points; and ``(M, E)``, from the bones of a trunk scaled where they point
    """
    everyone, blocks = np.eye(scene.points.shape[1]), []
    for joints in trunk_joints(scene):
        rows = everyone[joints]
        blocks.append(rows - rows.mean(axis=0) if len(joints) else rows)
    beside: Array = np.sqrt(weight) * np.concatenate(blocks)
    return beside, beside @ ancestor_bones(scene)


def ancestor_bones(scene: Scene) -> Array:
    """``(N, E)``: ones where a bone lies between a point and its body's root."""
    bone_of = {child: (row, parent) for row, (parent, child) in enumerate(scene.bones.tolist())}
    found = np.zeros((scene.points.shape[1], len(scene.bones)))
    for point in range(len(found)):
        joint = point
        while joint in bone_of:
            row, joint = bone_of[joint]
            found[point, row] = 1
    return found
