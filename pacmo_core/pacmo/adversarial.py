"""Fit the conditional generative adversarial neural operator (PaCMO, 3.2 and 4.2)."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import torch
from torch import Tensor

from pacmo_core.interaction import Interaction
from pacmo_core.operators.initialise import initialise
from pacmo_core.operators.quadrature import trapezoid_weights
from pacmo_core.operators.random_field import RandomField
from pacmo_core.operators.uno import UnoConfig, u_channels
from pacmo_core.pacmo.config import RATIOS, noise_from, skeleton_from, uno_from
from pacmo_core.pacmo.critic import Critic, gradient_norm
from pacmo_core.pacmo.fit import Fit, halving, running_mean, update_mean
from pacmo_core.pacmo.functions import MotionPairs, both_sides, encode
from pacmo_core.pacmo.generator import Generator, GeneratorConfig, react_on_grid
from pacmo_core.pacmo.losses import Symmetry, finite
from pacmo_core.pacmo.settings import PacmoSettings
from pacmo_core.skeleton import Skeleton


class Adversaries:
    """Generator, critic, their optimisers, and the running mean that is handed over.

    Parameters
    ----------
    pairs : MotionPairs, real training data
    settings : PacmoSettings
    skeleton : Skeleton
    random : CPU generator: weights, order, mixing and noise all come from it
    """

    def __init__(
        self,
        pairs: MotionPairs,
        settings: PacmoSettings,
        skeleton: Skeleton,
        random: torch.Generator,
    ) -> None:
        self.pairs, self.settings, self.random = pairs, settings, random
        device = pairs.partner.device
        self.generator = Generator(_generator_config(skeleton, settings))
        self.critic = Critic(
            _uno(settings, 6 * len(skeleton.joints) + 3, 1),
            self.generator.normalisation,
            hidden=settings.functional_hidden,
        )
        for network in (self.generator, self.critic):
            initialise(network, random)
            network.to(device)
        self.generator.normalisation.measure(pairs)
        self.mean = running_mean(self.generator)
        self.symmetry = Symmetry(skeleton)
        self.weights = trapezoid_weights(self.generator.points)
        self.optimisers = [self._adam(self.generator), self._adam(self.critic)]
        self.schedules = [halving(o, settings.halve_every) for o in self.optimisers]

    def step(self) -> dict[str, float]:
        """Move the critic ``n_critic`` times and the generator once."""
        critic_terms = [self._step_critic() for _ in range(self.settings.n_critic)]
        terms = critic_terms[-1] | self._step_generator()
        for schedule in self.schedules:
            schedule.step()
        update_mean(self.mean, self.generator, self.settings.ema)
        return finite(terms, "adversarial")

    def _step_critic(self) -> dict[str, Tensor]:
        real = self._batch()
        norm = self.generator.normalisation
        with torch.no_grad():
            u, c = norm.reaction(real.reaction), norm.partner(real.partner)
            fake = norm.reaction(react_on_grid(self.generator, real, self.random))
            share = torch.rand(len(u), 1, 1, generator=self.random).to(u.device)
        twice = torch.cat([real.log_duration, real.log_duration])
        judged_real, judged_fake = self.critic(
            torch.cat([u, fake]), torch.cat([c, c]), twice
        ).chunk(2)
        norms = gradient_norm(
            lambda a, b: self.critic(a, b, real.log_duration), fake.lerp(u, share), c, self.weights
        )
        distance = judged_real.mean() - judged_fake.mean()  # eq. 1
        penalty = (norms - 1).square().mean()  # eq. 2
        self._descend(1, self.settings.penalty_weight * penalty - distance)
        return {"distance": distance, "penalty": penalty, "gradient_norm": norms.mean()}

    def _step_generator(self) -> dict[str, Tensor]:
        real = self._batch()
        norm = self.generator.normalisation
        reaction = react_on_grid(self.generator, real, self.random)
        judged = self.critic(
            norm.reaction(reaction), norm.partner(real.partner), real.log_duration
        ).mean()
        symmetry = self.symmetry(reaction, self.weights)
        self._descend(0, self.settings.symmetry_weight * symmetry - judged)
        return {"judged": judged, "symmetry": symmetry}

    def _batch(self) -> MotionPairs:
        size = (min(self.settings.batch_size, len(self.pairs)),)
        rows = torch.randint(len(self.pairs), size, generator=self.random)
        return self.pairs[rows.to(self.pairs.partner.device)]

    def _descend(self, which: int, loss: Tensor) -> None:
        optimiser = self.optimisers[which]
        parameters = [p for group in optimiser.param_groups for p in group["params"]]
        gradients = torch.autograd.grad(loss, parameters)
        for parameter, gradient in zip(parameters, gradients, strict=True):
            parameter.grad = gradient
        optimiser.step()

    def _adam(self, network: torch.nn.Module) -> torch.optim.Adam:
        beta_1, beta_2 = self.settings.betas
        return torch.optim.Adam(
            network.parameters(), lr=self.settings.learning_rate, betas=(beta_1, beta_2)
        )


def fit(
    clips: Sequence[Interaction],
    settings: PacmoSettings,
    *,
    validation: Sequence[Interaction] = (),
    device: str = "cpu",
) -> Fit[Generator]:
    """Train adversarially; each generator step yields its terms; the model is the running mean.

    ``distance`` (eq. 1's estimate), ``penalty``, ``gradient_norm``, ``judged``, ``symmetry`` (m^2)
    and, if given clips, ``validation_distance``: the critic's on data it has not seen.
    """
    random = torch.Generator().manual_seed(settings.random_seed)
    pairs = encode(both_sides(clips, swap=settings.swap), settings.n_points).to(device)
    held_out = encode(validation, settings.n_points).to(device) if validation else None
    parts = Adversaries(pairs, settings, clips[0].skeleton, random)
    return Fit(parts.mean, _steps(parts, held_out))


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


def _steps(parts: Adversaries, held_out: MotionPairs | None) -> Iterator[dict[str, float]]:
    # Its own generator: whether anyone looks at held-out clips must not change the training.
    random = torch.Generator().manual_seed(parts.settings.random_seed)
    for _ in range(parts.settings.n_steps):
        terms = parts.step()
        if held_out is not None:
            # A batch, not all: looking must stay cheap beside a step.
            rows = torch.randperm(len(held_out), generator=random)[: parts.settings.batch_size]
            batch = held_out[rows.to(held_out.partner.device)]
            terms["validation_distance"] = _distance(parts, batch, random)
        yield terms


@torch.no_grad()
def _distance(parts: Adversaries, pairs: MotionPairs, random: torch.Generator) -> float:
    norm = parts.generator.normalisation
    c, log_duration = norm.partner(pairs.partner), pairs.log_duration
    fake = norm.reaction(react_on_grid(parts.mean, pairs, random))
    real = norm.reaction(pairs.reaction)
    judged = [parts.critic(u, c, log_duration).mean() for u in (real, fake)]
    return float(judged[0] - judged[1])


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
