"""What is wrong with captures that commands use all the same: bones, legs, axes, floors."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pacmo_core.data.interaction import Motion
from pacmo_core.data.posture import measure_posture
from pacmo_core.data.segments import feet, segments, trunk_pairs
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.finish.bones import leg_length, median_lengths
from pacmo_core.finish.stance import frame_runs
from pacmo_core.formats.registry import PersonMotion

# Metres by which the lowest points of one person stay above those of the other: at most 1 cm in
# optical captures of two people (dances, acts, embraces, a lift), more in 166 of the 200 of
# handover, and in 15 of the 282 of SBU.
MAX_FLOOR_GAP = 0.08
MIN_BONE_LENGTH = 1e-3  # metres
# Of the length of a leg: an ankle that stays this much above the other belongs to a leg that was
# not tracked. People who walk, dance or kick put it down.
MAX_RAISED = 0.3
# Cosine between the trunk and the upward axis below which a person lies, and the share of frames in
# which who lies may be upright.
MAX_LYING, LYING_EXCEPTIONS = 0.5, 0.05
# Frames one after the other that are equal to the bit: of a sensor that repeats each, two are.
MIN_STILL = 5
# Share of the frames in which toes may point ahead although left and right are exchanged.
MIRROR_EXCEPTIONS = 0.1
_PLURALS = {"trunk": "trunk", "arm": "arms", "leg": "legs", "foot": "feet"}


def doubts(files: Sequence[Path], people: Sequence[PersonMotion]) -> list[str]:
    """Return a line for each of them.

    Parameters
    ----------
    files : of each person
    people : of one world, metres, y up
    """
    by_person = list(zip(files, people, strict=True))
    texts = (_lost_text, _raised_text, _untracked_text, _mirrored_text)
    lines = [text(*one) for text in texts for one in by_person]
    lying = [_lying_text(*one) for one in by_person]
    lines += lying if all(lying) else []  # one of two may be carried
    if len(people) == 2:
        lines.append(_floors_text(files, people[0], people[1]))
    return list(dict.fromkeys(filter(None, lines)))


def _lost_text(file: Path, person: PersonMotion) -> str:
    """Say which bones of a person were lost; nothing if none was."""
    body = person.skeleton
    lost = lost_bones(body, person.motion)
    if not lost:
        return ""
    ends = {joint for joints in lost.values() for joint in joints}
    parts = {
        _PLURALS[segment.part]: None
        for child, segment in zip(body.bones[:, 1].tolist(), segments(body), strict=True)
        if body.joints[child] in ends
    }
    places = [f"{_listed(joints)} are at {place}" for place, joints in lost.items()]
    return (
        f"{file}: bones of length zero, as a conversion loses them: {'; '.join(places)}: "
        f"{_listed([*parts])} too short, and touches may be missed; wanted another conversion"
    )


def _raised_text(file: Path, person: PersonMotion) -> str:
    """Say that one foot is in the air throughout; nothing if none is, or legs have no names."""
    ankles = [foot[0] for foot in feet(person.skeleton)]
    if len(ankles) != 2:
        return ""
    heights = person.motion[:, ankles, 1].astype(np.float64)
    leg = leg_length(median_lengths(person.motion, person.skeleton), person.skeleton)
    for side, sign in enumerate((1, -1)):
        raised = float(np.quantile(sign * (heights[:, 0] - heights[:, 1]), 0.05))
        if raised > MAX_RAISED * leg:
            return (
                f"{file}: {person.skeleton.joints[ankles[side]]} is over {100 * raised:.0f} cm "
                "above the other throughout, as of a leg that was not tracked: bodies get in its "
                "way; wanted another capture or the other person"
            )
    return ""


def _untracked_text(file: Path, person: PersonMotion) -> str:
    """Say in which frames a person was not tracked: all joints in one place, or as before."""
    motion = person.motion.astype(np.float64)
    if len(motion) < 2 or len(person.skeleton.joints) < 2:
        return ""
    is_point = np.ptp(motion, axis=1).max(axis=-1) < MIN_BONE_LENGTH
    is_still = np.concatenate([[False], (motion[1:] == motion[:-1]).all(axis=(1, 2))])
    is_still &= not (motion == motion[0]).all()  # a rig in its rest pose
    texts = {
        "all joints of a person are in one place": frame_runs(is_point),
        "a person does not move at all": [
            run for run in frame_runs(is_still) if run.stop - run.start >= MIN_STILL
        ],
    }
    return "; ".join(
        f"{file}: {text} in {sum(run.stop - run.start for run in runs)} frames, the first of them "
        f"{runs[0].start} ({person.times[runs[0].start]:.2f} s): tracking was lost there"
        for text, runs in texts.items()
        if runs
    )


def _mirrored_text(file: Path, person: PersonMotion) -> str:
    """Say that left and right are exchanged: by the toes, the left hip is on the right."""
    body, motion = person.skeleton, person.motion.astype(np.float64)
    # Of the joints beyond an ankle, the farthest: another is a heel.
    toes = [
        (
            foot[0],
            max(foot[1:], key=lambda j: np.ptp(motion[:, [foot[0], j]][..., [0, 2]], 1).sum()),
        )
        for foot in feet(body)
        if len(foot) > 1
    ]
    hips = [(a, b) for a, b in trunk_pairs(body) if body.parents[a] == body.parents[b]]
    posture = measure_posture(person.motion, body)
    if len(toes) != 2 or not hips or posture is None:
        return ""
    upright = posture.trunk[:, 1] > MAX_LYING
    ahead = np.sum([motion[:, toe] - motion[:, ankle] for ankle, toe in toes], axis=0)
    lateral = np.sum([motion[:, left] - motion[:, right] for left, right in hips], axis=0)
    # Left is up x ahead.
    sign = lateral[:, 0] * ahead[:, 2] - lateral[:, 2] * ahead[:, 0]
    if not upright.any() or not (sign[upright] < 0).mean() > 1 - MIRROR_EXCEPTIONS:
        return ""
    return (
        f"{file}: toes point backwards throughout: left and right joints are exchanged, or one "
        "axis of the capture is mirrored, as in a left-handed export; wanted a right-handed one"
    )


def _lying_text(file: Path, person: PersonMotion) -> str:
    """Say that a trunk is never upright; nothing if it is, or arms and legs have no names."""
    posture = measure_posture(person.motion, person.skeleton)
    if posture is None or (np.abs(posture.trunk[:, 1]) > MAX_LYING).mean() > LYING_EXCEPTIONS:
        return ""
    return (
        f"{file}: the trunk of a person is nearer to the floor's plane than to the axis that is "
        "stated to be up, in nearly every frame: who does not lie there was captured with "
        "another upward axis; wanted it stated (up in the table, or --from-up)"
    )


def _floors_text(files: Sequence[Path], a: PersonMotion, b: PersonMotion) -> str:
    """Say that two people are not on one floor; nothing if they are, or their joints differ."""
    if a.skeleton.joints != b.skeleton.joints:
        return ""  # the lowest joints of one rig are toes, of another ankles
    above, gap = floor_gap(a.motion, b.motion)
    if gap <= MAX_FLOOR_GAP:
        return ""
    low, high = ("b", "a") if above > 0 else ("a", "b")
    text = " and ".join(dict.fromkeys(map(str, files)))
    return (
        f"{text}: the lowest point of person {low} is {100 * abs(above):.0f} cm below that of "
        f"{high} in the median frame, and by over {100 * MAX_FLOOR_GAP:.0f} cm throughout: two "
        f"floors or a slanted one, unless {high} is carried or stands on something"
    )


def _listed(names: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))


def lost_bones(skeleton: Skeleton, motion: Motion) -> dict[str, list[str]]:
    """Find bones that a conversion lost: the joints that are at a joint's own place, by its name.

    A joint that coincides with its parent is a helper where other bones leave the same parent. Lost
    is the bone of a joint that all its children coincide with, some of which lead on. At the hips,
    where the body branches first, rigs have several joints in one place.

    Parameters
    ----------
    motion : (T, J, 3) metres
    """
    children: dict[int, list[int]] = {joint: [] for joint in skeleton.order}
    for parent, child in skeleton.bones.tolist():
        children[parent].append(child)
    hips = skeleton.root
    while len(children[hips]) == 1:
        hips = children[hips][0]

    def coincide(one: int, other: int) -> bool:
        distances = np.linalg.norm(motion[:, one] - motion[:, other], axis=-1)
        return bool((distances < MIN_BONE_LENGTH).all())

    return {
        skeleton.joints[joint]: [skeleton.joints[child] for child in beyond]
        for joint, beyond in children.items()
        if len(beyond) > 1
        and any(children[child] for child in beyond)
        and all(coincide(joint, child) for child in beyond)
        and not coincide(joint, hips)
    }


def floor_gap(first: Motion, second: Motion) -> tuple[float, float]:
    """Compare the lowest points of two people of the same joints, ``(T, J, 3)`` metres, y up.

    Returns
    -------
    By how many metres the first's is above the second's, in the median frames, and by how many the
    higher one stays above the lower one throughout, but for a twentieth of the frames of each.
    """
    a, b = (
        np.quantile(motion[..., 1].min(axis=1), (0.05, 0.5, 0.95)) for motion in (first, second)
    )
    return float(a[1] - b[1]), float(max(a[0] - b[2], b[0] - a[2]))
