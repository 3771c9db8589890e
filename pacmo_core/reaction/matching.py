"""Training of the matcher on real pairs: contrastive learning of which reaction answers whom.

Of a batch, each partner is to pick its reaction and each reaction its partner (van den Oord et al.
2018, *Contrastive predictive coding*; in both directions as in CLIP, Radford et al. 2021).
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.operators.initialise import initialise
from pacmo_core.operators.uno import UnoConfig
from pacmo_core.reaction.config import uno_from
from pacmo_core.reaction.fit import Fit
from pacmo_core.reaction.functions import MotionPairs, both_sides, common_skeleton, encode
from pacmo_core.reaction.matcher import Matcher, MatcherConfig
from pacmo_core.reaction.mirror import mirrored
from pacmo_core.reaction.settings import MatcherSettings
from pacmo_core.reaction.supervised import Supervised
from pacmo_core.reaction.tensors import skeleton_from

# Of the three layers' grids to the latent one.
RATIOS = (0.75, 0.5, 0.5)


def fit(
    clips: Sequence[Interaction],
    settings: MatcherSettings,
    *,
    validation: Sequence[Interaction] = (),
    device: str = "cpu",
) -> Fit[Matcher]:
    """Train on real pairs, from both sides and mirrored; an epoch yields ``loss``.

    ``validation`` is the loss on all views of the held-out clips.
    """
    random = torch.Generator().manual_seed(settings.random_seed)
    pairs, codes = _all_views(clips, settings, device)
    held_out = _all_views(validation, settings, device) if validation else None
    model = Matcher(_config(clips[0].skeleton, settings))
    initialise(model, random)
    model.to(device).normalisation.measure(pairs)

    def loss(rows: Tensor) -> Tensor:
        rows = rows.to(device)
        return model.loss(_shaken(pairs[rows], settings.noise, random), codes[rows])

    judge = None if held_out is None else lambda: model.loss(*held_out)
    training = Supervised(model, len(pairs), loss, judge, settings, random)
    return Fit(training, n_epochs=settings.n_epochs, validate_every=settings.validate_every)


def embed(
    model: Matcher, interactions: Sequence[Interaction]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Embed interactions, ``person_a`` the partner: two ``(n, E)`` of unit vectors."""
    with torch.no_grad():
        partner, reaction = model(encode(interactions, model.config.uno.n_points))
    return partner.double().numpy(), reaction.double().numpy()


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
    clips: Sequence[Interaction], settings: MatcherSettings, device: str
) -> tuple[MotionPairs, Tensor]:
    """Encode each clip from either person and, if asked, mirrored; with the clip of each."""
    common_skeleton(clips)
    views = both_sides(clips, swap=True)
    if settings.mirror:
        views += [mirrored(view) for view in views]
    codes = torch.arange(len(clips), device=device).repeat(len(views) // len(clips))
    return encode(views, settings.n_points).to(device), codes


def _shaken(pairs: MotionPairs, noise: float, random: torch.Generator) -> MotionPairs:
    """Move every joint by an offset of its own, the same at all times: few clips, many bodies."""
    partner, reaction = (
        motion
        + noise * torch.randn(len(motion), 1, motion.shape[-1], generator=random).to(motion.device)
        for motion in (pairs.partner, pairs.reaction)
    )
    return replace(pairs, partner=partner, reaction=reaction)
