"""Fit the conditional generative adversarial neural operator (PaCMO, 3.2 and 4.2)."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import torch
from torch import Tensor

from pacmo_core.interaction import Interaction
from pacmo_core.operators.random_field import RandomField
from pacmo_core.operators.uno import UnoConfig, u_channels
from pacmo_core.pacmo.adversaries import Adversaries
from pacmo_core.pacmo.config import RATIOS, noise_from, skeleton_from, uno_from
from pacmo_core.pacmo.critic import Critic
from pacmo_core.pacmo.fit import Fit
from pacmo_core.pacmo.functions import both_sides, encode
from pacmo_core.pacmo.generator import Generator, GeneratorConfig
from pacmo_core.pacmo.settings import PacmoSettings
from pacmo_core.skeleton import Skeleton


def fit(
    clips: Sequence[Interaction],
    settings: PacmoSettings,
    *,
    validation: Sequence[Interaction] = (),
    device: str = "cpu",
) -> Fit[Generator]:
    """Train adversarially; the model is the running mean with the best energy score.

    An epoch yields ``distance`` (eq. 1's estimate), ``penalty``, ``gradient_norm``, ``judged``,
    ``symmetry`` and, if weighed, ``bones`` (m^2); ``validation`` is the energy score on either
    side of the held-out clips. In a group of processes each takes its share of every batch.
    """
    random = torch.Generator().manual_seed(settings.random_seed)
    pairs = encode(both_sides(clips, swap=settings.swap), settings.n_points).to(device)
    held_out = both_sides(validation, swap=True)
    held_out_pairs = encode(held_out, settings.n_points).to(device) if held_out else None
    generator = Generator(_generator_config(clips[0].skeleton, settings))
    critic = Critic(
        _uno(settings, 6 * len(clips[0].skeleton.joints) + 3, 1),
        generator.normalisation,
        hidden=settings.functional_hidden,
    )
    training = Adversaries(generator, critic, pairs, held_out_pairs, settings, random)
    return Fit(training, n_epochs=settings.n_epochs, validate_every=settings.validate_every)


def config(model: Generator) -> dict[str, Any]:
    """Describe a model in JSON's terms."""
    return asdict(model.config)


def from_state(config: Mapping[str, Any], state: Mapping[str, Tensor]) -> Generator:
    """Rebuild a model from what ``config`` and ``fit.state`` gave."""
    parts = GeneratorConfig(
        skeleton=skeleton_from(config["skeleton"]),
        uno=uno_from(config["uno"]),
        noise=noise_from(config["noise"]),
        noise_channels=config["noise_channels"],
    )
    model = Generator(parts)
    model.load_state_dict(dict(state))
    return model.requires_grad_(False)


def _generator_config(skeleton: Skeleton, settings: PacmoSettings) -> GeneratorConfig:
    channels = 3 * len(skeleton.joints)
    noise = RandomField(
        alpha=settings.noise_alpha,
        tau=settings.noise_tau,
        n_modes=settings.noise_modes,
        period=settings.period,
    )
    uno = _uno(settings, settings.noise_channels + channels + 3, channels)
    return GeneratorConfig(skeleton, uno, noise, settings.noise_channels)


def _uno(settings: PacmoSettings, in_channels: int, out_channels: int) -> UnoConfig:
    return UnoConfig(
        in_channels=in_channels,
        out_channels=out_channels,
        lifting=settings.width,
        channels=u_channels(settings.width),
        modes=tuple(settings.modes),
        ratios=RATIOS,
        n_points=settings.n_points,
        period=settings.period,
        skips=True,
    )
