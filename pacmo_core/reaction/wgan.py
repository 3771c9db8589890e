"""Training of PaCMO, a conditional WGAN with gradient penalty (PaCMO, sections 3.2 and 4.2).

Generator and critic are trained in turn with Adam; the model is the exponential moving average
(EMA) of the generator's weights. Beyond the paper, the generator may be trained on an energy score
too, and first of all on it alone (warm-up). ``losses.WganLosses`` holds the losses.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor, nn

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.operators.random_field import GaussianRandomField
from pacmo_core.operators.spectral import initialise_weights
from pacmo_core.operators.uno import u_shape_config
from pacmo_core.reaction.critic import Critic, CriticInputs, end_effectors
from pacmo_core.reaction.data import (
    MotionPairs,
    RandomAugmentation,
    expand_directions,
    sample_motion_pairs,
    with_random_parts,
)
from pacmo_core.reaction.energy_score import mean_energy_scores
from pacmo_core.reaction.generator import Generator, GeneratorConfig, copy_weights
from pacmo_core.reaction.inputs import UNLABELLED, ActionEmbedding, action_indices
from pacmo_core.reaction.losses import LossAndTerms, WganBatch, WganLosses
from pacmo_core.reaction.settings import AdamSettings, PacmoSettings
from pacmo_core.training.devices import ProcessGroup
from pacmo_core.training.loop import VALIDATION, TrainingLoop
from pacmo_core.training.state import (
    adam_state,
    add_prefixes,
    check_finite,
    ema_copy,
    load_adam_state,
    select_prefix,
    update_ema,
)
from pacmo_core.training.supervised import mean_terms, set_learning_rate


class WganTrainer:
    """Generator, critic, their optimisers, and the EMA of the generator.

    Parameters
    ----------
    generator, critic : sharing one ``Normalisation``; their weights are initialised here
    pairs : training data
    validation_pairs : to select weights on, or None
    settings : PacmoSettings
    random : CPU generator of weights, batches, augmentation, interpolation and noise

    Raises
    ------
    ValueError
        If a batch has fewer pairs than there are processes.
    """

    def __init__(
        self,
        generator: Generator,
        critic: Critic,
        pairs: MotionPairs,
        validation_pairs: MotionPairs | None,
        settings: PacmoSettings,
        random: torch.Generator,
    ) -> None:
        self.generator, self.critic = generator, critic
        self.pairs, self.validation_pairs = pairs, validation_pairs
        self.settings, self.random = settings, random
        self.batch_size = min(settings.batch_size, len(pairs))
        self.process_group = ProcessGroup.current()
        self.local_rows = self.process_group.rows(self.batch_size)
        for network in (generator, critic):
            initialise_weights(network, random)
            network.to(pairs.partner.device)
        generator.normalisation.fit(pairs)
        if settings.start.weights:
            copy_weights(generator, Path(settings.start.weights), settings.start.sha256)
        self.start = ema_copy(generator) if settings.start.weights else None
        self.ema_generator = ema_copy(generator)
        self.ema_generator.temperature.fill_(settings.temperatures[0])
        self.selects_weights = not settings.validate_from
        self.losses = WganLosses(generator, critic, settings)
        self.augmentation = RandomAugmentation(
            settings.augmentation, generator.skeleton, settings.n_points
        )
        self.adam_generator = _build_adam(generator, settings.generator)
        self.adam_critic = _build_adam(critic, settings.critic)

    @property
    def model(self) -> Generator:
        """The EMA of the generator, of which ``start.share`` is what it continues from."""
        return self.ema_generator

    @property
    def steps_per_epoch(self) -> int:
        """Generator steps in which the critic is trained on about as many pairs as there are."""
        # Without a critic there are as many as with one critic step for each.
        n_critic = max(1, self.settings.n_critic)
        return math.ceil(len(self.pairs) / (self.settings.batch_size * n_critic))

    def train_epoch(self, number: int) -> dict[str, float]:
        """Train for an epoch; the terms are means over its steps.

        In the first ``warmup_epochs`` the generator is trained on the energy score and the
        penalties on bones alone: from then on its reactions are near enough to the data for the
        gradients of an untrained critic to be informative. Without a critic it stays so.
        """
        settings, every = self.settings, self.settings.halve_learning_rate_every
        remaining = (settings.n_epochs - number) / (settings.cooldown_epochs + 1)
        rate = settings.generator.learning_rate * min(1.0, remaining)
        set_learning_rate(self.adam_generator, rate, epoch=number, every=every)
        set_learning_rate(
            self.adam_critic, settings.critic.learning_rate, epoch=number, every=every
        )
        self.selects_weights = number >= settings.validate_from
        without_critic = number < settings.warmup_epochs or not settings.n_critic
        step = self.warmup_step if without_critic else self.step
        return mean_terms([step() for _ in range(self.steps_per_epoch)])

    def step(self) -> dict[str, float]:
        """Update the critic ``n_critic`` times and the generator once."""
        critic_terms = [self._update_critic() for _ in range(self.settings.n_critic)]
        return mean_terms(critic_terms) | self._update_generator(use_critic=True)

    def warmup_step(self) -> dict[str, float]:
        """Update the generator once, without the critic."""
        return self._update_generator(use_critic=False)

    def validate(self) -> dict[str, Tensor]:
        """Return the EMA's energy scores on validation pairs, on the same noise every time.

        ``validation`` is the score that is minimised in training, of whole spread; the others are
        its parts. Of several temperatures the one with the best score is set. Epochs before
        ``validate_from`` are not scored: the score soon changes by chance only, while the critic
        still improves what a score on few clips does not measure.
        """
        if self.validation_pairs is None or not self.selects_weights:
            return {}
        pairs = self.validation_pairs
        found = {value: self._validate_at(value, pairs) for value in self.settings.temperatures}
        best = min(found, key=lambda value: float(found[value][VALIDATION]))
        self.ema_generator.temperature.fill_(best)
        return found[best]

    def _validate_at(self, temperature: float, pairs: MotionPairs) -> dict[str, Tensor]:
        self.ema_generator.temperature.fill_(temperature)
        scores = mean_energy_scores(
            self.ema_generator,
            pairs,
            self.losses.contact_score,
            n_samples=self.settings.validation_samples,
            batch_size=self.settings.batch_size,
            # A separate random generator: validation must not change the training.
            random=torch.Generator().manual_seed(self.settings.random_seed),
        )
        parts = {f"{VALIDATION}_{name}": score for name, score in scores.items()}
        motion = scores.pop("motion")
        return {VALIDATION: motion + self.losses.contact_score.total(scores), **parts}

    def state_dict(self) -> dict[str, Tensor]:
        """Return both networks, the EMA, both optimisers and the state of the random generator."""
        return add_prefixes(
            generator=self.generator.state_dict(),
            critic=self.critic.state_dict(),
            ema_generator=self.ema_generator.state_dict(),
            adam_generator=adam_state(self.adam_generator),
            adam_critic=adam_state(self.adam_critic),
            random={"state": self.random.get_state()},
        )

    def load_state_dict(self, state: Mapping[str, Tensor]) -> None:
        """Restore what ``state_dict`` returned."""
        self.generator.load_state_dict(select_prefix(state, "generator"))
        self.critic.load_state_dict(select_prefix(state, "critic"))
        self.ema_generator.load_state_dict(select_prefix(state, "ema_generator"))
        load_adam_state(self.adam_generator, select_prefix(state, "adam_generator"))
        load_adam_state(self.adam_critic, select_prefix(state, "adam_critic"))
        self.random.set_state(state["random/state"])

    def _update_critic(self) -> dict[str, float]:
        batch = self._sample_batch(for_critic=True)
        return self._minimise(self.adam_critic, self.losses.critic_loss(batch))

    def _update_generator(self, *, use_critic: bool) -> dict[str, float]:
        batch = self._sample_batch(for_critic=False)
        loss = self.losses.generator_loss(batch, use_critic=use_critic)
        terms = self._minimise(self.adam_generator, loss)
        settings = self.settings
        update_ema(
            self.ema_generator,
            self.generator,
            settings.ema_decay,
            self.start,
            settings.start.share,
        )
        return terms

    def _sample_batch(self, *, for_critic: bool) -> WganBatch:
        """Sample a whole batch, the same in every process, and return this process's rows."""
        n, device = self.batch_size, self.pairs.partner.device
        rows = torch.randint(len(self.pairs), (n,), generator=self.random)
        real = self._withhold_labels(self.augmentation(self.pairs[rows.to(device)], self.random))
        # The critic needs one reaction to a partner, an energy score two.
        n_samples = 2 if self.settings.energy_score_weight and not for_critic else 1
        noise = torch.stack([self.generator.sample_noise(n, self.random) for _ in range(n_samples)])
        interpolation = (
            torch.rand(n, 1, 1, generator=self.random) if for_critic else torch.zeros(n, 1, 1)
        )
        local = self.local_rows
        return WganBatch(real[local], noise[:, local].to(device), interpolation[local].to(device))

    def _withhold_labels(self, pairs: MotionPairs) -> MotionPairs:
        """Take the label from a share of pairs, so that reactions without one are learnt too."""
        if not self.settings.action_dropout:
            return pairs
        withheld = torch.rand(len(pairs), generator=self.random) < self.settings.action_dropout
        unlabelled = self.generator.config.actions.index(UNLABELLED)
        action = pairs.action.masked_fill(withheld.to(pairs.action.device), unlabelled)
        return replace(pairs, action=action)

    def _minimise(self, adam: torch.optim.Adam, loss_and_terms: LossAndTerms) -> dict[str, float]:
        loss, terms = loss_and_terms
        # Averaged first, so that all processes stop at a loss that is not finite.
        averaged = self.process_group.mean(list(terms.values()), self.batch_size)
        values = check_finite(dict(zip(terms, averaged, strict=True)), "wgan")
        parameters = adam.param_groups[0]["params"]
        gradients = self.process_group.mean(torch.autograd.grad(loss, parameters), self.batch_size)
        for parameter, gradient in zip(parameters, gradients, strict=True):
            parameter.grad = gradient
        adam.step()
        return values


def _build_adam(network: nn.Module, settings: AdamSettings) -> torch.optim.Adam:
    beta_1, beta_2 = settings.betas
    return torch.optim.Adam(network.parameters(), lr=settings.learning_rate, betas=(beta_1, beta_2))


def build_training(
    clips: Sequence[Interaction],
    settings: PacmoSettings,
    *,
    actions: Sequence[str] = (),
    validation: Sequence[Interaction] = (),
    validation_actions: Sequence[str] = (),
    device: str = "cpu",
) -> TrainingLoop[Generator]:
    """Build generator, critic and the loop that trains them.

    The model is the exponential moving average with the best energy score on the validation
    clips, in both directions. An epoch yields ``wasserstein_distance`` (the estimate of eq. 1),
    ``gradient_penalty``, ``gradient_norm``, ``critic_score``, ``bone_symmetry`` and, where their
    weights are not 0, ``energy_score``, ``contact_score`` and ``bone_length_variance`` (m^2). A
    validation yields ``validation``, and its parts ``validation_motion``, ``validation_near``,
    ``validation_log_distance`` and ``validation_stance``. In a group of processes each computes a
    part of every batch.

    Parameters
    ----------
    clips, validation : interactions
    settings : PacmoSettings
    actions, validation_actions : label of each clip, a condition if ``action_channels`` is not 0;
        with ``action_dropout`` validation is without labels, as most captures have none
    device : of torch

    Raises
    ------
    ValueError
        If ``action_channels`` is not 0 and the labels are not one a clip, or a validation label is
        no training label.
    """
    if settings.action_channels and (len(actions), len(validation_actions)) != (
        len(clips),
        len(validation),
    ):
        raise ValueError(
            f"action_channels want a label a clip: {len(clips)} and {len(validation)}; "
            f"got {len(actions)} and {len(validation_actions)}"
        )
    known = tuple(sorted(set(actions))) if settings.action_channels else ()
    if settings.action_dropout:
        known = (UNLABELLED, *known)
        validation_actions = [UNLABELLED] * len(validation)
    random = torch.Generator().manual_seed(settings.random_seed)
    shown = with_random_parts(clips, settings.parts)
    labels = [*actions] * (1 + settings.parts.n)
    pairs = _motion_pairs(shown, labels, known, settings, both=settings.both_directions)
    validation_pairs = (
        _motion_pairs(validation, validation_actions, known, settings, both=True).to(device)
        if validation
        else None
    )
    generator = Generator(_generator_config(clips[0].skeleton, known, settings))
    critic = _build_critic(generator, settings)
    trainer = WganTrainer(generator, critic, pairs.to(device), validation_pairs, settings, random)
    return TrainingLoop(trainer, n_epochs=settings.n_epochs, validate_every=settings.validate_every)


def _motion_pairs(
    clips: Sequence[Interaction],
    actions: Sequence[str],
    known: tuple[str, ...],
    settings: PacmoSettings,
    *,
    both: bool,
) -> MotionPairs:
    directions = expand_directions(clips, both=both)
    indices = action_indices(actions, known) if known else torch.zeros(len(clips), dtype=torch.long)
    repeated = indices.repeat(len(directions) // len(clips))
    return sample_motion_pairs(directions, settings.n_points, repeated)


def _generator_config(
    skeleton: Skeleton, actions: tuple[str, ...], settings: PacmoSettings
) -> GeneratorConfig:
    channels = 3 * len(skeleton.joints)
    noise = GaussianRandomField(
        alpha=settings.noise_alpha,
        tau=settings.noise_tau,
        n_frequencies=settings.noise_modes,
        period=settings.period,
    )
    return GeneratorConfig(
        skeleton,
        u_shape_config(
            settings, settings.noise_channels + channels + 3 + settings.action_channels, channels
        ),
        noise,
        settings.noise_channels,
        actions,
        settings.action_channels,
    )


def _build_critic(generator: Generator, settings: PacmoSettings) -> Critic:
    n_actions, channels = len(generator.config.actions), settings.action_channels
    inputs = CriticInputs(
        end_effectors=end_effectors(generator.skeleton) if settings.body_distances else (),
        actions=ActionEmbedding(n_actions=n_actions, channels=channels) if n_actions else None,
    )
    motion_channels = 6 * len(generator.skeleton.joints)  # of both people
    return Critic(
        u_shape_config(settings, motion_channels + 3 + inputs.channels, 1),
        generator.normalisation,
        inputs,
        hidden=settings.functional_hidden,
    )
