"""Train on clips and their variations: an epoch shows each clip as it is, or on other bodies.

Nothing else changes: as many steps of as many pairs, and the same draws of rows, noise and mirror
images as a training of the same seed without variations, so that the two can be compared.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pacmo_core.data.interaction import Interaction
from pacmo_core.reaction import wgan
from pacmo_core.reaction.data import MotionPairs, expand_directions, sample_motion_pairs
from pacmo_core.reaction.generator import Generator
from pacmo_core.reaction.settings import PacmoSettings
from pacmo_core.reaction.wgan import WganTrainer
from pacmo_core.training.loop import TrainingLoop


@dataclass(frozen=True, kw_only=True)
class TrainingVariations:
    """Variations of the clips that a model learns from.

    Parameters
    ----------
    interactions : V of them
    sources : of each, the number of its clip
    share : of a clip's showings in which a variation stands for it

    Raises
    ------
    ValueError
        If there are none, sources are not one each, or the share is none.
    """

    interactions: Sequence[Interaction]
    sources: Sequence[int]
    share: float

    def __post_init__(self) -> None:
        if not self.interactions or len(self.sources) != len(self.interactions):
            raise ValueError(
                f"wanted variations with a source each; got {len(self.interactions)} with "
                f"{len(self.sources)} sources"
            )
        if not 0 <= self.share <= 1:
            raise ValueError(f"share must lie in [0, 1]; got {self.share}")


def build_training(
    clips: Sequence[Interaction],
    settings: PacmoSettings,
    *,
    variations: TrainingVariations,
    **options: Any,
) -> TrainingLoop[Generator]:
    """Build the training of ``wgan.build_training`` on clips and their variations.

    Parameters
    ----------
    clips, settings : as there
    variations : of the clips
    options : as there
    """
    return add_variations(wgan.build_training(clips, settings, **options), variations)


def add_variations(
    plain: TrainingLoop[Generator], variations: TrainingVariations
) -> TrainingLoop[Generator]:
    """Let a training that has not begun show variations too.

    Parameters
    ----------
    plain : of ``adversarial.fit``, on the clips that are varied

    Raises
    ------
    TypeError
        If it trains something else.
    """
    training = plain.training
    if not isinstance(training, WganTrainer):
        raise TypeError(f"wanted a training of Adversaries, got {type(training).__name__}")
    validate_every = plain.validate_every
    return TrainingLoop(
        AugmentedWganTrainer(training, variations),
        n_epochs=plain.n_epochs,
        validate_every=validate_every,
    )


class AugmentedWganTrainer:
    """Adversaries that see other pairs in every epoch.

    Parameters
    ----------
    training : begun with the clips' own pairs, of which its normalisation stays
    variations : Variations

    Raises
    ------
    ValueError
        If a source is no clip.
    """

    def __init__(self, training: WganTrainer, variations: TrainingVariations) -> None:
        settings, own = training.settings, training.pairs
        n_clips = len(own) // (2 if settings.both_directions else 1)
        if not 0 <= min(variations.sources) <= max(variations.sources) < n_clips:
            raise ValueError(f"sources must be numbers of {n_clips} clips; {variations.sources}")
        sides = expand_directions(variations.interactions, both=settings.both_directions)
        # Clips' own pairs, and so their variations', come in the order of the clips, then again
        # with the people exchanged.
        sources = np.concatenate(
            [np.array(variations.sources) + first for first in range(0, len(own), n_clips)]
        )
        rows = torch.as_tensor(sources, device=own.action.device)
        made = sample_motion_pairs(sides, settings.n_points, own.action[rows]).to(
            own.partner.device
        )
        self.training, self.share = training, variations.share
        self.every = _concatenate(own, made)
        self.choice = VariationSampler(len(own), sources)

    @property
    def model(self) -> Generator:
        """The running mean."""
        return self.training.model

    def epoch(self, number: int) -> dict[str, float]:
        """Choose what the clips look like in epoch ``number``, and train through it."""
        random = np.random.default_rng((self.training.settings.random_seed, number))
        rows = torch.as_tensor(self.choice.draw(self.share, random))
        self.training.pairs = self.every[rows.to(self.every.partner.device)]
        return self.training.epoch(number)

    def score(self) -> Tensor | None:
        """Judge the model on held-out clips, as they were captured."""
        return self.training.score()

    def state(self) -> dict[str, Tensor]:
        """Take all that the epochs to come depend on; what they show depends on their number."""
        return self.training.state()

    def load(self, state: Mapping[str, Tensor]) -> None:
        """Go back to where ``state`` was taken."""
        self.training.load(state)


class VariationSampler:
    """Which of a pair's forms is shown.

    Parameters
    ----------
    n_own : pairs, whose own forms have the numbers below this
    sources : (V,) the pair that each further form is of; form v has the number ``n_own + v``
    """

    def __init__(self, n_own: int, sources: NDArray[np.intp]) -> None:
        self.own = np.arange(n_own)
        self.forms = n_own + np.argsort(sources, kind="stable")
        self.counts = np.bincount(sources, minlength=n_own)
        self.starts = np.cumsum(self.counts) - self.counts

    def draw(self, share: float, random: np.random.Generator) -> NDArray[np.intp]:
        """Draw ``(n_own,)`` numbers, a form of every pair.

        Parameters
        ----------
        share : how likely a pair that has further forms is shown in one of these
        """
        varied = (random.random(len(self.own)) < share) & (self.counts > 0)
        which = (random.random(len(self.own)) * self.counts).astype(np.intp)
        places = np.minimum(self.starts + which, len(self.forms) - 1)
        return np.where(varied, self.forms[places], self.own)


def _concatenate(first: MotionPairs, second: MotionPairs) -> MotionPairs:
    parts = zip(vars(first).values(), vars(second).values(), strict=True)
    return MotionPairs(*(torch.cat(both) for both in parts))
