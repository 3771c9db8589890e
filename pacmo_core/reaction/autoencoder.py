"""The auto-encoder operator of interactions, whose bottleneck gives the features (PaCMO, 4.3.1).

The metrics compare distributions of these features: F2ID and diversity.
"""

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
    """A U-NO ``M x M -> M x M`` of seven layers without skip connections.

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
        """Return the mean squared error of the reconstruction, in normalised units."""
        inputs = self._inputs(pairs)
        both = inputs[..., : self.config.uno.out_channels]
        out: Tensor = self.uno(inputs)
        return (out - both).square().mean()

    def features(self, pairs: MotionPairs) -> Tensor:
        """Return features: ``(B, C, r)`` at r midpoints of equal cells of [0, 1], standardised."""
        hidden = self.uno.bottleneck(self._inputs(pairs), BOTTLENECK_LAYER)
        values = (self.to_features @ hidden.flatten(1)).view(-1, *hidden.shape[1:])
        return ((values - self.feature_mean) / self.feature_std).permute(1, 2, 0)

    def standardise(self, pairs: MotionPairs) -> None:
        """Set mean and standard deviation so that features of these data are standardised."""
        with torch.no_grad():
            self.feature_mean.zero_()
            self.feature_std.fill_(1)
            raw = self.features(pairs)
            self.feature_mean.copy_(raw.mean(dim=(0, 2)))
            self.feature_std.copy_(raw.std(dim=(0, 2)))

    def _inputs(self, pairs: MotionPairs) -> Tensor:
        normalisation, period = self.normalisation, self.config.uno.period
        partner = normalisation.normalise_partner(pairs.partner)
        reaction = normalisation.normalise_reaction(pairs.reaction)
        context = normalisation.time_and_duration(self.points, pairs.log_duration, period)
        return torch.cat([partner, reaction, context], dim=-1)


class AutoencoderTrainer(SupervisedTrainer[Autoencoder]):
    """Train on the reconstruction error; standardise the features at every validation.

    Parameters
    ----------
    model : Autoencoder
    pairs : training data
    validation_pairs : to select weights on, or None
    settings : AutoencoderSettings
    random : CPU generator of the order of pairs
    """

    def __init__(
        self,
        model: Autoencoder,
        pairs: MotionPairs,
        validation_pairs: MotionPairs | None,
        settings: AutoencoderSettings,
        random: torch.Generator,
    ) -> None:
        self.pairs = pairs
        super().__init__(
            model,
            len(pairs),
            lambda rows: model.loss(pairs[rows.to(pairs.partner.device)]),
            None if validation_pairs is None else lambda: model.loss(validation_pairs),
            settings,
            random,
        )

    def validate(self) -> dict[str, Tensor]:
        """Standardise the features, for these weights may be selected; return the loss."""
        self.model.standardise(self.pairs)
        return super().validate()


def build_training(
    clips: Sequence[Interaction],
    settings: AutoencoderSettings,
    *,
    validation: Sequence[Interaction] = (),
    device: str = "cpu",
) -> TrainingLoop[Autoencoder]:
    """Build an auto-encoder and the loop that trains it on reconstruction.

    An epoch yields ``loss``.

    Parameters
    ----------
    clips, validation : interactions; validation clips are scored in both directions
    settings : AutoencoderSettings
    device : of torch
    """
    random = torch.Generator().manual_seed(settings.random_seed)
    pairs = sample_motion_pairs(
        expand_directions(clips, both=settings.both_directions), settings.n_points
    ).to(device)
    validation_pairs = (
        sample_motion_pairs(expand_directions(validation, both=True), settings.n_points).to(device)
        if validation
        else None
    )
    model = Autoencoder(_autoencoder_config(clips[0].skeleton, settings))
    initialise_weights(model, random)
    model.to(device).normalisation.fit(pairs)
    trainer = AutoencoderTrainer(model, pairs, validation_pairs, settings, random)
    return TrainingLoop(trainer, n_epochs=settings.n_epochs, validate_every=settings.validate_every)


def encode_features(
    model: Autoencoder, interactions: Sequence[Interaction], *, device: str = "cpu"
) -> NDArray[np.float64]:
    """Return features of interactions, ``person_a`` the partner: ``(n, C, r)``, standardised."""
    pairs = sample_motion_pairs(interactions, model.config.uno.n_points)
    return encode_pairs(model, pairs, device=device)


def encode_pairs(
    model: Autoencoder, pairs: MotionPairs, *, device: str = "cpu"
) -> NDArray[np.float64]:
    """Return features of pairs: ``(n, C, r)`` at r midpoints of equal cells of [0, 1]."""
    model.to(device)
    with torch.no_grad():
        features: NDArray[np.float64] = model.features(pairs.to(device)).cpu().double().numpy()
    return features


def autoencoder_from_state(config: Mapping[str, Any], state: Mapping[str, Tensor]) -> Autoencoder:
    """Rebuild a model from its configuration and ``training.state.model_state``."""
    config_fields = AutoencoderConfig(
        Skeleton.from_dict(config["skeleton"]), uno_config_from_dict(config["uno"])
    )
    model = Autoencoder(config_fields)
    model.load_state_dict(dict(state))
    return model.requires_grad_(False)


def _autoencoder_config(skeleton: Skeleton, settings: AutoencoderSettings) -> AutoencoderConfig:
    channels = list(u_shape_channels(settings.width))
    channels[BOTTLENECK_LAYER - 1] = settings.bottleneck_channels
    channels_of_both = 6 * len(skeleton.joints)
    uno = UnoConfig(
        in_channels=channels_of_both + 3,
        out_channels=channels_of_both,
        lifting=settings.width,
        channels=tuple(channels),
        modes=tuple(settings.modes),
        ratios=U_SHAPE_RATIOS,
        n_points=settings.n_points,
        period=settings.period,
        skips=False,
    )
    return AutoencoderConfig(skeleton, uno)
