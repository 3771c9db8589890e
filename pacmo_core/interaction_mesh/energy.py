"""The energy that a variation minimises among the motions with the target bone lengths.

With U the displacement of the joints from the source,

    E(U) = 1/2 sum_t |L_t U_t - r_t|^2                              Laplacian deformation
         + 1/2 trunk_shape sum_t sum_trunk |q_i(U_t) - mean q|^2    trunk shape
         + 1/2 acceleration sum_t |U_t+1 - 2 U_t + U_t-1|^2         smoothness
         + 1/2 sum_t sum_pairs w_ij |U_i - U_j|^2                   contact
         + 1/2 stance sum_t h_t h_t-1 |U_t - U_t-1|^2               feet in stance do not slide
         + 1/2 stance_height sum_t h_t U_y^2                        and stay on the ground
         + 1/2 regularisation |U|^2                                 Tikhonov regularisation

where r_t is what L_t does to the source when each bone is scaled alone along its own direction, q_i
is U_i less the displacement of the same trunk with its bones scaled along their own directions,
w_ij are the contact weights, and h_t is 1 where a joint supports and fades around that (``mesh``).

The Laplacian deformation energy and an acceleration energy are those of Ho, Komura and Tai (2010),
*Spatial relationship preserving character motion adaptation*. Unlike there, the acceleration of the
displacement is penalised, not of the motion: the source's own dynamics cost nothing.

In this package arrays of V bodies have the bodies last, (T, N, 3, V), so that one matrix product
per frame applies to all directions and bodies.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from math import prod

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from pacmo_core.interaction_mesh.linear_algebra import batched_product
from pacmo_core.interaction_mesh.mesh import (
    contact_weights,
    ground_supports,
    laplacian_matrices,
    support_weights,
    target_matrix,
    trunk_shape_matrices,
)
from pacmo_core.interaction_mesh.scene import Array, Real, Scene
from pacmo_core.interaction_mesh.settings import Settings

# Frames per second for which the weights of acceleration and stance are set.
REFERENCE_FPS = 30.0


@dataclass(frozen=True)
class QuadraticEnergy:
    """The energy as matrices: ``E(U) = 1/2 <U, H U> - <U, g> + 1/2 |r|^2``.

    Parameters
    ----------
    laplacians : (T, N + M, N), L, and below it the positions of the M trunk joints relative to
        their trunk's mean
    target_matrix : (3T(N + M), E) metres, from bone scales minus 1 to r, and below it to the
        trunks' displacement
    is_support : (T, N), whether a joint supports
    support_weights : (T, N), h
    contact_weights : (T, N, N)
    acceleration, stance, stance_height : weights at this scene's frame rate
    regularisation : weight
    """

    laplacians: Array
    target_matrix: csr_array
    is_support: NDArray[np.bool_]
    support_weights: Array
    contact_weights: Array
    acceleration: float
    stance: float
    stance_height: float
    regularisation: float

    @property
    def step_weights(self) -> Array:
        """``(T - 1, N)``: h_t h_t-1."""
        weights: Array = self.support_weights[1:] * self.support_weights[:-1]
        return weights

    def subsample(self, frames: slice) -> "QuadraticEnergy":
        """Return the energy of some frames alone; a step in ``frames`` lowers the frame rate."""
        stride = frames.step or 1
        n_frames = len(self.laplacians)
        rows = np.arange(self.target_matrix.shape[0]).reshape(n_frames, -1)[frames].reshape(-1)
        return replace(
            self,
            laplacians=self.laplacians[frames],
            target_matrix=self.target_matrix[rows],
            is_support=self.is_support[frames],
            support_weights=self.support_weights[frames],
            contact_weights=self.contact_weights[frames],
            acceleration=self.acceleration / stride**4,
            stance=self.stance / stride**2,
        )

    @cached_property
    def frame_hessians(self) -> Array:
        """``(T, N, N)``: ``frame_hessians_of`` all frames."""
        return self.frame_hessians_of(slice(None))

    def frame_hessians_of(self, frames: slice) -> Array:
        """``(F, N, N)``: the part of H within a frame, of Laplacian, contact and regularisation."""
        laplacians, contacts = self.laplacians[frames], self.contact_weights[frames]
        hessians: Array = laplacians.transpose(0, 2, 1) @ laplacians - contacts
        points = np.arange(contacts.shape[1])
        hessians[:, points, points] += contacts.sum(axis=-1) + self.regularisation
        return hessians


def build_energy(scene: Scene, settings: Settings) -> QuadraticEnergy:
    """Build the energy of a source; it does not depend on the target bodies."""
    weights, rate = settings.weights, scene.fps / REFERENCE_FPS
    laplacians = laplacian_matrices(scene, weights, settings.graph)
    trunk_rows, trunk_targets = trunk_shape_matrices(scene, weights.trunk_shape)
    trunks = np.broadcast_to(trunk_rows, (len(laplacians), *trunk_rows.shape))
    is_support = ground_supports(scene, settings.support)
    return QuadraticEnergy(
        laplacians=np.concatenate([laplacians, trunks], axis=1),
        target_matrix=target_matrix(scene, laplacians, trunk_targets),
        is_support=is_support,
        support_weights=support_weights(is_support, scene.fps, settings.support.fade_time),
        contact_weights=contact_weights(scene, weights),
        # Second and first differences in time scale with the frame rate squared.
        acceleration=weights.acceleration * rate**4,
        stance=weights.stance * rate**2,
        stance_height=weights.stance_height,
        regularisation=weights.regularisation,
    )


def energy_target(energy: QuadraticEnergy, scales: Array) -> Array:
    """Return r of each body, and below it the trunks' target: ``(T, N + M, 3, V)`` metres.

    Parameters
    ----------
    scales : (V, E)
    """
    target: Array = energy.target_matrix @ np.ascontiguousarray(scales.T - 1)
    return target.reshape(*energy.laplacians.shape[:2], 3, -1)


def energy_terms(energy: QuadraticEnergy, displacement: Real, target: Real) -> dict[str, Array]:
    """Return each term of the energy, (V,) each, summed in float64 for any dtype.

    Parameters
    ----------
    displacement : (T, N, 3, V) metres, U
    target : (T, N + M, 3, V) metres, of ``energy_target``
    """
    dtype, n_points = displacement.dtype, displacement.shape[1]
    rows = displacement.reshape(*displacement.shape[:2], -1)
    steps = np.diff(displacement, axis=0)
    deformation = batched_product(energy.laplacians.astype(dtype, copy=False), rows)
    deformation -= target.reshape(deformation.shape)
    contacts = energy.contact_weights
    contact_force = contacts.sum(axis=-1)[..., None].astype(dtype) * rows
    contact_force -= batched_product(contacts.astype(dtype, copy=False), rows)
    root_weights = np.sqrt(energy.support_weights)[..., None].astype(dtype, copy=False)
    lift = displacement[:, :, 1] * root_weights
    step_weights = np.sqrt(energy.step_weights)[..., None, None].astype(dtype, copy=False)
    return {
        "laplacian": _half_sum(deformation[:, :n_points], displacement),
        "trunk_shape": _half_sum(deformation[:, n_points:], displacement),
        "acceleration": energy.acceleration * _half_sum(np.diff(steps, axis=0), displacement),
        "contact": _half_sum(contact_force, displacement, rows),
        "stance": energy.stance * _half_sum(steps * step_weights, displacement),
        "stance_height": energy.stance_height * _half_sum(lift, displacement),
        "regularisation": energy.regularisation * _half_sum(displacement, displacement),
    }


def hessian_product(energy: QuadraticEnergy, displacement: Real) -> Real:
    """Return ``H U``, (T, N, 3, V), of displacements (T, N, 3, V)."""
    dtype, rows = displacement.dtype, displacement.reshape(*displacement.shape[:2], -1)
    hessians = energy.frame_hessians.astype(dtype, copy=False)
    result = batched_product(hessians, rows).reshape(displacement.shape)
    height_weights = (energy.stance_height * energy.support_weights[..., None]).astype(dtype)
    result[:, :, 1] += height_weights * displacement[:, :, 1]
    steps = np.diff(displacement, axis=0)
    accelerations = energy.acceleration * np.diff(steps, axis=0)
    steps *= (energy.stance * energy.step_weights[..., None, None]).astype(dtype)
    # The transposes of the first and second differences in time.
    result[1:] += steps
    result[:-1] -= steps
    for shift, weight in enumerate((1, -2, 1)):
        result[shift : len(accelerations) + shift] += weight * accelerations
    return result


def _half_sum(values: Real, like: Real, others: Real | None = None) -> Array:
    """Half the sum of squares, or of products with ``others``, over all but the last axis.

    Parameters
    ----------
    like : an array with that last axis, (..., V)
    """
    # The shape is explicit: motions of one or two frames have no accelerations, and -1 would be
    # ambiguous.
    shape = (len(values), prod(values.shape[1:]) // like.shape[-1], like.shape[-1])
    rows = values.reshape(shape)
    factors = rows if others is None else others.reshape(shape)
    half: Array = np.einsum("trv,trv->tv", rows, factors).sum(axis=0, dtype=np.float64) / 2
    return half
