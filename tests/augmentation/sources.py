"""Small interactions of the solver's test scenes, and batches of bodies for them."""

from dataclasses import replace

import numpy as np

from benchmarks._retargeting_tasks import SETTINGS as USUAL
from pacmo_core.augmentation.run import Batch, solver_key, source_key
from pacmo_core.data.interaction import Interaction
from tests.interaction_mesh.scenes import scene

# A first try so short that it serves easy bodies alone.
SETTINGS = replace(
    USUAL, attempts=(replace(USUAL.attempts[0], max_iterations=24, tolerance=1e-2), *USUAL.attempts)
)


def source(seed: int = 0, n_frames: int = 12) -> Interaction:
    """Draw two small bodies that turn."""
    drawn = scene(seed, n_frames)
    return Interaction(drawn.skeletons[0], np.arange(n_frames) / 30, *drawn.motions)


def flat_source(n_frames: int = 12) -> Interaction:
    """Draw two of whom one is a drawing."""
    pair = source(9, n_frames)
    flat = pair.person_b.copy()
    flat[..., 2] = 0
    return Interaction(pair.skeleton, pair.times, pair.person_a, flat)


def batch(scales: np.ndarray, seed: int = 0, interaction: Interaction | None = None) -> Batch:
    """Hand out bodies, (V, 10)."""
    interaction = interaction or source(seed)
    names = tuple(f"{seed}-{row.tobytes().hex()}" for row in scales)
    return Batch(
        source_key(interaction), solver_key(SETTINGS), interaction, SETTINGS, scales, names
    )


def bodies(count: int, seed: int = 0) -> np.ndarray:
    """Draw scales, (V, 10): in turn of bodies much smaller, hardly other, and moderately so."""
    random = np.random.default_rng(seed)
    scales = random.uniform(0.8, 1.25, (count, 10))
    scales[::3, 5:] *= 0.6
    scales[1::3] = 1 + 0.02 * (scales[1::3] - 1)
    return scales
