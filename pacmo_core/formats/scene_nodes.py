"""Scene nodes of a BVH file: what is above the hips of a body, and helpers beside it.

Programs export the armature, a reference on the floor, or the root of a game's character, as the
root, and the hips below it, in Unreal beside targets of inverse kinematics (``ik_foot_root``). None
of them is a joint of the body: they are left out when a file is read, and keep their motion when
another motion is written on the file's hierarchy. A root that moves carries the hips with it: the
body has their motion in the world.
"""

import re
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pacmo_core.formats.bvh import Bvh
from pacmo_core.formats.bvh_channels import columns_of, displacements, local_rotations, rows_of
from pacmo_core.formats.inverse_kinematics import PointTargets, forward_kinematics, rotate_vectors
from pacmo_core.formats.rotations import continuous_euler_angles

Array = NDArray[np.float64]

STILL = 1e-3  # file units and degrees by which channels of a node that does not move may change
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
        """Find the nodes: with one child, which has channels of its own place and rotation."""
        above, root = list[int](), 0
        while True:
            children = [j for j, parent in enumerate(bvh.parents) if parent == root]
            bodies = [child for child in children if not _HELPER.match(bvh.joints[child])]
            if len(bodies) != 1 or not _is_placed(bvh.channels[bodies[0]]):
                break
            above.append(root)
            root = bodies[0]
        end = next((j for j in range(root + 1, len(bvh.parents)) if bvh.parents[j] < root),
                   len(bvh.parents))  # fmt: skip
        below = bvh.parents[root + 1 : end]
        if len(set(below)) == len(below):  # a chain alone, which is no body
            return cls(bvh, (), slice(0, len(bvh.parents)))
        return cls(bvh, tuple(above), slice(root, end))

    def body(self) -> Bvh:
        """Return the file without the nodes, in the frame of the last of them at the start."""
        first, bvh = self.joints.start, self.bvh
        ends = range(*self.joints.indices(len(bvh.joints)))
        body = replace(
            bvh,
            joints=bvh.joints[self.joints],
            parents=(-1, *(parent - first for parent in bvh.parents[self.joints][1:])),
            offsets=bvh.offsets[self.joints],
            channels=bvh.channels[self.joints],
            end_sites=tuple(end - first for end in bvh.end_sites if end in ends),
            motion=bvh.motion[:, self._columns],
        )
        if not self._moves:
            return body
        (place, turn), (start, first_turn) = self._node(), self._first()
        return replace(body, motion=_moved(body, (place - start) @ first_turn, first_turn.T @ turn))

    def to_body(self, positions: Array) -> Array:
        """Transform positions (..., 3) in the file's world to the frame of ``body``."""
        place, turn = self._first()
        return np.asarray((positions - place) @ turn)

    def targets(self, targets: PointTargets) -> PointTargets:
        """Return targets of joints of the whole file, in its world, as those of the body."""
        shares = targets.shares[:, self.joints]
        return replace(targets, positions=self.to_body(targets.positions), shares=shares)

    def whole(self, body: Bvh, rows: Array) -> tuple[Bvh, Array]:
        """Put a body and its motion ``(T, C)`` in channels back into the file.

        The nodes and what is beside the body keep the file's motion, of its first frame if there
        are more or fewer frames.
        """
        own = self.bvh.motion
        if len(own) == len(rows):
            motion = own.copy()
            if self._moves:
                (place, turn), (start, first_turn) = self._node(), self._first()
                back = turn.swapaxes(1, 2)
                rows = _moved(
                    replace(body, motion=rows),
                    rotate_vectors(back, start - place),
                    back @ first_turn,
                )
        else:
            motion = np.repeat(own[:1], len(rows), axis=0)
        motion[:, self._columns] = rows
        offsets = self.bvh.offsets.copy()
        offsets[self.joints] = body.offsets
        return replace(self.bvh, offsets=offsets, frame_time=body.frame_time), motion

    @property
    def _columns(self) -> slice:
        """The columns of the body's channels."""
        counts = np.cumsum([0, *map(len, self.bvh.channels)])
        return slice(int(counts[self.joints.start]), int(counts[self.joints.stop]))

    @property
    def _moves(self) -> bool:
        """Whether a node moves."""
        columns = [column for node, column, _ in columns_of(self.bvh) if node in self.above]
        return bool(np.ptp(self.bvh.motion[:, columns], axis=0).max(initial=0) > STILL)

    def _node(self) -> tuple[Array, Array]:
        """``(T, 3)`` and ``(T, 3, 3)``: place and rotation of the last node in the world."""
        nodes = list(self.above)
        moved = displacements(self.bvh, self.bvh.offsets)[:, nodes]
        turned = local_rotations(self.bvh)[:, nodes]
        chain = range(-1, len(nodes) - 1)
        places, turns = forward_kinematics(chain, moved[:, 0], moved, turned)
        return places[:, -1], turns[:, -1]

    def _first(self) -> tuple[Array, Array]:
        """``(3,)`` and ``(3, 3)``: those at the start."""
        if not self.above:
            return np.zeros(3), np.eye(3)
        places, turns = replace(self, bvh=replace(self.bvh, motion=self.bvh.motion[:1]))._node()
        return places[0], turns[0]


def _moved(body: Bvh, by: Array, turn: Array) -> Array:
    """``(T, C)``: a body's motion, each frame turned by (T, 3, 3) and then moved by (T, 3)."""
    columns = slice(len(body.channels[0]))
    root = replace(
        body,
        joints=body.joints[:1],
        parents=(-1,),
        offsets=body.offsets[:1],
        channels=body.channels[:1],
        end_sites=(),
        motion=body.motion[:, columns],
    )
    moved, local = displacements(root, root.offsets), local_rotations(root)
    moved[:, 0] = rotate_vectors(turn, moved[:, 0]) + by
    motion = body.motion.copy()
    motion[:, columns] = rows_of(root, moved, turn[:, None] @ local, continuous_euler_angles)
    return motion


def _is_placed(channels: tuple[str, ...]) -> bool:
    """Whether channels hold any place and any rotation."""
    return set(channels) == {f"{axis}{kind}" for axis in "xyz" for kind in ("position", "rotation")}
