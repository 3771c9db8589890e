"""Training of PaCMO on clips and their variations on other bodies.

In each epoch every clip is shown either as captured or as one of its variations; random parts of
clips (``settings.parts``) are shown as captured. Nothing else changes: the number of steps, and the
random rows, noise and mirror images are those of a training of the same seed without variations, so
that the two can be compared.
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
    """Variations of training clips.

    Parameters
    ----------
    interactions : V of them
    sources : index of each one's clip
    share : probability of showing a variation in place of its clip

    Raises
    ------
    ValueError
        If there are none, the number of sources differs, or the share is not in [0, 1].
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
            raise ValueError(f"share must be in [0, 1]; got {self.share}")


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
    loop: TrainingLoop[Generator], variations: TrainingVariations
) -> TrainingLoop[Generator]:
    """Add variations to a training that has not begun.

    Parameters
    ----------
    loop : of ``wgan.build_training``, on the clips that are varied

    Raises
    ------
    TypeError
        If it trains something else.
    """
    if not isinstance(loop.trainer, WganTrainer):
        raise TypeError(f"wanted a loop of a WganTrainer; got one of {type(loop.trainer).__name__}")
    trainer = AugmentedWganTrainer(loop.trainer, variations)
    return TrainingLoop(trainer, n_epochs=loop.n_epochs, validate_every=loop.validate_every)


class AugmentedWganTrainer:
    """A WGAN trainer whose training pairs are selected anew in every epoch.

    Parameters
    ----------
    trainer : on the clips' own pairs, from which its normalisation was computed
    variations : TrainingVariations

    Raises
    ------
    ValueError
        If a source is no index of a clip.
    """

    def __init__(self, trainer: WganTrainer, variations: TrainingVariations) -> None:
        settings, originals = trainer.settings, trainer.pairs
        n_clips = len(originals) // (2 if settings.both_directions else 1)
        if not 0 <= min(variations.sources) <= max(variations.sources) < n_clips:
            raise ValueError(f"sources must be indices of {n_clips} clips; {variations.sources}")
        interactions = expand_directions(variations.interactions, both=settings.both_directions)
        # The pairs of clips, and so of their variations, come in the order of the clips, then again
        # in the other direction.
        sources = np.concatenate(
            [np.array(variations.sources) + first for first in range(0, len(originals), n_clips)]
        )
        rows = torch.as_tensor(sources, device=originals.action.device)
        varied = sample_motion_pairs(interactions, settings.n_points, originals.action[rows])
        self.trainer, self.share = trainer, variations.share
        self.pairs = _concatenate(originals, varied.to(originals.partner.device))
        self.sampler = VariationSampler(len(originals), sources)

    @property
    def model(self) -> Generator:
        """The EMA of the generator."""
        return self.trainer.model

    def train_epoch(self, number: int) -> dict[str, float]:
        """Select the pairs of epoch ``number``, and train on them."""
        random = np.random.default_rng((self.trainer.settings.random_seed, number))
        rows = torch.as_tensor(self.sampler.sample(self.share, random))
        self.trainer.pairs = self.pairs[rows.to(self.pairs.partner.device)]
        return self.trainer.train_epoch(number)

    def validate(self) -> dict[str, Tensor]:
        """Score the model on validation clips, as captured."""
        return self.trainer.validate()

    def state_dict(self) -> dict[str, Tensor]:
        """Return all that later epochs depend on; their selections depend on their numbers."""
        return self.trainer.state_dict()

    def load_state_dict(self, state: Mapping[str, Tensor]) -> None:
        """Restore what ``state_dict`` returned."""
        self.trainer.load_state_dict(state)


class VariationSampler:
    """Random selection of an original or one of its variations.

    Parameters
    ----------
    n_originals : their indices are the numbers below
    sources : (V,) the original of each variation; variation v has the index ``n_originals + v``
    """

    def __init__(self, n_originals: int, sources: NDArray[np.intp]) -> None:
        self.originals = np.arange(n_originals)
        self.variations = n_originals + np.argsort(sources, kind="stable")
        self.counts = np.bincount(sources, minlength=n_originals)
        self.starts = np.cumsum(self.counts) - self.counts

    def sample(self, share: float, random: np.random.Generator) -> NDArray[np.intp]:
        """Sample ``(n_originals,)`` indices, an original or a variation for each original.

        Parameters
        ----------
        share : probability of a variation, of originals that have any
        """
        is_varied = (random.random(len(self.originals)) < share) & (self.counts > 0)
        offsets = (random.random(len(self.originals)) * self.counts).astype(np.intp)
        positions = np.minimum(self.starts + offsets, len(self.variations) - 1)
        return np.where(is_varied, self.variations[positions], self.originals)


def _concatenate(first: MotionPairs, second: MotionPairs) -> MotionPairs:
    parts = zip(vars(first).values(), vars(second).values(), strict=True)
    return MotionPairs(*(torch.cat(both) for both in parts))
