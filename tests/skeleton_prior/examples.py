"""Small batch that tests train and vary: two bodies that swing, one of them on other bones."""

import numpy as np
import torch
from torch import nn

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import NTU25, Skeleton
from pacmo_core.skeleton_prior.data import Example
from pacmo_core.skeleton_prior.kinematics import ancestor_matrix
from pacmo_core.skeleton_prior.layers import initialise_weights
from pacmo_core.skeleton_prior.settings import LossWeights, SkeletonPriorSettings, StartSettings

JOINTS = (
    "root left_hip left_knee left_ankle right_hip right_knee right_ankle chest left_shoulder"
    " left_elbow left_wrist right_shoulder right_elbow right_wrist"
)
PAIRS = ((1, 4), (2, 5), (3, 6), (8, 11), (9, 12), (10, 13))
SMALL = Skeleton(
    "small", tuple(JOINTS.split()), (-1, 0, 1, 2, 0, 4, 5, 0, 7, 8, 9, 7, 11, 12), PAIRS
)
START = StartSettings(
    ground_height=0.2,
    contact_range=0.2,
    root=0.03,
    ground=30.0,
    contact=1.0,
    foot=1.0,
    hand=1.0,
    yielding=0.3,
)


def bone_vectors(skeleton: Skeleton, seed: int) -> np.ndarray:
    """Draw a standing pose's bones (J, 3), metres; the root's is its place."""
    random = np.random.default_rng(seed)
    down = {name: any(w in name for w in ("knee", "ankle", "foot")) for name in skeleton.joints}
    vectors = random.normal(0, 0.05, size=(len(skeleton.joints), 3))
    for joint, name in enumerate(skeleton.joints):
        side = 1 if "left" in name else -1 if "right" in name else 0
        vectors[joint] += [0.15 * side, -0.4, 0] if down[name] else [0.2 * side, 0.2, 0.05]
    vectors[skeleton.root] = [0, 1, 0]
    return vectors


def swinging_motion(skeleton: Skeleton, seed: int, n_frames: int, at: float) -> np.ndarray:
    """Draw a body whose bones swing, (T, J, 3) metres, its root ``at`` metres along z."""
    random = np.random.default_rng(seed)
    phase = random.uniform(0, 6, size=(1, len(skeleton.joints), 3))
    swing = 0.06 * np.sin(np.linspace(0, 6, n_frames)[:, None, None] + phase)
    vectors = bone_vectors(skeleton, seed) + swing
    lengths = np.linalg.norm(bone_vectors(skeleton, seed), axis=-1, keepdims=True)
    vectors = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True) * lengths
    vectors[:, skeleton.root] = [0, 1, at]
    return ancestor_matrix(skeleton).double().numpy() @ vectors


def interaction(seed: int = 0, n_frames: int = 31, skeleton: Skeleton = SMALL) -> Interaction:
    """Draw two people who swing half a metre from each other."""
    people = [swinging_motion(skeleton, 2 * seed + k, n_frames, 0.5 * k) for k in (0, 1)]
    first, second = (np.ascontiguousarray(p, dtype=np.float32) for p in people)
    return Interaction(skeleton, np.arange(n_frames) / 30, first, second)


def examples(sources: int = 2, each: int = 4, skeleton: Skeleton = SMALL) -> list[Example]:
    """Scale one bone of each source at random."""
    random = np.random.default_rng(0)
    result = []
    for source in range(sources):
        template = interaction(source, skeleton=skeleton)
        for _ in range(each):
            scales = np.ones((2, len(skeleton.bones)))
            scales[random.integers(2), random.integers(len(skeleton.bones))] = random.choice(
                [0.75, 0.95, 1.05, 1.25]
            )
            varied = [
                scale_bones(motion, skeleton, own)
                for motion, own in zip((template.person_a, template.person_b), scales, strict=True)
            ]
            pair = Interaction(skeleton, template.times, *varied)
            result.append(Example(f"source-{source}", template, scales, pair))
    return result


def scale_bones(motion: np.ndarray, skeleton: Skeleton, scales: np.ndarray) -> np.ndarray:
    """Scale bones along their own directions, joint by joint from the root."""
    out = motion.copy()
    for joint in skeleton.order[1:]:
        parent = skeleton.parents[joint]
        row = [child for _, child in skeleton.bones.tolist()].index(joint)
        out[:, joint] = out[:, parent] + scales[row] * (motion[:, joint] - motion[:, parent])
    return out


def settings(**changes: object) -> SkeletonPriorSettings:
    """Give settings that train in a moment."""
    defaults: dict[str, object] = {
        "random_seed": 1,
        "device": "cpu",
        "model": "kinematic",
        "hidden": 16,
        "frame_stride": 3,
        "window_frames": 9,
        "start": START,
        "loss_weights": LossWeights(
            kl_divergence=1e-3,
            bone_length=1.0,
            contact_distance=0.5,
            joint_distance=2.0,
            acceleration=0.1,
            energy_score=0.0,
        ),
        "skeleton_vae_steps": 20,
        "kl_warmup_epochs": 2,
        "random_rotation": True,
        "mirror_probability": 0.5,
        "used_share": 0.5,
        "swap_characters": True,
        "learning_rate": 1e-3,
        "halve_learning_rate_every": 10,
        "batch_size": 4,
        "n_epochs": 3,
        "validate_every": 2,
        "checkpoint_every": 10,
    }
    return SkeletonPriorSettings(**{**defaults, **changes})


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def randomised(layer: nn.Module) -> nn.Module:
    """Randomise all weights, including those that are initialised to one or zero."""
    random = generator(1)
    initialise_weights(layer, random)
    with torch.no_grad():
        for value in [*layer.parameters(), *layer.buffers()]:
            if value.is_floating_point():
                value += 0.1 * torch.rand(value.shape, generator=random)
    return layer.eval()


__all__ = ["NTU25", "SMALL", "examples", "generator", "interaction", "randomised", "settings"]
