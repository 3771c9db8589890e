"""Two bodies as one set of points connected by bones, and scalings of it that need no solver."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Motion
from pacmo_core.data.skeleton import Skeleton

Array = NDArray[np.float64]
Single = NDArray[np.float32]
Real = TypeVar("Real", Array, Single)

# Metres: a shorter bone has no direction, a thinner body no volume.
MIN_LENGTH = 1e-3
# Quantile of a joint's heights that is its lowest level; heights below it are noise.
LOWEST_QUANTILE = 0.05


@dataclass(frozen=True)
class Scene:
    """The motions of two people at the same instants; their skeletons may differ.

    Parameters
    ----------
    motions : two of (T, J, 3) float32, metres, y up, right-handed, finite; J may differ
    skeletons : two, of as many joints
    fps : frames per second
    given_levels : of the whole, if the motions are a part of longer ones

    Raises
    ------
    ValueError
        If a shape or value is wrong, a body is flat, or a bone has no length.
    """

    motions: tuple[Motion, Motion]
    skeletons: tuple[Skeleton, Skeleton]
    fps: float
    given_levels: "Levels | None" = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.fps) and self.fps > 0):
            raise ValueError(f"fps must be positive; got {self.fps}")
        if len(self.motions[0]) != len(self.motions[1]):
            lengths = [len(motion) for motion in self.motions]
            raise ValueError(f"both people need the same frames; got {lengths}")
        for name, motion, skeleton in zip("ab", self.motions, self.skeletons, strict=True):
            _check_body(f"person_{name}", motion, skeleton)

    @property
    def n_joints(self) -> tuple[int, int]:
        """Number of joints of person a and of person b."""
        return len(self.skeletons[0].joints), len(self.skeletons[1].joints)

    @property
    def n_bones(self) -> tuple[int, int]:
        """Number of bones of person a and of person b."""
        return len(self.skeletons[0].bones), len(self.skeletons[1].bones)

    @cached_property
    def points(self) -> Array:
        """``(T, N, 3)`` metres: the joints of person a, then of person b."""
        return np.concatenate(self.motions, axis=1, dtype=np.float64)

    @cached_property
    def bones(self) -> NDArray[np.intp]:
        """``(E, 2)`` rows (parent, child) of ``points``: the bones of a, then of b."""
        a, b = (skeleton.bones for skeleton in self.skeletons)
        return np.concatenate([a, b + self.n_joints[0]])

    @cached_property
    def bone_vectors(self) -> Array:
        """``(T, E, 3)`` metres: from parent to child along each bone."""
        vectors: Array = self.points[:, self.bones[:, 1]] - self.points[:, self.bones[:, 0]]
        return vectors

    @cached_property
    def levels(self) -> "Levels":
        """Heights of the ground and of the joints."""
        return self.given_levels or measure_levels(self)

    @property
    def ground_height(self) -> float:
        """Metres: median over frames of the height of the lowest joint."""
        return self.levels.ground

    def frames(self, frames: slice) -> "Scene":
        """Return a stretch of the motions, with the levels of the whole."""
        a, b = (motion[frames] for motion in self.motions)
        return replace(self, motions=(a, b), given_levels=self.levels)


@dataclass(frozen=True)
class Levels:
    """Heights in a scene, metres.

    Parameters
    ----------
    ground : median over frames of the height of the lowest joint
    lowest : (N,), lowest point of the person to which a joint belongs
    joints : (N,), low quantile of each joint's heights
    """

    ground: float
    lowest: Array
    joints: Array


def measure_levels(scene: Scene) -> Levels:
    """Measure the levels of a scene."""
    heights = scene.points[..., 1]
    n_a = scene.n_joints[0]
    lowest = np.repeat([heights[:, :n_a].min(), heights[:, n_a:].min()], scene.n_joints)
    return Levels(
        ground=float(np.median(heights.min(axis=1))),
        lowest=lowest,
        joints=np.quantile(heights, LOWEST_QUANTILE, axis=0),
    )


def check_scales(scales: Array, n_bones: int) -> None:
    """Check bone scales.

    Raises
    ------
    ValueError
        If the shape is not (V, E), or a scale is not a positive number.
    """
    if scales.ndim != 2 or scales.shape[1] != n_bones:
        raise ValueError(f"scales must be (V, {n_bones}); got {scales.shape}")
    wrong = ~(np.isfinite(scales) & (scales > 0))
    if wrong.any():
        variation, bone = np.argwhere(wrong)[0]
        raise ValueError(
            f"scales must be positive and finite; variation {variation}, bone {bone} "
            f"has {scales[variation, bone]}"
        )


def _check_body(name: str, motion: Motion, skeleton: Skeleton) -> None:
    shape = (len(motion), len(skeleton.joints), 3)
    if motion.shape != shape or motion.dtype != np.float32 or len(motion) < 1:
        raise ValueError(f"{name} must be {shape} float32; got {motion.shape} {motion.dtype}")
    if not np.isfinite(motion).all():
        frame, joint = np.argwhere(~np.isfinite(motion))[0][:2]
        raise ValueError(
            f"{name} must be finite; frame {frame}, joint {skeleton.joints[joint]} is not"
        )
    parent, child = skeleton.bones.T
    lengths = np.linalg.norm(motion[:, child] - motion[:, parent], axis=-1)
    if (lengths < MIN_LENGTH).any():
        frame, bone = np.argwhere(lengths < MIN_LENGTH)[0]
        raise ValueError(
            f"{name}: {skeleton.joints[parent[bone]]} and {skeleton.joints[child[bone]]} coincide "
            f"in frame {frame}; leave one of them out"
        )
    spread = (motion - motion.mean(axis=1, keepdims=True)).reshape(-1, 3).astype(np.float64)
    thickness = np.linalg.svd(spread, compute_uv=False)[-1] / np.sqrt(len(spread))
    if thickness < MIN_LENGTH:
        raise ValueError(f"{name} is flat: {thickness:.2g} m thick, wanted at least {MIN_LENGTH}")


def common_scale(scene: Scene, scales: Array) -> Array:
    """Return the scale that both bodies have in common, ``(V,)``.

    The median of 1 and the two bodies' mean scales, weighted by bone length: 1 where one body
    changes or both change in opposite directions; the bodies' scale where both have the same.
    """
    lengths = np.linalg.norm(scene.bone_vectors, axis=-1).mean(axis=0)
    n_a = scene.n_bones[0]
    means = [
        np.average(scales[:, bones], axis=1, weights=lengths[bones])
        for bones in (slice(None, n_a), slice(n_a, None))
    ]
    common: Array = np.median([np.ones(len(scales)), *means], axis=0)
    return common


def scale_scene(scene: Scene, points: Array, scale: Array) -> Array:
    """Scale motions about the scene's centre on the ground: ``(T, N, 3, V)`` metres.

    Parameters
    ----------
    points : (T, N, 3, V) metres
    scale : (V,)
    """
    centre = scene.points.mean(axis=(0, 1))
    centre[1] = scene.ground_height
    scaled: Array = centre[:, None] + scale * (points - centre[:, None])
    return scaled


def naive_scaling(scene: Scene, scales: Array) -> Array:
    """Scale bones along their own directions, each body alone: ``(T, N, 3, V)`` metres.

    The baseline of the reports. The root keeps its horizontal position, and the lowest joint of
    each body its height.

    Parameters
    ----------
    scales : (V, E)
    """
    points = np.zeros((*scene.points.shape, len(scales)))
    first, bone_of = 0, {child: row for row, (_, child) in enumerate(scene.bones.tolist())}
    for skeleton in scene.skeletons:
        joints = slice(first, first + len(skeleton.joints))
        body, source = points[:, joints], scene.points[:, joints]
        body[:, skeleton.root] = source[:, skeleton.root, :, None]
        for joint in skeleton.order[1:]:
            bone = bone_of[first + joint]
            vector = scene.bone_vectors[:, bone, :, None] * scales[:, bone]
            np.add(body[:, skeleton.parents[joint]], vector, out=body[:, joint])
        lift = source[..., 1].min(axis=1)[:, None] - body[:, :, 1].min(axis=1)
        body[:, :, 1] += lift[:, None]
        first = joints.stop
    return points
