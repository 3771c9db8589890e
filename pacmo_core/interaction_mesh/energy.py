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

from pacmo_core.interaction_mesh.graph import contact_ties, laplacian, pulls_of
from pacmo_core.interaction_mesh.products import product
from pacmo_core.interaction_mesh.scene import Array, Real, Scene
from pacmo_core.interaction_mesh.settings import Settings
from pacmo_core.interaction_mesh.supports import holds, supports
from pacmo_core.interaction_mesh.trunk import shape_rows

# The rate for which weights are stated.
FPS = 30.0


@dataclass(frozen=True)
class Quadratic:
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
    height: float
    anchor: float

    @property
    def steps_held(self) -> Array:
        """``(T - 1, N)``: by how much either end of a step is held."""
        steps: Array = self.held[1:] * self.held[:-1]
        return steps

    def part(self, frames: slice) -> "Quadratic":
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
        inside[:, everyone, everyone] += ties.sum(axis=-1) + self.anchor
        return inside


def quadratic(scene: Scene, settings: Settings) -> Quadratic:
    """Take the matrices of a source; they do not depend on the bodies that are wanted."""
    weights, rate = settings.weights, scene.fps / FPS
    laplacians = laplacian(scene, weights, settings.graph)
    beside, stretched = shape_rows(scene, weights.shape)
    trunks = np.broadcast_to(beside, (len(laplacians), *beside.shape))
    standing = supports(scene, settings.support)
    return Quadratic(
        laplacians=np.concatenate([laplacians, trunks], axis=1),
        pulls=pulls_of(scene, laplacians, stretched),
        standing=standing,
        held=holds(standing, scene.fps, settings.support.fade),
        ties=contact_ties(scene, weights),
        acceleration=weights.acceleration * rate**4,
        stance=weights.stance * rate**2,
        height=weights.height,
        anchor=weights.anchor,
    )


def energy_terms(energy: Quadratic, change: Real, target: Real) -> dict[str, Array]:
    """Say what each term of the energy is, (V,) each; summed in float64 whatever is given.

    Parameters
    ----------
    change : (T, N, 3, V) metres, U
    target : (T, N + M, 3, V) metres, r, and below it what scaling the bones would do to trunks
    """
    kind, n_points = change.dtype, change.shape[1]
    rows = change.reshape(*change.shape[:2], -1)
    steps = np.diff(change, axis=0)
    missed = product(energy.laplacians.astype(kind, copy=False), rows)
    missed -= target.reshape(missed.shape)
    springs = energy.ties.sum(axis=-1)[..., None].astype(kind) * rows
    springs -= product(energy.ties.astype(kind, copy=False), rows)
    lifted = change[:, :, 1] * np.sqrt(energy.held)[..., None].astype(kind, copy=False)
    held = np.sqrt(energy.steps_held)[..., None, None].astype(kind, copy=False)
    return {
        "laplacian": _half(missed[:, :n_points], change),
        "shape": _half(missed[:, n_points:], change),
        "acceleration": energy.acceleration * _half(np.diff(steps, axis=0), change),
        "contact": _half(springs, change, rows),
        "stance": energy.stance * _half(steps * held, change),
        "height": energy.height * _half(lifted, change),
        "anchor": energy.anchor * _half(change, change),
    }


def forces(energy: Quadratic, change: Real) -> Real:
    """``H U``, (T, N, 3, V), of changes (T, N, 3, V)."""
    kind, rows = change.dtype, change.reshape(*change.shape[:2], -1)
    found = product(energy.inside.astype(kind, copy=False), rows).reshape(change.shape)
    found[:, :, 1] += (energy.height * energy.held[..., None]).astype(kind) * change[:, :, 1]
    steps = np.diff(change, axis=0)
    bends = energy.acceleration * np.diff(steps, axis=0)
    steps *= (energy.stance * energy.steps_held[..., None, None]).astype(kind)
    # The transposes of differences, in the order of time.
    found[1:] += steps
    found[:-1] -= steps
    for shift, weight in enumerate((1, -2, 1)):
        found[shift : len(bends) + shift] += weight * bends
    return found


def target_of(energy: Quadratic, scales: Array) -> Array:
    """``(T, N + M, 3, V)`` metres: r for each body, and below it the same for trunks.

    Parameters
    ----------
    scales : (V, E)
    """
    target: Array = energy.pulls @ np.ascontiguousarray(scales.T - 1)
    return target.reshape(*energy.laplacians.shape[:2], 3, -1)


def _half(values: Real, like: Real, others: Real | None = None) -> Array:
    """Sum squares, or products with ``others``, of all but the last axis of ``like``; halve."""
    # In full: motions of one or two frames have no accelerations to tell a -1 from.
    shape = (len(values), prod(values.shape[1:]) // like.shape[-1], like.shape[-1])
    rows = values.reshape(shape)
    beside = rows if others is None else others.reshape(shape)
    half: Array = np.einsum("trv,trv->tv", rows, beside).sum(axis=0, dtype=np.float64) / 2
    return half
