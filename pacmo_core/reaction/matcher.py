"""The matcher, a contrastive model of which reaction belongs to which partner, and its training.

Two operators embed the partner's and the reaction's motion as functions of time of unit norm in L2;
the inner product of the two is their similarity. In a batch, each partner's reaction is classified
among all reactions and each reaction's partner among all partners: InfoNCE (van den Oord et al.
2018, *Contrastive predictive coding*) in both directions, as in CLIP (Radford et al. 2021).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.limits import MAX_GRID
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.operators.spectral import initialise_weights, interpolation_matrix
from pacmo_core.operators.uno import Uno, UnoConfig, uno_config_from_dict
from pacmo_core.reaction.data import (
    MotionPairs,
    check_common_skeleton,
    expand_directions,
    mirror_interaction,
    sample_motion_pairs,
)
from pacmo_core.reaction.inputs import Normalisation
from pacmo_core.reaction.settings import MatcherSettings
from pacmo_core.training.loop import TrainingLoop
from pacmo_core.training.supervised import SupervisedTrainer

# Sizes of the three layers' grids, relative to the latent grid.
GRID_RATIOS = (0.75, 0.5, 0.5)


@dataclass(frozen=True)
class MatcherConfig:
    """A matcher's skeleton, operator, times of the embedding and temperature of the softmax."""

    skeleton: Skeleton
    uno: UnoConfig
    n_times: int
    temperature: float

    def __post_init__(self) -> None:
        if not 0 < self.n_times <= MAX_GRID:
            raise ValueError(f"n_times must be 1 to {MAX_GRID}; got {self.n_times}")


class Matcher(nn.Module):
    """Embed partners and reactions so that those of one interaction have a high inner product.

    Parameters
    ----------
    config : MatcherConfig
    """

    points: Tensor
    evaluation: Tensor

    def __init__(self, config: MatcherConfig) -> None:
        super().__init__()
        self.config = config
        self.partner, self.reaction = Uno(config.uno), Uno(config.uno)
        self.normalisation = Normalisation(channels=config.uno.in_channels - 3)
        self.register_buffer("points", torch.linspace(0, 1, config.uno.n_points), persistent=False)
        midpoints = (torch.arange(config.n_times) + 0.5) / config.n_times
        evaluation = interpolation_matrix(
            midpoints / config.uno.period, config.uno.sizes[-1]
        ).float()
        self.register_buffer("evaluation", evaluation, persistent=False)

    def forward(self, pairs: MotionPairs) -> tuple[Tensor, Tensor]:
        """Embed partners and reactions: two ``(B, r E)``, unit vectors."""
        normalisation, period = self.normalisation, self.config.uno.period
        context = normalisation.time_and_duration(self.points, pairs.log_duration, period)
        partner = normalisation.normalise_partner(pairs.partner)
        reaction = normalisation.normalise_reaction(pairs.reaction)
        return (
            self._embed(self.partner, partner, context),
            self._embed(self.reaction, reaction, context),
        )

    def loss(self, pairs: MotionPairs, clips: Tensor) -> Tensor:
        """Return the symmetric InfoNCE loss: cross-entropies of both classifications.

        Parameters
        ----------
        pairs : B real pairs
        clips : (B,) index of each pair's clip; other pairs of the same clip are no negatives
        """
        partner, reaction = self(pairs)
        logits = partner @ reaction.T / self.config.temperature
        target = torch.arange(len(clips), device=clips.device)
        same_clip = (clips[:, None] == clips) & (target[:, None] != target)
        logits = logits.masked_fill(same_clip, -torch.inf)
        of_partner = functional.cross_entropy(logits, target)
        return (of_partner + functional.cross_entropy(logits.T, target)) / 2

    def _embed(self, operator: Uno, motion: Tensor, context: Tensor) -> Tensor:
        inputs = torch.cat([motion, context], dim=-1)
        values = operator.evaluate(operator.trunk(inputs), inputs, self.evaluation)
        return functional.normalize(values.flatten(1), dim=-1)


def build_training(
    clips: Sequence[Interaction],
    settings: MatcherSettings,
    *,
    validation: Sequence[Interaction] = (),
    device: str = "cpu",
) -> TrainingLoop[Matcher]:
    """Build a matcher and the loop that trains it on real pairs; an epoch yields ``loss``.

    Parameters
    ----------
    clips, validation : interactions, taken in both directions and, if set so, mirrored
    settings : MatcherSettings
    device : of torch
    """
    random = torch.Generator().manual_seed(settings.random_seed)
    pairs, indices = _sample_views(clips, settings, device)
    validation_views = _sample_views(validation, settings, device) if validation else None
    model = Matcher(_matcher_config(clips[0].skeleton, settings))
    initialise_weights(model, random)
    model.to(device).normalisation.fit(pairs)

    def loss(rows: Tensor) -> Tensor:
        rows = rows.to(device)
        return model.loss(_offset_joints(pairs[rows], settings.joint_noise, random), indices[rows])

    validation_loss = None if validation_views is None else lambda: model.loss(*validation_views)
    trainer = SupervisedTrainer(model, len(pairs), loss, validation_loss, settings, random)
    return TrainingLoop(trainer, n_epochs=settings.n_epochs, validate_every=settings.validate_every)


def embed(
    model: Matcher, interactions: Sequence[Interaction]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Embed interactions, ``person_a`` the partner: two ``(n, E)`` of unit vectors."""
    with torch.no_grad():
        partner, reaction = model(sample_motion_pairs(interactions, model.config.uno.n_points))
    return partner.double().numpy(), reaction.double().numpy()


def matcher_from_state(config: Mapping[str, Any], state: Mapping[str, Tensor]) -> Matcher:
    """Rebuild a model from its configuration and ``training.state.model_state``."""
    parts = {
        "skeleton": Skeleton.from_dict(config["skeleton"]),
        "uno": uno_config_from_dict(config["uno"]),
    }
    model = Matcher(MatcherConfig(**{**config, **parts}))
    model.load_state_dict(dict(state))
    return model.requires_grad_(False)


def _matcher_config(skeleton: Skeleton, settings: MatcherSettings) -> MatcherConfig:
    width = settings.width
    uno = UnoConfig(
        in_channels=3 * len(skeleton.joints) + 3,
        out_channels=settings.embedding_channels,
        lifting=width,
        channels=(width, width, width),
        modes=tuple(settings.modes),
        ratios=GRID_RATIOS,
        n_points=settings.n_points,
        period=settings.period,
        skips=False,
    )
    return MatcherConfig(skeleton, uno, settings.n_times, settings.temperature)


def _sample_views(
    clips: Sequence[Interaction], settings: MatcherSettings, device: str
) -> tuple[MotionPairs, Tensor]:
    """Sample clips in both directions and, if set, mirrored; return also each pair's clip."""
    check_common_skeleton(clips)
    views = expand_directions(clips, both=True)
    if settings.mirror:
        views += [mirror_interaction(view) for view in views]
    indices = torch.arange(len(clips), device=device).repeat(len(views) // len(clips))
    return sample_motion_pairs(views, settings.n_points).to(device), indices


def _offset_joints(pairs: MotionPairs, noise: float, random: torch.Generator) -> MotionPairs:
    """Augment: add a random constant offset to each joint, as of other bodies."""
    partner, reaction = (
        motion
        + noise * torch.randn(len(motion), 1, motion.shape[-1], generator=random).to(motion.device)
        for motion in (pairs.partner, pairs.reaction)
    )
    return replace(pairs, partner=partner, reaction=reaction)
