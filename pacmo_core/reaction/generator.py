"""The conditional generator: from a random field and a partner's motion to a reaction (PaCMO, 3.2).

A U-NO on the channels of the partner's motion, a Gaussian random field, time and duration.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.finish.learnt import LearntModule
from pacmo_core.operators.random_field import GaussianRandomField
from pacmo_core.operators.uno import Uno, UnoConfig, uno_config_from_dict
from pacmo_core.reaction.data import Condition
from pacmo_core.reaction.inputs import ActionEmbedding, Normalisation
from pacmo_core.store.files import file_hash
from pacmo_core.store.weights import read_weights


@dataclass(frozen=True)
class GeneratorConfig:
    """A generator's skeleton, operator, noise and action labels.

    Parameters
    ----------
    skeleton : Skeleton
    uno : UnoConfig
    noise : GaussianRandomField
    noise_channels : of the random field; 0 for a deterministic regression
    actions : labels that the reaction is conditioned on beside the partner; may be empty
    action_channels : of the labels' embedding
    """

    skeleton: Skeleton
    uno: UnoConfig
    noise: GaussianRandomField
    noise_channels: int
    actions: tuple[str, ...]
    action_channels: int

    @property
    def n_inputs(self) -> int:
        """Channels of the operator's input."""
        # A random field, a partner, two of time and one of duration, and labels.
        inputs = self.noise_channels + 3 * len(self.skeleton.joints) + 3
        return inputs + (self.action_channels if self.actions else 0)

    def __post_init__(self) -> None:
        inputs = self.n_inputs
        if min(self.noise_channels, self.action_channels) < 0 or self.uno.in_channels != inputs:
            raise ValueError(
                f"the operator must have {inputs} input channels for {self.noise_channels} of noise"
                f" and {self.action_channels} of labels; got {self.uno.in_channels}"
            )
        if self.actions and not self.action_channels:
            raise ValueError("action_channels must be positive where there are actions; got 0")
        if self.uno.out_channels != 3 * len(self.skeleton.joints):
            raise ValueError(f"output channels must be 3 a joint; got {self.uno.out_channels}")


class Generator(nn.Module):
    """``G: A x M -> M`` as a U-NO; metres in, metres out, in the partner's first frame.

    Parameters
    ----------
    config : GeneratorConfig

    Attributes
    ----------
    learnt : of the finish; changes nothing until it is learnt
    temperature : () standard deviation of the noise that reactions are sampled from; 1 in training
    """

    points: Tensor
    temperature: Tensor

    def __init__(self, config: GeneratorConfig) -> None:
        super().__init__()
        self.config = config
        self.uno = Uno(config.uno)
        self.normalisation = Normalisation(channels=config.uno.out_channels)
        n_actions, channels = len(config.actions), config.action_channels
        self.actions = (
            ActionEmbedding(n_actions=n_actions, channels=channels) if n_actions else None
        )
        self.learnt = LearntModule(config.skeleton)
        self.register_buffer("temperature", torch.ones(()))
        self.register_buffer("points", torch.linspace(0, 1, config.uno.n_points), persistent=False)

    @property
    def skeleton(self) -> Skeleton:
        """Skeleton of both people."""
        return self.config.skeleton

    def sample_noise(self, n: int, random: torch.Generator) -> Tensor:
        """Sample ``(n, k, 2 K)`` coefficients of the random field, on ``random``'s device."""
        noise = self.config.noise.sample(n, self.config.noise_channels, random=random)
        return self.temperature.to(noise.device) * noise

    def forward(self, noise: Tensor, condition: Condition) -> Tensor:
        """Generate reactions on the grid.

        Parameters
        ----------
        noise : (B, k, 2 K), of ``sample_noise``
        condition : the partner on the grid, N times

        Returns
        -------
        (B, N, 3 J), metres
        """
        out: Tensor = self.uno(self._inputs(noise, condition, self.points))
        return self.normalisation.denormalise_reaction(out)

    def latent(self, noise: Tensor, condition: Condition) -> Tensor:
        """Apply all but the head: ``(L, B, C)``, to be evaluated by ``evaluate``."""
        return self.uno.trunk(self._inputs(noise, condition, self.points))

    def evaluate(
        self, latent: Tensor, noise: Tensor, condition: Condition, times: Tensor
    ) -> Tensor:
        """Evaluate reactions at any times ``(T,)`` in [0, 1], those of the condition's partner."""
        inputs = self._inputs(noise, condition, times)
        evaluation = self.uno.evaluation(times).to(latent.device)
        out = self.uno.evaluate(latent, inputs, evaluation)
        return self.normalisation.denormalise_reaction(out)

    def _inputs(self, noise: Tensor, condition: Condition, times: Tensor) -> Tensor:
        return self._with_condition(self.config.noise.evaluate(noise, times), condition, times)

    def _with_condition(self, channels: Tensor, condition: Condition, times: Tensor) -> Tensor:
        """Append the partner, time, duration and label to ``(B, T, C)`` channels."""
        period, normalisation = self.config.uno.period, self.normalisation
        context = normalisation.time_and_duration(times, condition.log_duration, period)
        parts = [channels, normalisation.normalise_partner(condition.partner), context]
        if self.actions is not None:
            parts.append(self.actions(condition.action, times, period))
        return torch.cat(parts, dim=-1)


def copy_weights(model: Generator, file: Path, sha256: str) -> None:
    """Give a model the weights and the normalisation of a file, to continue their training.

    Labels of actions that the file's model does not know change nothing at first: the weights of
    their channels are zero.

    Raises
    ------
    StoreError
        If the file is damaged.
    ValueError
        If its content is another than stated, or its joints, noise, labels or operator differ.
    """
    facts, state = read_weights(file)
    if (found := file_hash(file)) != sha256:
        raise ValueError(f"{file}: wanted the SHA-256 {sha256}; got {found}")
    try:
        theirs = GeneratorConfig(**config_fields(facts["config"]))
    except (KeyError, TypeError) as fault:
        raise ValueError(f"{file}: wanted weights of PaCMO; got {facts.get('model')}") from fault
    own = model.config
    has_new_labels = bool(own.actions) and not theirs.actions
    if has_new_labels:
        more = replace(theirs.uno, in_channels=theirs.uno.in_channels + own.action_channels)
        theirs = replace(theirs, uno=more, actions=own.actions, action_channels=own.action_channels)
    if theirs.skeleton.joints != own.skeleton.joints:
        wanted, got = (", ".join(of.skeleton.joints) for of in (own, theirs))
        raise ValueError(
            f"{file}: wanted the joints {wanted}; got {got}; "
            "ingest.skeleton and drop_joints say in which joints captures are stored"
        )
    for field in ("noise", "noise_channels", "actions", "action_channels", "uno"):
        wanted, got = getattr(own, field), getattr(theirs, field)
        if got != wanted:
            raise ValueError(f"{file}: wanted {field} {wanted}; got {got}")
    if has_new_labels:
        known = state["uno.lift.weight"]
        state["uno.lift.weight"] = nn.functional.pad(known, (0, own.action_channels))
        state |= {k: v for k, v in model.state_dict().items() if k.startswith("actions.")}
    model.load_state_dict(state)
    model.temperature.fill_(1.0)  # that of the training


def generator_from_state(config: Mapping[str, Any], state: Mapping[str, Tensor]) -> Generator:
    """Rebuild a model from its configuration and ``training.state.model_state``."""
    model = Generator(GeneratorConfig(**config_fields(config)))
    model.load_state_dict(dict(state))
    return model.requires_grad_(False)


def config_fields(config: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of a ``GeneratorConfig``, or of a class derived from it, from JSON."""
    return {
        **config,
        "skeleton": Skeleton.from_dict(config["skeleton"]),
        "uno": uno_config_from_dict(config["uno"]),
        "noise": GaussianRandomField(**config["noise"]),
        "actions": tuple(config["actions"]),
    }
