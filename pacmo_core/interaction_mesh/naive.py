"""The peer: bodies scaled where they stand, each for itself, blind to the other."""

import numpy as np

from pacmo_core.interaction_mesh.scene import Array, Scene


def naive(scene: Scene, scales: Array) -> Array:
    """``(V, T, N, 3)`` metres: bones scaled along their own directions, from the root.

    The root stays above its place, and each body's lowest joint at its height.

    Parameters
    ----------
    scales : (V, E)
    """
    points = np.zeros((len(scales), *scene.points.shape))
    first = 0
    for skeleton, bones in zip(scene.skeletons, _by_child(scene), strict=True):
        joints = slice(first, first + len(skeleton.joints))
        body, source = points[:, :, joints], scene.points[:, joints]
        body[:, :, skeleton.root] = source[:, skeleton.root]
        for joint in skeleton.order[1:]:
            bone = bones[joint]
            vector = scene.vectors[:, bone] * scales[:, None, bone, None]
            body[:, :, joint] = body[:, :, skeleton.parents[joint]] + vector
        lift = source[..., 1].min(axis=1) - body[..., 1].min(axis=2)
        body[..., 1] += lift[..., None]
        first = joints.stop
    return points


def _by_child(scene: Scene) -> list[dict[int, int]]:
    """Give the bone that ends at each joint of either body."""
    first, found = 0, []
    for skeleton in scene.skeletons:
        found.append({child: row + first for row, (_, child) in enumerate(skeleton.bones.tolist())})
        first += len(skeleton.bones)
    return found
