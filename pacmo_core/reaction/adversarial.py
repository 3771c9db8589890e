"""Fit the conditional generative adversarial neural operator (PaCMO, 3.2 and 4.2)."""

from collections.abc import Sequence

import torch

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.operators.random_field import RandomField
from pacmo_core.reaction.adversaries import Adversaries
from pacmo_core.reaction.config import trunk
from pacmo_core.reaction.critic import Conditions, Critic, end_joints
from pacmo_core.reaction.fit import Fit
from pacmo_core.reaction.functions import MotionPairs, both_sides, encode
from pacmo_core.reaction.generator import Generator, GeneratorConfig
from pacmo_core.reaction.labels import LabelFunction, numbers_of
from pacmo_core.reaction.settings import PacmoSettings


def fit(
    clips: Sequence[Interaction],
    settings: PacmoSettings,
    *,
    labels: Sequence[str] = (),
    validation: Sequence[Interaction] = (),
    validation_labels: Sequence[str] = (),
    device: str = "cpu",
) -> Fit[Generator]:
    """Train adversarially; the model is the running mean with the best energy score.

    An epoch yields ``distance`` (eq. 1's estimate), ``penalty``, ``gradient_norm``, ``judged``,
    ``symmetry`` and, if weighed, ``score`` and ``bones`` (m^2); ``validation`` is the energy score
    on either side of the held-out clips. In a group of processes each takes its share of every
    batch.

    Parameters
    ----------
    clips, validation : interactions
    settings : PacmoSettings
    labels, validation_labels : the action of each, a condition if ``action_channels`` is not 0
    device : of torch

    Raises
    ------
    ValueError
        If labels are wanted and not one a clip, or a held-out one was never trained on.
    """
    actions = tuple(sorted(set(labels))) if settings.action_channels else ()
    if settings.action_channels and (len(labels), len(validation_labels)) != (
        len(clips),
        len(validation),
    ):
        raise ValueError(
            f"action_channels want a label a clip: {len(clips)} and {len(validation)}; "
            f"got {len(labels)} and {len(validation_labels)}"
        )
    random = torch.Generator().manual_seed(settings.random_seed)
    pairs = _encode(clips, labels, actions, settings, swap=settings.swap).to(device)
    held_out = (
        _encode(validation, validation_labels, actions, settings, swap=True).to(device)
        if validation
        else None
    )
    generator = Generator(_generator_config(clips[0].skeleton, actions, settings))
    critic = _critic(generator, settings)
    training = Adversaries(generator, critic, pairs, held_out, settings, random)
    return Fit(training, n_epochs=settings.n_epochs, validate_every=settings.validate_every)


def _encode(
    clips: Sequence[Interaction],
    labels: Sequence[str],
    actions: tuple[str, ...],
    settings: PacmoSettings,
    *,
    swap: bool,
) -> MotionPairs:
    sides = both_sides(clips, swap=swap)
    numbers = numbers_of(labels, actions) if actions else torch.zeros(len(clips), dtype=torch.long)
    return encode(sides, settings.n_points, numbers.repeat(len(sides) // len(clips)))


def _generator_config(
    skeleton: Skeleton, actions: tuple[str, ...], settings: PacmoSettings
) -> GeneratorConfig:
    motion = 3 * len(skeleton.joints)
    noise = RandomField(
        alpha=settings.noise_alpha,
        tau=settings.noise_tau,
        n_modes=settings.noise_modes,
        period=settings.period,
    )
    return GeneratorConfig(
        skeleton,
        trunk(settings, settings.noise_channels + motion + 3 + settings.action_channels, motion),
        noise,
        settings.noise_channels,
        actions,
        settings.action_channels,
    )


def _critic(generator: Generator, settings: PacmoSettings) -> Critic:
    n_actions, channels = len(generator.config.actions), settings.action_channels
    conditions = Conditions(
        ends=end_joints(generator.skeleton) if settings.body_distances else (),
        labels=LabelFunction(n_actions=n_actions, channels=channels) if n_actions else None,
    )
    both = 6 * len(generator.skeleton.joints)
    return Critic(
        trunk(settings, both + 3 + conditions.channels, 1),
        generator.normalisation,
        conditions,
        hidden=settings.functional_hidden,
    )
