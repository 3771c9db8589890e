"""Scenes for tests: two small bodies that rotate and touch, or a real window."""

from dataclasses import replace

import numpy as np

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.interaction_mesh import (
    Attempt,
    AttemptLimits,
    Posture,
    Scene,
    Settings,
    Support,
    Weights,
)

SETTINGS = Settings(
    weights=Weights(
        distance_softening=0.01,
        interaction_range=0.5,
        posture=Posture(
            trunk=2, upper_limb=2, shin=3, foot=3, forearm=0.5, knee=4, elbow=1, spine=1
        ),
        trunk_shape=20,
        root=0.3,
        yielding=1.0,
        acceleration=10,
        contact=10,
        contact_range=0.15,
        body_contact=0.3,
        smoothing_time=0.1,
        stance=300,
        stance_height=300,
        floor_height=5,
        regularisation=1e-2,  # for scenes of so few points: with less, float32 blurs their steps
    ),
    support=Support(max_height=0.2, height_tolerance=0.03, max_speed=0.2, fade_time=0.07),
    limits=AttemptLimits(
        primal_residual=1e-2,
        contacts_kept=0.5,
        capsule_penetration=0.5,
        trunk_change=9,
        spine_bend=180,
        seam_ratio=2,
    ),
    attempts=(
        Attempt(bone_penalty=0.7, max_iterations=40, pair_penalty=0, tolerance=1e-3),
        Attempt(bone_penalty=2, max_iterations=100, pair_penalty=0, tolerance=1e-3),
        Attempt(bone_penalty=6, max_iterations=200, pair_penalty=60, tolerance=1e-3),
    ),
    floor_penalty=0,  # which the oracles do not have
    separation_stiffness=500,
    contact_stiffness=500,
    max_spine_bend=30,
    max_hinge_bend=150,
    n_pairs=12,
    near_distance=0.25,
    contact_distance=0.1,
    contact_slack=0.02,
)

LEG = Skeleton("leg", ("hip", "left_knee", "left_foot"), (-1, 0, 1))
ARM = Skeleton(
    "arm",
    ("root", "chest", "left_arm", "left_hand", "right_arm", "right_hand"),
    (-1, 0, 1, 2, 1, 4),
    ((2, 4), (3, 5)),
)


def thorough(iterations: int = 2000, **changes: object) -> Settings:
    """Give settings that iterate to the end."""
    attempts = (Attempt(bone_penalty=3, max_iterations=iterations, pair_penalty=0, tolerance=0),)
    return replace(SETTINGS, attempts=attempts, **changes)


def body(random: np.random.Generator, skeleton: Skeleton, times: np.ndarray, turn: float):
    """Draw a body whose bones keep their lengths and swing smoothly about where they hang."""
    motion = np.zeros((len(times), len(skeleton.joints), 3))
    motion[:, skeleton.root] = 0.05 * swing(random, times) + [0, 0.9, 0]
    for joint in skeleton.order[1:]:
        rest = random.normal(size=3)
        rest /= np.linalg.norm(rest)
        direction = rest + 0.3 * swing(random, times)
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        length = random.uniform(0.15, 0.35)
        motion[:, joint] = motion[:, skeleton.parents[joint]] + length * direction
    cos, sin = np.cos(turn), np.sin(turn)
    return motion @ np.array([[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]])


def swing(random: np.random.Generator, times: np.ndarray) -> np.ndarray:
    """Draw a slow sum of sines, (T, 3)."""
    rates = random.uniform(0.5, 1.5, size=(3, 1, 3))
    phases = random.uniform(0, 2 * np.pi, size=(3, 1, 3))
    return np.sin(2 * np.pi * rates * times[:, None] + phases).mean(axis=0)


def scene(
    seed: int = 0,
    n_frames: int = 15,
    skeletons: tuple[Skeleton, Skeleton] = (ARM, ARM),
    distance: float = 0.4,
) -> Scene:
    """Draw two bodies whose roots are ``distance`` metres apart."""
    random = np.random.default_rng(seed)
    times = np.arange(n_frames) / 30
    first = body(random, skeletons[0], times, 0)
    second = body(random, skeletons[1], times, np.pi) + np.array([0, 0, distance])
    return Scene((first.astype(np.float32), second.astype(np.float32)), skeletons, 30.0)


def touching_scene(seed: int = 0, n_frames: int = 15) -> Scene:
    """Draw two bodies whose left hands stay about 8 cm from each other."""
    source = scene(seed, n_frames)
    first, second = source.motions
    hand = ARM.joints.index("left_hand")
    miss = (first[:, hand] - second[:, hand]).mean(axis=0) + np.float32([0, 0, 0.05])
    return Scene((first, second + miss), source.skeletons, source.fps)


def random_scales(n_bones: int, seed: int = 0) -> np.ndarray:
    """Sample the bone scales of three bodies, (3, E)."""
    return np.random.default_rng(seed).uniform(0.75, 1.25, size=(3, n_bones))
