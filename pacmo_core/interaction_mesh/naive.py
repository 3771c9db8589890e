"""The peer: bodies scaled where they stand, each for itself, blind to the other."""

import numpy as np

from pacmo_core.interaction_mesh.scene import Array, Scene


def naive(scene: Scene, scales: Array) -> Array:
    """``(T, N, 3, V)`` metres: bones scaled along their own directions, from the root.

    The root stays above its place, and each body's lowest joint at its height.

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
            vector = scene.vectors[:, bone, :, None] * scales[:, bone]
            np.add(body[:, skeleton.parents[joint]], vector, out=body[:, joint])
        lift = source[..., 1].min(axis=1)[:, None] - body[:, :, 1].min(axis=1)
        body[:, :, 1] += lift[:, None]
        first = joints.stop
    return points
