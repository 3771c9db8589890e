"""Where a measurement of a variation is worst: person, joint, frame and time.

Measurements are means, percentiles or maxima over frames (``interaction_mesh.report``); whoever
wants to mend a motion looks at the frame in which what they measure is largest.
"""

from bisect import bisect_left
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from pacmo_core.commands.reading import PEOPLE
from pacmo_core.interaction_mesh import Scene
from pacmo_core.interaction_mesh.body_parts import (
    ancestor_bones,
    capsule_radii,
    hinges,
    scene_bone_kinds,
    trunk_bends,
    trunk_joints,
)
from pacmo_core.interaction_mesh.capsules import closest_fractions
from pacmo_core.interaction_mesh.mesh import support_steps
from pacmo_core.interaction_mesh.report import (
    MEDIAN_SECONDS,
    bend_flips,
    mean_accelerations,
    seam_ratios,
)
from pacmo_core.interaction_mesh.scene import naive_scaling

Array = NDArray[np.float64]
TINY = float(np.finfo(np.float32).tiny)


@dataclass(frozen=True)
class Places:
    """One variation beside its source, in which places are looked up.

    Parameters
    ----------
    scene : the source
    supports : (T, N) which joints support
    scales : (E,) of the bones of both, without the scale that both have in common
    motion : (T, N, 3) metres, without it too
    contact_distance : metres, below which joints are in contact
    worse : the person, 0 or 1, in whom each measurement of one person is worse
    """

    scene: Scene
    supports: NDArray[np.bool_]
    scales: Array
    motion: Array
    contact_distance: float
    worse: Mapping[str, int]

    def text(self, name: str) -> str:
        """Return where what is measured, by its name in ``Report``, is worst; empty if nowhere."""
        place: str = _PLACES[name](self, name) if name in _PLACES else ""
        return place

    def _worst_joint(self, name: str) -> str:
        """Find the joint and the frame in which what a measurement is of is largest."""
        faults = _FAULTS[name](self, name)
        if name in self.worse:
            faults[:, self._joints(1 - self.worse[name])] = -np.inf
        if not np.isfinite(faults).any():
            return ""
        # Speeds and accelerations begin with that of frame 1.
        first = int(len(faults) < len(self.motion))
        row, point = (int(i) for i in np.unravel_index(faults.argmax(), faults.shape))
        return f"person {self._whose(point)}, {self._name(point)} {self._when(row + first)}"

    def _nowhere(self) -> Array:
        return np.full(self.motion.shape[:2], -np.inf)

    def _hinges(self, name: str) -> Array:
        faults = self._nowhere()
        pairs, names = hinges(self.scene)
        for (upper, lower), hinge in zip(pairs.tolist(), names, strict=True):
            if name.startswith(hinge):
                faults[:, self.scene.bones[lower, 0]] = np.abs(self._bend(upper, lower))
        return faults

    def _spine(self, name: str) -> Array:
        """Bends of the spine; of ``spine_change_p95`` those of bones on which both arms hang."""
        faults, is_change = self._nowhere(), name == "spine_change_p95"
        pairs, is_rigid = trunk_bends(self.scene)
        kinds, ancestors = scene_bone_kinds(self.scene), ancestor_bones(self.scene)
        arms = [row for row, kind in enumerate(kinds) if kind == "upper_arm"]
        n_arms = ancestors[self.scene.bones[arms, 0]].sum(axis=0)
        for first, second in pairs[~is_rigid].tolist():
            if not is_change or n_arms[second] > 1:
                bend, joint = self._bend(first, second), self.scene.bones[second, 0]
                faults[:, joint] = np.maximum(faults[:, joint], np.abs(bend) if is_change else bend)
        return faults

    def _pelvis(self, _name: str) -> Array:
        faults, ground = self._nowhere(), self.scene.ground_height
        for person in range(2):
            root = self._joints(person).start + self.scene.skeletons[person].root
            before, after = (m[:, root, 1] - ground for m in (self.scene.points, self.motion))
            faults[:, root] = np.abs(after - self._leg_scale(person) * before)
        return faults

    def _support_heights(self, _name: str) -> Array:
        change = np.abs(self.motion - self.scene.points)[..., 1]
        return np.where(self.supports, change, -np.inf)

    def _depths_in_floor(self, _name: str) -> Array:
        depths: Array = self.scene.levels.lowest - self.motion[..., 1]
        return depths

    def _skates(self, _name: str) -> Array:
        before, after = (
            np.linalg.norm(np.diff(motion[..., ::2], axis=0), axis=-1)
            for motion in (self.scene.points, self.motion)
        )
        return np.where(support_steps(self.supports), after - before, -np.inf)

    def _accelerations(self, name: str) -> Array:
        """Accelerations in the frame in which their mean over a person's joints is worst."""
        of_joints = np.linalg.norm(np.diff(self.motion, 2, axis=0), axis=-1)
        faults: Array = np.full_like(of_joints, -np.inf)
        if not len(faults):
            return faults
        radius = max(1, round(MEDIAN_SECONDS * self.scene.fps))
        for person in range(2):
            joints = self._joints(person)
            before, after = (
                mean_accelerations(motion[:, joints, :, None])
                for motion in (self.scene.points, self.motion)
            )
            if name == "seam_ratio":
                ratios = seam_ratios(after, radius) / np.maximum(1, seam_ratios(before, radius))
            else:
                ratios = after / max(before.max(), TINY)
            frame = int(ratios.argmax())
            of_frame = of_joints[frame, joints]
            faults[frame, joints] = ratios[frame, 0] * of_frame / max(of_frame.max(), TINY)
        return faults

    def _lost_contact(self, _name: str) -> str:
        n_a, worst = self.scene.n_joints[0], (0.0, 0, 0, 0)
        for joint in range(n_a):  # all pairs at once would take too much memory
            before, after = (
                np.linalg.norm(motion[:, n_a:] - motion[:, joint, None], axis=-1)
                for motion in (self.scene.points, self.motion)
            )
            lost = np.where(before < self.contact_distance, after, 0.0)
            row, other = (int(i) for i in np.unravel_index(lost.argmax(), lost.shape))
            worst = max(worst, (float(lost.max()), row, joint, n_a + other))
        apart, frame, first, second = worst
        if apart < self.contact_distance:
            return ""
        return f"{self._two(first, second)}, {100 * apart:.1f} cm apart {self._when(frame)}"

    def _deepest(self, _name: str) -> str:
        radii, n_a = capsule_radii(self.scene), self.scene.n_joints[0]
        n_bones = self.scene.n_bones
        reach = (radii[: n_bones[0], None] + radii[n_bones[0] :]).reshape(-1)
        parts = np.split(self.motion.astype(np.float32), [n_a], axis=1)
        moved = Scene((parts[0], parts[1]), self.scene.skeletons, self.scene.fps)
        before, after = (reach - closest_fractions(one)[2] for one in (self.scene, moved))
        added = after.max(axis=1).clip(min=0) - before.max(axis=1).clip(min=0)
        frame = int(added.argmax())
        first, second = divmod(int(after[frame].argmax()), n_bones[1])
        ends = self.scene.bones[[first, n_bones[0] + second], 1].tolist()
        return f"bones to {self._two(*ends)} {self._when(frame)}"

    def _trunk(self, _name: str) -> str:
        expected = naive_scaling(self.scene, self.scales[None])[..., 0]
        worst = (-1.0, 0, 0)
        for joints in trunk_joints(self.scene):
            for i, j in combinations(joints.tolist(), 2):
                own, wanted = (
                    np.linalg.norm(motion[:, i] - motion[:, j], axis=-1)
                    for motion in (self.motion, expected)
                )
                ratio = float(np.median(own / np.maximum(wanted, TINY)))
                worst = max(worst, (abs(ratio - 1), i, j))
        _, i, j = worst
        return f"person {self._whose(i)}, {self._name(i)} and {self._name(j)}"

    def _first_flip(self, name: str) -> str:
        person, hinge = self.worse[name], name.removesuffix("_flips")

        def flips(n_frames: int) -> bool:
            scene, motion = self.scene.frames(slice(n_frames)), self.motion[:n_frames, :, :, None]
            return bool(bend_flips(scene, motion, person)[hinge] > 0)

        frame = bisect_left(range(1, len(self.motion) + 1), x=True, key=flips)
        return f"person {PEOPLE[person]}, first {self._when(frame)}"

    def _bend(self, first: int, second: int) -> Array:
        """``(T,)`` degrees by which two bones bend further than in the source."""
        before, after = (
            _angles(*(_along(motion, self.scene.bones[row]) for row in (first, second)))
            for motion in (self.scene.points, self.motion)
        )
        return after - before

    def _leg_scale(self, person: int) -> float:
        kinds, first = scene_bone_kinds(self.scene), self.scene.n_bones[0] * person
        own = range(first, first + self.scene.n_bones[person])
        legs = [row for row in own if kinds[row] in ("thigh", "shin")] or list(own)
        lengths = np.linalg.norm(self.scene.bone_vectors[:, legs], axis=-1).mean(axis=0)
        return float(np.average(self.scales[legs], weights=lengths))

    def _joints(self, person: int) -> slice:
        n_a = self.scene.n_joints[0]
        return slice(n_a, n_a + self.scene.n_joints[1]) if person else slice(0, n_a)

    def _whose(self, point: int) -> str:
        return PEOPLE[point >= self.scene.n_joints[0]]

    def _name(self, point: int) -> str:
        a, b = (skeleton.joints for skeleton in self.scene.skeletons)
        return (*a, *b)[point]

    def _two(self, first: int, second: int) -> str:
        return f"{self._name(first)} of person a and {self._name(second)} of b"

    def _when(self, frame: int) -> str:
        return f"in frame {frame} ({frame / self.scene.fps:.2f} s)"


def _along(motion: Array, bone: NDArray[np.intp]) -> Array:
    along: Array = motion[:, bone[1]] - motion[:, bone[0]]
    return along


def _angles(first: Array, second: Array) -> Array:
    sine = np.linalg.norm(np.cross(first, second), axis=-1)
    angles: Array = np.degrees(np.arctan2(sine, (first * second).sum(axis=-1)))
    return angles


# What is compared at each joint in each frame, by the name of the measurement: (T, N), or fewer
# frames of speeds; minus infinity where there is nothing to compare.
_FAULTS: dict[str, Callable[[Places, str], Array]] = {
    "knee_change_p95": Places._hinges,
    "elbow_change_p95": Places._hinges,
    "spine_change_p95": Places._spine,
    "spine_bend": Places._spine,
    "pelvis_height_error": Places._pelvis,
    "support_height_error": Places._support_heights,
    "below_floor": Places._depths_in_floor,
    "added_foot_skate": Places._skates,
    "peak_acceleration_ratio": Places._accelerations,
    "seam_ratio": Places._accelerations,
}
_PLACES: dict[str, Callable[[Places, str], str]] = {
    **dict.fromkeys(_FAULTS, Places._worst_joint),
    "contacts_kept": Places._lost_contact,
    "capsule_penetration": Places._deepest,
    "trunk_change": Places._trunk,
    "knee_flips": Places._first_flip,
    "elbow_flips": Places._first_flip,
}
