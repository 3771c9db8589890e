"""What commands say of a motion: bones that turn fast, jolts; of a reaction also feet and depth.

Of the motion as it is in the files, all joints and End Sites. No captured reaction is needed:
limits are what captured people keep; those of heights, of the speed beside the partner's and of
crossed legs depend on the partner.
"""

from collections.abc import Sequence
from math import inf

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from pacmo_core.commands.peaks import (
    MAX_ACCELERATION,
    angles,
    bone_names,
    bone_turns,
    find_peak,
    joint_accelerations,
    max_turn,
    when,
)
from pacmo_core.commands.sample_table import (
    Measurement,
    format_range,
    limit_lines,
    table_lines,
    within_limits,
)
from pacmo_core.data.interaction import Motion
from pacmo_core.data.posture import measure_posture
from pacmo_core.data.segments import feet
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.figures.numbers import format_fixed
from pacmo_core.finish.body import MAX_SIZE_RATIO
from pacmo_core.finish.bones import leg_length, median_lengths
from pacmo_core.finish.floor import find_floor
from pacmo_core.finish.stance import find_stance
from pacmo_core.formats.registry import PersonMotion
from pacmo_core.formats.resample import frame_rate
from pacmo_core.interaction_mesh.proximity import penetration_depths
from pacmo_core.interaction_mesh.scene import MIN_LENGTH, Scene
from pacmo_core.metrics.plausibility import find_body_joints
from pacmo_core.metrics.touching import TouchName, has_hands, is_as_asked, least_gap, touches

# Metres: the bodies are modelled as capsules, and nine of ten captured dances, pushes and
# handshakes are up to 8 cm deep. SBU's captured hugs are 12 cm deep in the median.
MAX_DEPTH = 0.08
MAX_EMBRACE_DEPTH = 0.13
MIN_EMBRACE = 0.15  # metres between the pelvises: 0.15 to 0.48 in SBU's
# Metres, the same of the legs of one body: at most 6.5 cm in recorded dances, greetings, stretches
# and walks.
MAX_LEG_DEPTH = 0.07
# Metres below the floor, as in augment.limits of params.yaml.
MAX_BELOW = 0.01
# Metres by which the lowest point is above the partner's in half of the frames: 99 of 100 captured
# motions of the default are below 5.6 cm.
MAX_HOVER = 0.06
# Metres by which the feet of a person who stands differ in height, in the median frame: the pose.
MAX_FOOT_GAP = 0.05
# Metres per second: the mean speed of the slower foot, 99 of 100 captured motions are below 28.5
# cm/s.
MAX_GLIDE_SPEED = 0.3
# Times as fast as the reaction that the partner moves: 1.4 at most in recorded dances, greetings,
# stretches, push-ups and embraces, 2.7 in the default; whoever receives an object may stand still.
MAX_SPEED_RATIO = 3.0
MIN_SPEED = 0.03  # metres per second: who stands and breathes is no slower
STATURE = "stature by the legs, m"
LEAN = "lean of the trunk, °"
# Degrees by which a partner leans who bows, or was seen by a tilted camera: of SBU's people, in the
# axes of the floor, half lean by less than 9 in the median frame, of CMU's couple by less than 7.
MAX_LEAN = 15
# Frames in which samples are compared with each other.
N_COMPARED = 20
# Seconds, standard deviation of the kernel by which paths are smoothed.
SMOOTHING = 0.1

Array = NDArray[np.float64]


def motion_lines(
    skeleton: Skeleton,
    times: Array,
    partner: Motion,
    samples: Motion,
    people: Sequence[PersonMotion],
    sole: float = 0.0,
) -> list[str]:
    """Return a table of the measurements of all samples, and lines on those beyond a limit.

    Parameters
    ----------
    times : (T,) seconds, evenly spaced
    partner, samples : (T, J, 3) and (S, T, J, 3) metres
    people : the partner and each sample with all joints and End Sites of their files, which turn,
        accelerate and may be below the floor
    sole : metres by which the soles of the rig are lower, under its joints, than the partner's
    """
    rows, unmeasured = _measured(skeleton, times, partner, samples, people, sole)
    nearness, untouched = _nearness(skeleton, partner, samples)
    limits = [row for row in rows if row.limit < inf]
    alike = [_likeness(samples)] if len(samples) > 2 else []
    return [
        "the motion of the reaction, measured in what was written (docs/react.md):",
        *(f"  {line}" for line in [*table_lines([*rows, *nearness, *alike]), *unmeasured]),
        *_partner_lines(rows),
        *(line for row in alike for line in _most_alike(row, limits, untouched)),
        *limit_lines(limits, untouched),
    ]


def is_within_limits(skeleton: Skeleton, times: Array, partner: Motion, reaction: Motion) -> bool:
    """Return whether a reaction ``(T, J, 3)`` is within every limit, before it is on a rig."""
    people = [PersonMotion(skeleton, times, motion) for motion in (partner, reaction)]
    rows, _ = _measured(skeleton, times, partner, reaction[None], people, 0.0)
    return not any(row.beyond for row in rows)


def _measured(
    skeleton: Skeleton,
    times: Array,
    partner: Motion,
    samples: Motion,
    people: Sequence[PersonMotion],
    sole: float,
) -> tuple[list[Measurement], list[str]]:
    """Measure what may have a limit; return it, and lines on what cannot be measured."""
    rows = [*_postures(skeleton, partner, samples), _speed_ratios(times, partner, samples)]
    if ankles := list(find_body_joints(skeleton).ankles):
        rows.append(_glides(times, partner[:, ankles], samples[:, :, ankles]))
    if feet(skeleton):
        rows += _heights(skeleton, times, partner, samples, people, sole)
    unmeasured = []
    try:
        rows += _depths(skeleton, times, partner, samples)
    except ValueError as fault:
        unmeasured = [f"how deep the bodies are in each other is not measured ({fault})"]
    return [*rows, _jolts(times, people), _turns(times, people)], unmeasured


def _partner_lines(rows: Sequence[Measurement]) -> list[str]:
    """Say that the partner is beyond limits or leans, and that bodies are of other sizes."""
    lines = []
    beyond = [
        f"{row.name.rpartition(', ')[0]} {format_fixed(row.partner, row.decimals)}{row.unit}, "
        f"{row.partner_place}"
        for row in rows
        if row.partner is not None and row.partner_place and row.partner > row.limit
    ]
    if beyond:
        text = "; ".join(beyond)
        lines.append(f"the capture itself, noisy or very fast, is beyond limits: {text}")
    lines += [
        f"the partner's trunk leans by {row.partner:.0f}° in the median frame, as of who bows, "
        "sits or lies, or before a camera that was tilted (docs/react.md)"
        for row in rows
        if row.name == LEAN and row.partner is not None and round(row.partner) > MAX_LEAN
    ]
    sizes = [row for row in rows if row.name == STATURE and row.partner]
    ratios = [value / row.partner for row in sizes for value in row.values if row.partner]
    if any(not 1 / MAX_SIZE_RATIO <= ratio <= MAX_SIZE_RATIO for ratio in ratios):
        times = format_range(ratios, 2)
        lines.append(f"bodies are {times} times as tall as the partner (--body partner, --rig)")
    return lines


def _postures(skeleton: Skeleton, partner: Motion, samples: Motion) -> list[Measurement]:
    """Measure the size of the bodies, and how far trunks lean in the median frame."""
    found = [measure_posture(motion, skeleton) for motion in (partner, *samples)]
    postures = [posture for posture in found if posture]
    if len(postures) < len(found):
        return []
    up = np.array([0.0, 1.0, 0.0])
    size, *sizes = (posture.stature for posture in postures)
    lean, *leans = (float(np.median(angles(posture.trunk, up))) for posture in postures)
    return [
        Measurement(STATURE, sizes, decimals=2, partner=size),
        Measurement(LEAN, leans, decimals=0, partner=lean),
    ]


def _glides(times: Array, partner: Motion, samples: Motion) -> Measurement:
    """Measure the speed over the floor of the slower of the ankles ``(T, 2, 3)``."""
    own, *speeds = (100 * _glide(ankles, times) for ankles in (partner, *samples))
    return Measurement(
        "slower foot, cm/s",
        speeds,
        100 * MAX_GLIDE_SPEED,
        "the slower foot moves at {} on average",
        " cm/s",
        partner=own,
    )


def _heights(
    skeleton: Skeleton,
    times: Array,
    partner: Motion,
    samples: Motion,
    people: Sequence[PersonMotion],
    sole: float,
) -> tuple[Measurement, Measurement]:
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
    below = Measurement(
        "below the partner's lowest point, cm",
        [100 * max(0.0, float(depth.max())) for depth in depths],
        100 * (MAX_BELOW + sole),
        "the lowest joint or End Site is {} below the partner's lowest",
        " cm",
        [f"{peak.joint} {peak.place}" for peak in peaks],
    )
    usual = float(np.median(own.min(axis=1)))
    # A person who is seen by a tilted camera stands with one foot higher: the floor is between.
    sides = [list(foot) for foot in feet(people[0].skeleton)]
    soles = [float(np.median(own[:, side].min(axis=1))) for side in sides]
    slant = max(soles) - min(soles) if soles else 0.0
    slant = slant / 2 if slant > MAX_FOOT_GAP else 0.0
    above = Measurement(
        "above the partner's lowest point, cm",
        [
            100 * max(0.0, float(np.median(of.min(axis=1)) - usual * leg / own_leg))
            for leg, of in zip(legs, heights, strict=True)
        ],
        100 * (MAX_HOVER + slant),
        "in the median frame that lowest point is {} above the partner's",
        " cm",
    )
    return below, above


def _speed_ratios(times: Array, partner: Motion, samples: Motion) -> Measurement:
    """Compare the mean speed of the partner's joints with that of each sample's."""
    own = _mean_speed(partner, times)
    return Measurement(
        "partner's speed over the reaction's",
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


def _jolts(times: Array, people: Sequence[PersonMotion]) -> Measurement:
    """Measure the largest acceleration of a joint of each sample, and of the partner."""
    values, places = [], []
    for person in people:
        accelerations = joint_accelerations(times, person.motion)
        values.append(float(accelerations.max(initial=0.0)))
        peak = find_peak(accelerations, person.skeleton.joints, times) if values[-1] else None
        places.append(f"{peak.joint} {peak.place}" if peak else "")
    return Measurement(
        "acceleration of a joint, m/s²",
        values[1:],
        MAX_ACCELERATION,
        "a joint accelerates by {}",
        " m/s²",
        places[1:],
        0,
        values[0],
        places[0],
    )


def _turns(times: Array, people: Sequence[PersonMotion]) -> Measurement:
    """Measure the largest turn of a bone from a frame to the next, and the partner's."""
    every = [bone_turns(person.skeleton, person.motion) for person in people]
    own, *peaks = (
        find_peak(turns, bone_names(person.skeleton), times)
        for turns, person in zip(every, people, strict=True)
    )
    partner, *samples = every
    return Measurement(
        f"turn of a bone in 1/{frame_rate(times):.3g} s, °",
        [float(turns.max()) for turns in samples],
        max_turn(times),
        "a bone turns by {} from one frame to the next",
        "°",
        [f"that to {peak.joint} {peak.place}" for peak in peaks],
        partner=float(partner.max()),
        partner_place=f"that to {own.joint} {own.place}",
    )


def _glide(ankles: Motion, times: Array) -> float:
    """Return the mean horizontal speed of the slower ankle in metres per second."""
    return float(_speeds(ankles[..., [0, 2]], times).min(axis=1).mean())


def _depths(
    skeleton: Skeleton, times: Array, partner: Motion, samples: Motion
) -> list[Measurement]:
    """Measure how deep the bodies are in each other at most, and the legs of each sample.

    Raises
    ------
    ValueError
        If a body is none.
    """
    partner, samples = (_apart(motion, skeleton) for motion in (partner, samples))
    found = [_deepest(skeleton, times, partner, sample) for sample in samples]
    bodies = Measurement(
        "bodies in each other, cm",
        [100 * depth for depth, _ in found],
        100 * MAX_DEPTH,
        "the bodies are {} deep in each other",
        " cm",
        [place for _, place in found],
        limits={
            number: 100 * MAX_EMBRACE_DEPTH
            for number, sample in enumerate(samples)
            if is_embrace(skeleton, times, partner, sample)
        },
    )
    if len(feet(skeleton)) != 2:
        return [bodies]
    return [bodies, _crossed_legs(skeleton, times, partner, samples)]


def is_embrace(skeleton: Skeleton, times: Array, partner: Motion, sample: Motion) -> bool:
    """Whether each has a hand on the other's body at once, and a place of its own."""
    apart = np.linalg.norm(partner[:, skeleton.root] - sample[:, skeleton.root], axis=-1).min()
    return (
        apart >= MIN_EMBRACE
        and has_hands(skeleton)
        and is_as_asked(TouchName.embrace, skeleton, times, partner, sample)
    )


def _nearness(
    skeleton: Skeleton, partner: Motion, samples: Motion
) -> tuple[list[Measurement], list[int]]:
    """Measure how near the people come, and in how many frames which hands touch what.

    There is no limit: whether they should touch, no measurement knows.

    Returns
    -------
    Rows of the table, and the numbers of the samples in which neither's hand touches the other;
    none of people without hands
    """
    roots = np.linalg.norm(partner[:, skeleton.root] - samples[:, :, skeleton.root], axis=-1)
    nearest = [100 * least_gap(partner, sample) for sample in samples]
    rows = [
        Measurement("pelvises apart at least, m", roots.min(axis=1).tolist(), decimals=2),
        Measurement("nearest joints apart, cm", nearest),
        Measurement(
            "away from the partner after that, cm",
            [100 * _way(partner[:, skeleton.root], one[:, skeleton.root]) for one in samples],
            decimals=0,
        ),
    ]
    every_touch = touches(skeleton)
    if not every_touch:
        return rows, []
    frames = {
        touch.name: [int(touch.frames(partner, sample).sum()) for sample in samples]
        for touch in every_touch.values()
    }
    rows += [
        Measurement(f"frames of {len(partner)}: {name}", counts, decimals=0)
        for name, counts in frames.items()
    ]
    touched = np.any(list(frames.values()), axis=0)
    return rows, np.flatnonzero(~touched).tolist()


def _way(partner: Motion, person: Motion) -> float:
    """Return how far one moves away, once nearest, from where the other then is, in metres.

    Parameters
    ----------
    partner, person : (T, 3) metres, their pelvises
    """
    nearest = int(np.linalg.norm(partner - person, axis=-1).argmin())
    apart = np.linalg.norm((person[nearest:] - partner[nearest])[:, [0, 2]], axis=-1)
    return float(apart.max() - apart[0])


def _likeness(samples: Motion) -> Measurement:
    """Measure how far the joints of each sample are from those of the others, on average."""
    frames = np.linspace(0, samples.shape[1] - 1, N_COMPARED).round().astype(int)
    seen = samples[:, frames]
    sums = [np.linalg.norm(seen - one, axis=-1).mean(axis=(1, 2)).sum() for one in seen]
    apart = [100 * float(total) / (len(seen) - 1) for total in sums]
    return Measurement("apart from the other samples, cm", apart)


def _most_alike(
    likeness: Measurement, limits: Sequence[Measurement], untouched: Sequence[int]
) -> list[str]:
    """Name the sample that is nearest to all others; none if they are alike.

    Of those within every limit, and of those in which a hand touches if it does in half of them.
    """
    mostly_touches = 2 * len(untouched) <= len(likeness.values)
    within = [number for number in within_limits(limits) if (number in untouched) != mostly_touches]
    if len({likeness.range_of([number]) for number in within}) < 2:
        return []
    nearest = min(within, key=lambda number: likeness.values[number])
    return [f"most like the other samples: sample {nearest}"]


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
) -> Measurement:
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
    return Measurement(
        "legs in each other, cm",
        [100 * max(0.0, float(depths.max())) for depths in found],
        100 * max(MAX_LEG_DEPTH, float(own.max())),
        "the legs of the reaction are {} deep in each other",
        " cm",
        [f"bones to {peak.joint} {peak.place}" for peak in peaks],
        partner=100 * max(0.0, float(own.max())),
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
