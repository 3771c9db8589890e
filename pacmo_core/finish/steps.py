"""Steps in place of glides: a body that travels or turns on feet that both slide is let walk.

A generator's mean over gaits in and out of step has none: both feet slide along beneath the body.
Where both slide on the floor, far, they take steps in turn instead. Each foot stands until its
turn, is lifted to its next place, and stands again. Places are those at which the foot would be in
the middle of its stance, beneath the body as it travels and turns; it leaves from and arrives at
those of the generated motion. Legs follow by inverse kinematics. The mean over moments at which
people set out goes in jerks, which no steps can follow: so the body goes more evenly meanwhile.
A single foot that goes to another place close to the floor is lifted.
"""

from math import ceil

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, maximum_filter1d, minimum_filter1d

from pacmo_core.data.segments import feet
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.finish.bones import leg_joints, leg_length, set_bone_lengths, set_legs
from pacmo_core.finish.stance import frame_runs
from pacmo_core.finish.turns import find_headings, smooth_step, turned

Array = NDArray[np.float64]

SMOOTHING = 0.08  # seconds, standard deviation of the filter on the ankles' paths
GLIDE_SPEED = 0.12  # metres per second, of the slower foot
MIN_GLIDE = 0.25  # metres that both feet slide before they step instead
MAX_PAUSE = 0.15  # seconds for which a glide may rest
# Before or after, within which the lower foot comes down to the floor: that of a camera that is
# tilted rises along the way, by as much as a foot is lifted.
FLOOR_SECONDS = 0.3
MAX_LIFT = 0.1  # metres above that height, up to which a foot slides; a higher one is lifted
# Length of a step ahead, metres, by steps a second: people who walk faster take longer steps, and
# more of them, in proportion: 0.0065 m by steps a minute (Sekiya and Nagasaki 1998,
# *Reproducibility of the walking patterns of normal young adults*).
WALK_RATIO = 0.39
# Of a step ahead, by which feet part at most, of a body that goes straight on. They then do as
# captured ones: by 0.27 m on average of a walk (0.28).
MAX_PARTING = 1.8
# Of the legs' length, by which feet part at most: more steps are taken in turns, in which they
# would lunge (captured feet: 0.73 in 99 % of frames); none faster than, in seconds:
MAX_STRIDE, FASTEST_STEP = 0.9, 0.2
# Of one step, at most: how far the body goes aside, metres, and turns, radians; and its time.
MAX_ASIDE, MAX_TURN = 0.22, np.pi / 4
MIN_APART = 0.1  # metres that the left foot stands to the left of the right one
MIN_SECONDS, MAX_SECONDS = 0.3, 0.7
MIN_PROGRESS = 0.3  # of the mean speed, at which steps go on while the body rests
STEP_HEIGHT = 0.08  # metres
# Speed of a foot, metres per second, above which it is lifted, and the lift for the speed beyond.
LIFT_SPEED, LIFT_SECONDS = 0.1, 0.2
SWING_SECONDS = 0.1  # within which a foot that steps is lifted
# Of a joint of legs that step, in metres per second (squared), within the peaks of captured walks,
# lightly smoothed: over 142 people of the default 5.4 and 70 in the median, 6.6 and 93 at the 90th
# percentile. A body that is faster glides on.
MAX_SPEED, MAX_ACCELERATION = 5.5, 100.0
EVEN_SECONDS = 0.2  # standard deviation of the filter on the path of a body that glides
SLACK = 0.02  # of the legs' length, of ``set_legs``
FADE_SECONDS = 0.15  # from steps to a glide


def take_steps(motion: Array, lengths: Array, fps: float, skeleton: Skeleton) -> Array:
    """Let feet step where both glide, and lift a foot that is dragged; others are unchanged.

    Parameters
    ----------
    motion : (T, J, 3) metres, y up
    lengths : (E,) metres, of the bones
    fps : frames per second
    skeleton : of the motion; without two feet the motion is unchanged

    Returns
    -------
    (T, J, 3) metres
    """
    if len(feet(skeleton)) != 2 or len(motion) < 2:
        return motion
    headings = find_headings(motion, fps, skeleton)
    legs = leg_joints(skeleton)
    change = np.zeros((*motion.shape[:1], len(legs), 3))
    motion = motion.copy()
    for glide in find_glides(motion, fps, skeleton):
        motion[glide] += _evening(motion[glide, skeleton.root], fps)[:, None]
        wanted = _stepping(motion[glide], headings[glide], lengths, fps, skeleton)
        change[glide] = _change(motion[glide], wanted, lengths, skeleton)
    if change.any():
        motion[:, legs] += _share(motion[:, legs], change, fps)[:, None, None] * change
    lifted = motion.copy()
    for foot, rise in zip(feet(skeleton), find_lift(motion, fps, skeleton).T, strict=True):
        lifted[:, list(foot), 1] += rise[:, None]
    motion[:, legs] += _change(motion, lifted, lengths, skeleton)
    return motion


def _change(motion: Array, wanted: Array, lengths: Array, skeleton: Skeleton) -> Array:
    """``(T, K, 3)`` metres: how legs change if feet are where they are wanted, not where they are.

    The rest of the body stays: its bones are not yet of their lengths.
    """
    nowhere, before = (
        np.full(motion.shape[:2], -np.inf),
        set_bone_lengths(motion, lengths, skeleton),
    )
    after = before.copy()
    for body, places in ((before, motion), (after, wanted)):
        set_legs(body, places, nowhere, lengths, skeleton, SLACK)
    return np.asarray((after - before)[:, leg_joints(skeleton)])


def find_lift(motion: Array, fps: float, skeleton: Skeleton) -> Array:
    """``(T, 2)`` metres by which each of two feet must be lifted, so that it is not dragged.

    A generated foot that goes to another place does so close to the floor. The faster of the two is
    lifted with its speed, up to the height of a step; one that is higher stays as it is.

    Parameters
    ----------
    motion : (T, J, 3) metres
    fps : frames per second
    skeleton : of the motion, with two feet
    """
    path = _ankle_paths(motion, fps, skeleton)
    speed = np.linalg.norm(np.gradient(path[..., [0, 2]], 1 / fps, axis=0), axis=-1)
    lift = _lifts(path, fps)
    faster = (2 * (speed - speed[:, ::-1]) / np.maximum(speed, 1e-9)).clip(0, 1)
    wanted = faster * (LIFT_SECONDS * (speed - LIFT_SPEED)).clip(0, STEP_HEIGHT)
    # A foot in the middle of a step is lifted soon, if it is not yet.
    soon = maximum_filter1d(lift, 2 * round(SWING_SECONDS * fps) + 1, axis=0, mode="nearest")
    missing = np.maximum(wanted - soon, 0)
    return np.asarray(gaussian_filter1d(missing, SMOOTHING / 2 * fps, axis=0, mode="nearest"))


def find_glides(motion: Array, fps: float, skeleton: Skeleton) -> list[slice]:
    """List the frames in which both feet slide over the floor so far that they should step.

    Parameters
    ----------
    motion : (T, J, 3) metres
    fps : frames per second
    skeleton : of the motion
    """
    if len(feet(skeleton)) != 2 or len(motion) < 2:
        return []
    path = _ankle_paths(motion, fps, skeleton)
    speed = np.linalg.norm(np.gradient(path[..., [0, 2]], 1 / fps, axis=0), axis=-1)
    lift = _lifts(path, fps)
    slides = (speed.min(axis=1) > GLIDE_SPEED) & (lift.max(axis=1) < MAX_LIFT)
    found: list[slice] = []
    end = 0
    for first, stop in _joined_runs(slides, round(MAX_PAUSE * fps)):
        if (speed[first:stop].sum(axis=0) / fps).min() < MIN_GLIDE:
            continue
        part = motion[first:stop]
        headings = find_headings(part, fps, skeleton)
        n_steps = _count_steps(part[:, skeleton.root], headings, fps)
        more = max(0, round((n_steps * MIN_SECONDS * fps - (stop - first)) / 2))
        first, stop = max(end, first - more), min(len(motion), stop + more)
        if stop - first > 1:
            found.append(slice(first, stop))
            end = stop
    return found


def _ankle_paths(motion: Array, fps: float, skeleton: Skeleton) -> Array:
    """``(T, 2, 3)`` metres, smoothed."""
    ankles = [foot[0] for foot in feet(skeleton)]
    path: Array = gaussian_filter1d(
        motion[:, ankles].astype(np.float64), SMOOTHING * fps, axis=0, mode="nearest"
    )
    return path


def _lifts(path: Array, fps: float) -> Array:
    """``(T, 2)`` metres of ankles ``(T, 2, 3)`` over where the lower one comes down nearby."""
    reach = 2 * round(FLOOR_SECONDS * fps) + 1
    floor = minimum_filter1d(path[..., 1].min(axis=1), reach, mode="nearest")
    return np.asarray(path[..., 1] - floor[:, None])


def _joined_runs(mask: NDArray[np.bool_], pause: int) -> list[tuple[int, int]]:
    """List the first frame and the end of runs, those joined that are a pause apart at most."""
    joined: list[tuple[int, int]] = []
    for run in frame_runs(mask):
        if joined and run.start - joined[-1][1] <= pause:
            joined[-1] = (joined[-1][0], run.stop)
        else:
            joined.append((run.start, run.stop))
    return joined


def _demand(root: Array, headings: Array, fps: float) -> Array:
    """``(T - 1,)``: how many steps each frame's way takes.

    No step takes less than the shortest time: where the body is too fast, steps are longer.

    Parameters
    ----------
    root : (T, 3) metres
    headings : (T,) radians
    fps : frames per second
    """
    path = gaussian_filter1d(root[:, [0, 2]], EVEN_SECONDS * fps, axis=0, mode="nearest")
    way, angle = np.diff(path, axis=0), (headings[1:] + headings[:-1]) / 2
    aside = way[:, 0] * np.sin(angle) + way[:, 1] * np.cos(angle)
    ahead = way[:, 0] * np.cos(angle) - way[:, 1] * np.sin(angle)
    walked = np.sqrt(np.abs(ahead) / fps / WALK_RATIO)
    shares = walked, aside / MAX_ASIDE, np.diff(headings) / MAX_TURN
    demand: Array = np.minimum(np.linalg.norm(shares, axis=0), 1 / (MIN_SECONDS * fps))
    return demand


def _count_steps(root: Array, headings: Array, fps: float) -> int:
    """Count the steps of both feet that a way takes: so many that these do not part too far.

    If each foot takes one step they part by the whole way; with three steps by half of it, and with
    more by half again as much as one step's share, in the first and the last one. A body that goes
    aside takes as many with the foot that follows as with the one that leads, which it would cross.

    Parameters
    ----------
    root : (T, 3) metres
    headings : (T,) radians
    fps : frames per second
    """
    way = float(_demand(root, headings, fps).sum()) / MAX_PARTING
    least = 2 if way <= 1 else 3 if way <= 2 else ceil(1.5 * way)
    n_steps = max(least, ceil(len(root) / fps / MAX_SECONDS))
    lefts = np.array([_left(heading) for heading in headings])
    aside = np.abs(lefts @ (root[-1] - root[0])).max()
    return n_steps + n_steps % 2 if aside > MAX_ASIDE else n_steps


def _stepping(
    motion: Array, headings: Array, lengths: Array, fps: float, skeleton: Skeleton
) -> Array:
    """Return a motion ``(T, J, 3)`` of which the feet step; its other joints are as they were.

    Of the numbers of steps that are possible, the first with which feet do not part too far, else
    that with which they part least.
    """
    root, ankles = motion[:, skeleton.root], [foot[0] for foot in feet(skeleton)]
    progress = _progress(_demand(root, headings, fps))
    most = MAX_STRIDE * leg_length(lengths, skeleton)
    found: list[tuple[float, Array]] = []
    n_steps = _count_steps(root, headings, fps)
    while not found or _fastest(progress, n_steps, fps) >= FASTEST_STEP:
        walk = _walk(motion, headings, progress, n_steps, fps, skeleton)
        parting = np.linalg.norm((walk[:, ankles[0]] - walk[:, ankles[1]]) * [1, 0, 1], axis=1)
        found.append((float(parting.max()), walk))
        if found[-1][0] <= most:
            return walk
        n_steps += 1
    return min(found, key=lambda one: one[0])[1]


def _fastest(progress: Array, n_steps: int, fps: float) -> float:
    """Return the time of the shortest of so many steps, in seconds."""
    borders = np.interp(np.arange(n_steps + 1) / n_steps, progress, np.arange(len(progress)))
    return float(np.diff(borders).min()) / fps


def _walk(
    motion: Array, headings: Array, progress: Array, n_steps: int, fps: float, skeleton: Skeleton
) -> Array:
    """Return a motion ``(T, J, 3)`` of which the feet take so many steps in turn."""
    result, root = motion.copy(), motion[:, skeleton.root]
    ankles = [foot[0] for foot in feet(skeleton)]
    paths = [_beneath(motion, foot, headings, skeleton) for foot in feet(skeleton)]
    order = _order(motion[0, ankles] - root[0], root[-1] - root[0], headings[0])
    starts = [np.arange(turn, n_steps, 2) / n_steps for turn in (0, 1)]
    stops = [_stops(progress, own, 1 / n_steps) for own in starts]
    places = [paths[number][at] for number, at in zip(order, stops, strict=True)]
    lefts = {left for left, _ in skeleton.left_right}
    sides = [1 if ankles[number] in lefts else -1 for number in order]
    _keep_apart(places, [headings[at] for at in stops], sides)
    for own, of_foot, number in zip(starts, places, order, strict=True):
        joints = list(feet(skeleton)[number])
        result[:, joints] = of_foot[0]
        result[:, joints, 1] = _standing_heights(motion, ankles, joints, fps)
        for start, here, there in zip(own, of_foot[:-1], of_foot[1:], strict=True):
            done = ((progress - start) * n_steps).clip(0, 1)[:, None, None]
            result[:, joints] += smooth_step(done) * (there - here) * [1, 0, 1]
            result[:, joints, 1] += STEP_HEIGHT * np.sin(np.pi * done[..., 0]).clip(0) ** 1.5
    return result


def _order(feet_at: Array, travel: Array, heading: float) -> list[int]:
    """Return which foot steps first: the one behind, of a body that goes aside the one that leads.

    Parameters
    ----------
    feet_at : (2, 3) metres, of the ankles from the root
    travel : (3,) metres
    heading : radians
    """
    left = _left(heading)
    aside = travel @ left * left
    ahead = (travel - aside) * [1, 0, 1]
    order: list[int] = np.argsort(feet_at @ (ahead - aside), kind="stable").tolist()
    return order


def _left(heading: float) -> Array:
    """``(3,)``: the direction to the left of a body."""
    return np.array([np.sin(heading), 0, np.cos(heading)])


def _stops(progress: Array, starts: Array, step: float) -> list[int]:
    """List the frames whose places a foot stands at: the first, middles of stances, the last."""
    middles = (starts[:-1] + step + starts[1:]) / 2
    return [0, *np.searchsorted(progress, middles).tolist(), len(progress) - 1]


def _keep_apart(places: list[Array], headings: list[Array], sides: list[int]) -> None:
    """Move places at which a foot would cross the other, which stands, to its own side; in place.

    A body that goes sideways by a step puts the foot that follows beyond the one that leads.

    Parameters
    ----------
    places : (N, K, 3) metres of each foot's joints, the foot that steps first before the other
    headings : (N,) radians, of the body at these places
    sides : 1 for a left foot, -1 for a right one
    """
    for step in range(sum(map(len, places)) - 2):
        turn, number = step % 2, step // 2 + 1
        if number == len(places[turn]) - 1:  # where the generated foot goes on
            continue
        aside = sides[turn] * _left(headings[turn][number])
        others = places[1 - turn][(step + 1) // 2 :][:2]
        if len(others) > 1 and (step + 1) // 2 + 2 < len(places[1 - turn]):
            others = others[:1]  # the next one is moved in its turn, its last one is not
        apart = min((places[turn][number, 0] - other[0]) @ aside for other in others)
        places[turn][number] += max(MIN_APART - apart, 0) * aside


def _evening(path: Array, fps: float) -> Array:
    """``(T, 3)`` metres over the floor, from a path to a smoother one of the same ends."""
    first, last = path[:1], path[-1:]
    # Reflected about its ends, the path keeps them.
    longer = np.concatenate([2 * first - path[:0:-1], path, 2 * last - path[-2::-1]])
    smooth = gaussian_filter1d(longer, EVEN_SECONDS * fps, axis=0)[len(path) - 1 : -len(path) + 1]
    return np.asarray((smooth - path) * [1, 0, 1])


def _share(legs: Array, change: Array, fps: float) -> Array:
    """``(T,)``: how much of a change makes no joint of the legs too fast; 1 where all of it does.

    A foot that swings goes about three times as fast as the body. Where that is too fast, or where
    a glide begins or ends in motion, feet glide, less than they did or as they did.

    Parameters
    ----------
    legs, change : (T, K, 3) metres
    fps : frames per second
    """
    allowed = np.ones(len(legs))
    for order, limit in ((1, MAX_SPEED), (2, MAX_ACCELERATION)):
        before, after = (
            np.linalg.norm(np.diff(motion, n=order, axis=0), axis=-1) * fps**order
            for motion in (legs, legs + change)
        )
        excess = np.maximum(after - limit, 0) / np.maximum(after - before, 1e-9)
        fits = 1 - excess.clip(0, 1).max(axis=1)
        frames = slice(order - 1, order - 1 + len(fits))
        allowed[frames] = np.minimum(allowed[frames], fits)
    # The minimum reaches as far as the kernel, and one frame farther, as the differences do.
    half = max(1, round(FADE_SECONDS * fps))
    lowest = minimum_filter1d(allowed, 2 * (half + 1) + 1, mode="nearest")
    return np.asarray(gaussian_filter1d(lowest, half / 3, mode="nearest", radius=half))


def _beneath(motion: Array, foot: tuple[int, ...], headings: Array, skeleton: Skeleton) -> Array:
    """``(T, K, 3)``: where a foot would be beneath its hip; its first and last place are given.

    In the body's frame it turns evenly from its first direction to its last.

    Parameters
    ----------
    motion : (T, J, 3) metres
    foot : its joints, the ankle first
    headings : (T,) radians
    skeleton : of the motion
    """
    root, joints = motion[:, skeleton.root], motion[:, list(foot)]
    hip = motion[:, skeleton.parents[skeleton.parents[foot[0]]]]
    beside = turned((hip - root)[:, None], -headings).mean(axis=0)
    share = np.linspace(0, 1, len(motion))[:, None, None]
    ends = joints[[0, -1]]
    shape = turned(ends - ends[:, :1], -headings[[0, -1]])
    path = root[:, None] + turned(beside + shape[0] + share * (shape[1] - shape[0]), headings)
    path[[0, -1]] = ends
    return np.asarray(path)


def _standing_heights(motion: Array, ankles: list[int], joints: list[int], fps: float) -> Array:
    """``(T, K)`` metres: heights of a foot's joints while it stands, from where they are at first.

    The lower ankle of those of the first and last frames is on the floor; a foot that is lifted
    when a glide begins or ends comes down from there soon, or goes up.
    """
    edge = max(1, round(FLOOR_SECONDS * fps))
    floor = [motion[part][:, ankles, 1].min() for part in (slice(edge), slice(-edge, None))]
    foot = motion[:, joints, 1]
    times = np.arange(len(foot))[:, None] / fps
    level = (
        np.interp(times, times[[0, -1], 0], floor) + foot[foot[:, 0].argmin()] - foot[:, 0].min()
    )
    first, last = (1 - smooth_step((t / FADE_SECONDS).clip(0, 1)) for t in (times, times[::-1]))
    return np.asarray(level + first * (foot[0] - level[0]) + last * (foot[-1] - level[-1]))


def _progress(demand: Array) -> Array:
    """``(T,)`` from 0 to 1: how many of the steps are done; they go on while the body rests."""
    speed = demand + MIN_PROGRESS * max(float(demand.mean()), 1e-9)
    progress = np.concatenate([[0], np.cumsum(speed)])
    return np.asarray(progress / progress[-1])
