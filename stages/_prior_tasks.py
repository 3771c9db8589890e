"""The two tasks of a skeleton prior: motions on given bodies, and on bodies that it draws."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from pacmo_core.data.interaction import Interaction
from pacmo_core.interaction_mesh import Scene, Settings, prepare, vary
from pacmo_core.metrics.retargeting import sample_diversity
from pacmo_core.skeleton_prior.data import Example
from pacmo_core.skeleton_prior.inference import generate_skeletons, retarget
from pacmo_core.skeleton_prior.vae import SkeletonPrior
from stages._prior_scores import Judge, oriented


@dataclass(frozen=True)
class GeneratedSkeletons:
    """The skeletons that are sampled for generation.

    Parameters
    ----------
    per_source : at least 2
    n_samples : motions of one of them, for the diversity
    random_seed : int
    """

    per_source: int
    n_samples: int
    random_seed: int


def drawn_bodies(
    model: SkeletonPrior, test: Sequence[Example], bodies: GeneratedSkeletons, solver: Settings
) -> list[Example]:
    """Draw bodies for each source of the test side, and let the solver move them."""
    random = torch.Generator().manual_seed(bodies.random_seed)
    sources = {example.source: example.template for example in test}
    found = []
    for name, template in sources.items():
        scales = generate_skeletons(model, bodies.per_source, random=random)
        points = solved(template, scales, solver)
        n_joints = len(template.skeleton.joints)
        for own, both in zip(scales, points, strict=True):
            first, second = (np.ascontiguousarray(p) for p in np.split(both, [n_joints], axis=1))
            varied = replace(template, person_a=first, person_b=second)
            found.append(Example(name, template, own, varied))
    return found


def solved(
    template: Interaction, scales: NDArray[np.float64], solver: Settings
) -> NDArray[np.float32]:
    """``(V, T, 2 J, 3)`` metres: what the solver makes of a source on bodies (V, 2, E)."""
    people = (template.person_a, template.person_b)
    scene = Scene(people, (template.skeleton,) * 2, template.fps)
    made = vary(prepare(scene, solver), scales.reshape(len(scales), -1))
    return made.points.astype(np.float32)


def retargeting(model: SkeletonPrior, judge: Judge, test: Sequence[Example]) -> dict[str, float]:
    """Measure the likeliest motions of one source on given bodies."""
    return judge.retargeted(varied(model, test, None), test)


def generation(
    model: SkeletonPrior,
    judge: Judge,
    sides: tuple[Sequence[Example], Sequence[Example]],
    n_samples: int,
    random: torch.Generator,
) -> dict[str, float]:
    """Measure drawn motions of one source on drawn bodies.

    Parameters
    ----------
    sides : real variations; the solver's on the drawn bodies
    n_samples : motions of one body, for their diversity
    """
    real, drawn = sides
    motions = varied(model, drawn, random)
    one = drawn[0]
    (samples,) = retarget(model, one.template, one.scales[None], samples=n_samples, random=random)
    return {
        **judge.generated(motions, drawn),
        **judge.distance(motions, drawn, drawn, "FID"),
        **judge.distance(motions, drawn, real, "FID_test"),
        "diversity": sample_diversity(np.stack([oriented(motion, one) for motion in samples])),
    }


def varied(
    model: SkeletonPrior, examples: Sequence[Example], random: torch.Generator | None
) -> list[Interaction]:
    """Vary one source to each example's body."""
    scales = np.stack([example.scales for example in examples])
    template = examples[0].template
    return [pair for (pair,) in retarget(model, template, scales, samples=1, random=random)]
