"""The energy whose least value, among motions with the new bones, is the variation.

With U the change of the joints' positions against the source,

    E(U) = 1/2 sum_t |L_t U_t - r_t|^2                                  the mesh keeps its shape
         + 1/2 acceleration sum_t |U_t+1 - 2 U_t + U_t-1|^2             the change is smooth
         + 1/2 sum_t sum_pairs contact exp(-(d / reach)^2) |U_i - U_j|^2
         + 1/2 stance sum over steps that stand |U_t - U_t-1|^2
         + 1/2 height sum over joints that stand U_y^2
         + 1/2 anchor |U|^2

where r_t is what L does to the source when each bone is scaled alone and all else stays.

Unlike Ho, Komura and Tai (2010), which penalises the acceleration of the motion, this penalises
that of the change: the source's own dynamics are free.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.interaction_mesh.graph import contact_ties, laplacian
from pacmo_core.interaction_mesh.scene import Array, Scene
from pacmo_core.interaction_mesh.settings import Settings
from pacmo_core.interaction_mesh.supports import steps_of, supports

# The rate for which weights are stated.
FPS = 30.0


@dataclass(frozen=True)
class Quadratic:
    """E as matrices: ``E(U) = 1/2 <U, H U> - <U, g> + 1/2 |r|^2``.

    Parameters
    ----------
    laplacians : (T, N, N), L
    within : (T, N, N), what H has within a frame from L, contact and anchor
    pulls : (2, T, E, 3), metres; what a bone of twice its length adds to r at parent and child
    ends : (2, N, E), ones where a point is the bone's parent, and its child
    standing : (T, N), which joints stand
    acceleration, stance, height : weights at this scene's rate
    ties : (T, N, N), contact between joints
    anchor : weight
    """

    laplacians: Array
    within: Array
    pulls: Array
    ends: Array
    standing: NDArray[np.bool_]
    ties: Array
    acceleration: float
    stance: float
    height: float
    anchor: float


def quadratic(scene: Scene, settings: Settings) -> Quadratic:
    """Take the matrices of a source; they do not depend on the bodies that are wanted."""
    weights, rate = settings.weights, scene.fps / FPS
    laplacians = laplacian(scene, weights, settings.graph)
    ties = contact_ties(scene, weights)
    n_points = scene.points.shape[1]
    springs = ties.sum(axis=-1)[..., None] * np.eye(n_points) - ties
    return Quadratic(
        laplacians=laplacians,
        within=laplacians.transpose(0, 2, 1) @ laplacians
        + springs
        + weights.anchor * np.eye(n_points),
        pulls=_pulls(scene, laplacians),
        ends=(scene.bones.T[:, None] == np.arange(n_points)[:, None]).astype(np.float64),
        standing=supports(scene, settings.support),
        ties=ties,
        acceleration=weights.acceleration * rate**4,
        stance=weights.stance * rate**2,
        height=weights.height,
        anchor=weights.anchor,
    )


def energy_terms(energy: Quadratic, change: Array, target: Array) -> dict[str, Array]:
    """Say what each term of the energy is, (V,) each.

    Parameters
    ----------
    change : (V, T, N, 3) metres, U
    target : (V, T, N, 3) metres, r
    """
    steps = np.diff(change, axis=1)
    stands = steps_of(energy.standing)[..., None]
    squares = np.square(change)
    springs = (energy.ties.sum(axis=-1)[..., None] * squares).sum(axis=(1, 2, 3)) - (
        change * (energy.ties @ change)
    ).sum(axis=(1, 2, 3))
    height = (squares[..., 1] * energy.standing).sum(axis=(1, 2))
    return {
        "laplacian": _half(np.square(energy.laplacians @ change - target)),
        "acceleration": energy.acceleration * _half(np.square(np.diff(steps, axis=1))),
        "contact": springs / 2,
        "stance": energy.stance * _half(np.square(steps) * stands),
        "height": energy.height * height / 2,
        "anchor": energy.anchor * _half(squares),
    }


def target_of(energy: Quadratic, scales: Array) -> Array:
    """``(V, T, N, 3)`` metres: r for each body.

    Parameters
    ----------
    scales : (V, E)
    """
    at_parent, at_child = energy.pulls[:, None] * (scales - 1)[:, None, :, None]
    target: Array = energy.ends[0] @ at_parent + energy.ends[1] @ at_child
    return target


def _pulls(scene: Scene, laplacians: Array) -> Array:
    """Scale one bone: each of its ends sees the other farther away, by that share of the bone."""
    parent, child = scene.bones.T
    forth = laplacians[:, parent, child, None] * scene.vectors
    back = -laplacians[:, child, parent, None] * scene.vectors
    return np.stack([forth, back])


def _half(squares: Array) -> Array:
    half: Array = squares.sum(axis=(1, 2, 3)) / 2
    return half
