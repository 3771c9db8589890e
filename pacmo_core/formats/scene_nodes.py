"""Scene nodes of a BVH file: joints above a body that do not move, and helpers beside the body.

Programs export the armature, or a reference on the floor, as the root, and the hips below it, in
Unreal beside targets of inverse kinematics (``ik_foot_root``). None of them is a joint of the body:
they are left out when a file is read, and stay as they are when a motion is written on the file's
hierarchy.
"""

import re
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pacmo_core.formats.bvh import Bvh
from pacmo_core.formats.bvh_channels import local_rotations
from pacmo_core.formats.inverse_kinematics import PointTargets

Array = NDArray[np.float64]

STILL = 1e-3  # file units and degrees by which a node's channels may change
_HELPER = re.compile(r"(.*[:|])?ik_", re.IGNORECASE)


@dataclass(frozen=True)
class SceneNodes:
    """The nodes of a file.

    Parameters
    ----------
    bvh : the whole file
    above : the nodes, from the root on, each the parent of the next and the last that of the body
    joints : of the body, which follow each other in the file
    """

    bvh: Bvh
    above: tuple[int, ...]
    joints: slice

    @classmethod
    def of(cls, bvh: Bvh) -> "SceneNodes":
        """Find the nodes: without motion, with one child that has channels of its place."""
        above, root = list[int](), 0
        while True:
            children = [j for j, parent in enumerate(bvh.parents) if parent == root]
            bodies = [child for child in children if not _HELPER.match(bvh.joints[child])]
            if len(bodies) != 1 or not _is_node(bvh, root, bodies[0]):
                break
            above.append(root)
            root = bodies[0]
        end = next((j for j in range(root + 1, len(bvh.parents)) if bvh.parents[j] < root),
                   len(bvh.parents))  # fmt: skip
        return cls(bvh, tuple(above), slice(root, end))

    def body(self) -> Bvh:
        """Return the file without the nodes, in the frame of the last of them."""
        first, bvh = self.joints.start, self.bvh
        ends = range(*self.joints.indices(len(bvh.joints)))
        return replace(
            bvh,
            joints=bvh.joints[self.joints],
            parents=(-1, *(parent - first for parent in bvh.parents[self.joints][1:])),
            offsets=bvh.offsets[self.joints],
            channels=bvh.channels[self.joints],
            end_sites=tuple(end - first for end in bvh.end_sites if end in ends),
            motion=bvh.motion[:, self._columns],
        )

    def to_body(self, positions: Array) -> Array:
        """Transform positions (..., 3) in the file's world to the frame of ``body``."""
        if not self.above:
            return positions
        still = replace(self.bvh, motion=self.bvh.motion[:1])
        rotation = np.eye(3)
        for local in local_rotations(still)[0, list(self.above)]:
            rotation = rotation @ local
        place = still.positions()[0, self.above[-1]]
        return np.asarray((positions - place) @ rotation)

    def targets(self, targets: PointTargets) -> PointTargets:
        """Return targets of joints of the whole file, in its world, as those of the body."""
        shares = targets.shares[:, self.joints]
        return replace(targets, positions=self.to_body(targets.positions), shares=shares)

    def whole(self, body: Bvh, rows: Array) -> tuple[Bvh, Array]:
        """Put a body and its motion ``(T, C)`` in channels back into the file.

        What is beside the body keeps the file's motion, of its first frame if there are more or
        fewer frames.
        """
        own = self.bvh.motion
        motion = own.copy() if len(own) == len(rows) else np.repeat(own[:1], len(rows), axis=0)
        motion[:, self._columns] = rows
        offsets = self.bvh.offsets.copy()
        offsets[self.joints] = body.offsets
        return replace(self.bvh, offsets=offsets, frame_time=body.frame_time), motion

    @property
    def _columns(self) -> slice:
        """The columns of the body's channels."""
        counts = np.cumsum([0, *map(len, self.bvh.channels)])
        return slice(int(counts[self.joints.start]), int(counts[self.joints.stop]))


def _is_node(bvh: Bvh, joint: int, child: int) -> bool:
    """Whether a joint does not move, and its child says where it is."""
    counts = np.cumsum([0, *map(len, bvh.channels)])
    own = bvh.motion[:, counts[joint] : counts[joint + 1]]
    is_placed = sum(channel.endswith("position") for channel in bvh.channels[child]) == 3
    return is_placed and bool(np.ptp(own, axis=0).max(initial=0) < STILL)
