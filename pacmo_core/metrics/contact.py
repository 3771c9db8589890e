"""Contact of two bodies: contacts met, false contacts, their agreement, penetration of capsules.

Distances between bodies are those of their nearest joints in a frame. Each function returns sums
(2, n), a numerator and a denominator for each reaction, so that a metric on any resample of clips
is a ratio of weighted sums.
"""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Motion, closest_points, min_point_distance
from pacmo_core.metrics.bootstrap import Array
from pacmo_core.metrics.plausibility import BodyJoints
from pacmo_core.metrics.reactions import Reactions

# Seconds by which a contact may be early or late in ``nearest_in_time``.
TIME_TOLERANCE = 0.1
MICROSECOND = 1e-6  # round-off of frame times


Distances = Sequence[Array]  # (T_i,) metres of each clip, as of ``contact_distances``


def contact_distances(row: Reactions) -> list[Array]:
    """Return the distance between the nearest joints of partner and reaction, n arrays (T,)."""
    return [min_point_distance(p, m) for p, m in zip(row.partners, row.motions, strict=True)]


def contacts_met(generated: Distances, captured: Distances, *, contact: float, met: float) -> Array:
    """Return the captured frames of contact that are met, and all of them, (2, n): a recall.

    A frame is of contact where the captured two are within ``contact`` metres, and met where the
    generated two are within ``met`` metres.
    """
    return _count(
        (distances <= met, real <= contact) for distances, real in _pairs(generated, captured)
    )


def false_contacts(generated: Distances, captured: Distances, *, apart: float, met: float) -> Array:
    """Return the frames of false contact, and those in which there could be one, (2, n).

    A contact is false where the generated two are within ``met`` metres and the captured two
    farther apart than ``apart``.
    """
    return _count(
        (distances <= met, real > apart) for distances, real in _pairs(generated, captured)
    )


def contact_f1(generated: Distances, captured: Distances, *, distance: float) -> Array:
    """Return twice the frames with contact in both, and the sum of both counts, (2, n).

    Their ratio is the F1 of contact frames over all samples. Duolando (Siyao et al. 2024) reports
    the frequency of contact; F1 requires contact in the same frames.
    """
    sums = []
    for distances, real in _pairs(generated, captured):
        touching, expected = distances <= distance, real <= distance
        sums.append((2 * (touching & expected).sum(), touching.sum() + expected.sum()))
    return np.array(sums, dtype=np.float64).T


def nearest_in_time(distances: Array, times: Array) -> Array:
    """Return the minimum of distances over the frames within 0.1 s of each, (T,)."""
    reach = TIME_TOLERANCE + MICROSECOND
    starts = np.searchsorted(times, times - reach)
    ends = np.searchsorted(times, times + reach, side="right")
    return np.array([distances[i:j].min() for i, j in zip(starts, ends, strict=True)])


def _pairs(generated: Distances, captured: Distances) -> Iterator[tuple[Array, Array]]:
    return zip(generated, captured, strict=True)


def _count(frames: Iterable[tuple[NDArray[np.bool_], NDArray[np.bool_]]]) -> Array:
    """Count the frames of each clip that are hits among those that count, and these, (2, n)."""
    sums = [((hit & counted).sum(), counted.sum()) for hit, counted in frames]
    return np.array(sums, dtype=np.float64).T


def penetration(row: Reactions, body: BodyJoints, *, radius: float) -> Array:
    """Return the summed depth of penetration, metres, and the number of frames, (2, n).

    Every bone is a capsule of one radius; the depth in a frame is that of the deepest pair of
    capsules of the two bodies. Captured contact has a depth too: the value is to be compared with
    that of captured motion.
    """
    depths = [
        (2 * radius - bone_distance(partner, motion, body.bones)).clip(min=0)
        for partner, motion in zip(row.partners, row.motions, strict=True)
    ]
    return np.array([[d.sum() for d in depths], [len(d) for d in depths]], dtype=np.float64)


def bone_distance(first: Motion, second: Motion, bones: NDArray[np.intp]) -> Array:
    """Return the distance between the nearest two bones of two bodies, (T,) metres.

    Parameters
    ----------
    first, second : (T, J, 3) metres
    bones : (E, 2) indices, parent and child
    """
    begin, end = bones.T
    (p, u), (q, v) = (
        (motion[:, begin].astype(np.float64), (motion[:, end] - motion[:, begin]).astype(float))
        for motion in (first, second)
    )
    _, _, distances = closest_points((p[:, :, None], u[:, :, None]), (q[:, None], v[:, None]))
    return np.asarray(distances.min(axis=(1, 2)))
