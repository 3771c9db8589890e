"""Interactions: two motions on one clock in one world, and the distances between the two people.

World coordinates are metres, y up, right-handed; times are seconds.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.skeleton import Skeleton

Motion = NDArray[np.float32]
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Interaction:
    """Two motions sampled at the same instants.

    Parameters
    ----------
    skeleton : both people's joints
    times : (T,) float64, seconds, strictly increasing, T >= 2
    person_a, person_b : (T, J, 3) float32, metres, y up, right-handed, finite

    Raises
    ------
    ValueError
        If a shape, a dtype or a value is otherwise.
    """

    skeleton: Skeleton
    times: NDArray[np.float64]
    person_a: Motion
    person_b: Motion

    def __post_init__(self) -> None:
        if self.times.ndim != 1 or len(self.times) < 2 or self.times.dtype != np.float64:
            raise ValueError(
                f"times must be (T,) float64 with T >= 2; got {self.times.shape} {self.times.dtype}"
            )
        if not np.isfinite(self.times).all() or (np.diff(self.times) <= 0).any():
            raise ValueError("times must be finite and strictly increasing")
        shape = (len(self.times), len(self.skeleton.joints), 3)
        for name in ("person_a", "person_b"):
            motion = getattr(self, name)
            if motion.shape != shape or motion.dtype != np.float32:
                raise ValueError(
                    f"{name} must be {shape} float32; got {motion.shape} {motion.dtype}"
                )
            if not np.isfinite(motion).all():
                frame, joint = np.argwhere(~np.isfinite(motion))[0][:2]
                raise ValueError(
                    f"{name} must be finite; frame {frame}, "
                    f"joint {self.skeleton.joints[joint]} is not"
                )

    @property
    def fps(self) -> float:
        """Frames a second: the inverse of the median time between frames."""
        return float(1 / np.median(np.diff(self.times)))

    @property
    def duration(self) -> float:
        """Seconds from the first frame to the last."""
        return float(self.times[-1] - self.times[0])

    def swapped(self) -> "Interaction":
        """Exchange the two people: (a, b) and (b, a) are the same interaction (PaCMO, 3.1)."""
        return replace(self, person_a=self.person_b, person_b=self.person_a)

    def frames(self, start: int, stop: int) -> "Interaction":
        """Select frames ``start`` to ``stop`` (exclusive); times start at zero again."""
        window = slice(start, stop)
        return replace(
            self,
            times=self.times[window] - self.times[start],
            person_a=self.person_a[window],
            person_b=self.person_b[window],
        )

    def without(self, joints: list[str]) -> "Interaction":
        """Remove joints by name, as PaCMO does with finger tips and thumbs (section 4.1)."""
        skeleton = self.skeleton.without(joints)
        remaining = self.skeleton.indices(skeleton.joints)
        return replace(
            self,
            skeleton=skeleton,
            person_a=np.ascontiguousarray(self.person_a[:, remaining]),
            person_b=np.ascontiguousarray(self.person_b[:, remaining]),
        )


def bone_lengths(motion: Motion, skeleton: Skeleton) -> NDArray[np.float32]:
    """``(T, E)`` metres: the length of each of ``skeleton.bones`` in each frame."""
    parent, child = skeleton.bones.T
    lengths: NDArray[np.float32] = np.linalg.norm(motion[:, child] - motion[:, parent], axis=-1)
    return lengths


def joint_distances(interaction: Interaction) -> NDArray[np.float32]:
    """``(T, J, J)`` metres: from each joint of person a (rows) to each of person b (columns)."""
    a, b = interaction.person_a, interaction.person_b
    # Joint by joint: all differences at once would take three times the memory of the result.
    rows = [np.linalg.norm(b - a[:, [joint]], axis=-1) for joint in range(a.shape[1])]
    return np.stack(rows, axis=1)


def min_joint_distance(interaction: Interaction) -> NDArray[np.float32]:
    """``(T,)`` metres: the minimum of ``joint_distances``, computed in less memory."""
    a, b = interaction.person_a, interaction.person_b
    minimum = np.full(len(a), np.inf, dtype=np.float32)
    for joint in range(a.shape[1]):
        to_joint = np.linalg.norm(b - a[:, [joint]], axis=-1).min(axis=1)
        minimum = np.minimum(minimum, to_joint)
    return minimum


def min_point_distance(first: Motion, second: Motion) -> NDArray[np.float64]:
    """``(T,)`` metres: minimum distance between two sets of points, accurate to a micrometre.

    One matrix product a frame, faster than ``min_joint_distance``: for the many motions that
    metrics compare.

    Parameters
    ----------
    first, second : (T, P, 3), (T, Q, 3) float32, metres
    """
    # Centred, as a large common offset would cancel the digits of |a - b|² = |a|² + |b|² - 2 a·b.
    centre = first.mean(axis=1, keepdims=True)
    a, b = first - centre, second - centre
    squared = (a**2).sum(axis=-1)[:, :, None] + (b**2).sum(axis=-1)[:, None]
    squared = squared - 2 * a @ b.transpose(0, 2, 1)
    minimum: NDArray[np.float64] = np.sqrt(squared.min(axis=(1, 2)).clip(0), dtype=np.float64)
    return minimum


def closest_points(
    first: tuple[Array, Array], second: tuple[Array, Array]
) -> tuple[Array, Array, Array]:
    """Return where along two segments their closest points are, 0 to 1, and their distance.

    After Ericson (2005), *Real-time collision detection*, section 5.1.9.

    Parameters
    ----------
    first, second : beginning and vector of each segment, (..., 3) metres, that broadcast
    """
    (p, u), (q, v) = first, second
    r = p - q
    a, e, b = _dot(u, u), _dot(v, v), _dot(u, v)
    c, f = _dot(u, r), _dot(v, r)
    tiny = np.finfo(np.float64).tiny
    denominator = a * e - b * b
    is_parallel = denominator <= 1e-12 * a * e
    s = np.where(is_parallel, 0.0, (b * f - c * e) / np.where(is_parallel, 1, denominator))
    s = s.clip(0, 1)
    t = ((b * s + f) / np.maximum(e, tiny)).clip(0, 1)
    s = ((b * t - c) / np.maximum(a, tiny)).clip(0, 1)
    gap = r + s[..., None] * u - t[..., None] * v
    return s, t, np.sqrt(_dot(gap, gap))


def _dot(a: Array, b: Array) -> Array:
    product: Array = np.einsum("...c,...c->...", a, b)
    return product
