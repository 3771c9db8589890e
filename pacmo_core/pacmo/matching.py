"""A network that tells which partner a reaction answers, trained on real pairs.

Two operators turn the partner's and the reaction's motion into functions of time with values on a
sphere; a reaction fits a partner as well as the two functions agree, in the mean over time:
contrastive learning of pairs (van den Oord et al. 2018; symmetric as in CLIP, Radford et al. 2021).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from pacmo_core.interaction import Interaction
from pacmo_core.operators.fourier import interpolation
from pacmo_core.operators.initialise import initialise
from pacmo_core.operators.uno import Uno, UnoConfig
from pacmo_core.pacmo.config import skeleton_from, uno_from
from pacmo_core.pacmo.fit import Fit, halving, state
from pacmo_core.pacmo.functions import MotionPairs, common_skeleton, encode
from pacmo_core.pacmo.losses import finite
from pacmo_core.pacmo.mirror import mirrored
from pacmo_core.pacmo.normalisation import Normalisation
from pacmo_core.pacmo.settings import MatcherSettings
from pacmo_core.skeleton import Skeleton

RATIOS = (0.75, 0.5, 0.5)


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
        evaluation = interpolation(midpoints / config.uno.period, config.uno.sizes[-1]).float()
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
        alike = (clips[:, None] == clips) & ~torch.eye(len(clips), dtype=torch.bool)
        fit = fit.masked_fill(alike, -torch.inf)
        true = torch.arange(len(clips))
        return (functional.cross_entropy(fit, true) + functional.cross_entropy(fit.T, true)) / 2

    def _embedded(self, operator: Uno, motion: Tensor, context: Tensor) -> Tensor:
        inputs = torch.cat([motion, context], dim=-1)
        values = operator.evaluate(operator.trunk(inputs), inputs, self.evaluation)
        return functional.normalize(values.flatten(1), dim=-1)


def fit(
    clips: Sequence[Interaction],
    settings: MatcherSettings,
    *,
    validation: Sequence[Interaction] = (),
) -> Fit[Matcher]:
    """Train on real pairs, from both sides and mirrored; an epoch yields its terms.

    Given validation clips, an epoch yields ``validation_loss`` too, and the weights of the epoch
    at which it was least stand in the model when the terms are exhausted.
    """
    random = torch.Generator().manual_seed(settings.random_seed)
    pairs, codes = _all_views(clips, settings)
    held_out = _all_views(validation, settings) if validation else None
    model = Matcher(_config(clips[0].skeleton, settings))
    initialise(model, random)
    model.normalisation.measure(pairs)
    return Fit(model, _epochs(model, (pairs, codes), held_out, settings, random))


def embed(
    model: Matcher, interactions: Sequence[Interaction]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Embed interactions, ``person_a`` the partner: two ``(n, E)`` of unit vectors."""
    with torch.no_grad():
        partner, reaction = model(encode(interactions, model.config.uno.n_points))
    return partner.double().numpy(), reaction.double().numpy()


def config(model: Matcher) -> dict[str, Any]:
    """Describe a model in JSON's terms."""
    return asdict(model.config)


def from_state(config: Mapping[str, Any], state: Mapping[str, Tensor]) -> Matcher:
    """Rebuild a model from what ``config`` and ``fit.state`` gave."""
    parts = {"skeleton": skeleton_from(config["skeleton"]), "uno": uno_from(config["uno"])}
    model = Matcher(MatcherConfig(**{**config, **parts}))
    model.load_state_dict(dict(state))
    return model.requires_grad_(False)


def _config(skeleton: Skeleton, settings: MatcherSettings) -> MatcherConfig:
    width = settings.width
    uno = UnoConfig(
        in_channels=3 * len(skeleton.joints) + 3,
        out_channels=settings.embedding,
        lifting=width,
        channels=(width, width, width),
        modes=tuple(settings.modes),
        ratios=RATIOS,
        n_points=settings.n_points,
        period=settings.period,
        skips=False,
    )
    return MatcherConfig(skeleton, uno, settings.n_instants, settings.temperature)


def _all_views(
    clips: Sequence[Interaction], settings: MatcherSettings
) -> tuple[MotionPairs, Tensor]:
    """Encode each clip from either person and, if asked, mirrored; with the clip of each."""
    common_skeleton(clips)
    views = [*clips, *(clip.swapped() for clip in clips)]
    if settings.mirror:
        views += [mirrored(view) for view in views]
    codes = torch.arange(len(clips)).repeat(len(views) // len(clips))
    return encode(views, settings.n_points), codes


def _step(
    model: Matcher,
    optimiser: torch.optim.Optimizer,
    pairs: MotionPairs,
    clips: Tensor,
    noise: float,
    random: torch.Generator,
) -> Tensor:
    shaken = MotionPairs(
        _shaken(pairs.partner, noise, random),
        _shaken(pairs.reaction, noise, random),
        pairs.log_duration,
    )
    loss = model.loss(shaken, clips)
    finite({"loss": loss}, "matcher")
    optimiser.zero_grad()
    loss.backward()  # type: ignore[no-untyped-call]  # torch leaves it untyped
    optimiser.step()
    return loss.detach()


def _shaken(motion: Tensor, noise: float, random: torch.Generator) -> Tensor:
    """Move every joint of ``(B, N, 3 J)`` by an offset of its own, the same at all times."""
    offsets = torch.randn(len(motion), 1, motion.shape[-1], generator=random)
    return motion + noise * offsets


def _epochs(
    model: Matcher,
    train: tuple[MotionPairs, Tensor],
    held_out: tuple[MotionPairs, Tensor] | None,
    settings: MatcherSettings,
    random: torch.Generator,
) -> Iterator[dict[str, float]]:
    optimiser = torch.optim.AdamW(
        model.parameters(), lr=settings.learning_rate, weight_decay=settings.weight_decay
    )
    schedule = halving(optimiser, settings.halve_every)
    best, least = state(model), float("inf")
    for _ in range(settings.n_epochs):
        losses = [
            _step(model, optimiser, train[0][rows], train[1][rows], settings.noise, random)
            for rows in torch.randperm(len(train[0]), generator=random).chunk(
                max(1, round(len(train[0]) / settings.batch_size))
            )
        ]
        schedule.step()
        terms = {"loss": torch.stack(losses).mean()}
        if held_out is not None:
            with torch.no_grad():
                terms["validation_loss"] = model.loss(*held_out)
        found = finite(terms, "matcher")
        if found.get("validation_loss", -1.0) < least:
            least = found.get("validation_loss", least)
            best = {name: value.clone() for name, value in state(model).items()}
        yield found
    model.load_state_dict(best)
