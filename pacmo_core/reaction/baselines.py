"""Deterministic baselines: a recurrent network and a U-NO, both trained on squared error.

``Gru`` is the paper's baseline, stacked GRU layers (PaCMO, 4.3.2). The regression baseline is
PaCMO's generator without noise and without a critic.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.utils.rnn import pad_sequence

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.limits import MAX_PARAMETERS
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.data.transforms import body_frame
from pacmo_core.finish.learnt import LearntModule
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
    with_random_parts,
)
from pacmo_core.reaction.generator import Generator, GeneratorConfig
from pacmo_core.reaction.inputs import Normalisation
from pacmo_core.reaction.settings import GruSettings, RegressionSettings
from pacmo_core.training.loop import TrainingLoop
from pacmo_core.training.supervised import SupervisedTrainer


@dataclass(frozen=True)
class GruConfig:
    """Skeleton, frame rate and size of a ``Gru``."""

    skeleton: Skeleton
    fps: float
    hidden: int
    n_layers: int

    def __post_init__(self) -> None:
        n_parameters = 6 * self.n_layers * self.hidden**2
        if not self.fps > 0 or min(self.hidden, self.n_layers) < 1 or n_parameters > MAX_PARAMETERS:
            raise ValueError(
                f"wanted fps > 0, hidden and n_layers >= 1 and {MAX_PARAMETERS} parameters at most;"
                f" got {self.fps}, {self.hidden}, {self.n_layers}"
            )


@dataclass(frozen=True)
class FrameSequences:
    """Partners and reactions at one frame rate, a tensor a clip.

    Parameters
    ----------
    partner, reaction : list of (T_i, 3 J) float32, metres, in the partner's first frame
    """

    partner: list[Tensor]
    reaction: list[Tensor]


class Gru(nn.Module):
    """GRU layers and three dense layers with GELU; in the paper five GRU layers of 200 units.

    Causal: padding after a clip does not change its output.

    Parameters
    ----------
    config : GruConfig

    Attributes
    ----------
    learnt : of the finish; changes nothing until it is learnt
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
        self.learnt = LearntModule(config.skeleton)

    @property
    def skeleton(self) -> Skeleton:
        """Skeleton of both people."""
        return self.config.skeleton

    def forward(self, partner: Tensor) -> Tensor:
        """Predict reactions frame by frame: ``(B, T, 3 J)`` metres to the same."""
        hidden, _ = self.gru(self.normalisation.normalise_partner(partner))
        out: Tensor = self.head(hidden)
        return self.normalisation.denormalise_reaction(out)

    def loss(self, frames: FrameSequences, rows: Sequence[int]) -> Tensor:
        """Return the mean squared error over all frames but padding, in normalised units."""
        return self._loss(*pad(frames, rows))

    def training_loss(
        self,
        frames: FrameSequences,
        rows: Sequence[int],
        augmentation: RandomAugmentation,
        random: torch.Generator,
    ) -> Tensor:
        """Return ``loss`` of clips that are transformed at random."""
        partner, reaction, is_frame = pad(frames, rows)
        return self._loss(*augmentation.people(partner, reaction, random), is_frame)

    def _loss(self, partner: Tensor, reaction: Tensor, is_frame: Tensor) -> Tensor:
        error = (self(partner) - reaction).square().mean(dim=-1) / self.normalisation.scale**2
        return torch.masked_select(error, is_frame).mean()


def pad(frames: FrameSequences, rows: Sequence[int]) -> tuple[Tensor, Tensor, Tensor]:
    """Return partners and reactions ``(B, T, 3 J)``, and ``(B, T)`` which frames are no padding."""
    partner = pad_sequence([frames.partner[i] for i in rows], batch_first=True)
    reaction = pad_sequence([frames.reaction[i] for i in rows], batch_first=True)
    lengths = torch.tensor([len(frames.partner[i]) for i in rows], device=partner.device)
    is_frame = torch.arange(partner.shape[1], device=partner.device) < lengths[:, None]
    return partner, reaction, is_frame


def frame_times(start: float, end: float, fps: float) -> NDArray[np.float64]:
    """List evenly spaced times with both ends, at a frame rate as near to ``fps`` as possible."""
    return np.linspace(start, end, max(2, round((end - start) * fps) + 1))


def build_gru_training(
    clips: Sequence[Interaction],
    settings: GruSettings,
    *,
    validation: Sequence[Interaction] = (),
    device: str = "cpu",
) -> TrainingLoop[Gru]:
    """Build a GRU and the loop that trains it on squared error; an epoch yields ``loss``.

    Parameters
    ----------
    clips, validation : interactions; validation clips are scored in both directions
    settings : GruSettings
    device : of torch
    """
    check_common_skeleton([*clips, *validation])
    random = torch.Generator().manual_seed(settings.random_seed)
    shown = with_random_parts(clips, settings.parts)
    directions = expand_directions(shown, both=settings.both_directions)
    frames = sample_frames(directions, settings.fps, device)
    validation_frames = sample_frames(
        expand_directions(validation, both=True), settings.fps, device
    )
    config = GruConfig(clips[0].skeleton, settings.fps, settings.hidden, settings.n_layers)
    model = Gru(config)
    initialise_weights(model, random)
    model.to(device).normalisation.fit(sample_motion_pairs(directions, n_points=33).to(device))
    augmentation = RandomAugmentation(settings.augmentation, model.skeleton, n_points=0)
    trainer = SupervisedTrainer(
        model,
        len(frames.partner),
        lambda rows: model.training_loss(frames, rows.tolist(), augmentation, random),
        (lambda: model.loss(validation_frames, range(len(validation_frames.partner))))
        if validation
        else None,
        settings,
        random,
    )
    return TrainingLoop(trainer, n_epochs=settings.n_epochs, validate_every=settings.validate_every)


def gru_from_state(config: Mapping[str, Any], state: Mapping[str, Tensor]) -> Gru:
    """Rebuild a model from its configuration and ``training.state.model_state``."""
    model = Gru(GruConfig(**{**config, "skeleton": Skeleton.from_dict(config["skeleton"])}))
    model.load_state_dict(dict(state))
    return model.requires_grad_(False)


def sample_frames(clips: Sequence[Interaction], fps: float, device: str) -> FrameSequences:
    """Resample interactions to one frame rate: ``person_a`` is the partner, ``person_b`` reacts."""
    frames = FrameSequences([], [])
    for clip in clips:
        frame = body_frame(clip.person_a, clip.skeleton)
        out_times = frame_times(clip.times[0], clip.times[-1], fps)
        for motion, sampled in ((clip.person_a, frames.partner), (clip.person_b, frames.reaction)):
            local = frame.to_local(motion).reshape(len(motion), -1)
            values = Spline(clip.times, local)(out_times).astype(np.float32)
            sampled.append(torch.tensor(values, device=device))
    return frames


def build_regression_training(
    clips: Sequence[Interaction],
    settings: RegressionSettings,
    *,
    validation: Sequence[Interaction] = (),
    device: str = "cpu",
) -> TrainingLoop[Generator]:
    """Build a generator without noise and the loop that trains it on squared error.

    An epoch yields ``loss``.

    Parameters
    ----------
    clips, validation : interactions; validation clips are scored in both directions
    settings : RegressionSettings
    device : of torch
    """
    random = torch.Generator().manual_seed(settings.random_seed)
    shown = with_random_parts(clips, settings.parts)
    pairs = sample_motion_pairs(
        expand_directions(shown, both=settings.both_directions), settings.n_points
    ).to(device)
    validation_pairs = (
        sample_motion_pairs(expand_directions(validation, both=True), settings.n_points).to(device)
        if validation
        else None
    )
    model = Generator(_regression_config(clips[0].skeleton, settings))
    initialise_weights(model, random)
    model.to(device).normalisation.fit(pairs)
    augmentation = RandomAugmentation(settings.augmentation, model.skeleton, settings.n_points)
    trainer = SupervisedTrainer(
        model,
        len(pairs),
        lambda rows: _regression_loss(model, augmentation(pairs[rows.to(device)], random)),
        None if validation_pairs is None else lambda: _regression_loss(model, validation_pairs),
        settings,
        random,
    )
    return TrainingLoop(trainer, n_epochs=settings.n_epochs, validate_every=settings.validate_every)


def _regression_loss(model: Generator, pairs: MotionPairs) -> Tensor:
    """Return the mean squared error over time, in normalised units."""
    no_noise = pairs.partner.new_zeros(len(pairs), 0, 2 * model.config.noise.n_frequencies)
    error = (model(no_noise, pairs.condition) - pairs.reaction) / model.normalisation.scale
    loss: Tensor = (error.square().mean(dim=-1) @ trapezoid_weights(model.points)).mean()
    return loss


def _regression_config(skeleton: Skeleton, settings: RegressionSettings) -> GeneratorConfig:
    channels = 3 * len(skeleton.joints)
    return GeneratorConfig(
        skeleton,
        u_shape_config(settings, channels + 3, channels),
        GaussianRandomField(alpha=2.0, tau=5.0, n_frequencies=1, period=settings.period),
        noise_channels=0,
        actions=(),
        action_channels=0,
    )
