"""APE and AVE: errors of a generated reaction against the real one to the same partner.

Both as in PaCMO (section 4.3.1): absolute positions, no normalisation, a mean within each
sequence and then over sequences, for one generated reaction per partner.
"""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Motions = Sequence[NDArray[np.float32]]
Weighting = Literal["sequence", "frame"]


def position_errors(generated: Motions, real: Motions) -> Array:
    """Return the mean distance over time of each joint from its real position, (n, J) metres."""
    pairs = _pairs(generated, real)
    return np.array([np.linalg.norm(g - r, axis=-1).mean(axis=0) for g, r in pairs])


def variance_errors(generated: Motions, real: Motions) -> Array:
    """Return the error of each joint's variance over time, by axis, (n, J) m².

    The variance is the unbiased one, over T − 1, as in TEMOS (Petrovich et al. 2022).
    """
    pairs = _pairs(generated, real)
    gaps = (g.var(axis=0, ddof=1) - r.var(axis=0, ddof=1) for g, r in pairs)
    return np.array([np.linalg.norm(gap, axis=-1) for gap in gaps])


def ape(generated: Motions, real: Motions, *, weighting: Weighting) -> Array:
    """Return the average position error of each joint.

    Parameters
    ----------
    generated, real : n motions (T_i, J, 3) each, metres, at the same times
    weighting : ``sequence``: equal weights, as in PaCMO; ``frame``: weights T_i, as in TEMOS

    Returns
    -------
    (J,) metres; index by the root joint for the value of the paper
    """
    return sequence_weights(real, weighting) @ position_errors(generated, real)


def ave(generated: Motions, real: Motions, *, weighting: Weighting) -> Array:
    """Return the average variance error of each joint, (J,) square metres; see ``ape``."""
    return sequence_weights(real, weighting) @ variance_errors(generated, real)


def sequence_weights(motions: Motions, weighting: Weighting) -> Array:
    """Return the weights of n motions, (n,), which sum to 1."""
    if weighting not in ("sequence", "frame"):
        raise ValueError(f"weighting must be 'sequence' or 'frame'; got {weighting!r}")
    lengths = np.array([len(m) if weighting == "frame" else 1 for m in motions], dtype=np.float64)
    return np.asarray(lengths / lengths.sum())


def _pairs(generated: Motions, real: Motions) -> list[tuple[Array, Array]]:
    if not real or len(generated) != len(real):
        raise ValueError(
            f"wanted a real motion for each generated; got {len(generated)}, {len(real)}"
        )
    for i, (g, r) in enumerate(zip(generated, real, strict=True)):
        if g.shape != r.shape or g.ndim != 3 or len(g) < 2:
            raise ValueError(
                f"motion {i}: generated and real must both be (T, J, 3) with T >= 2; "
                f"got {g.shape}, {r.shape}"
            )
    return [
        (g.astype(np.float64), r.astype(np.float64)) for g, r in zip(generated, real, strict=True)
    ]
