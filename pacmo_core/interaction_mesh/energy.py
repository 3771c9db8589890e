"""The energy that a variation minimises among the motions with the target bone lengths.

With U the displacement of the joints from the source, v_e the vector of bone e in the source, s_e
its scale and l_e its mean length,

    E(U) = 1/2 sum_t |L_t U_t - r_t|^2                                      Laplacian deformation
         + 1/2 sum_t sum_e w_e |dU_e - (s_e - 1) v_e|^2                     posture
         + 1/2 sum_t sum_hinges w |b (d_lower - d_upper)|^2                 knees, elbows, spine
         + 1/2 trunk_shape sum_t sum_trunk |q_i(U_t) - mean q|^2            trunk shape
         + 1/2 root sum_t a_t |U_root - (0, g_t, 0)|^2                      place of the roots
         + 1/2 sum_t sum_pairs c_ij |U_i - U_j|^2                           contact
         + 1/2 acceleration sum_t |U_t+1 - 2 U_t + U_t-1|^2                 smoothness
         + 1/2 stance sum_t h_t h_t-1 |U_t - U_t-1|^2                       supports do not slide
         + 1/2 sum_t k_t (U_y - (s - 1)(y - ground))^2                      heights near the floor
         + 1/2 regularisation |U|^2                                         Tikhonov

where dU_e is the displacement of the end of bone e relative to its beginning; r_t is what L_t does
to the source when each bone is scaled alone along its own direction; d = (dU_e - (s_e - 1) v_e) /
l_e of the two bones of a hinge, and b a length (``HINGE_LENGTH``); q_i is U_i less the displacement
of the same trunk with its bones scaled along their own directions; g is the height by which the
root rises if all bones grow along their own directions while the lowest joints keep their height;
a_t is 1 in stance and ``mesh.AIRBORNE_FRACTION`` in a jump, times ``yielding`` for person a and
divided by it for b. The terms are built in ``mesh``. All
are quadratic, and all targets are linear in the scales, so that the whole energy is

    E(U; s) = 1/2 <U, H U> - <U, G (s - 1)> + 1/2 <s - 1, R (s - 1)>.

The Laplacian deformation energy and an acceleration energy are those of Ho, Komura and Tai (2010),
*Spatial relationship preserving character motion adaptation*. Unlike there, the acceleration of the
displacement is penalised, not of the motion: the source's own dynamics cost nothing. Posture, hinge
and root terms keep what the interaction does not need to change.

In this package arrays of V bodies have the bodies last, (T, N, 3, V), so that one matrix product
per frame applies to all directions and bodies.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pacmo_core.interaction_mesh.linear_algebra import batched_product
from pacmo_core.interaction_mesh.mesh import (
    LinearTerm,
    carrying_joints,
    contact_hessians,
    ground_supports,
    height_term,
    linear_terms,
    root_term,
    support_weights,
)
from pacmo_core.interaction_mesh.scene import Array, Real, Scene, Single
from pacmo_core.interaction_mesh.settings import Settings

# Frames per second for which the weights of acceleration and stance are set.
REFERENCE_FPS = 30.0


@dataclass(frozen=True)
class QuadraticEnergy:
    """The energy as matrices.

    Parameters
    ----------
    frame_hessians : (T, N, N), the part of H within a frame that acts on all directions alike
    height_weights : (T, N), its diagonal part that acts on heights alone
    targets : (T, N, E) float32; G is these times the bone's vector in the source
    height_targets : (T, N, E) float32 metres, in addition to that, on heights alone
    bone_vectors : (T, E, 3) metres, of the source
    constant : (E, E), R
    is_support : (T, N), whether a joint supports
    step_weights : (T - 1, N), h_t h_t-1
    acceleration, stance : weights at this scene's frame rate
    """

    frame_hessians: Array
    height_weights: Array
    targets: Single
    height_targets: Single
    bone_vectors: Array
    constant: Array
    is_support: NDArray[np.bool_]
    step_weights: Array
    acceleration: float
    stance: float

    def subsample(self, stride: int) -> "QuadraticEnergy":
        """Return the energy of every ``stride``-th frame alone, at the lower frame rate."""
        frames = slice(None, None, stride)
        steps = len(self.frame_hessians[frames]) - 1
        return replace(
            self,
            frame_hessians=self.frame_hessians[frames],
            height_weights=self.height_weights[frames],
            targets=self.targets[frames],
            height_targets=self.height_targets[frames],
            bone_vectors=self.bone_vectors[frames],
            is_support=self.is_support[frames],
            step_weights=self.step_weights[frames][:steps],
            acceleration=self.acceleration / stride**4,
            stance=self.stance / stride**2,
        )


def build_energy(scene: Scene, settings: Settings) -> QuadraticEnergy:
    """Build the energy of a source; it does not depend on the target bodies."""
    weights, rate = settings.weights, scene.fps / REFERENCE_FPS
    is_support = ground_supports(scene, settings.support)
    supports = support_weights(is_support, scene.fps, settings.support.fade_time)
    n_frames, n_points, _ = scene.points.shape
    hessians = contact_hessians(scene, weights)
    points = np.arange(n_points)
    hessians[:, points, points] += weights.regularisation
    targets = np.zeros((n_frames, n_points, len(scene.bones)))
    constant = np.zeros((len(scene.bones), len(scene.bones)))
    for linear in linear_terms(scene, weights):
        _add_linear_term(linear, scene, hessians, targets, constant)
    root_hessian, root = root_term(scene, weights)
    hessians[:, points, points] += root_hessian
    height_targets = np.zeros(targets.shape)
    carries = carrying_joints(scene, settings.support, is_support)
    fade_time = settings.support.fade_time
    heights = height_term(scene, weights, support_weights(carries, scene.fps, fade_time))
    for term in (root, heights):
        weighted = term.weights[:, :, None] * term.targets
        height_targets += weighted
        flat = (-1, constant.shape[1])
        constant += weighted.reshape(flat).T @ term.targets.reshape(flat)
    return QuadraticEnergy(
        frame_hessians=hessians,
        height_weights=heights.weights,
        targets=targets.astype(np.float32),
        height_targets=height_targets.astype(np.float32),
        bone_vectors=scene.bone_vectors,
        constant=constant,
        is_support=is_support,
        step_weights=supports[1:] * supports[:-1],
        # Second and first differences in time scale with the frame rate squared.
        acceleration=weights.acceleration * rate**4,
        stance=weights.stance * rate**2,
    )


def _add_linear_term(
    term: LinearTerm, scene: Scene, hessians: Array, targets: Array, constant: Array
) -> None:
    """Add ``1/2 |rows U - factors ((s - 1) v)|^2`` to H, G and R."""
    transposed = np.swapaxes(term.rows, -1, -2)
    hessians += transposed @ term.rows
    targets += transposed @ term.factors
    products = np.swapaxes(term.factors, -1, -2) @ term.factors
    vectors = scene.bone_vectors
    for axis in range(3):
        along = vectors[:, :, axis]
        constant += (products * along[:, :, None] * along[:, None]).sum(axis=0)


def energy_rhs(energy: QuadraticEnergy, scales: Array) -> Single:
    """Return ``G (s - 1)`` of each body, ``(T, N, 3, V)`` float32.

    Parameters
    ----------
    scales : (V, E)
    """
    growth = np.ascontiguousarray(scales.T - 1).astype(np.float32)
    vectors = energy.bone_vectors.astype(np.float32)
    rhs = np.zeros((*energy.targets.shape[:2], 3, len(scales)), dtype=np.float32)
    for axis in range(3):
        matrix = energy.targets * vectors[:, None, :, axis]
        if axis == 1:
            matrix += energy.height_targets
        rhs[:, :, axis] = batched_product(matrix.reshape(-1, len(growth)), growth).reshape(
            *energy.targets.shape[:2], -1
        )
    return rhs


def energy_of(energy: QuadraticEnergy, displacement: Array, scales: Array) -> Array:
    """Return the energy of each body, ``(V,)``.

    Parameters
    ----------
    displacement : (T, N, 3, V) metres, U
    scales : (V, E)
    """
    growth = scales - 1
    product = hessian_product(energy, displacement) / 2 - energy_rhs(energy, scales)
    constant = np.einsum("ve,ef,vf->v", growth, energy.constant, growth) / 2
    total: Array = np.einsum("tncv,tncv->tv", product, displacement).sum(axis=0) + constant
    return total


def hessian_product(energy: QuadraticEnergy, displacement: Real) -> Real:
    """Return ``H U``, (T, N, 3, V), of displacements (T, N, 3, V)."""
    dtype, rows = displacement.dtype, displacement.reshape(*displacement.shape[:2], -1)
    hessians = energy.frame_hessians.astype(dtype, copy=False)
    result = (hessians @ rows).reshape(displacement.shape)
    result[:, :, 1] += energy.height_weights[..., None].astype(dtype) * displacement[:, :, 1]
    steps = np.diff(displacement, axis=0)
    accelerations = energy.acceleration * np.diff(steps, axis=0)
    steps *= (energy.stance * energy.step_weights[..., None, None]).astype(dtype)
    # The transposes of the first and second differences in time.
    result[1:] += steps
    result[:-1] -= steps
    for shift, weight in enumerate((1, -2, 1)):
        result[shift : len(accelerations) + shift] += weight * accelerations
    return result
