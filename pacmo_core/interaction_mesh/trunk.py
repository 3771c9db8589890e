"""Trunks: what a body must not fold to make room.

Bones that leave one joint turn freely against each other, and a mesh that wants a smaller body as
high as the larger one was would fold hips and shoulders together. So the trunk's joints are held
to the places that the trunk has when its bones are scaled where they point, wherever the trunk as a
whole goes.
"""

import numpy as np
from numpy.typing import NDArray

from pacmo_core.interaction_mesh.hinges import hinges
from pacmo_core.interaction_mesh.scene import Array, Scene


def trunks(scene: Scene) -> list[NDArray[np.intp]]:
    """List the points of each body from its root to where its limbs begin; no limbs, no trunk."""
    parent_of = {child: parent for parent, child in scene.bones.tolist()}
    found: tuple[set[int], set[int]] = (set(), set())
    for start, _, _ in hinges(scene).tolist():
        joint, trunk = start, found[int(start >= scene.n_joints[0])]
        trunk.add(joint)
        while joint in parent_of:
            joint = parent_of[joint]
            trunk.add(joint)
    return [np.array(sorted(trunk), dtype=np.intp) for trunk in found]


def shape_rows(scene: Scene, weight: float) -> tuple[Array, Array]:
    """Give what each joint of a trunk does beside its trunk's middle, times the weight's root.

    Returns
    -------
    ``(M, N)``, from points; and ``(M, E)``, from the bones of a trunk scaled where they point
    """
    everyone, blocks = np.eye(scene.points.shape[1]), []
    for joints in trunks(scene):
        rows = everyone[joints]
        blocks.append(rows - rows.mean(axis=0) if len(joints) else rows)
    beside: Array = np.sqrt(weight) * np.concatenate(blocks)
    return beside, beside @ paths(scene)


def paths(scene: Scene) -> Array:
    """``(N, E)``: ones where a bone lies between a point and its body's root."""
    bone_of = {child: (row, parent) for row, (parent, child) in enumerate(scene.bones.tolist())}
    found = np.zeros((scene.points.shape[1], len(scene.bones)))
    for point in range(len(found)):
        joint = point
        while joint in bone_of:
            row, joint = bone_of[joint]
            found[point, row] = 1
    return found
