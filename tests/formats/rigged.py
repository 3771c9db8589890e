"""Two people of the embedded default on rigs of other programs, and their files."""

import numpy as np

from pacmo_core.api import synthesise
from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.skeleton import Skeleton, mirror_by_name

# Joints of Mixamo: the parent, and the joints of Kinect's skeleton whose mean they are.
_MIXAMO = {
    "Hips": ("", "spine_base"),
    "Spine": ("Hips", "spine_base spine_mid"),
    "Spine1": ("Spine", "spine_mid"),
    "Spine2": ("Spine1", "spine_mid spine_shoulder"),
    "Neck": ("Spine2", "neck"),
    "Head": ("Neck", "head"),
    **{
        f"{Side}{name}": (parent.replace("*", Side), where.replace("*", side))
        for Side, side in (("Left", "left"), ("Right", "right"))
        for name, parent, where in (
            ("Shoulder", "Spine2", "*_shoulder spine_shoulder"),
            ("Arm", "*Shoulder", "*_shoulder"),
            ("ForeArm", "*Arm", "*_elbow"),
            ("Hand", "*ForeArm", "*_wrist"),
            ("HandMiddle1", "*Hand", "*_hand_tip"),
            ("UpLeg", "Hips", "*_hip"),
            ("Leg", "*UpLeg", "*_knee"),
            ("Foot", "*Leg", "*_ankle"),
            ("ToeBase", "*Foot", "*_foot"),
        )
    },
}


def people() -> Interaction:
    """Two people of Kinect's 25 joints who shake hands or the like."""
    return next(iter(synthesise(1).values()))


def mixamo(clip: Interaction, prefix: str = "mixamorig:") -> tuple[Skeleton, list[Motion]]:
    """Return both people on Mixamo's joints."""
    names = list(_MIXAMO)
    joints = tuple(prefix + name for name in names)
    parents = tuple(names.index(parent) if parent else -1 for parent, _ in _MIXAMO.values())
    skeleton = Skeleton("mixamo", joints, parents, mirror_by_name(tuple(names)))
    rows = [clip.skeleton.indices(where.split()) for _, where in _MIXAMO.values()]
    motions = [
        np.stack([motion[:, row].mean(axis=1) for row in rows], axis=1).astype(np.float32)
        for motion in (clip.person_a, clip.person_b)
    ]
    return skeleton, motions
