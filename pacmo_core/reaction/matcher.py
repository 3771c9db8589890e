"""The matcher, a contrastive model of which reaction belongs to which partner, and its training.

Two operators embed the partner's and the reaction's motion as functions of time of unit length in
L2; a reaction fits a partner as well as the two functions agree. In a batch, each partner is to
select its reaction and each reaction its partner: InfoNCE (van den Oord et al. 2018, *Contrastive
predictive coding*) in both directions, as in CLIP (Radford et al. 2021).
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


@dataclass(frozen=True)
class MatcherConfig:
    """A matcher's skeleton, the operator of either side and how sharply it chooses."""

    skeleton: Skeleton
    uno: UnoConfig
    n_instants: int
    temperature: float


class Matcher(nn.Module):
    """Embed partners and reactions so that those of one interaction lie close.

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
        r = config.n_instants
        midpoints = (torch.arange(r) + 0.5) / r
        evaluation = interpolation_matrix(
            midpoints / config.uno.period, config.uno.sizes[-1]
        ).float()
        self.register_buffer("evaluation", evaluation, persistent=False)

    def forward(self, pairs: MotionPairs) -> tuple[Tensor, Tensor]:
        """Embed both sides: two ``(B, r E)``, unit vectors whose product is the fit."""
        norm, period = self.normalisation, self.config.uno.period
        context = norm.context(self.points, pairs.log_duration, period)
        return (
            self._embedded(self.partner, norm.partner(pairs.partner), context),
            self._embedded(self.reaction, norm.reaction(pairs.reaction), context),
        )

    def loss(self, pairs: MotionPairs, clips: Tensor) -> Tensor:
        """Take the mean surprise at the true partner among those given, and at the true reaction.

        Parameters
        ----------
        pairs : B real pairs
        clips : (B,) the clip of each; the other person's view of a clip is no rival
        """
        partner, reaction = self(pairs)
        fit = partner @ reaction.T / self.config.temperature
        true = torch.arange(len(clips), device=clips.device)
        alike = (clips[:, None] == clips) & (true[:, None] != true)
        fit = fit.masked_fill(alike, -torch.inf)
        return (functional.cross_entropy(fit, true) + functional.cross_entropy(fit.T, true)) / 2

    def _embedded(self, operator: Uno, motion: Tensor, context: Tensor) -> Tensor:
        inputs = torch.cat([motion, context], dim=-1)
        values = operator.evaluate(operator.trunk(inputs), inputs, self.evaluation)
        return functional.normalize(values.flatten(1), dim=-1)


# Of the three layers' grids to the latent one.
GRID_RATIOS = (0.75, 0.5, 0.5)


def build_training(
    clips: Sequence[Interaction],
    settings: MatcherSettings,
    *,
    validation: Sequence[Interaction] = (),
    device: str = "cpu",
) -> TrainingLoop[Matcher]:
    """Train on real pairs, from both sides and mirrored; an epoch yields ``loss``.

    ``validation`` is the loss on all views of the held-out clips.
    """
    random = torch.Generator().manual_seed(settings.random_seed)
    pairs, codes = _all_views(clips, settings, device)
    held_out = _all_views(validation, settings, device) if validation else None
    model = Matcher(_matcher_config(clips[0].skeleton, settings))
    initialise_weights(model, random)
    model.to(device).normalisation.measure(pairs)

    def loss(rows: Tensor) -> Tensor:
        rows = rows.to(device)
        return model.loss(_offset_joints(pairs[rows], settings.joint_noise, random), codes[rows])

    judge = None if held_out is None else lambda: model.loss(*held_out)
    training = SupervisedTrainer(model, len(pairs), loss, judge, settings, random)
    return TrainingLoop(
        training, n_epochs=settings.n_epochs, validate_every=settings.validate_every
    )


def embed(
    model: Matcher, interactions: Sequence[Interaction]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Embed interactions, ``person_a`` the partner: two ``(n, E)`` of unit vectors."""
    with torch.no_grad():
        partner, reaction = model(sample_motion_pairs(interactions, model.config.uno.n_points))
    return partner.double().numpy(), reaction.double().numpy()


def matcher_from_state(config: Mapping[str, Any], state: Mapping[str, Tensor]) -> Matcher:
    """Rebuild a model from what ``config`` and ``fit.state`` gave."""
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
    return MatcherConfig(skeleton, uno, settings.n_instants, settings.temperature)


def _all_views(
    clips: Sequence[Interaction], settings: MatcherSettings, device: str
) -> tuple[MotionPairs, Tensor]:
    """Encode each clip from either person and, if asked, mirrored; with the clip of each."""
    check_common_skeleton(clips)
    views = expand_directions(clips, both=True)
    if settings.mirror:
        views += [mirror_interaction(view) for view in views]
    codes = torch.arange(len(clips), device=device).repeat(len(views) // len(clips))
    return sample_motion_pairs(views, settings.n_points).to(device), codes


def _offset_joints(pairs: MotionPairs, noise: float, random: torch.Generator) -> MotionPairs:
    """Move every joint by an offset of its own, the same at all times: few clips, many bodies."""
    partner, reaction = (
        motion
        + noise * torch.randn(len(motion), 1, motion.shape[-1], generator=random).to(motion.device)
        for motion in (pairs.partner, pairs.reaction)
    )
    return replace(pairs, partner=partner, reaction=reaction)
