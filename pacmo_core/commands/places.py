"""Where a variation is worst: person, joint, frame and time.

Measurements are means, percentiles or maxima over frames (``interaction_mesh.report``); whoever
wants to mend a motion looks at the frame in which what they measure is largest. Turns of bones,
accelerations and depths below the floor are measured in single frames, of all joints and End Sites
of the files (``check_people``).
"""

from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.commands.captures import TwoPersonCapture
from pacmo_core.commands.motion_checks import MAX_BELOW
from pacmo_core.commands.peaks import (
    MAX_ACCELERATION,
    bone_names,
    bone_turns,
    find_peak,
    joint_accelerations,
    max_turn,
    when,
)
from pacmo_core.commands.reading import PEOPLE
from pacmo_core.commands.sample_table import format_range
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.figures.numbers import format_fixed
from pacmo_core.formats.registry import PersonMotion
from pacmo_core.interaction_mesh import Scene
from pacmo_core.interaction_mesh.mesh import support_steps
from pacmo_core.interaction_mesh.proximity import near_pairs, penetration_depths
from pacmo_core.interaction_mesh.report import (
    angle_changes,
    angle_joints,
    bend_flips,
    mean_accelerations,
    pelvis_rises,
    seams,
    spine_bends,
    trunk_errors,
)
from pacmo_core.interaction_mesh.scene import common_scale, naive_scaling, scale_scene

Array = NDArray[np.float64]
People = tuple[PersonMotion, PersonMotion]
TINY = float(np.finfo(np.float32).tiny)
# Of the capture's turn of the same bone in the same frame, as accelerations are limited to that
# share of the capture's (peak_acceleration_ratio in params.yaml).
MAX_TURN_RATIO = 1.3
MIN_LOSS = 1e-3  # metres, of a near distance: a capture itself is not more exact
MAX_PAIRS = 3  # of joints in ``near_pairs``


@dataclass(frozen=True)
class FrameCheck:
    """The worst single frame of a variation, of all joints and End Sites of the files.

    Parameters
    ----------
    value, limit : the measured value, and the largest that is wanted
    captured : what the capture itself has, in words
    place : person, joint or bone, frame and time
    """

    value: float
    limit: float
    captured: str
    place: str


@dataclass(frozen=True)
class FrameMeasure:
    """What a ``FrameCheck`` measures: label, unit and decimals, and what follows the limit."""

    label: str
    unit: str
    decimals: int
    meaning: str = ""

    def text(self, value: float) -> str:
        """Return a value with its unit."""
        return f"{format_fixed(value, self.decimals)}{self.unit}"

    def limit_text(self, check: FrameCheck) -> str:
        """Say the limit, and what the capture has."""
        return f"wanted at most {self.text(check.limit)}{self.meaning}, {check.captured}"


FRAME_MEASURES = {
    "turn": FrameMeasure("turn of a bone", "°", 1, " from one frame to the next"),
    "acceleration": FrameMeasure("joint acceleration", " m/s²", 0),
}


@dataclass(frozen=True)
class Places:
    """One variation beside its source, in which places are looked up.

    Parameters
    ----------
    scene : the source
    supports : (T, N) which joints support
    scales : (E,) of the bones of both, without the scale that both have in common
    motion : (T, N, 3) metres, without it too
    contact_distance, near_distance : metres, below which joints are in contact, and near
    worse : the person, 0 or 1, in whom each measurement of one person is worse
    """

    scene: Scene
    supports: NDArray[np.bool_]
    scales: Array
    motion: Array
    contact_distance: float
    near_distance: float
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

    @property
    def _motions(self) -> Array:
        """``(T, N, 3, 1)`` metres, as measurements want it."""
        return self.motion[..., None]

    def _nowhere(self) -> Array:
        return np.full(self.motion.shape[:2], -np.inf)

    def _angles(self, name: str) -> Array:
        faults, angle = self._nowhere(), name.removesuffix("_change_p95")
        for person in range(2):
            changes = angle_changes(self.scene, self._motions, person, angle)[..., 0]
            faults[:, angle_joints(self.scene, person, angle)] = changes
        return faults

    def _spine_bends(self, _name: str) -> Array:
        faults, (joints, bends) = self._nowhere(), spine_bends(self.scene, self._motions)
        for joint, bend in zip(joints, bends[..., 0].T, strict=True):
            faults[:, joint] = np.maximum(faults[:, joint], bend)
        return faults

    def _pelvis(self, _name: str) -> Array:
        faults = self._nowhere()
        for person in range(2):
            root = self._joints(person).start + self.scene.skeletons[person].root
            rises = pelvis_rises(self.scene, self.scales[None], self._motions, person)
            faults[:, root] = np.abs(rises[:, 0])
        return faults

    def _support_heights(self, _name: str) -> Array:
        change = np.abs(self.motion - self.scene.points)[..., 1]
        return np.where(self.supports, change, -np.inf)

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
        for person in range(2):
            joints = self._joints(person)
            source, body = self.scene.points[:, joints, :, None], self._motions[:, joints]
            if name == "seam_ratio":
                ratios = seams(source, body, self.scene.fps)
            else:
                ratios = mean_accelerations(body) / max(mean_accelerations(source).max(), TINY)
            frame = int(ratios.argmax())
            of_frame = of_joints[frame, joints]
            faults[frame, joints] = ratios[frame, 0] * of_frame / max(of_frame.max(), TINY)
        return faults

    def _lost_contact(self, _name: str) -> str:
        apart, place = self.contact_distance, ""
        for pairs in near_pairs(self.scene, self._motions, self.contact_distance):
            row = int(pairs.after.argmax()) if len(pairs.after) else 0
            if len(pairs.after) and pairs.after[row, 0] >= apart:
                apart = float(pairs.after[row, 0])
                two = self._two(pairs.joint_a[row], self.scene.n_joints[0] + pairs.joint_b[row])
                place = f"{two}, {100 * apart:.1f} cm apart {self._when(int(pairs.frame[row]))}"
        return place

    def near_pairs(self) -> list[str]:
        """Return the near pairs whose distances change most beyond what scaling changes.

        The worst first, each in its worst frame; a joint is in one of them.
        """
        both = np.stack(
            [self.motion, naive_scaling(self.scene, self.scales[None])[..., 0]], axis=-1
        )
        found = list(near_pairs(self.scene, both, self.near_distance))
        frames, first, second, captured, after = (
            np.concatenate(values)
            for values in zip(*(vars(pairs).values() for pairs in found), strict=True)
        )
        change, scaled = np.abs(after - captured[:, None]).T
        excess, texts = change - scaled, list[str]()
        while len(texts) < MAX_PAIRS and excess.max(initial=0.0) > MIN_LOSS:
            row = int(excess.argmax())
            apart, naive = 100 * after[row]
            texts.append(
                f"{self._two(first[row], self.scene.n_joints[0] + second[row])}, "
                f"{apart:.1f} cm apart {self._when(int(frames[row]))}, "
                f"{100 * captured[row]:.1f} cm in the capture, {naive:.1f} cm if only scaled"
            )
            excess[(first == first[row]) | (second == second[row])] = 0
        return texts

    def _deepest(self, _name: str) -> str:
        parts = np.split(self.motion.astype(np.float32), [self.scene.n_joints[0]], axis=1)
        moved = Scene((parts[0], parts[1]), self.scene.skeletons, self.scene.fps)
        before, after = (penetration_depths(one) for one in (self.scene, moved))
        added = after.max(axis=1).clip(min=0) - before.max(axis=1).clip(min=0)
        frame = int(added.argmax())
        n_a, n_b = self.scene.n_bones
        first, second = divmod(int(after[frame].argmax()), n_b)
        ends = self.scene.bones[[first, n_a + second], 1].tolist()
        return f"bones to {self._two(*ends)} {self._when(frame)}"

    def _trunk(self, _name: str) -> str:
        pairs, errors = trunk_errors(self.scene, self.scales[None], self._motions)
        i, j = pairs[int(errors.argmax())]
        return f"person {self._whose(i)}, {self._name(i)} and {self._name(j)}"

    def _first_flip(self, name: str) -> str:
        person, hinge = self.worse[name], name.removesuffix("_flips")

        def flips(n_frames: int) -> bool:
            scene, motion = self.scene.frames(slice(n_frames)), self.motion[:n_frames, :, :, None]
            return bool(bend_flips(scene, motion, person)[hinge] > 0)

        frame = bisect_left(range(1, len(self.motion) + 1), x=True, key=flips)
        return f"person {PEOPLE[person]}, first {self._when(frame)}"

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
        return when(frame, frame / self.scene.fps)


def check_people(
    duo: TwoPersonCapture,
    variations: Sequence[tuple[PersonMotion, PersonMotion]],
    bodies: Array,
    *,
    has_ends: bool,
) -> list[list[dict[str, FrameCheck]]]:
    """Find the worst frames of person a and person b of each variation, by name.

    Parameters
    ----------
    variations : all joints of both people in what was written
    bodies : (V, E) scales of the bones of both
    has_ends : whether the End Sites of BVH files are among the joints
    """
    whole = [
        duo.whole[row] if has_ends and duo.is_on_own_rig(row) else duo.people[row]
        for row in range(2)
    ]
    lowest = np.concatenate([person.motion[..., 1] for person in whole], axis=1).min(axis=1)
    turns = [_turns_of_bones(duo.people[row], duo.whole[row]) for row in range(2)]
    common = common_scale(duo.scene, bodies)
    checked = []
    for pair, scale in zip(variations, common, strict=True):
        checks = []
        for row, (own, person) in enumerate(zip(whole, pair, strict=True)):
            whom = f"person {PEOPLE[row]}, "
            motion = person.motion.astype(np.float64)[..., None]
            heights = scale_scene(duo.scene, motion, 1 / scale[None])[..., 1, 0]
            found = {
                "below_floor": _check_floor(whom, own, person, heights, float(np.median(lowest)))
            }
            if len(person.times) > 1:
                found["turn"] = _check_turns(whom, turns[row], person)
            if len(person.times) > 2:
                found["acceleration"] = _check_accelerations(whom, own, person)
            checks.append(found)
        checked.append(checks)
    return checked


def worst_of(checks: Sequence[FrameCheck]) -> FrameCheck:
    """Return the check that is farthest beyond its limit, or nearest to it."""
    return max(checks, key=lambda check: check.value / check.limit)


def _turns_of_bones(*people: PersonMotion) -> dict[tuple[str, str], Array]:
    """Return ``bone_turns`` of all bones of a person, each by its two joints."""
    return {
        (body.joints[parent], body.joints[child]): turns
        for person in people
        for body in [person.skeleton]
        for (parent, child), turns in zip(
            body.bones.tolist(), bone_turns(body, person.motion).T, strict=True
        )
    }


def _check_floor(
    whom: str, own: PersonMotion, person: PersonMotion, heights: Array, ground: float
) -> FrameCheck:
    """Compare the lowest joint or End Site with the capture's lowest: soles may be below its floor.

    Parameters
    ----------
    heights : (T, J) metres, of the person without the scale that both bodies have in common
    ground : metres, of the capture's floor
    """
    lowest = float(own.motion[..., 1].min())
    peak = find_peak(lowest - heights, person.skeleton.joints, person.times)
    captured = (
        f"from the capture's own lowest point, {100 * max(0.0, ground - lowest):.2f} cm below its "
        "floor"
    )
    depth = max(0.0, lowest - float(heights.min()))
    return FrameCheck(depth, MAX_BELOW, captured, f"{whom}{peak.joint} {peak.place}")


def _check_turns(
    whom: str, captured: Mapping[tuple[str, str], Array], person: PersonMotion
) -> FrameCheck:
    """Compare the turns of all bones with what people do, and with the capture's."""
    after = bone_turns(person.skeleton, person.motion)
    before = np.zeros_like(after)
    for column, child in enumerate(person.skeleton.bones[:, 1].tolist()):
        before[:, column] = _captured_turn(captured, person.skeleton, child)
    limits = np.maximum(max_turn(person.times), MAX_TURN_RATIO * before)
    peak = find_peak(after / limits, bone_names(person.skeleton), person.times)
    at = peak.row, peak.column
    return FrameCheck(
        float(after[at]),
        float(limits[at]),
        f"{format_fixed(before[at], 1)}° in the capture",
        f"{whom}bone to {peak.joint} {peak.place}",
    )


def _captured_turn(
    captured: Mapping[tuple[str, str], Array], body: Skeleton, child: int
) -> Array | float:
    """Return the capture's turn of the bone to a joint, or of the bone that carries it."""
    parent = body.parents[child]
    if parent < 0:
        return 0.0
    own = captured.get((body.joints[parent], body.joints[child]))
    return _captured_turn(captured, body, parent) if own is None else own


def _check_accelerations(whom: str, own: PersonMotion, person: PersonMotion) -> FrameCheck:
    """Compare the accelerations of all joints with what people do, and with the capture's."""
    before, after = (joint_accelerations(p.times, p.motion) for p in (own, person))
    peak, most = find_peak(after, person.skeleton.joints, person.times), float(before.max())
    return FrameCheck(
        float(after.max()),
        max(MAX_ACCELERATION, most),
        f"at most {most:.0f} m/s² in the capture",
        f"{whom}{peak.joint} {peak.place}",
    )


def captured_turn_lines(
    duo: TwoPersonCapture, variations: Sequence[tuple[PersonMotion, PersonMotion]]
) -> Iterator[str]:
    """Yield the largest turn of each person in the capture, where people do not turn like that."""
    for row, (label, own) in enumerate(zip(PEOPLE, duo.people, strict=True)):
        if len(own.times) < 2:
            return
        written = [_turns_of_bones(pair[row]) for pair in variations]
        captured = {
            bone: turns
            for bone, turns in _turns_of_bones(own, duo.whole[row]).items()
            if bone in written[0] and turns.max(initial=0.0) > max_turn(own.times)
        }
        if captured:
            bone = max(captured, key=lambda bone: captured[bone].max())
            peak = find_peak(captured[bone][:, None], bone[1:], own.times)
            after = format_range([float(turns[bone][peak.row]) for turns in written], 1)
            yield (
                f"  the capture itself turns a bone of person {label} by "
                f"{captured[bone].max():.1f}° {peak.place} (to {peak.joint}, {after}° in what was "
                "written): if it jumps there, mend the capture"
            )


# What is compared at each joint in each frame, by the name of the measurement: (T, N), or fewer
# frames of speeds; minus infinity where there is nothing to compare.
_FAULTS: dict[str, Callable[[Places, str], Array]] = {
    "knee_change_p95": Places._angles,
    "elbow_change_p95": Places._angles,
    "spine_change_p95": Places._angles,
    "spine_bend": Places._spine_bends,
    "pelvis_height_error": Places._pelvis,
    "support_height_error": Places._support_heights,
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
