"""Scene nodes of a BVH file: joints above a body that do not move.

Programs export the armature, or a reference on the floor, as the root, and the hips below it. Such
a node is no joint of the body: it is left out when a file is read, and stays as it is when a
motion is written on the file's hierarchy.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pacmo_core.formats.bvh import Bvh
from pacmo_core.formats.bvh_channels import local_rotations
from pacmo_core.formats.inverse_kinematics import PointTargets

Array = NDArray[np.float64]

STILL = 1e-3  # file units and degrees by which a node's channels may change


@dataclass(frozen=True)
class SceneNodes:
    """The nodes of a file.

    Parameters
    ----------
    bvh : the whole file
    count : the first joints of the file are nodes, each the parent of the next
    """

    bvh: Bvh
    count: int

    @classmethod
    def of(cls, bvh: Bvh) -> "SceneNodes":
        """Find the nodes: without motion, with one child each that has channels of its place."""
        count = 0
        while (
            bvh.parents.count(count) == 1
            and sum(channel.endswith("position") for channel in bvh.channels[count + 1]) == 3
            and np.ptp(bvh.motion[:, : _n_channels(bvh, count + 1)], axis=0).max(initial=0) < STILL
        ):
            count += 1
        return cls(bvh, count)

    def body(self) -> Bvh:
        """Return the file without the nodes, in the frame of the last of them."""
        n, bvh = self.count, self.bvh
        return replace(
            bvh,
            joints=bvh.joints[n:],
            parents=(-1, *(parent - n for parent in bvh.parents[n + 1 :])),
            offsets=bvh.offsets[n:],
            channels=bvh.channels[n:],
            end_sites=tuple(end - n for end in bvh.end_sites),
            motion=bvh.motion[:, _n_channels(bvh, n) :],
        )

    def to_body(self, positions: Array) -> Array:
        """Transform positions (..., 3) in the file's world to the frame of ``body``."""
        if not self.count:
            return positions
        still = replace(self.bvh, motion=self.bvh.motion[:1])
        rotation = np.eye(3)
        for local in local_rotations(still)[0, : self.count]:
            rotation = rotation @ local
        place = still.positions()[0, self.count - 1]
        return np.asarray((positions - place) @ rotation)

    def targets(self, targets: PointTargets) -> PointTargets:
        """Return targets of joints of the whole file, in its world, as those of the body."""
        shares = targets.shares[:, self.count :]
        return replace(targets, positions=self.to_body(targets.positions), shares=shares)

    def whole(self, body: Bvh, rows: Array) -> tuple[Bvh, Array]:
        """Put the nodes above a body and its motion ``(T, C)`` in channels."""
        n = _n_channels(self.bvh, self.count)
        still = np.repeat(self.bvh.motion[:1, :n], len(rows), axis=0)
        offsets = np.concatenate([self.bvh.offsets[: self.count], body.offsets])
        whole = replace(self.bvh, offsets=offsets, frame_time=body.frame_time)
        return whole, np.concatenate([still, rows], axis=1)


def _n_channels(bvh: Bvh, joints: int) -> int:
    """Count the channels of the first joints."""
    return sum(len(channels) for channels in bvh.channels[:joints])
