"""The same trunk without noise, regressed: how far a deterministic operator gets."""

from collections.abc import Sequence

import torch
from torch import Tensor

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.operators.initialise import initialise
from pacmo_core.operators.quadrature import trapezoid_weights
from pacmo_core.operators.random_field import RandomField
from pacmo_core.reaction.augment import Augment
from pacmo_core.reaction.config import trunk
from pacmo_core.reaction.fit import Fit
from pacmo_core.reaction.functions import MotionPairs, both_sides, encode
from pacmo_core.reaction.generator import Generator, GeneratorConfig
from pacmo_core.reaction.settings import RegressionSettings
from pacmo_core.reaction.supervised import Supervised


def fit(
    clips: Sequence[Interaction],
    settings: RegressionSettings,
    *,
    validation: Sequence[Interaction] = (),
    device: str = "cpu",
) -> Fit[Generator]:
    """Train a generator of no noise on squared error; an epoch yields ``loss``.

    ``validation`` is the loss on either side of the held-out clips.
    """
    random = torch.Generator().manual_seed(settings.random_seed)
    pairs = encode(both_sides(clips, swap=settings.swap), settings.n_points).to(device)
    sides = both_sides(validation, swap=True)
    held_out = encode(sides, settings.n_points).to(device) if sides else None
    model = Generator(_config(clips[0].skeleton, settings))
    initialise(model, random)
    model.to(device).normalisation.measure(pairs)
    augment = Augment(settings.augment, model.skeleton, settings.n_points)
    training = Supervised(
        model,
        len(pairs),
        lambda rows: _loss(model, augment(pairs[rows.to(device)], random)),
        None if held_out is None else lambda: _loss(model, held_out),
        settings,
        random,
    )
    return Fit(training, n_epochs=settings.n_epochs, validate_every=settings.validate_every)


def _loss(model: Generator, pairs: MotionPairs) -> Tensor:
    """Take the mean squared error over time, in normalised units."""
    no_noise = pairs.partner.new_zeros(len(pairs), 0, 2 * model.config.noise.n_modes)
    error = (model(no_noise, pairs.condition) - pairs.reaction) / model.normalisation.scale
    loss: Tensor = (error.square().mean(dim=-1) @ trapezoid_weights(model.points)).mean()
    return loss


def _config(skeleton: Skeleton, settings: RegressionSettings) -> GeneratorConfig:
    motion = 3 * len(skeleton.joints)
    return GeneratorConfig(
        skeleton,
        trunk(settings, motion + 3, motion),
        RandomField(alpha=2.0, tau=5.0, n_modes=1, period=settings.period),
        noise_channels=0,
        actions=(),
        action_channels=0,
    )
