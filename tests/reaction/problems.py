"""Toy distributions of two bodies with answers that are known, and small settings."""

from dataclasses import replace

import numpy as np

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import SBU15
from pacmo_core.reaction.settings import (
    AdamSettings,
    AugmentationSettings,
    AutoencoderSettings,
    ContactScoreSettings,
    FineTuningSettings,
    FlowMatchingSettings,
    GruSettings,
    PacmoSettings,
    PartsSettings,
    RegressionSettings,
)

REST = np.zeros((15, 3))
for _row, (_joint, _x, _y) in enumerate(
    [
        ("head", 0, 0.6), ("neck", 0, 0.4), ("torso", 0, 0),
        ("left_shoulder", 0.2, 0.4), ("left_elbow", 0.4, 0.3), ("left_hand", 0.5, 0.1),
        ("right_shoulder", -0.2, 0.4), ("right_elbow", -0.4, 0.3), ("right_hand", -0.5, 0.1),
        ("left_hip", 0.1, -0.2), ("left_knee", 0.1, -0.6), ("left_foot", 0.1, -1.0),
        ("right_hip", -0.1, -0.2), ("right_knee", -0.1, -0.6), ("right_foot", -0.1, -1.0),
    ]
):  # fmt: skip
    REST[_row, :2] = _x, _y


def wave(times: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """``(T,)``: a band-limited function of normalised time."""
    a, b = random.normal(size=(2, 3)) / (1 + np.arange(3))
    phase = 2 * np.pi / 1.25 * np.outer(times, 1 + np.arange(3))
    return np.sin(phase) @ a + np.cos(phase) @ b


def delayed_mirror(seed: int, times: np.ndarray) -> Interaction:
    """Let a partner sway and raise a hand, and another, a metre ahead, follow a little later."""
    x = times / times[-1]
    motions = []
    for delay, turn, ahead in ((0.1, -1, 1.0), (0.0, 1, 0.0)):
        random = np.random.default_rng(seed)
        motion = np.tile(REST * [turn, 1, turn] + [0, 0, ahead], (len(x), 1, 1))
        motion[:, :, 0] += 0.15 * wave(x - delay, random)[:, None]
        motion[:, 5, 1] += 0.2 * wave(x - delay, random)
        motions.append(motion.astype(np.float32))
    reaction, partner = motions
    return Interaction(SBU15, times, reaction, partner)


def clips(n: int, first_seed: int = 0) -> list[Interaction]:
    """Interactions of several lengths, at 15 frames a second."""
    return [delayed_mirror(first_seed + i, np.arange(20 + i % 12) / 15) for i in range(n)]


AUTOENCODER = AutoencoderSettings(
    random_seed=0,
    device="cpu",
    n_points=17,
    period=1.25,
    width=8,
    bottleneck_channels=4,
    modes=[8, 6, 4, 4, 4, 6, 8],
    learning_rate=3e-3,
    halve_learning_rate_every=20,
    batch_size=8,
    n_epochs=20,
    validate_every=1,
    checkpoint_every=2,
    both_directions=True,
)
NO_AUGMENTATION = AugmentationSettings(
    mirror_probability=0.0,
    size_spread=0.0,
    rotation_spread=0.0,
    min_rate=1.0,
    tempo_spread=0.0,
    joint_offset=0.0,
    joint_noise=0.0,
)
NO_PARTS = PartsSettings(n=0, min_share=0.4, max_share=0.9, random_seed=0)
GRU = GruSettings(
    random_seed=0,
    device="cpu",
    fps=15.0,
    hidden=24,
    n_layers=1,
    learning_rate=1e-2,
    halve_learning_rate_every=60,
    batch_size=8,
    n_epochs=60,
    validate_every=1,
    checkpoint_every=2,
    both_directions=True,
    parts=NO_PARTS,
    augmentation=NO_AUGMENTATION,
)
PACMO = PacmoSettings(
    random_seed=0,
    start=FineTuningSettings("", "", 0.25),
    device="cpu",
    n_points=17,
    period=1.25,
    width=8,
    modes=[8, 6, 4, 4, 4, 6, 8],
    noise_channels=2,
    noise_modes=8,
    noise_alpha=2.0,
    noise_tau=5.0,
    functional_hidden=8,
    body_distances=True,
    action_channels=0,
    action_dropout=0.0,
    generator=AdamSettings(2e-3, (0.0, 0.9)),
    critic=AdamSettings(2e-3, (0.0, 0.9)),
    halve_learning_rate_every=200,
    cooldown_epochs=0,
    batch_size=16,
    n_epochs=4,
    validate_every=2,
    checkpoint_every=2,
    validation_samples=4,
    temperatures=[1.0],
    n_critic=2,
    gradient_penalty_weight=10.0,
    validate_from=1,
    warmup_epochs=1,
    energy_score_weight=1.0,
    contact_score=ContactScoreSettings(
        near_weight=0.5,
        near_distance=0.1,
        log_distance_weight=0.5,
        approach_weight=0.25,
        stance_weight=0.25,
        stance_speed=0.3,
        spread=0.8,
    ),
    bone_symmetry_weight=5.0,
    bone_length_weight=0.0,
    ema_decay=0.5,
    both_directions=True,
    parts=NO_PARTS,
    augmentation=AugmentationSettings(
        mirror_probability=0.5,
        size_spread=0.05,
        rotation_spread=0.1,
        min_rate=0.5,
        tempo_spread=0.1,
        joint_offset=0.02,
        joint_noise=0.01,
    ),
    mixed_precision=False,
    compile_generator=False,
)
PACMO_LONG = replace(PACMO, n_epochs=60, n_critic=3, ema_decay=0.97, both_directions=False)
REGRESSION = RegressionSettings(
    random_seed=0,
    device="cpu",
    n_points=17,
    period=1.25,
    width=8,
    modes=[8, 6, 4, 4, 4, 6, 8],
    learning_rate=3e-3,
    halve_learning_rate_every=20,
    batch_size=8,
    n_epochs=20,
    validate_every=5,
    checkpoint_every=5,
    both_directions=False,
    parts=NO_PARTS,
    augmentation=NO_AUGMENTATION,
)
FLOW_MATCHING = FlowMatchingSettings(
    **vars(REGRESSION),
    noise_modes=8,
    noise_alpha=2.0,
    noise_tau=5.0,
    noise_period=2.5,
    noise_scale=0.5,
    n_steps=4,
)
