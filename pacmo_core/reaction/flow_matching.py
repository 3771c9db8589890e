"""Functional flow matching: a generative model of reactions that is trained by regression alone.

Kerrigan, Migliorini and Smyth (2024), *Functional flow matching*. A Gaussian random field ``X_0``
and a captured reaction ``X_1`` are joined by the path ``X_s = (1 - s) X_0 + s X_1``, whose velocity
is ``X_1 - X_0``. Its mean given ``X_s``, which least squares in L2 over time find, is a velocity
``v(X, s)``; along ``dX / ds = v(X, s)`` the distribution of the field becomes that of reactions.

The operator, its condition and the field are those of PaCMO's generator; the state ``X_s`` stands
in place of the noise, and flow time ``s`` is a further input.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor

from pacmo_core.data.interaction import Interaction
from pacmo_core.operators.quadrature import trapezoid_weights
from pacmo_core.operators.random_field import GaussianRandomField
from pacmo_core.operators.spectral import initialise_weights
from pacmo_core.operators.uno import u_shape_config
from pacmo_core.reaction.data import (
    Condition,
    MotionPairs,
    RandomAugmentation,
    expand_directions,
    sample_motion_pairs,
    with_random_parts,
)
from pacmo_core.reaction.energy_score import EnergyScore
from pacmo_core.reaction.generator import Generator, GeneratorConfig, config_fields
from pacmo_core.reaction.settings import FlowMatchingSettings
from pacmo_core.training.loop import TrainingLoop
from pacmo_core.training.supervised import SupervisedTrainer

FLOW_TIME_CHANNELS = 4  # cosines
MIN_VARIANCE = 1e-6  # of the field in any direction, relative to the reactions' mean variance
# E[X_1 | X_s] of a state (B, T, C) and flow time (B, 1, 1).
Prediction = Callable[[Tensor, Tensor], Tensor]


@dataclass(frozen=True)
class FlowConfig(GeneratorConfig):
    """A generator's configuration, and how it samples.

    Parameters
    ----------
    noise_scale : standard deviation of the field, relative to that of reactions
    n_steps : of the integration
    """

    noise_scale: float
    n_steps: int

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.n_steps < 1 or self.noise_channels != self.uno.out_channels:
            raise ValueError(
                f"wanted n_steps of at least 1 and {self.uno.out_channels} channels of the field; "
                f"got {self.n_steps} and {self.noise_channels}"
            )

    @property
    def n_inputs(self) -> int:
        """Channels of the operator's input, flow time among them."""
        return super().n_inputs + FLOW_TIME_CHANNELS


class FlowGenerator(Generator):
    """A generator that integrates a velocity from a random field to a reaction.

    The operator predicts the end of the path, ``E[X_1 | X_s]``; the velocity is
    ``(E[X_1 | X_s] - X_s) / (1 - s)``. States are functions of continuous time as reactions are:
    each step's latent function gives the prediction at any times, and so the state.

    Parameters
    ----------
    config : FlowConfig

    Attributes
    ----------
    channel_root : (3 J, 3 J), square root of the covariance of the normalised reactions' channels
    """

    config: FlowConfig
    channel_root: Tensor

    def __init__(self, config: FlowConfig) -> None:
        super().__init__(config)
        self.register_buffer("channel_root", torch.eye(config.uno.out_channels))

    def fit_noise(self, pairs: MotionPairs) -> None:
        """Compute the covariance of channels from training data, after the normalisation's fit."""
        reaction = self.normalisation.normalise_reaction(pairs.reaction).flatten(0, 1).double()
        variance, directions = torch.linalg.eigh(reaction.T @ reaction / len(reaction))
        deviation = variance.clamp(min=MIN_VARIANCE * float(variance.mean())).sqrt()
        self.channel_root.copy_((directions * deviation) @ directions.T)

    def sample_noise(self, n: int, random: torch.Generator) -> Tensor:
        """Sample ``(n, 3 J, 2 K)`` coefficients of ``X_0``, normalised, on ``random``'s device."""
        root = self.config.noise_scale * self.channel_root.to(random.device)
        return root @ super().sample_noise(n, random)

    def forward(self, noise: Tensor, condition: Condition) -> Tensor:
        """Generate reactions on the grid; see ``Generator.forward``."""
        return self.evaluate(self.latent(noise, condition), noise, condition, self.points)

    def latent(self, noise: Tensor, condition: Condition) -> Tensor:
        """Integrate on the grid and keep each step's latent function: ``(L, B, n_steps C)``."""
        latents: list[Tensor] = []

        def predict(state: Tensor, flow_time: Tensor) -> Tensor:
            inputs = self._flow_inputs(state, flow_time, condition, self.points)
            latents.append(self.uno.trunk(inputs))
            out = self.uno.evaluate(latents[-1], inputs, self.uno.at_points)
            return _end(out, state, flow_time)

        integrate(predict, self.config.noise.evaluate(noise, self.points), self.config.n_steps)
        return torch.cat(latents, dim=-1)

    def evaluate(
        self, latent: Tensor, noise: Tensor, condition: Condition, times: Tensor
    ) -> Tensor:
        """Evaluate reactions at any times; see ``Generator.evaluate``."""
        evaluation = self.uno.evaluation(times).to(latent.device)
        latents = iter(latent.chunk(self.config.n_steps, dim=-1))

        def predict(state: Tensor, flow_time: Tensor) -> Tensor:
            inputs = self._flow_inputs(state, flow_time, condition, times)
            out = self.uno.evaluate(next(latents), inputs, evaluation)
            return _end(out, state, flow_time)

        end = integrate(predict, self.config.noise.evaluate(noise, times), self.config.n_steps)
        return self.normalisation.denormalise_reaction(end)

    def predict_end(self, state: Tensor, flow_time: Tensor, condition: Condition) -> Tensor:
        """Predict ``E[X_1 | X_s]`` on the grid, for training.

        Parameters
        ----------
        state : (B, N, 3 J), normalised
        flow_time : (B, 1, 1), in [0, 1]
        condition : the partner on the grid

        Returns
        -------
        (B, N, 3 J), normalised
        """
        out = self.uno(self._flow_inputs(state, flow_time, condition, self.points))
        return _end(out, state, flow_time)

    def _flow_inputs(
        self, state: Tensor, flow_time: Tensor, condition: Condition, times: Tensor
    ) -> Tensor:
        # In the angle of ``flow_times``, whose steps are even.
        angle = (1 - 2 * flow_time).clamp(-1, 1).acos()
        order = torch.arange(1, FLOW_TIME_CHANNELS + 1, device=state.device)
        channels = (order * angle).cos().expand(*state.shape[:2], -1)
        return self._with_condition(torch.cat([state, channels], dim=-1), condition, times)


def _end(out: Tensor, state: Tensor, flow_time: Tensor) -> Tensor:
    """Add to the operator's output what the state tells by itself.

    That is ``E[X_1 | X_s]`` if reactions were distributed as the field: so a state need not pass
    through the operator's few channels. The output counts as much as is left unknown.
    """
    variance = (1 - flow_time).square() + flow_time.square()
    return flow_time / variance * state + (1 - flow_time) / variance.sqrt() * out


def flow_times(share: Tensor) -> Tensor:
    """Return the flow times ``(1 - cos(pi u)) / 2`` of shares u in [0, 1] of the integration.

    Dense at both ends: at the first what the reaction will be is decided, for the state's many
    channels tell it early; at the last, where exactly hands and feet are.
    """
    return (1 - (math.pi * share).cos()) / 2


def integrate(predict: Prediction, start: Tensor, n_steps: int) -> Tensor:
    """Integrate the velocity over flow time from 0 to 1 by Euler's method, at ``flow_times``.

    Parameters
    ----------
    predict : of the end, from which the velocity is ``(end - state) / (1 - s)``
    start : (B, T, C), the state at flow time 0
    n_steps : int

    Returns
    -------
    (B, T, C), the state at flow time 1: the last prediction of the end
    """
    state = start
    times = flow_times(torch.arange(n_steps + 1, device=start.device) / n_steps).view(-1, 1, 1, 1)
    for now, later in pairwise(times):
        state = state.lerp(predict(state, now), ((later - now) / (1 - now)).to(state.dtype))
    return state


def prediction_error(predict: Prediction, start: Tensor, end: Tensor, flow_time: Tensor) -> Tensor:
    """Return the error at a point of a path: that of the velocity, times ``1 - s``.

    Parameters
    ----------
    predict : of the end
    start, end : (B, T, C), the states at flow times 0 and 1
    flow_time : (B, 1, 1), in [0, 1]

    Returns
    -------
    (B, T, C)
    """
    return predict(start.lerp(end, flow_time), flow_time) - end


class FlowLoss:
    """The squared error of the velocity in L2 over time, weighted by ``(1 - s)^2``.

    The norm is that of the energy score's linear views of a motion: in any norm the same velocity
    has the least error.

    Parameters
    ----------
    model : FlowGenerator
    """

    def __init__(self, model: FlowGenerator) -> None:
        self.model, self.views = model, EnergyScore(model.skeleton).views
        self.weights = trapezoid_weights(model.points)

    def __call__(self, pairs: MotionPairs, random: torch.Generator) -> Tensor:
        """Return the mean over pairs, their flow times evenly spread: ``()``."""
        model, n, device = self.model, len(pairs), pairs.partner.device
        noise = model.sample_noise(n, random).to(device)
        share = (torch.arange(n) + torch.rand(n, generator=random)) / n
        error = prediction_error(
            lambda state, now: model.predict_end(state, now, pairs.condition),
            model.config.noise.evaluate(noise, model.points),
            model.normalisation.normalise_reaction(pairs.reaction),
            flow_times(share)[:, None, None].to(device),
        )
        squares = [view.square().mean(dim=-1) @ self.weights for view in self.views(error)]
        return torch.stack(squares).mean()


def build_training(
    clips: Sequence[Interaction],
    settings: FlowMatchingSettings,
    *,
    validation: Sequence[Interaction] = (),
    device: str = "cpu",
) -> TrainingLoop[FlowGenerator]:
    """Build a flow and the loop that trains its velocity; an epoch yields ``loss``.

    Parameters
    ----------
    clips, validation : interactions; validation clips are scored in both directions, at the same
        states every time
    settings : FlowMatchingSettings
    device : of torch
    """
    random = torch.Generator().manual_seed(settings.random_seed)
    shown = with_random_parts(clips, settings.parts)
    directions = expand_directions(shown, both=settings.both_directions)
    pairs = sample_motion_pairs(directions, settings.n_points).to(device)
    model = FlowGenerator(_flow_config(clips[0], settings))
    initialise_weights(model, random)
    model.to(device).normalisation.fit(pairs)
    model.fit_noise(pairs)
    augmentation = RandomAugmentation(settings.augmentation, model.skeleton, settings.n_points)
    loss = FlowLoss(model)

    def validation_loss() -> Tensor:
        return loss(held_out, torch.Generator().manual_seed(settings.random_seed))

    if validation:
        held_out = sample_motion_pairs(
            expand_directions(validation, both=True), settings.n_points
        ).to(device)
    trainer = SupervisedTrainer(
        model,
        len(pairs),
        lambda rows: loss(augmentation(pairs[rows.to(device)], random), random),
        validation_loss if validation else None,
        settings,
        random,
    )
    return TrainingLoop(trainer, n_epochs=settings.n_epochs, validate_every=settings.validate_every)


def flow_generator_from_state(
    config: Mapping[str, Any], state: Mapping[str, Tensor]
) -> FlowGenerator:
    """Rebuild a model from its configuration and ``training.state.model_state``."""
    model = FlowGenerator(FlowConfig(**config_fields(config)))
    model.load_state_dict(dict(state))
    return model.requires_grad_(False)


def _flow_config(clip: Interaction, settings: FlowMatchingSettings) -> FlowConfig:
    channels = 3 * len(clip.skeleton.joints)
    noise = GaussianRandomField(
        alpha=settings.noise_alpha,
        tau=settings.noise_tau,
        n_frequencies=settings.noise_modes,
        period=settings.noise_period,
    )
    return FlowConfig(
        clip.skeleton,
        u_shape_config(settings, 2 * channels + 3 + FLOW_TIME_CHANNELS, channels),
        noise,
        noise_channels=channels,
        actions=(),
        action_channels=0,
        noise_scale=settings.noise_scale,
        n_steps=settings.n_steps,
    )
