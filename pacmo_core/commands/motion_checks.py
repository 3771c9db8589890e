"""What commands say of a motion: bones that turn fast, jolts; of a reaction also feet and depth.

Of the motion as it is in the files, all joints and End Sites. No captured reaction is needed: feet
and turns are compared with the partner's, the rest with limits that captured people keep. Means and
percentiles over time hide a jump in one frame, which everybody sees: bones and joints are named
with frame and time.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from pacmo_core.data.interaction import Motion
from pacmo_core.data.segments import feet, segments
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.figures.numbers import format_fixed
from pacmo_core.finish.bones import leg_length, median_lengths
from pacmo_core.finish.floor import find_floor
from pacmo_core.finish.stance import find_stance
from pacmo_core.formats.inverse_kinematics import CONTACT_DISTANCE
from pacmo_core.formats.registry import PersonMotion
from pacmo_core.formats.resample import frame_rate
from pacmo_core.interaction_mesh.capsules import penetration_depths
from pacmo_core.interaction_mesh.scene import MIN_LENGTH, Scene
from pacmo_core.metrics.plausibility import find_body_joints

# Metres per second squared, of a joint: 99 of 100 captured motions of the default stay below.
MAX_ACCELERATION = 150.0
# Degrees a second that a bone turns between two frames: 25 degrees at 30 frames a second. In 99.9 %
# of 30,000 recorded frames (salsa, acts, embraces, walking) none turns by more than 22.8 degrees,
# and by 24.2 at most in 46 of the 48 files; in the other two single markers flicker.
MAX_TURN_SPEED = 750.0
# Metres: a shorter bone, of which these turns move the end by 2 mm, has no turn. The last bones of
# a child's fingers are 14 mm long, and their tips are seen to jump.
MIN_BONE = 0.005
# Metres: the bodies are modelled as capsules, and captured hugs are up to 8 cm deep.
MAX_DEPTH = 0.08
# Metres, the same of the legs of one body: at most 6.5 cm in recorded dances, greetings, stretches
# and walks.
MAX_LEG_DEPTH = 0.07
# Metres below the floor, as in augment.limits of params.yaml.
MAX_BELOW = 0.01
# Metres by which the lowest point is above the partner's in half of the frames: 99 of 100 captured
# motions of the default are below 5.6 cm.
MAX_HOVER = 0.06
# Metres per second: the mean speed of the slower foot, 99 of 100 captured motions are below 28.5
# cm/s.
MAX_GLIDE_SPEED = 0.3
# Times as fast as the reaction that the partner moves: 1.4 at most in recorded dances, greetings,
# stretches, push-ups and embraces, 2.7 in the default; whoever receives an object may stand still.
MAX_SPEED_RATIO = 3.0
MIN_SPEED = 0.03  # metres per second: who stands and breathes is no slower
# Seconds, standard deviation of the kernel by which paths are smoothed.
SMOOTHING = 0.1
# Samples with a line each; more of them have one line together.
MAX_LINES = 4
# Numbers of samples in a line.
MAX_NUMBERS = 12

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SampleLimit:
    """A measurement of every sample, and its limit.

    Parameters
    ----------
    values : (S,) in the printed unit
    limit : the largest that is wanted
    text : what is measured, with ``{}`` in place of the value
    unit : of value and limit, with a space before it if there is one
    places : (S,) where each value is, such as its frame; empty if it is of the whole motion
    decimals : of the values
    """

    values: Sequence[float]
    limit: float
    text: str
    unit: str
    places: Sequence[str] = ()
    decimals: int = 1

    @property
    def wanted(self) -> str:
        """The limit, in words."""
        return f"wanted at most {self.limit:.3g}{self.unit}"

    @property
    def beyond(self) -> list[int]:
        """The numbers of the samples beyond the limit, the worst first."""
        order = np.argsort([-value for value in self.values], kind="stable").tolist()
        return [number for number in order if self.values[number] > self.limit]

    @property
    def is_beyond_in_all(self) -> bool:
        """Whether several samples are beyond the limit and none is within it."""
        return len(self.beyond) == len(self.values) > 1

    def said(self, numbers: Sequence[int]) -> str:
        """Return the measurement of some samples in words: one value, or least and greatest."""
        return self.text.format(self.range_of(numbers))

    def range_of(self, numbers: Sequence[int]) -> str:
        """Return one value, or the least and the greatest of some samples, with the unit."""
        # At least as many as the limit has: 7.63 beyond 7.61 would read 7.6.
        decimals = max(self.decimals, len(f"{self.limit:.3g}".partition(".")[2]))
        values = format_range([self.values[number] for number in numbers], decimals)
        return f"{values}{self.unit}"

    def lines(self) -> list[str]:
        """Return a line for each sample beyond the limit; one line if they are many, or all."""
        beyond, count = self.beyond, len(self.values)
        if len(beyond) <= MAX_LINES and not self.is_beyond_in_all:
            return [
                f"{self._sample(number, f': {self.said([number])}')}, {self.wanted}"
                for number in sorted(beyond)
            ]
        number_text = f"all {count}" if self.is_beyond_in_all else f"{len(beyond)} of {count}"
        worst = "; ".join(self._sample(number) for number in beyond[:MAX_LINES])
        more = "; ..." if beyond[MAX_LINES:] else ""
        texts = {self.range_of([number]) for number in beyond}
        order = "alike" if len(texts) == 1 else "the worst first"
        return [
            f"{number_text} samples: {self.said(beyond)}, {self.wanted} ({order}: {worst}{more})"
        ]

    def _sample(self, number: int, said: str = "") -> str:
        place = f", {self.places[number]}" if self.places else ""
        return f"sample {number}{said}{place}"


def limit_lines(limits: Sequence[SampleLimit], untouched: Sequence[int]) -> list[str]:
    """Return the lines of all limits, and one on what to do; one if all samples are within.

    Parameters
    ----------
    limits : at least one
    untouched : numbers of the samples in which no hand touches the partner
    """
    lines = [line for one in limits for line in one.lines()]
    count = len(limits[0].values)
    where = f"in {_samples(untouched)} " if len(untouched) < count else ""
    without = [f"{where}no hand touches the partner"] if untouched else []
    if not lines:
        those = f"all {count} samples are" if count > 1 else "the reaction is"
        return ["; ".join([f"{those} within every limit that was measured", *without])]
    part = "a part of the capture (pacmo export --seconds) or another one"
    if any(one.is_beyond_in_all for one in limits):
        hint = (
            f"where all samples are beyond a limit another --seed hardly helps: try {part}, or "
            "train on captures like this one (docs/react.md)"
        )
        return [*lines, "; ".join([*without, hint])]
    beyond = {number for one in limits for number in one.beyond}
    within = [number for number in range(count) if number not in beyond]
    within_text = [f"within every limit: {_samples(within)}"] if within else []
    other = (
        "other samples"
        if count > 1
        else f"another sample; where --samples 3 are all beyond it, try {part}"
    )
    return [*lines, "; ".join([*within_text, *without, f"another --seed gives {other}"])]


def _samples(numbers: Sequence[int]) -> str:
    return f"sample{'s' * (len(numbers) > 1)} {listed(numbers)}"


def listed(numbers: Sequence[object]) -> str:
    """List numbers of samples, or values of each, if they are not too many."""
    return f"{', '.join(map(str, numbers[:MAX_NUMBERS]))}{', ...' * bool(numbers[MAX_NUMBERS:])}"


def samples_of(texts: Sequence[str], worst: int) -> str:
    """Say which samples have the value of the worst, as values are printed.

    Returns
    -------
    ``sample 1`` or ``samples 0, 2``; ``all samples`` where values are alike; empty of one sample
    """
    same = [number for number, text in enumerate(texts) if text == texts[worst]]
    if len(texts) == 1:
        return ""
    if len(same) == len(texts):
        return "all samples"
    return _samples(same)


def format_range(values: Sequence[float], decimals: int) -> str:
    """Format one value, or the least and the greatest."""
    low, high = (format_fixed(value, decimals) for value in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"


@dataclass(frozen=True)
class Peak:
    """Where a measured value is greatest.

    Parameters
    ----------
    row, column : in the measured array
    joint : that accelerates, or at the end of the bone that turns
    frame : from 0; of a turn the second of the two frames
    time : seconds after the first frame
    """

    row: int
    column: int
    joint: str
    frame: int
    time: float

    @property
    def place(self) -> str:
        """Frame and time, in words."""
        return when(self.frame, self.time)


def when(frame: int, seconds: float) -> str:
    """Return a frame, counted from 0, and its time in words."""
    return f"in frame {frame} ({seconds:.2f} s)"


def find_peak(values: Array, joints: tuple[str, ...], times: Array) -> Peak:
    """Find the greatest of depths, ``bone_turns``, ``joint_accelerations`` or ratios of these.

    Parameters
    ----------
    values : (T, J), (T - 1, E) or (T - 2, J)
    joints : the name of each column
    times : (T,) seconds
    """
    row, column = (int(i) for i in np.unravel_index(values.argmax(), values.shape))
    # Turns and accelerations begin with that of frame 1.
    frame = row + int(len(values) < len(times))
    return Peak(row, column, joints[column], frame, float(times[frame] - times[0]))


def angles(first: Array, second: Array) -> Array:
    """Return the angles in degrees between vectors ``(..., 3)``."""
    sine = np.linalg.norm(np.cross(first, second), axis=-1)
    degrees: Array = np.degrees(np.arctan2(sine, (first * second).sum(axis=-1)))
    return degrees


def bone_turns(skeleton: Skeleton, motion: Motion) -> Array:
    """Return the turn of each bone from a frame to the next, ``(T - 1, E)`` degrees.

    Bones that are shorter than ``MIN_BONE`` have no turn.
    """
    ends = motion[:, skeleton.bones].astype(np.float64)
    bones = ends[:, :, 1] - ends[:, :, 0]
    turns = angles(bones[:-1], bones[1:])
    is_long = np.linalg.norm(bones, axis=-1).min(axis=0) >= MIN_BONE
    return np.where(is_long, turns, 0.0)


def max_turn(times: Array) -> float:
    """Return the largest turn from a frame to the next that people make, in degrees."""
    return MAX_TURN_SPEED / frame_rate(times)


def bone_names(skeleton: Skeleton) -> tuple[str, ...]:
    """Return the joint at the end of each bone."""
    return tuple(skeleton.joints[child] for child in skeleton.bones[:, 1].tolist())


def joint_accelerations(times: Array, motion: Motion) -> Array:
    """Return the acceleration of each joint between neighbouring frames, ``(T - 2, J)`` m/s²."""
    steps = np.diff(times)[:, None, None]
    velocity = np.diff(motion.astype(np.float64), axis=0) / steps
    change = np.diff(velocity, axis=0) / ((steps[1:] + steps[:-1]) / 2)
    accelerations: Array = np.linalg.norm(change, axis=-1)
    return accelerations


def motion_lines(
    skeleton: Skeleton,
    times: Array,
    partner: Motion,
    samples: Motion,
    people: Sequence[PersonMotion],
    sole: float = 0.0,
) -> list[str]:
    """Return a line for each measurement of all samples, and lines on those beyond its limit.

    Parameters
    ----------
    times : (T,) seconds, evenly spaced
    partner, samples : (T, J, 3) and (S, T, J, 3) metres
    people : the partner and each sample with all joints and End Sites of their files, which turn,
        accelerate and may be below the floor
    sole : metres by which the soles of the rig are lower, under its joints, than the partner's
    """
    every = range(len(samples))
    speeds = _speed_ratios(times, partner, samples)
    own = format_fixed(100 * _mean_speed(partner, times), 1)
    lines, limits = [f"{speeds.said(every)}, {speeds.wanted} (at {own} cm/s)"], [speeds]
    if ankles := list(find_body_joints(skeleton).ankles):
        own = format_fixed(100 * _glide(partner[:, ankles], times), 1)
        glide = SampleLimit(
            [100 * _glide(sample[:, ankles], times) for sample in samples],
            100 * MAX_GLIDE_SPEED,
            "the slower foot moves at {} on average",
            " cm/s",
        )
        limits.append(glide)
        lines.append(f"{glide.said(every)}, {glide.wanted} (the partner's at {own})")
    if feet(skeleton):
        below, above = _heights(skeleton, times, partner, samples, people, sole)
        limits += [below, above]
        lower = f"{100 * sole:.2f} cm by which the rig's soles are lower"
        of_rig = f" ({100 * MAX_BELOW:g} cm, and {lower})" if sole else ""
        lines.append(f"{below.said(every)}, {below.wanted}{of_rig}")
        lines.append(f"{above.said(every)}, {above.wanted}")
    try:
        depths = _depths(skeleton, times, partner, samples)
    except ValueError as fault:
        lines.append(f"how deep the bodies are in each other is not measured ({fault})")
    else:
        limits += depths
        lines += [
            f"{depth.text.format(f'at most {depth.range_of(every)}')}, {depth.wanted}"
            for depth in depths
        ]
    nearness, touches = _nearness(skeleton, times, partner, samples)
    jolt, (turn, most) = _jolts(times, people[1:]), _turns(times, people)
    text = f"joints accelerate by at most {format_range(jolt.values, 0)} m/s², {jolt.wanted}"
    lines += [nearness, text, most]
    limits += [jolt, turn]
    of_samples = f"; least and greatest of {len(samples)} samples" if len(samples) > 1 else ""
    return [
        f"the motion of the reaction, measured in what was written (docs/react.md){of_samples}:",
        *(f"  {line}" for line in lines),
        *limit_lines(limits, [number for number, frames in enumerate(touches) if not frames]),
    ]


def _heights(
    skeleton: Skeleton,
    times: Array,
    partner: Motion,
    samples: Motion,
    people: Sequence[PersonMotion],
    sole: float,
) -> tuple[SampleLimit, SampleLimit]:
    """Compare the lowest point of each sample with the partner's, in proportion to the legs.

    The first is how far it is below the partner's lowest in any frame, the second how far it is
    above the partner's in half of the frames: a body that floats. Over one floor the joints of a
    smaller person are lower. The floor is level: the slope of one that is fitted to a person in one
    place says nothing of another place.
    """
    fps = frame_rate(times)
    floor = find_floor(partner, find_stance(partner, fps, skeleton), skeleton).height
    own, *heights = (person.motion[..., 1].astype(np.float64) - floor for person in people)
    own_leg, *legs = (
        leg_length(median_lengths(motion, skeleton), skeleton) for motion in (partner, *samples)
    )
    depths = [own.min() * leg / own_leg - of for leg, of in zip(legs, heights, strict=True)]
    peaks = [
        find_peak(depth, person.skeleton.joints, times)
        for depth, person in zip(depths, people[1:], strict=True)
    ]
    below = SampleLimit(
        [100 * max(0.0, float(depth.max())) for depth in depths],
        100 * (MAX_BELOW + sole),
        "the lowest joint or End Site is {} below the partner's lowest",
        " cm",
        [f"{peak.joint} {peak.place}" for peak in peaks],
    )
    usual = float(np.median(own.min(axis=1)))
    above = SampleLimit(
        [
            100 * max(0.0, float(np.median(of.min(axis=1)) - usual * leg / own_leg))
            for leg, of in zip(legs, heights, strict=True)
        ],
        100 * MAX_HOVER,
        "in the median frame that lowest point is {} above the partner's",
        " cm",
    )
    return below, above


def _speed_ratios(times: Array, partner: Motion, samples: Motion) -> SampleLimit:
    """Compare the mean speed of the partner's joints with that of each sample's."""
    own = _mean_speed(partner, times)
    return SampleLimit(
        [own / max(_mean_speed(sample, times), MIN_SPEED) for sample in samples],
        MAX_SPEED_RATIO,
        "the partner's joints move {} as fast as those of the reaction, on average",
        " times",
    )


def _mean_speed(motion: Motion, times: Array) -> float:
    """Return the mean speed of all joints in metres per second."""
    return float(_speeds(motion, times).mean())


def _speeds(paths: Motion, times: Array) -> Array:
    """Return the speeds, ``(T - 1, J)`` metres per second, of smoothed paths ``(T, J, D)``."""
    fps = frame_rate(times)
    smooth = gaussian_filter1d(paths.astype(np.float64), SMOOTHING * fps, axis=0)
    speeds: Array = np.linalg.norm(np.diff(smooth, axis=0), axis=-1) * fps
    return speeds


def _jolts(times: Array, samples: Sequence[PersonMotion]) -> SampleLimit:
    """Compare the largest acceleration of each sample with that of people."""
    values, places = [], []
    for person in samples:
        accelerations = joint_accelerations(times, person.motion)
        values.append(float(accelerations.max(initial=0.0)))
        peak = find_peak(accelerations, person.skeleton.joints, times) if values[-1] else None
        places.append(f"{peak.joint} {peak.place}" if peak else "")
    return SampleLimit(values, MAX_ACCELERATION, "a joint accelerates by {}", " m/s²", places, 0)


def _turns(times: Array, people: Sequence[PersonMotion]) -> tuple[SampleLimit, str]:
    """Compare the largest turn of a bone from a frame to the next of each sample with people's.

    Returns
    -------
    It, and which bone of all samples turns most, beside the partner's most
    """
    partner, *samples = (bone_turns(person.skeleton, person.motion) for person in people)
    peaks = [
        find_peak(turns, bone_names(person.skeleton), times)
        for turns, person in zip(samples, people[1:], strict=True)
    ]
    limit = SampleLimit(
        [float(turns.max()) for turns in samples],
        max_turn(times),
        "a bone turns by {} from one frame to the next",
        "°",
        [f"that to {peak.joint} {peak.place}" for peak in peaks],
    )
    number = int(np.argmax(limit.values))
    peak, texts = peaks[number], [limit.range_of([row]) for row in range(len(samples))]
    of_sample = f" of {samples_of(texts, number)}" if len(samples) > 1 else ""
    return limit, (
        f"the bone to {peak.joint} turns most from one frame to the next, by "
        f"{limit.range_of([number])} {peak.place}{of_sample}, {limit.wanted} (the "
        f"partner's most: {format_fixed(partner.max(), 1)}°)"
    )


def _glide(ankles: Motion, times: Array) -> float:
    """Return the mean horizontal speed of the slower ankle in metres per second."""
    return float(_speeds(ankles[..., [0, 2]], times).min(axis=1).mean())


def _depths(
    skeleton: Skeleton, times: Array, partner: Motion, samples: Motion
) -> list[SampleLimit]:
    """Measure how deep the bodies are in each other at most, and the legs of each sample.

    Raises
    ------
    ValueError
        If a body is none.
    """
    partner, samples = (_apart(motion, skeleton) for motion in (partner, samples))
    found = [_deepest(skeleton, times, partner, sample) for sample in samples]
    bodies = SampleLimit(
        [100 * depth for depth, _ in found],
        100 * MAX_DEPTH,
        "the bodies are {} deep in each other",
        " cm",
        [place for _, place in found],
    )
    if len(feet(skeleton)) != 2:
        return [bodies]
    return [bodies, _crossed_legs(skeleton, times, partner, samples)]


def _nearness(
    skeleton: Skeleton, times: Array, partner: Motion, samples: Motion
) -> tuple[str, list[int]]:
    """Say how near the two people come, and in how many frames a hand touches the partner.

    There is no limit: whether they should touch, no measurement knows.

    Returns
    -------
    It, and the frames with such a touch in each sample; none of people without hands
    """
    found = [_distances(partner, sample) for sample in samples]  # (T, J) each
    nearest = [100 * float(distances.min()) for distances in found]
    number = int(np.argmin(nearest))
    frame, joint = (int(i) for i in np.unravel_index(found[number].argmin(), found[number].shape))
    other = np.linalg.norm(partner[frame] - samples[number, frame, joint], axis=-1).argmin()
    of_sample = f" of sample {number}" if len(samples) > 1 else ""
    text = (
        f"the nearest joints of the two are {format_range(nearest, 1)} cm apart "
        f"({skeleton.joints[joint]} and the partner's {skeleton.joints[other]} "
        f"{when(frame, times[frame] - times[0])}{of_sample})"
    )
    hands = _hands(skeleton)
    if not hands:
        return text, []
    touching = {
        side: np.array([(of[:, joints] < CONTACT_DISTANCE).any(axis=1) for of in found])
        for side, joints in hands.items()
    }
    touches = np.any(list(touching.values()), axis=0).sum(axis=1)
    every_hand = [joint for joints in hands.values() for joint in joints]
    hand_to_hand = [
        int((_distances(partner[:, every_hand], of[:, every_hand]) < CONTACT_DISTANCE).any(1).sum())
        for of in samples
    ]
    by_side = ", ".join(
        f"the {side} in {format_range(frames.sum(axis=1).tolist(), 0)}"
        for side, frames in touching.items()
    )
    page = "docs/react.md, Where a touch is missing"
    by_side += f"; hand to hand in {format_range(hand_to_hand, 0)}"
    hint = f" ({by_side})" if touches.any() else f"; where you expect a touch: {page}"
    said = (
        f"{text}; a hand of the reaction is within {100 * CONTACT_DISTANCE:.0f} cm of a joint of "
        f"the partner in {listed(touches.tolist())} of {len(times)} frames{hint}"
    )
    return said, touches.tolist()


def _hands(skeleton: Skeleton) -> dict[str, list[int]]:
    """Return the joints of each hand, from the wrist on, by its side."""
    hands: dict[str, list[int]] = {}
    for end, of in zip(skeleton.bones[:, 1].tolist(), segments(skeleton), strict=True):
        if of.part == "arm" and of.kind != "upper_arm":
            hands.setdefault(of.name.partition("_")[0], []).append(end)
    return hands


def _distances(partner: Motion, sample: Motion) -> Array:
    """Return the distance of each joint of a sample from the partner's nearest, ``(T, J)``."""
    by_joint = [np.linalg.norm(partner - joint[:, None], axis=-1).min(axis=1)
                for joint in np.moveaxis(sample, 1, 0)]  # fmt: skip
    return np.stack(by_joint, axis=1).astype(np.float64)


def _apart(motion: Motion, skeleton: Skeleton) -> Motion:
    """Raise a joint by millimetres that is where its parent is: depths need bones with lengths.

    Trackers put a neck between the shoulders, where the joint of the spine is too.
    """
    motion = motion.copy()
    for joint in skeleton.order[1:]:
        parent = motion[..., skeleton.parents[joint], :]
        bone = motion[..., joint, :] - parent
        is_none = np.linalg.norm(bone, axis=-1) < 2 * MIN_LENGTH
        raised = parent + np.array([0, 2 * MIN_LENGTH, 0], np.float32)
        motion[..., joint, :] = np.where(is_none[..., None], raised, motion[..., joint, :])
    return motion


def _crossed_legs(
    skeleton: Skeleton, times: Array, partner: Motion, samples: Motion
) -> SampleLimit:
    """Measure how deep a shin of each sample is in the other leg; the partner's, if that is more.

    Thighs, which begin beside each other, are not compared with each other.
    """
    shins = [foot[0] for foot in feet(skeleton)]
    thighs = [skeleton.parents[shin] for shin in shins]
    rows = {joint: row for row, joint in enumerate(skeleton.bones[:, 1].tolist())}
    pairs = [(shins[0], shins[1]), (shins[0], thighs[1]), (thighs[0], shins[1])]
    columns = [len(rows) * rows[left] + rows[right] for left, right in pairs]
    fps = frame_rate(times)
    own, *found = (
        penetration_depths(Scene((body, body), (skeleton, skeleton), fps))[:, columns]
        for body in (partner, *samples)
    )
    names = tuple(" and ".join(skeleton.joints[joint] for joint in pair) for pair in pairs)
    peaks = [find_peak(depths, names, times) for depths in found]
    return SampleLimit(
        [100 * max(0.0, float(depths.max())) for depths in found],
        100 * max(MAX_LEG_DEPTH, float(own.max())),
        "the legs of the reaction are {} deep in each other",
        " cm",
        [f"bones to {peak.joint} {peak.place}" for peak in peaks],
    )


def _deepest(
    skeleton: Skeleton, times: Array, partner: Motion, sample: Motion
) -> tuple[float, str]:
    """Return how deep the bodies are in each other at most, in metres, and where."""
    fps = frame_rate(times)
    scene = Scene((partner, sample), (skeleton, skeleton), fps)
    depths = penetration_depths(scene)
    frame, pair = (int(i) for i in np.unravel_index(depths.argmax(), depths.shape))
    names = bone_names(skeleton)
    own, others = names[pair % len(names)], names[pair // len(names)]
    place = f"bones to {own} and the partner's {others} {when(frame, times[frame] - times[0])}"
    return max(0.0, float(depths.max())), place
