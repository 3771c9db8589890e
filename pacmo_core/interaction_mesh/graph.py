"""The interaction mesh: who is tied to whom in each frame, and how strongly.

Laplacian coordinates after Ho, Komura and Tai (2010), *Spatial relationship preserving character
motion adaptation*; every pair of points between the two characters is joined, after section 1
of the supplement of Li et al. (2024).
"""

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import Delaunay

from pacmo_core.interaction_mesh.scene import Array, Scene
from pacmo_core.interaction_mesh.settings import Weights


def laplacian(scene: Scene, weights: Weights, graph: str) -> Array:
    """``(T, N, N)``: L with ``(L p)_i = p_i - sum_j w_ij p_j``; each row of w sums to one.

    Weights fall with the distance in the source: ``w_ij ~ 1 / (d_ij + softening) ** power``.
    """
    ties = 1 / (_distances(scene.points) + weights.softening) ** weights.power
    ties *= complete(scene) if graph == "complete" else tetrahedra(scene)
    ties /= ties.sum(axis=-1, keepdims=True)
    laplacians: Array = np.eye(ties.shape[-1]) - ties
    return laplacians


def contact_ties(scene: Scene, weights: Weights) -> Array:
    """``(T, N, N)`` symmetric: what falls as ``exp(-(d / reach)^4)`` between the bodies.

    A joint that touches many shares its weight among them, ``w_ij = c_ij / sqrt(s_i s_j)`` with
    ``s_i`` the larger of 1 and the sum of ``c_ij``: a hand of many joints holds no harder than one.
    """
    closeness = np.exp(-np.square(np.square(_distances(scene.points) / weights.contact_reach)))
    closeness *= between(scene)
    shares = np.sqrt(closeness.sum(axis=-1).clip(min=1))
    ties: Array = weights.contact * closeness / (shares[:, :, None] * shares[:, None])
    return ties


def pulls_of(scene: Scene, laplacians: Array, stretched: Array) -> csr_array:
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


def between(scene: Scene) -> Array:
    """``(N, N)`` ones where the two joints are of different bodies."""
    owner = np.repeat([0, 1], scene.n_joints)
    apart: Array = (owner[:, None] != owner).astype(np.float64)
    return apart


def complete(scene: Scene) -> Array:
    """``(N, N)`` ones along bones and between the bodies."""
    edges = between(scene)
    parent, child = scene.bones.T
    edges[parent, child] = edges[child, parent] = 1
    return edges


def tetrahedra(scene: Scene) -> Array:
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


def _distances(points: Array) -> Array:
    squares = np.zeros((len(points), points.shape[1], points.shape[1]))
    for axis in range(3):
        squares += np.square(points[:, :, None, axis] - points[:, None, :, axis])
    distances: Array = np.sqrt(squares, out=squares)
    return distances
