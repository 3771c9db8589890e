"""Generator and critic against each other, step by step (PaCMO, 3.2 and 4.2)."""

import math
from collections.abc import Mapping

import torch
from torch import Tensor, nn

from pacmo_core.operators.initialise import initialise
from pacmo_core.reaction.augment import Augment
from pacmo_core.reaction.critic import Critic
from pacmo_core.reaction.energy import mean_energy_score
from pacmo_core.reaction.functions import MotionPairs
from pacmo_core.reaction.generator import Generator
from pacmo_core.reaction.objectives import Batch, Loss, Objectives
from pacmo_core.reaction.processes import Processes
from pacmo_core.reaction.settings import DescentSettings, PacmoSettings
from pacmo_core.reaction.supervised import halve, means
from pacmo_core.reaction.tensors import (
    adam_state,
    finite,
    load_adam,
    parted,
    prefixed,
    running_mean,
    update_mean,
)


class Adversaries:
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
        self.processes = Processes.of_group()
        self.mine = self.processes.rows(self.batch_size)
        for network in (generator, critic):
            initialise(network, random)
            network.to(pairs.partner.device)
        generator.normalisation.measure(pairs)
        self.mean = running_mean(generator)
        self.looked_at = not settings.validate_from
        self.objectives = Objectives(generator, critic, settings)
        self.augment = Augment(settings.augment, generator.skeleton, settings.n_points)
        self.adam_generator = _adam(generator, settings.generator)
        self.adam_critic = _adam(critic, settings.critic)

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
        settings, every = self.settings, self.settings.halve_every
        halve(self.adam_generator, settings.generator.learning_rate, epoch=number, every=every)
        halve(self.adam_critic, settings.critic.learning_rate, epoch=number, every=every)
        self.looked_at = number >= settings.validate_from
        step = self.warm_up if number < settings.warmup_epochs else self.step
        return means([step() for _ in range(self.steps_an_epoch)])

    def step(self) -> dict[str, float]:
        """Move the critic ``n_critic`` times and the generator once."""
        moves = [
            self._descend(self.adam_critic, self.objectives.of_critic(self._draw(mixed=True)))
            for _ in range(self.settings.n_critic)
        ]
        return means(moves) | self._move_generator(judged=True)

    def warm_up(self) -> dict[str, float]:
        """Move the generator once, the critic not being asked."""
        return self._move_generator(judged=False)

    def _move_generator(self, *, judged: bool) -> dict[str, float]:
        batch = self._draw(mixed=False)
        moved = self._descend(
            self.adam_generator, self.objectives.of_generator(batch, judged=judged)
        )
        update_mean(self.mean, self.generator, self.settings.ema)
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
        return prefixed(
            generator=self.generator.state_dict(),
            critic=self.critic.state_dict(),
            mean=self.mean.state_dict(),
            adam_generator=adam_state(self.adam_generator),
            adam_critic=adam_state(self.adam_critic),
            random={"state": self.random.get_state()},
        )

    def load(self, state: Mapping[str, Tensor]) -> None:
        """Go back to where ``state`` was taken."""
        self.generator.load_state_dict(parted(state, "generator"))
        self.critic.load_state_dict(parted(state, "critic"))
        self.mean.load_state_dict(parted(state, "mean"))
        load_adam(self.adam_generator, parted(state, "adam_generator"))
        load_adam(self.adam_critic, parted(state, "adam_critic"))
        self.random.set_state(state["random/state"])

    def _draw(self, *, mixed: bool) -> Batch:
        """Draw a whole batch, as every process does, and keep this one's rows."""
        n, device = self.batch_size, self.pairs.partner.device
        rows = torch.randint(len(self.pairs), (n,), generator=self.random)
        real = self.augment(self.pairs[rows.to(device)], self.random)
        # The critic judges one reaction to a partner; an energy score wants two.
        n_samples = 2 if self.settings.score_weight and not mixed else 1
        noise = torch.stack([self.generator.draw(n, self.random) for _ in range(n_samples)])
        mixing = torch.rand(n, 1, 1, generator=self.random) if mixed else torch.zeros(n, 1, 1)
        return Batch(real[self.mine], noise[:, self.mine].to(device), mixing[self.mine].to(device))

    def _descend(self, adam: torch.optim.Adam, of_rows: Loss) -> dict[str, float]:
        loss, terms = of_rows
        # Averaged first, so that all processes stop at a loss that is no number.
        whole = self.processes.mean(list(terms.values()), self.batch_size)
        values = finite(dict(zip(terms, whole, strict=True)), "adversarial")
        parameters = adam.param_groups[0]["params"]
        gradients = self.processes.mean(torch.autograd.grad(loss, parameters), self.batch_size)
        for parameter, gradient in zip(parameters, gradients, strict=True):
            parameter.grad = gradient
        adam.step()
        return values


def _adam(network: nn.Module, settings: DescentSettings) -> torch.optim.Adam:
    beta_1, beta_2 = settings.betas
    return torch.optim.Adam(network.parameters(), lr=settings.learning_rate, betas=(beta_1, beta_2))
