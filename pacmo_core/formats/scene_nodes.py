"""Scene nodes of a BVH file: what is above the hips of a body, and helpers beside it.

Programs export the armature, a reference on the floor, or the root of a game's character, as the
root, and the hips below it, in Unreal beside targets of inverse kinematics (``ik_foot_root``). None
of them is a joint of the body: they are left out when a file is read. A root that moves carries the
hips with it: the body has their motion in the world. Where a file's motion is changed, its nodes
keep theirs; where another motion is written on its hierarchy, a root that moves goes beneath the
hips.
"""

import re
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pacmo_core.formats.bvh import Bvh
from pacmo_core.formats.bvh_channels import columns_of, displacements, local_rotations, rows_of
from pacmo_core.formats.inverse_kinematics import PointTargets, forward_kinematics, rotate_vectors
from pacmo_core.formats.rotations import axis_rotations, continuous_euler_angles

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

    def whole(self, body: Bvh, rows: Array, up: int | None = None) -> tuple[Bvh, Array]:
        """Put a body and its motion ``(T, C)`` in channels back into the file.

        The nodes and what is beside the body keep the file's motion.

        Parameters
        ----------
        body : the body, whose offsets may have changed
        rows : its motion
        up : of another motion than the file's, of as many frames or not, the axis that is up: then
            the nodes keep that of the first frame, but for a last node that moves. It stands
            beneath the hips, and turns with them, as in the first frame
        """
        own = self.bvh.motion
        motion = own.copy() if up is None else np.repeat(own[:1], len(rows), axis=0)
        if self._moves:
            place, turn = self._node()
            if up is not None:
                place, turn = self._beneath(body, rows, up)
                columns = self._columns_of(self.above[-1])
                motion[:, columns] = self._last_node(motion[:, columns], place, turn)
            start, first_turn = self._first()
            back = turn.swapaxes(1, 2)
            there = rotate_vectors(back, start - place), back @ first_turn
            rows = _moved(replace(body, motion=rows), *there)
        motion[:, self._columns] = rows
        offsets = self.bvh.offsets.copy()
        offsets[self.joints] = body.offsets
        return replace(self.bvh, offsets=offsets, frame_time=body.frame_time), motion

    def _beneath(self, body: Bvh, rows: Array, axis: int) -> tuple[Array, Array]:
        """``(T, 3)`` and ``(T, 3, 3)``: where the last node stands beneath the hips of a motion."""
        start, first_turn = self._first()
        if not _is_placed(self.bvh.channels[self.above[-1]]):
            return np.tile(start, (len(rows), 1)), np.tile(first_turn, (len(rows), 1, 1))
        (place, turn), (first_place, first_hips) = (
            _root_of(replace(body, motion=motion)) for motion in (rows, self.body().motion[:1])
        )
        offset = first_turn @ first_place[0]  # of the hips from the node, in the world
        turned = first_turn @ turn @ first_hips[0].T @ first_turn.T
        quaternions = Rotation.from_matrix(turned).as_quat()
        heading = axis_rotations(
            axis, np.degrees(2 * np.arctan2(quaternions[:, axis], quaternions[:, 3]))
        )
        under = start + place @ first_turn.T - rotate_vectors(heading, offset[None])
        under[:, axis] = start[axis]
        return under, heading @ first_turn

    def _last_node(self, motion: Array, place: Array, turn: Array) -> Array:
        """``(T, C)``: channels of the last node for a place and a rotation in the world."""
        node = self.above[-1]
        alone = _alone(self.bvh, node, motion)
        parent_place, parent_turn = replace(self, above=self.above[:-1])._first()
        moved, local = ((place - parent_place) @ parent_turn)[:, None], parent_turn.T @ turn
        return rows_of(alone, moved, local[:, None], continuous_euler_angles)

    @property
    def _columns(self) -> slice:
        """The columns of the body's channels."""
        first, last = self._columns_of(self.joints.start), self._columns_of(self.joints.stop - 1)
        return slice(first.start, last.stop)

    def _columns_of(self, joint: int) -> slice:
        counts = np.cumsum([0, *map(len, self.bvh.channels)])
        return slice(int(counts[joint]), int(counts[joint + 1]))

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


def _alone(bvh: Bvh, joint: int, motion: Array) -> Bvh:
    """Return one joint as a file of its own, with a motion of its channels."""
    return replace(
        bvh,
        joints=(bvh.joints[joint],),
        parents=(-1,),
        offsets=bvh.offsets[[joint]],
        channels=(bvh.channels[joint],),
        end_sites=(),
        motion=motion,
    )


def _root_of(body: Bvh) -> tuple[Array, Array]:
    """``(T, 3)`` and ``(T, 3, 3)``: place and rotation of a body's root in its frame."""
    root = _alone(body, 0, body.motion[:, : len(body.channels[0])])
    return displacements(root, root.offsets)[:, 0], local_rotations(root)[:, 0]


def _moved(body: Bvh, by: Array, turn: Array) -> Array:
    """``(T, C)``: a body's motion, each frame turned by (T, 3, 3) and then moved by (T, 3)."""
    columns = slice(len(body.channels[0]))
    root = _alone(body, 0, body.motion[:, columns])
    place, local = _root_of(body)
    moved = rotate_vectors(turn, place) + by
    motion = body.motion.copy()
    motion[:, columns] = rows_of(
        root, moved[:, None], (turn @ local)[:, None], continuous_euler_angles
    )
    return motion


def _is_placed(channels: tuple[str, ...]) -> bool:
    """Whether channels hold any place and any rotation."""
    return set(channels) == {f"{axis}{kind}" for axis in "xyz" for kind in ("position", "rotation")}
