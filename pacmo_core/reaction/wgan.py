"""Training of the conditional WGAN with gradient penalty (PaCMO, sections 3.2 and 4.2)."""

import math
from collections.abc import Mapping, Sequence

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
)
from pacmo_core.reaction.energy_score import mean_energy_score
from pacmo_core.reaction.generator import Generator, GeneratorConfig
from pacmo_core.reaction.inputs import ActionEmbedding, action_indices
from pacmo_core.reaction.losses import LossAndTerms, WganBatch, WganLosses
from pacmo_core.reaction.settings import AdamSettings, PacmoSettings
from pacmo_core.training.devices import ProcessGroup
from pacmo_core.training.loop import TrainingLoop
from pacmo_core.training.state import (
    adam_state,
    check_finite,
    ema_copy,
    join_tables,
    load_adam_state,
    select_table,
    update_ema,
)
from pacmo_core.training.supervised import mean_terms, set_learning_rate


class WganTrainer:
    """Generator, critic, their optimisers, and the running mean that is handed over.

    Parameters
    ----------
    generator, critic : on one normalisation; their weights are drawn anew
    pairs : real training data
    held_out : real pairs to choose weights on, or nothing
    settings : PacmoSettings
    random : CPU generator: weights, order, mixing and noise all come from it

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
        held_out: MotionPairs | None,
        settings: PacmoSettings,
        random: torch.Generator,
    ) -> None:
        self.generator, self.critic = generator, critic
        self.pairs, self.held_out = pairs, held_out
        self.settings, self.random = settings, random
        self.batch_size = min(settings.batch_size, len(pairs))
        self.processes = ProcessGroup.of_group()
        self.mine = self.processes.rows(self.batch_size)
        for network in (generator, critic):
            initialise_weights(network, random)
            network.to(pairs.partner.device)
        generator.normalisation.measure(pairs)
        self.mean = ema_copy(generator)
        self.looked_at = not settings.validate_from
        self.objectives = WganLosses(generator, critic, settings)
        self.augment = RandomAugmentation(
            settings.augmentation, generator.skeleton, settings.n_points
        )
        self.adam_generator = _build_adam(generator, settings.generator)
        self.adam_critic = _build_adam(critic, settings.critic)

    @property
    def model(self) -> Generator:
        """The running mean."""
        return self.mean

    @property
    def steps_an_epoch(self) -> int:
        """Generator steps in which the critic sees about as many pairs as there are."""
        return math.ceil(len(self.pairs) / (self.settings.batch_size * self.settings.n_critic))

    def epoch(self, number: int) -> dict[str, float]:
        """Take an epoch's steps; the terms are means over them.

        In the first ``warmup_epochs`` the generator follows its score and penalties alone: it is
        then near enough to the data for a fresh critic to tell it something.
        """
        settings, every = self.settings, self.settings.halve_learning_rate_every
        set_learning_rate(
            self.adam_generator, settings.generator.learning_rate, epoch=number, every=every
        )
        set_learning_rate(
            self.adam_critic, settings.critic.learning_rate, epoch=number, every=every
        )
        self.looked_at = number >= settings.validate_from
        step = self.warm_up if number < settings.warmup_epochs else self.step
        return mean_terms([step() for _ in range(self.steps_an_epoch)])

    def step(self) -> dict[str, float]:
        """Move the critic ``n_critic`` times and the generator once."""
        moves = [
            self._descend(self.adam_critic, self.objectives.of_critic(self._draw(mixed=True)))
            for _ in range(self.settings.n_critic)
        ]
        return mean_terms(moves) | self._move_generator(judged=True)

    def warm_up(self) -> dict[str, float]:
        """Move the generator once, the critic not being asked."""
        return self._move_generator(judged=False)

    def _move_generator(self, *, judged: bool) -> dict[str, float]:
        batch = self._draw(mixed=False)
        moved = self._descend(
            self.adam_generator, self.objectives.of_generator(batch, judged=judged)
        )
        update_ema(self.mean, self.generator, self.settings.ema_decay)
        return moved

    def score(self) -> Tensor | None:
        """Take the running mean's energy score on held-out pairs, on the same noise every time.

        Early weights are not looked at: the score is soon flat but for chance, while the critic
        goes on to better what a score of few clips does not see.
        """
        if self.held_out is None or not self.looked_at:
            return None
        return mean_energy_score(
            self.mean,
            self.held_out,
            n_samples=self.settings.validation_samples,
            batch_size=self.settings.batch_size,
            # A generator of its own: looking must not change the training.
            random=torch.Generator().manual_seed(self.settings.random_seed),
        )

    def state(self) -> dict[str, Tensor]:
        """Take both networks, the mean, both optimisers and the generator of random numbers."""
        return join_tables(
            generator=self.generator.state_dict(),
            critic=self.critic.state_dict(),
            mean=self.mean.state_dict(),
            adam_generator=adam_state(self.adam_generator),
            adam_critic=adam_state(self.adam_critic),
            random={"state": self.random.get_state()},
        )

    def load(self, state: Mapping[str, Tensor]) -> None:
        """Go back to where ``state`` was taken."""
        self.generator.load_state_dict(select_table(state, "generator"))
        self.critic.load_state_dict(select_table(state, "critic"))
        self.mean.load_state_dict(select_table(state, "mean"))
        load_adam_state(self.adam_generator, select_table(state, "adam_generator"))
        load_adam_state(self.adam_critic, select_table(state, "adam_critic"))
        self.random.set_state(state["random/state"])

    def _draw(self, *, mixed: bool) -> WganBatch:
        """Draw a whole batch, as every process does, and keep this one's rows."""
        n, device = self.batch_size, self.pairs.partner.device
        rows = torch.randint(len(self.pairs), (n,), generator=self.random)
        real = self.augment(self.pairs[rows.to(device)], self.random)
        # The critic judges one reaction to a partner; an energy score wants two.
        n_samples = 2 if self.settings.energy_score_weight and not mixed else 1
        noise = torch.stack([self.generator.draw(n, self.random) for _ in range(n_samples)])
        mixing = torch.rand(n, 1, 1, generator=self.random) if mixed else torch.zeros(n, 1, 1)
        return WganBatch(
            real[self.mine], noise[:, self.mine].to(device), mixing[self.mine].to(device)
        )

    def _descend(self, adam: torch.optim.Adam, of_rows: LossAndTerms) -> dict[str, float]:
        loss, terms = of_rows
        # Averaged first, so that all processes stop at a loss that is no number.
        whole = self.processes.mean(list(terms.values()), self.batch_size)
        values = check_finite(dict(zip(terms, whole, strict=True)), "wgan")
        parameters = adam.param_groups[0]["params"]
        gradients = self.processes.mean(torch.autograd.grad(loss, parameters), self.batch_size)
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
    weights are not 0, ``energy_score`` and ``bone_length_variance`` (m^2). In a group of processes
    each computes a part of every batch.

    Parameters
    ----------
    clips, validation : interactions
    settings : PacmoSettings
    actions, validation_actions : label of each clip, a condition if ``action_channels`` is not 0
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
    random = torch.Generator().manual_seed(settings.random_seed)
    pairs = _motion_pairs(clips, actions, known, settings, both=settings.both_directions)
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
    motion = 3 * len(skeleton.joints)
    noise = GaussianRandomField(
        alpha=settings.noise_alpha,
        tau=settings.noise_tau,
        n_modes=settings.noise_modes,
        period=settings.period,
    )
    return GeneratorConfig(
        skeleton,
        u_shape_config(
            settings, settings.noise_channels + motion + 3 + settings.action_channels, motion
        ),
        noise,
        settings.noise_channels,
        actions,
        settings.action_channels,
    )


def _build_critic(generator: Generator, settings: PacmoSettings) -> Critic:
    n_actions, channels = len(generator.config.actions), settings.action_channels
    conditions = CriticInputs(
        ends=end_effectors(generator.skeleton) if settings.body_distances else (),
        labels=ActionEmbedding(n_actions=n_actions, channels=channels) if n_actions else None,
    )
    both = 6 * len(generator.skeleton.joints)
    return Critic(
        u_shape_config(settings, both + 3 + conditions.channels, 1),
        generator.normalisation,
        conditions,
        hidden=settings.functional_hidden,
    )
