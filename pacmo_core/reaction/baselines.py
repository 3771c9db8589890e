"""The deterministic baselines: stacked GRU layers (PaCMO, 4.3.2) and a regressed U-NO."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.utils.rnn import pad_sequence

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.data.transforms import body_frame
from pacmo_core.operators.quadrature import trapezoid_weights
from pacmo_core.operators.random_field import GaussianRandomField
from pacmo_core.operators.spectral import initialise_weights
from pacmo_core.operators.spline import Spline
from pacmo_core.operators.uno import u_shape_config
from pacmo_core.reaction.data import (
    MotionPairs,
    RandomAugmentation,
    check_common_skeleton,
    expand_directions,
    sample_motion_pairs,
)
from pacmo_core.reaction.generator import Generator, GeneratorConfig
from pacmo_core.reaction.inputs import Normalisation
from pacmo_core.reaction.settings import GruSettings, RegressionSettings
from pacmo_core.training.loop import TrainingLoop
from pacmo_core.training.supervised import SupervisedTrainer


@dataclass(frozen=True)
class GruConfig:
    """A recurrent network's skeleton and size."""

    skeleton: Skeleton
    fps: float
    hidden: int
    n_layers: int


@dataclass(frozen=True)
class FrameSequences:
    """Partners and reactions at one rate, one tensor a clip.

    Parameters
    ----------
    partner, reaction : list of (T_i, 3 J) float32, metres, in the partner's first frame
    """

    partner: list[Tensor]
    reaction: list[Tensor]


class Gru(nn.Module):
    """Five GRU layers of 200 and three dense ones with GELU, in the paper's size.

    Causal, so frames of padding after a clip do not change it.

    Parameters
    ----------
    config : GruConfig
    """

    def __init__(self, config: GruConfig) -> None:
        super().__init__()
        self.config = config
        channels, hidden = 3 * len(config.skeleton.joints), config.hidden
        self.gru = nn.GRU(channels, hidden, config.n_layers, batch_first=True)
        self.head = nn.Sequential(
            nn.Linear(hidden, hidden),
            nn.GELU(),
            nn.Linear(hidden, hidden),
            nn.GELU(),
            nn.Linear(hidden, channels),
        )
        self.normalisation = Normalisation(channels=channels)

    @property
    def skeleton(self) -> Skeleton:
        """Whose joints go in and come out."""
        return self.config.skeleton

    def forward(self, partner: Tensor) -> Tensor:
        """React frame by frame: ``(B, T, 3 J)`` metres to the same."""
        hidden, _ = self.gru(self.normalisation.partner(partner))
        out: Tensor = self.head(hidden)
        return self.normalisation.metres(out)

    def loss(self, frames: FrameSequences, rows: Sequence[int]) -> Tensor:
        """Take the mean squared error over real frames, in normalised units."""
        partner = pad_sequence([frames.partner[i] for i in rows], batch_first=True)
        reaction = pad_sequence([frames.reaction[i] for i in rows], batch_first=True)
        lengths = torch.tensor([len(frames.partner[i]) for i in rows], device=partner.device)
        here = torch.arange(partner.shape[1], device=partner.device) < lengths[:, None]
        error = (self(partner) - reaction).square().mean(dim=-1) / self.normalisation.scale**2
        return torch.masked_select(error, here).mean()


def frame_times(start: float, end: float, fps: float) -> NDArray[np.float64]:
    """Space instants evenly, both ends among them, as near to a rate as that allows."""
    return np.linspace(start, end, max(2, round((end - start) * fps) + 1))


def build_gru_training(
    clips: Sequence[Interaction],
    settings: GruSettings,
    *,
    validation: Sequence[Interaction] = (),
    device: str = "cpu",
) -> TrainingLoop[Gru]:
    """Train on squared error; an epoch yields ``loss``.

    ``validation`` is the loss on either side of the held-out clips.
    """
    check_common_skeleton([*clips, *validation])
    random = torch.Generator().manual_seed(settings.random_seed)
    sides = expand_directions(clips, both=settings.both_directions)
    frames = sample_frames(sides, settings.fps, device)
    held_out = sample_frames(expand_directions(validation, both=True), settings.fps, device)
    config = GruConfig(clips[0].skeleton, settings.fps, settings.hidden, settings.n_layers)
    model = Gru(config)
    initialise_weights(model, random)
    model.to(device).normalisation.measure(sample_motion_pairs(sides, n_points=33).to(device))
    training = SupervisedTrainer(
        model,
        len(frames.partner),
        lambda rows: model.loss(frames, rows.tolist()),
        (lambda: model.loss(held_out, range(len(held_out.partner)))) if validation else None,
        settings,
        random,
    )
    return TrainingLoop(
        training, n_epochs=settings.n_epochs, validate_every=settings.validate_every
    )


def gru_from_state(config: Mapping[str, Any], state: Mapping[str, Tensor]) -> Gru:
    """Rebuild a model from what ``config`` and ``fit.state`` gave."""
    model = Gru(GruConfig(**{**config, "skeleton": Skeleton.from_dict(config["skeleton"])}))
    model.load_state_dict(dict(state))
    return model.requires_grad_(False)


def sample_frames(clips: Sequence[Interaction], fps: float, device: str) -> FrameSequences:
    """Sample interactions at one rate: ``person_a`` the partner, ``person_b`` reacts."""
    frames = FrameSequences([], [])
    for clip in clips:
        frame = body_frame(clip.person_a, clip.skeleton)
        at = frame_times(clip.times[0], clip.times[-1], fps)
        for motion, found in ((clip.person_a, frames.partner), (clip.person_b, frames.reaction)):
            local = frame.to_local(motion).reshape(len(motion), -1)
            values = Spline(clip.times, local)(at).astype(np.float32)
            found.append(torch.tensor(values, device=device))
    return frames


def build_regression_training(
    clips: Sequence[Interaction],
    settings: RegressionSettings,
    *,
    validation: Sequence[Interaction] = (),
    device: str = "cpu",
) -> TrainingLoop[Generator]:
    """Train a generator of no noise on squared error; an epoch yields ``loss``.

    ``validation`` is the loss on either side of the held-out clips.
    """
    random = torch.Generator().manual_seed(settings.random_seed)
    pairs = sample_motion_pairs(
        expand_directions(clips, both=settings.both_directions), settings.n_points
    ).to(device)
    sides = expand_directions(validation, both=True)
    held_out = sample_motion_pairs(sides, settings.n_points).to(device) if sides else None
    model = Generator(_regression_config(clips[0].skeleton, settings))
    initialise_weights(model, random)
    model.to(device).normalisation.measure(pairs)
    augment = RandomAugmentation(settings.augmentation, model.skeleton, settings.n_points)
    training = SupervisedTrainer(
        model,
        len(pairs),
        lambda rows: _regression_loss(model, augment(pairs[rows.to(device)], random)),
        None if held_out is None else lambda: _regression_loss(model, held_out),
        settings,
        random,
    )
    return TrainingLoop(
        training, n_epochs=settings.n_epochs, validate_every=settings.validate_every
    )


def _regression_loss(model: Generator, pairs: MotionPairs) -> Tensor:
    """Take the mean squared error over time, in normalised units."""
    no_noise = pairs.partner.new_zeros(len(pairs), 0, 2 * model.config.noise.n_modes)
    error = (model(no_noise, pairs.condition) - pairs.reaction) / model.normalisation.scale
    loss: Tensor = (error.square().mean(dim=-1) @ trapezoid_weights(model.points)).mean()
    return loss


def _regression_config(skeleton: Skeleton, settings: RegressionSettings) -> GeneratorConfig:
    motion = 3 * len(skeleton.joints)
    return GeneratorConfig(
        skeleton,
        u_shape_config(settings, motion + 3, motion),
        GaussianRandomField(alpha=2.0, tau=5.0, n_modes=1, period=settings.period),
        noise_channels=0,
        actions=(),
        action_channels=0,
    )
