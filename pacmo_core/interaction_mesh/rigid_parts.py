"""Pelvis and chest, which are rigid: the bones that begin at one joint turn as one.

The proximal point of their rows in ADMM is the rotated and scaled part that is nearest to v,

    z_m = R s_m a_m,   R = argmax tr(R^T M),   M = sum_m p_m v_m (s_m a_m)^T      over rotations R

(Kabsch 1976; as rigid as possible, Sorkine and Alexa 2007), with a_m the bones in the source, s_m
their scales and p_m their penalties. Bounds on the distances between the bones' ends would hold for
the mirrored part too: a pelvis is a flat pyramid, which the other body turns inside out.

R is followed from iteration to iteration by Newton steps on a unit quaternion.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.interaction_mesh.body_parts import RIGID, trunk_bends
from pacmo_core.interaction_mesh.linear_algebra import pair_frames
from pacmo_core.interaction_mesh.scene import Array, Scene, Single

# Newton steps of the rotations in an iteration of ADMM.
N_STEPS = 2
# Of the trace of M: what is determined less, such as the turn about two bones in a line, stays.
REGULARISATION = np.float32(1e-5)

Entries = list[list[Single]]  # of a matrix of three rows


@dataclass(frozen=True)
class RigidParts:
    """G rigid parts of up to M bones, in K blocks of two frames.

    Parameters
    ----------
    bones : (G, M) rows; where a part has fewer bones, 0
    is_bone : (G, M)
    vectors : (K, 3, 2, G, M, 1) float32 metres, in the source; zero where there is no bone
    weighted : the same times the penalties
    """

    bones: NDArray[np.intp]
    is_bone: NDArray[np.bool_]
    vectors: Single
    weighted: Single

    @property
    def rows(self) -> NDArray[np.intp]:
        """``(Q,)``: all bones of the parts."""
        rows: NDArray[np.intp] = self.bones[self.is_bone]
        return rows

    def unturned(self, n_bodies: int) -> Single:
        """``(K, 4, 2, G, V)``: quaternions of no rotation."""
        turns = np.zeros((len(self.vectors), 4, 2, len(self.bones), n_bodies), np.float32)
        turns[:, 0] = 1
        return turns

    def nearest(self, governing: Single, scales: Single, turns: Single) -> Single:
        """Return the proximal points, (K, 3, 2, Q, V) metres; update the turns.

        All blocks at once, as the arrays of a few are small beside the cost of a call.

        Parameters
        ----------
        governing : (K, 3, 2, R, V) metres, v
        scales : (R, V)
        turns : (K, 4, 2, G, V) unit quaternions
        """
        own = scales[self.bones]
        found = governing[:, :, :, self.bones] * own
        moments = [
            [(found[:, i] * self.weighted[:, j]).sum(axis=-2) for j in range(3)] for i in range(3)
        ]
        for _ in range(N_STEPS):
            _turn(turns, moments)
        rotation = _entries(turns)
        result = np.empty_like(found)
        for i, (x, y, z) in enumerate(rotation):
            np.multiply(x[..., None, :], self.vectors[:, 0], out=result[:, i])
            result[:, i] += y[..., None, :] * self.vectors[:, 1]
            result[:, i] += z[..., None, :] * self.vectors[:, 2]
        result *= own
        return result[:, :, :, self.is_bone]


def rigid_parts(scene: Scene, penalties: Array) -> RigidParts:
    """Find the rigid parts of both bodies.

    Parameters
    ----------
    penalties : (T, E), of the bones
    """
    pairs, kinds = trunk_bends(scene)
    members: dict[int, set[int]] = {}
    for pair in pairs[kinds == RIGID].tolist():
        members.setdefault(int(scene.bones[pair[0], 0]), set()).update(pair)
    size = max(map(len, members.values()), default=0)
    bones = np.zeros((len(members), size), dtype=np.intp)
    is_bone = np.zeros(bones.shape, dtype=np.bool_)
    for row, own in enumerate(members.values()):
        bones[row, : len(own)], is_bone[row, : len(own)] = sorted(own), True
    vectors = np.where(is_bone[..., None], scene.bone_vectors[:, bones], 0.0)
    blocks = np.moveaxis(pair_frames(vectors), -1, 1)[..., None]
    weights = pair_frames(penalties[:, bones])[:, None, ..., None]
    return RigidParts(
        bones, is_bone, blocks.astype(np.float32), (blocks * weights).astype(np.float32)
    )


def _entries(turns: Single) -> Entries:
    """Return the entries of the rotations of unit quaternions (B, 4, ...), (B, ...) each."""
    w, x, y, z = np.moveaxis(turns, 1, 0)
    two = np.float32(2)
    xx, yy, zz = two * x * x, two * y * y, two * z * z
    xy, xz, yz, wx, wy, wz = x * y, x * z, y * z, w * x, w * y, w * z
    one = np.float32(1)
    return [
        [one - yy - zz, two * (xy - wz), two * (xz + wy)],
        [two * (xy + wz), one - xx - zz, two * (yz - wx)],
        [two * (xz - wy), two * (yz + wx), one - xx - yy],
    ]


def _turn(turns: Single, moments: Entries) -> None:
    """Take a Newton step to the rotations R with the largest tr(R^T M), in place.

    With S = R^T M the step solves ``(c I - sym S) w = g``, g the axial vector of S - S^T. At the
    maximum c is tr S; farther from it c is at least the norm of S, so that the matrix stays
    positive definite and the step leads upwards.
    """
    rotation = _entries(turns)
    s = [
        [sum(rotation[k][i] * moments[k][j] for k in range(3)) for j in range(3)] for i in range(3)
    ]
    gradient = [s[2][1] - s[1][2], s[0][2] - s[2][0], s[1][0] - s[0][1]]
    norm = np.sqrt(sum(entry * entry for row in s for entry in row))
    bound = np.maximum(s[0][0] + s[1][1] + s[2][2], norm)
    bound += REGULARISATION * norm + np.finfo(np.float32).tiny
    half = np.float32(-0.5)
    a, b, c = (bound - s[i][i] for i in range(3))
    d, e, f = half * (s[1][2] + s[2][1]), half * (s[0][2] + s[2][0]), half * (s[0][1] + s[1][0])
    # The inverse of [[a, f, e], [f, b, d], [e, d, c]] by its cofactors.
    aa, bb, cc = b * c - d * d, a * c - e * e, a * b - f * f
    dd, ee, ff = e * f - a * d, d * f - b * e, d * e - c * f
    half_inverse = np.float32(0.5) / (a * aa + f * ff + e * ee + np.finfo(np.float32).tiny)
    gx, gy, gz = gradient
    x = (aa * gx + ff * gy + ee * gz) * half_inverse
    y = (ff * gx + bb * gy + dd * gz) * half_inverse
    z = (ee * gx + dd * gy + cc * gz) * half_inverse
    w0, x0, y0, z0 = np.moveaxis(turns, 1, 0).copy()
    turned = (
        w0 - x0 * x - y0 * y - z0 * z,
        x0 + w0 * x + y0 * z - z0 * y,
        y0 + w0 * y + z0 * x - x0 * z,
        z0 + w0 * z + x0 * y - y0 * x,
    )
    length = np.sqrt(sum(entry * entry for entry in turned))
    for index, entry in enumerate(turned):
        np.divide(entry, length, out=turns[:, index])
