"""The interaction mesh: who is tied to whom in each frame, and how strongly.

Laplacian coordinates after Ho, Komura and Tai (2010), *Spatial relationship preserving character
motion adaptation*; every pair of points between the two characters is joined, after section 1
of the supplement of Li et al. (2024).
"""

import numpy as np
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
    closeness = np.exp(-((_distances(scene.points) / weights.contact_reach) ** 4))
    closeness *= between(scene)
    shares = np.sqrt(closeness.sum(axis=-1).clip(min=1))
    ties: Array = weights.contact * closeness / (shares[:, :, None] * shares[:, None])
    return ties


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
    distances: Array = np.linalg.norm(points[:, :, None] - points[:, None], axis=-1)
    return distances
