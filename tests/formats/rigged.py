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


ROTATIONS = "Zrotation Xrotation Yrotation"
# Joints of an adult in a T-pose who faces z: the parent, and the offset in cm, x to the left.
_T_POSE = {
    "Hips": ("", 0, 100, 0),
    "Spine": ("Hips", 0, 10, -1),
    "Spine1": ("Spine", 0, 12, 0),
    "Spine2": ("Spine1", 0, 13, 0),
    "Neck": ("Spine2", 0, 15, 1),
    "Head": ("Neck", 0, 10, 3),
    **{
        f"{side}{name}": (parent.replace("*", side), sign * x, y, z)
        for side, sign in (("Left", 1), ("Right", -1))
        for name, parent, x, y, z in (
            ("Shoulder", "Spine2", 6, 10, 0),
            ("Arm", "*Shoulder", 13, -1, 0),
            ("ForeArm", "*Arm", 28, 0, 0),
            ("Hand", "*ForeArm", 26, 0, 0),
            *(
                (f"Hand{finger}{n}", "*Hand" if n == 1 else f"*Hand{finger}{n - 1}", *place)
                for finger, z in (("Thumb", 4), ("Index", 3), ("Middle", 0), ("Ring", -2))
                for n, place in ((1, (9, 0, z)), (2, (4, 0, 0)), (3, (3, 0, 0)))
            ),
            ("UpLeg", "Hips", 9, -5, 0),
            ("Leg", "*UpLeg", 0, -44, 1),
            ("Foot", "*Leg", 0, -43, -2),
            ("ToeBase", "*Foot", 0, -6, 13),
        )
    },
}


def t_pose(size: float = 1.0, *, has_reference: bool = False) -> str:
    """Write Mixamo's rig with fingers, in a T-pose, as BVH in centimetres.

    Parameters
    ----------
    size : relative to an adult of 1.75 m
    has_reference : whether the hips have a parent on the floor, which alone has positions
    """
    joints = {name: tuple(of) for name, of in _T_POSE.items()}
    root = "Hips"
    if has_reference:
        root = "Reference"
        joints = {root: ("", 0, 0, 0), **joints, "Hips": (root, 0, 100, 0)}
    place = joints[root][1:]

    def lines(name: str) -> list[str]:
        parent, *offset = joints[name]
        text = " ".join(f"{size * value:.4f}" for value in offset) if parent else "0 0 0"
        below = [child for child, (of, *_) in joints.items() if of == name]
        end = ["End Site", "{", f"OFFSET 0 {size:.4f} 0", "}"]
        return [
            f"{'JOINT' if parent else 'ROOT'} mixamorig:{name}",
            "{",
            f"OFFSET {text}",
            f"CHANNELS {'3' if parent else '6 Xposition Yposition Zposition'} {ROTATIONS}",
            *([line for child in below for line in lines(child)] or end),
            "}",
        ]

    row = " ".join(f"{size * value:.4f}" for value in (*place, *[0] * (3 * len(joints))))
    header = ["MOTION", "Frames: 2", "Frame Time: 0.0333333"]
    return "\n".join(["HIERARCHY", *lines(root), *header, row, row, ""])
