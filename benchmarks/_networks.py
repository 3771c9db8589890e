"""The operator, the generator and the partner of the benchmark of speed."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from pacmo_core.data.interaction import Motion
from pacmo_core.data.skeleton import NTU25
from pacmo_core.operators.random_field import GaussianRandomField
from pacmo_core.operators.spectral import initialise_weights
from pacmo_core.operators.uno import U_SHAPE_RATIOS, Uno, UnoConfig, u_shape_channels
from pacmo_core.reaction.generator import Generator, GeneratorConfig
from stages.common.params import read_params


@dataclass(frozen=True)
class Shape:
    """Width, grid and modes of an operator."""

    width: int
    n_points: int
    modes: tuple[int, ...]


WIDE = Shape(width=64, n_points=65, modes=(24, 16, 8, 8, 8, 16, 24))
FPS, SECONDS = 30.0, 4.0
SKELETON = NTU25.without(["left_hand_tip", "left_thumb", "right_hand_tip", "right_thumb"])
NOISE = GaussianRandomField(alpha=2.0, tau=5.0, n_frequencies=16, period=1.25)
NOISE_CHANNELS = 4


def our_operator(in_channels: int, out_channels: int) -> Uno:
    """Build our operator with initial weights."""
    uno = Uno(_config(WIDE, in_channels, out_channels))
    initialise_weights(uno, torch.Generator().manual_seed(0))
    return uno


def trained_shape() -> Shape:
    """Read the shape of the generator that the pipeline trains."""
    params = read_params("train_pacmo", dict[str, Any])
    return Shape(params["width"], params["n_points"], tuple(params["modes"]))


def generator(shape: Shape) -> Generator:
    """Build a generator with the normalisation of clips of four seconds."""
    channels = 3 * len(SKELETON.joints)
    config = GeneratorConfig(
        SKELETON,
        _config(shape, NOISE_CHANNELS + channels + 3, channels),
        NOISE,
        NOISE_CHANNELS,
        actions=(),
        action_channels=0,
    )
    model = Generator(config)
    initialise_weights(model, torch.Generator().manual_seed(0))
    model.normalisation.log_duration.copy_(torch.tensor([math.log(SECONDS), 0.1]))
    return model.requires_grad_(False)


def partner(n_frames: int) -> tuple[Motion, NDArray[np.float64]]:
    """Return a synthetic partner: a random body that sways, (T, J, 3), at times (T,)."""
    random = np.random.default_rng(0)
    times = np.arange(n_frames) / FPS
    build = random.normal(scale=0.4, size=(len(SKELETON.joints), 3))
    phase = np.outer(times, random.uniform(1, 4, size=build.size)).reshape(-1, *build.shape)
    motion: Motion = (build + 0.05 * np.sin(phase)).astype(np.float32)
    return motion, times


def _config(shape: Shape, in_channels: int, out_channels: int) -> UnoConfig:
    return UnoConfig(
        in_channels=in_channels,
        out_channels=out_channels,
        lifting=shape.width,
        channels=u_shape_channels(shape.width),
        modes=shape.modes,
        ratios=U_SHAPE_RATIOS,
        n_points=shape.n_points,
        period=1.25,
        skips=True,
    )
