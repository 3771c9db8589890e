"""From the solver's answer to motions whose bones have exactly the wanted lengths."""

import numpy as np

from pacmo_core.interaction_mesh.scene import Array, Scene, Single


def raw_residual(scene: Scene, change: Single, scales: Array) -> Array:
    """``(V,)``: by how much bones still miss their length before they are set to it, at worst.

    Setting them hides it: a solver that cycles gives exact bones too, with feet that slide.

    Parameters
    ----------
    change : (T, N, 3, V) float32 metres, the solver's
    scales : (V, E)
    """
    source = scene.vectors.astype(np.float32)
    wanted = np.linalg.norm(source, axis=-1)
    worst = np.zeros(len(scales))
    for bone, (parent, child) in enumerate(scene.bones):
        vector = change[:, child] - change[:, parent] + source[:, bone, :, None]
        length = np.sqrt(np.einsum("tcv,tcv->tv", vector, vector))
        share = length / (wanted[:, bone, None] * scales[:, bone].astype(np.float32))
        worst = np.maximum(worst, np.abs(share - 1).max(axis=0))
    return worst


def exact(scene: Scene, change: Single, directions: Single, scales: Array) -> Array:
    """``(T, N, 3, V)`` float64 metres: bones along ``directions``, each body where it went.

    Parameters
    ----------
    change : (T, N, 3, V) float32 metres, the solver's
    directions : (T, E, 3, V), of any length but zero
    scales : (V, E)
    """
    lengths = np.linalg.norm(scene.vectors, axis=-1)
    placed = np.zeros(change.shape)
    first_joint = first_bone = 0
    for skeleton in scene.skeletons:
        joints = slice(first_joint, first_joint + len(skeleton.joints))
        body = placed[:, joints]
        bone_of = {child: row + first_bone for row, (_, child) in enumerate(skeleton.bones)}
        for joint in skeleton.order[1:]:
            bone = bone_of[joint]
            along = directions[:, bone].astype(np.float64)
            long = np.sqrt(np.einsum("tcv,tcv->tv", along, along))
            along *= (lengths[:, bone, None] * scales[:, bone] / long)[:, None]
            np.add(body[:, skeleton.parents[joint]], along, out=body[:, joint])
        middle = scene.points[:, joints].mean(axis=1)[..., None] + change[:, joints].mean(axis=1)
        body += (middle - body.mean(axis=1))[:, None]
        first_joint, first_bone = joints.stop, first_bone + len(skeleton.bones)
    return placed
