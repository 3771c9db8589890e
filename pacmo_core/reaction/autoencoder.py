"""The auto-encoder operator on both people; its bottleneck gives the features (PaCMO, 4.3.1)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.operators.spectral import initialise_weights, interpolation_matrix
from pacmo_core.operators.uno import (
    U_SHAPE_RATIOS,
    Uno,
    UnoConfig,
    u_shape_channels,
    uno_config_from_dict,
)
from pacmo_core.reaction.data import MotionPairs, expand_directions, sample_motion_pairs
from pacmo_core.reaction.inputs import Normalisation
from pacmo_core.reaction.settings import AutoencoderSettings
from pacmo_core.training.loop import TrainingLoop
from pacmo_core.training.supervised import SupervisedTrainer

BOTTLENECK_LAYER = 4


@dataclass(frozen=True)
class AutoencoderConfig:
    """An auto-encoder's skeleton and operator."""

    skeleton: Skeleton
    uno: UnoConfig


class Autoencoder(nn.Module):
    """``M x M -> M x M`` in seven layers without skips.

    Parameters
    ----------
    config : AutoencoderConfig
    """

    points: Tensor
    to_features: Tensor
    feature_mean: Tensor
    feature_std: Tensor

    def __init__(self, config: AutoencoderConfig) -> None:
        super().__init__()
        self.config = config
        self.uno = Uno(config.uno)
        self.normalisation = Normalisation(channels=config.uno.out_channels // 2)
        channels = config.uno.channels[BOTTLENECK_LAYER - 1]
        self.register_buffer("feature_mean", torch.zeros(channels))
        self.register_buffer("feature_std", torch.ones(channels))
        self.register_buffer("points", torch.linspace(0, 1, config.uno.n_points), persistent=False)
        n_latent = config.uno.sizes[BOTTLENECK_LAYER - 1]
        midpoints = (torch.arange(n_latent) + 0.5) / n_latent
        to_features = interpolation_matrix(midpoints / config.uno.period, n_latent).float()
        self.register_buffer("to_features", to_features, persistent=False)

    def loss(self, pairs: MotionPairs) -> Tensor:
        """Take the mean squared error of the reconstruction, in normalised units."""
        inputs = self._inputs(pairs)
        both = inputs[..., : self.config.uno.out_channels]
        out: Tensor = self.uno(inputs)
        return (out - both).square().mean()

    def features(self, pairs: MotionPairs) -> Tensor:
        """Encode: ``(B, C, r)`` at r midpoints of equal cells of [0, 1], standardised."""
        hidden = self.uno.bottleneck(self._inputs(pairs), BOTTLENECK_LAYER)
        values = (self.to_features @ hidden.flatten(1)).view(-1, *hidden.shape[1:])
        return ((values - self.feature_mean) / self.feature_std).permute(1, 2, 0)

    def standardise(self, pairs: MotionPairs) -> None:
        """Give the features of these data mean zero and unit variance, channel by channel."""
        with torch.no_grad():
            self.feature_mean.zero_()
            self.feature_std.fill_(1)
            raw = self.features(pairs)
            self.feature_mean.copy_(raw.mean(dim=(0, 2)))
            self.feature_std.copy_(raw.std(dim=(0, 2)))

    def _inputs(self, pairs: MotionPairs) -> Tensor:
        norm, period = self.normalisation, self.config.uno.period
        context = norm.context(self.points, pairs.log_duration, period)
        motions = [norm.partner(pairs.partner), norm.reaction(pairs.reaction)]
        return torch.cat([*motions, context], dim=-1)


class AutoencoderTrainer(SupervisedTrainer[Autoencoder]):
    def __init__(
        self,
        model: Autoencoder,
        pairs: MotionPairs,
        held_out: MotionPairs | None,
        settings: AutoencoderSettings,
        random: torch.Generator,
    ) -> None:
        self.pairs = pairs
        super().__init__(
            model,
            len(pairs),
            lambda rows: model.loss(pairs[rows.to(pairs.partner.device)]),
            None if held_out is None else lambda: model.loss(held_out),
            settings,
            random,
        )

    def score(self) -> Tensor | None:
        """Standardise the features, since these weights may be handed over; take the loss."""
        self.model.standardise(self.pairs)
        return super().score()


def build_training(
    clips: Sequence[Interaction],
    settings: AutoencoderSettings,
    *,
    validation: Sequence[Interaction] = (),
    device: str = "cpu",
) -> TrainingLoop[Autoencoder]:
    """Train on reconstruction; an epoch yields ``loss``.

    ``validation`` is the loss on either side of the held-out clips.
    """
    random = torch.Generator().manual_seed(settings.random_seed)
    pairs = sample_motion_pairs(
        expand_directions(clips, both=settings.both_directions), settings.n_points
    ).to(device)
    held_out = expand_directions(validation, both=True)
    held_out_pairs = (
        sample_motion_pairs(held_out, settings.n_points).to(device) if held_out else None
    )
    model = Autoencoder(_autoencoder_config(clips[0].skeleton, settings))
    initialise_weights(model, random)
    model.to(device).normalisation.measure(pairs)
    training = AutoencoderTrainer(model, pairs, held_out_pairs, settings, random)
    return TrainingLoop(
        training, n_epochs=settings.n_epochs, validate_every=settings.validate_every
    )


def encode_features(
    model: Autoencoder, interactions: Sequence[Interaction], *, device: str = "cpu"
) -> NDArray[np.float64]:
    """Encode interactions, ``person_a`` the partner: ``(n, C, r)``, standardised, frozen."""
    pairs = sample_motion_pairs(interactions, model.config.uno.n_points)
    return encode_pairs(model, pairs, device=device)


def encode_pairs(
    model: Autoencoder, pairs: MotionPairs, *, device: str = "cpu"
) -> NDArray[np.float64]:
    """Encode pairs of functions: ``(n, C, r)``, r midpoints of equal cells of [0, 1]."""
    model.to(device)
    with torch.no_grad():
        found: NDArray[np.float64] = model.features(pairs.to(device)).cpu().double().numpy()
    return found


def autoencoder_from_state(config: Mapping[str, Any], state: Mapping[str, Tensor]) -> Autoencoder:
    """Rebuild a model from what ``config`` and ``fit.state`` gave."""
    parts = AutoencoderConfig(
        Skeleton.from_dict(config["skeleton"]), uno_config_from_dict(config["uno"])
    )
    model = Autoencoder(parts)
    model.load_state_dict(dict(state))
    return model.requires_grad_(False)


def _autoencoder_config(skeleton: Skeleton, settings: AutoencoderSettings) -> AutoencoderConfig:
    channels = list(u_shape_channels(settings.width))
    channels[BOTTLENECK_LAYER - 1] = settings.bottleneck_channels
    both = 6 * len(skeleton.joints)
    uno = UnoConfig(
        in_channels=both + 3,
        out_channels=both,
        lifting=settings.width,
        channels=tuple(channels),
        modes=tuple(settings.modes),
        ratios=U_SHAPE_RATIOS,
        n_points=settings.n_points,
        period=settings.period,
        skips=False,
    )
    return AutoencoderConfig(skeleton, uno)
