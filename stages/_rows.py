"""Rows of the table, seen from their partners: real, generated, dealt to other partners."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.names import ReactionName, sample_name
from pacmo_core.metrics.partners import has_wrong_partner
from pacmo_core.metrics.reactions import Reactions
from pacmo_core.reaction import autoencoder, matcher
from pacmo_core.reaction.autoencoder import Autoencoder
from pacmo_core.reaction.data import replace_reaction, to_partner_frame
from pacmo_core.reaction.matcher import Matcher
from pacmo_core.store.motions import stream_motions
from stages._files import MOTIONS
from stages._reactions import directed_clips

Indices = NDArray[np.intp]


@dataclass(frozen=True)
class Seen:
    """Interactions seen from their partners, in the order of the tested clips.

    Parameters
    ----------
    names : of the directed clips, the clip's, ``#`` and the person who reacts
    clips, acts : of each
    interactions : with the first reaction to each partner
    further : with the second to each, the third, and so on
    """

    names: list[str]
    clips: list[str]
    acts: list[str]
    interactions: list[Interaction]
    further: list[list[Interaction]]

    def dealt(self, order: Indices) -> "Seen":
        """Give partner i the reaction of sample ``order[i]``, and its clip's name with it."""
        sets = [self.interactions, *self.further]
        dealt = [
            [replace_reaction(own, some[i]) for own, i in zip(some, order, strict=True)]
            for some in sets
        ]
        clips = [self.clips[i] for i in order]
        return Seen(self.names, clips, self.acts, dealt[0], dealt[1:])

    def take(self, chosen: Indices) -> "Seen":
        """Choose samples by index, in that order."""
        names, clips, acts = (
            [part[i] for i in chosen] for part in (self.names, self.clips, self.acts)
        )
        sets = [[some[i] for i in chosen] for some in (self.interactions, *self.further)]
        return Seen(names, clips, acts, sets[0], sets[1:])


@dataclass(frozen=True)
class Extractors:
    """The two frozen networks that give what metrics compare."""

    autoencoder: Autoencoder
    matcher: Matcher

    def reactions(self, seen: Seen) -> Reactions:
        """Add features and embeddings, as the metrics want a row."""
        features = autoencoder.encode_features(self.autoencoder, seen.interactions)
        further = [autoencoder.encode_features(self.autoencoder, some) for some in seen.further]
        return Reactions(
            features=features,
            motions=[interaction.person_b for interaction in seen.interactions],
            partners=[interaction.person_a for interaction in seen.interactions],
            times=[interaction.times for interaction in seen.interactions],
            clips=seen.clips,
            embedded=np.stack(matcher.embed(self.matcher, seen.interactions)),
            further=np.array(further).reshape(len(further), *features.shape),
        )


def real_side(clips: Path, sides: Path, side: str) -> Seen:
    """See the recorded clips of a side from either person."""
    found = list(directed_clips(clips, sides, side))
    return Seen(
        [name for name, _, _ in found],
        [facts.clip for _, facts, _ in found],
        [facts.action for _, facts, _ in found],
        [to_partner_frame(interaction) for _, _, interaction in found],
        [],
    )


def generated(file: Path, real: Seen) -> Seen | None:
    """See a run's reactions to the partners tested; none if the run makes none of these data.

    Raises
    ------
    ValueError
        If a partner is without its reaction, or has fewer than the others.
    """
    found = dict(stream_motions(file))
    if not found:
        return None
    n_samples = 1 + max(ReactionName.parse(name).sample for name in found)
    wanted = [[sample_name(name, k) for name in real.names] for k in range(n_samples)]
    missing = {name for names in wanted for name in names} ^ found.keys()
    if missing:
        raise ValueError(
            f"{file}: wanted {n_samples} reactions to each partner tested, and no others; "
            f"{min(missing)} is amiss"
        )
    sets = [[to_partner_frame(found[name]) for name in names] for names in wanted]
    return Seen(real.names, real.clips, real.acts, sets[0], sets[1:])


def runs(reactions: Path, real: Seen) -> Iterator[tuple[str, int, Seen]]:
    """Yield what stands in ``ROW/SEED`` below a folder, without the runs that made nothing."""
    files = sorted(reactions.glob(f"*/*/{MOTIONS}"))
    if not files:
        raise ValueError(f"{reactions}: wanted ROW/SEED/{MOTIONS} below it, found none")
    for file in files:
        seen = generated(file, real)
        if seen is not None:
            yield file.parts[-3], int(file.parts[-2]), seen


def exchangeable(real: Seen) -> Indices:
    """Find the samples of acts in which partners can be exchanged."""
    return np.flatnonzero(has_wrong_partner(real.clips, real.acts))
