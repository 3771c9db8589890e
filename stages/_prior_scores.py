"""What a skeleton prior's motions are measured by, one row a task, character and metric."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Interaction
from pacmo_core.metrics import retargeting
from pacmo_core.metrics.body import Body
from pacmo_core.metrics.retargeting import Limits, Pair
from pacmo_core.skeleton_prior.data import Example, canonical_frame, is_b_first
from pacmo_core.skeleton_prior.features import FeatureExtractor

# The supplement's A follows its B; here the second follows the first.
CHARACTERS = ("first", "second")
# The mean over sources, beside theirs.
ALL = "all"


@dataclass(frozen=True)
class Judge:
    """What all models of a split are judged with.

    Parameters
    ----------
    extractor : of the features of the Fréchet distance
    body : joints that metrics speak of
    limits : what counts as touching, standing and merging
    """

    extractor: FeatureExtractor
    body: Body
    limits: Limits

    def retargeted(
        self, found: Sequence[Interaction], truths: Sequence[Example]
    ) -> dict[str, float]:
        """Measure motions on given bodies against the solver's."""
        rows = [
            self._errors(oriented(motion, truth), oriented(truth.variation, truth), truth)
            for motion, truth in zip(found, truths, strict=True)
        ]
        return _means(rows) | _ratios(
            [self._sums(m, t) for m, t in zip(found, truths, strict=True)]
        )

    def generated(
        self, found: Sequence[Interaction], truths: Sequence[Example]
    ) -> dict[str, float]:
        """Measure motions on drawn bodies; ``truths`` are the solver's on the same bodies."""
        rows = []
        for motion, truth in zip(found, truths, strict=True):
            ours, theirs = oriented(motion, truth), oriented(truth.variation, truth)
            errors = self._errors(ours, theirs, truth)
            rows.append({name: errors[name] for name in errors if not name.startswith("E_r")})
        return _means(rows)

    def distance(
        self,
        found: Sequence[Interaction],
        bodies: Sequence[Example],
        real: Sequence[Example],
        name: str,
    ) -> dict[str, float]:
        """Measure the Fréchet distance of motions from real ones, of each character."""
        distances = {}
        for role, character in enumerate(CHARACTERS):
            ours = self.features(found, bodies, role)
            theirs = self.features([example.variation for example in real], real, role)
            distances[f"{name}_{character}"] = retargeting.frechet_distance(theirs, ours)
        return distances

    def features(
        self, motions: Sequence[Interaction], examples: Sequence[Example], role: int
    ) -> NDArray[np.float64]:
        """Take one character's features, in the frames of the sources."""
        return self.extractor.features(list(characters(motions, examples, role)))

    def _errors(self, ours: Pair, theirs: Pair, truth: Example) -> dict[str, float]:
        template = oriented(truth.template, truth)
        scales = truth.scales[::-1] if is_b_first(truth.scales) else truth.scales
        skeleton = truth.template.skeleton
        places = retargeting.joint_error(ours, theirs)
        bones = retargeting.bone_error(ours, template, scales, skeleton)
        columns = {"E_r": places, "E_b": bones}
        return {
            f"{metric}_{name}": float(values[role])
            for metric, values in columns.items()
            for role, name in enumerate(CHARACTERS)
        } | {"JPD": retargeting.pair_distance_error(ours, theirs)}

    def _sums(self, motion: Interaction, truth: Example) -> dict[str, tuple[float, float]]:
        ours, template = oriented(motion, truth), oriented(truth.template, truth)
        kept, touching = retargeting.contacts_kept(ours, template, self.limits)
        slid, standing = retargeting.slide(
            ours, template, truth.template.times, self.body, self.limits
        )
        merged = retargeting.merged_frames(ours, self.body, self.limits)
        return {
            "contacts_kept": (kept, touching),
            "slide": (float(slid), float(standing)),
            "merged": (merged, len(ours)),
        }


def of_source(examples: Sequence[Example], source: str) -> list[Example]:
    """Take the examples of one source."""
    return [example for example in examples if example.source == source]


def oriented(motion: Interaction, truth: Example) -> Pair:
    """``(T, 2, J, 3)`` metres, the character that changes first."""
    people = [motion.person_a, motion.person_b]
    return np.stack(people[::-1] if is_b_first(truth.scales) else people, axis=1)


def characters(
    motions: Sequence[Interaction], examples: Sequence[Example], role: int
) -> Iterator[NDArray[np.float32]]:
    """Yield one character's motions in the canonical frames of their sources."""
    for motion, example in zip(motions, examples, strict=True):
        own = np.ascontiguousarray(oriented(motion, example)[:, role])
        yield canonical_frame(example.template).to_local(own)


def _means(rows: Sequence[dict[str, float]]) -> dict[str, float]:
    return {name: float(np.mean([row[name] for row in rows])) for name in rows[0]}


def _ratios(rows: Sequence[dict[str, tuple[float, float]]]) -> dict[str, float]:
    """Divide sums over all motions; nothing is left out but what was never there."""
    totals = {name: np.sum([row[name] for row in rows], axis=0) for name in rows[0]}
    return {name: float(top / below) for name, (top, below) in totals.items() if below}
