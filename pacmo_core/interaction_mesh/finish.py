"""From the solver's answer to motions whose bones have exactly the wanted lengths."""

import numpy as np

from pacmo_core.interaction_mesh.scene import Array, Scene


def raw_residual(scene: Scene, points: Array, scales: Array) -> Array:
    """``(V,)``: by how much bones still miss their length before they are set to it, at worst.

    Setting them hides it: a solver that cycles gives exact bones too, with feet that slide.

    Parameters
    ----------
    points : (V, T, N, 3) metres
    scales : (V, E)
    """
    parent, child = scene.bones.T
    lengths = np.linalg.norm(points[:, :, child] - points[:, :, parent], axis=-1)
    wanted = np.linalg.norm(scene.vectors, axis=-1) * scales[:, None]
    residual: Array = np.abs(lengths / wanted - 1).max(axis=(1, 2))
    return residual


def exact(scene: Scene, points: Array, directions: Array, scales: Array) -> Array:
    """``(V, T, N, 3)`` metres: bones along ``directions``, each body where its points are.

    Parameters
    ----------
    points : (V, T, N, 3) metres, the solver's
    directions : (V, T, E, 3), of any length but zero
    scales : (V, E)
    """
    wanted = np.linalg.norm(scene.vectors, axis=-1) * scales[:, None]
    bones = directions * (wanted / np.linalg.norm(directions, axis=-1))[..., None]
    placed = np.zeros_like(points)
    first_joint = first_bone = 0
    for skeleton in scene.skeletons:
        joints = slice(first_joint, first_joint + len(skeleton.joints))
        body = placed[:, :, joints]
        bone_of = {child: row + first_bone for row, (_, child) in enumerate(skeleton.bones)}
        for joint in skeleton.order[1:]:
            body[:, :, joint] = body[:, :, skeleton.parents[joint]] + bones[:, :, bone_of[joint]]
        body += (points[:, :, joints] - body).mean(axis=2, keepdims=True)
        first_joint, first_bone = joints.stop, first_bone + len(skeleton.bones)
    return placed
