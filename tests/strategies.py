"""Inputs that tests draw: small bodies, interactions and sets of them."""

import numpy as np
from hypothesis import strategies as st

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.quality import QualityLimits
from pacmo_core.data.skeleton import Skeleton

SMALL = Skeleton("small", ("root", "left", "right", "head"), (-1, 0, 0, 0), left_right=((1, 2),))
# Every published clip at hand keeps within these.
LIMITS = QualityLimits(
    min_frames=10,
    max_rate_jitter=0.5,
    max_rate_error=0.02,
    max_bone_length_variation=0.2,
    max_joint_speed=25,
    max_body_speed=8,
    min_person_distance=0.1,
)


def make_interaction(
    random: np.random.Generator, n_frames: int = 20, skeleton: Skeleton = SMALL, fps: float = 30
) -> Interaction:
    """Draw two smooth random motions."""
    shape = (n_frames, len(skeleton.joints), 3)
    person_a, person_b = (
        (
            0.01 * random.standard_normal(shape).cumsum(axis=0) + random.standard_normal(shape[1:])
        ).astype(np.float32)
        for _ in range(2)
    )
    return Interaction(skeleton, np.arange(n_frames) / fps, person_a, person_b)


def interactions() -> st.SearchStrategy[Interaction]:
    """Draw interactions of 2 to 40 frames."""
    return st.builds(
        lambda seed, n_frames: make_interaction(np.random.default_rng(seed), n_frames),
        st.integers(0, 2**32 - 1),
        st.integers(2, 40),
    )


def make_set(random: np.random.Generator, n_clips: int) -> dict[str, Interaction]:
    """Draw interactions of varied length by ascending name."""
    return {
        f"clip{number:04d}": make_interaction(random, int(random.integers(10, 40)))
        for number in range(n_clips)
    }
