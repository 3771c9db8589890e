"""Training of the matcher on real pairs: contrastive learning of which reaction answers whom.

Of a batch, each partner is to pick its reaction and each reaction its partner (van den Oord et al.
2018, *Contrastive predictive coding*; in both directions as in CLIP, Radford et al. 2021).
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacmo_core.interaction import Interaction
from pacmo_core.operators.initialise import initialise
from pacmo_core.operators.uno import UnoConfig
from pacmo_core.pacmo.config import skeleton_from, uno_from
from pacmo_core.pacmo.fit import Fit, batches, halving, state
from pacmo_core.pacmo.functions import MotionPairs, both_sides, common_skeleton, encode
from pacmo_core.pacmo.losses import finite
from pacmo_core.pacmo.matcher import Matcher, MatcherConfig
from pacmo_core.pacmo.mirror import mirrored
from pacmo_core.pacmo.settings import MatcherSettings
from pacmo_core.skeleton import Skeleton

# Of the three layers' grids to the latent one.
RATIOS = (0.75, 0.5, 0.5)


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

    def loss(rows: Tensor) -> Tensor:
        return model.loss(_shaken(pairs[rows], settings.noise, random), codes[rows])

    judge = None if held_out is None else lambda: model.loss(*held_out)
    return Fit(model, _epochs(model, pairs, loss, judge, settings, random))


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
    views = both_sides(clips, swap=True)
    if settings.mirror:
        views += [mirrored(view) for view in views]
    codes = torch.arange(len(clips)).repeat(len(views) // len(clips))
    return encode(views, settings.n_points), codes


def _epochs(
    model: Matcher,
    train: MotionPairs,
    loss: Callable[[Tensor], Tensor],
    held_out: Callable[[], Tensor] | None,
    settings: MatcherSettings,
    random: torch.Generator,
) -> Iterator[dict[str, float]]:
    optimiser = torch.optim.Adam(model.parameters(), lr=settings.learning_rate)
    schedule = halving(optimiser, settings.halve_every)
    best, least = state(model), float("inf")
    for _ in range(settings.n_epochs):
        steps = batches(len(train), settings.batch_size, random)
        losses = [_step(loss(rows), optimiser) for rows in steps]
        schedule.step()
        terms = {"loss": torch.stack(losses).mean()}
        if held_out is not None:
            with torch.no_grad():
                terms["validation_loss"] = held_out()
        found = finite(terms, "matcher")
        if found.get("validation_loss", -1.0) < least:
            least = found.get("validation_loss", least)
            best = {name: value.clone() for name, value in state(model).items()}
        yield found
    model.load_state_dict(best)


def _step(loss: Tensor, optimiser: torch.optim.Optimizer) -> Tensor:
    finite({"loss": loss}, "matcher")
    optimiser.zero_grad()
    loss.backward()  # type: ignore[no-untyped-call]  # torch leaves it untyped
    optimiser.step()
    return loss.detach()


def _shaken(pairs: MotionPairs, noise: float, random: torch.Generator) -> MotionPairs:
    """Move every joint by an offset of its own, the same at all times: few clips, many bodies."""
    partner, reaction = (
        motion + noise * torch.randn(len(motion), 1, motion.shape[-1], generator=random)
        for motion in (pairs.partner, pairs.reaction)
    )
    return MotionPairs(partner, reaction, pairs.log_duration)
