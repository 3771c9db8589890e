"""Judge all skeleton priors of a split: on given bodies, and on bodies that they draw.

Usage: python -m stages.evaluate_skeleton_prior FAMILY SIDES.parquet MODELS SCORES.json

MODELS holds a folder a model, in it one a seed. Bodies are drawn once, by the prior of bodies of
the first, and the solver moves them too: what it makes of them is the reference.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from pacmo_core.interaction import Interaction
from pacmo_core.interaction_mesh import Scene, prepare, vary
from pacmo_core.interaction_mesh import Settings as SolverSettings
from pacmo_core.metrics.body import body_of
from pacmo_core.metrics.retargeting import Limits, sample_diversity
from pacmo_core.skeleton_prior import extractor, training
from pacmo_core.skeleton_prior.examples import Example
from pacmo_core.skeleton_prior.extractor import ExtractorSettings
from pacmo_core.skeleton_prior.model import SkeletonPrior
from pacmo_core.skeleton_prior.vary import generate_bodies, retarget
from pacmo_core.store.weights import read_weights
from stages._examples import stream_examples
from stages._files import WEIGHTS, write_json
from stages._params import read_params
from stages._prior_scores import Judge, characters, oriented


@dataclass(frozen=True)
class Params:
    """The ``evaluate_skeleton_prior`` section of ``params.yaml``."""

    threads: int
    random_seed: int
    bodies: int  # drawn, and as many samples of one body for the diversity
    limits: Limits
    extractor: ExtractorSettings
    solver: SolverSettings


def main(paths: argparse.Namespace) -> None:
    params = read_params("evaluate_skeleton_prior", Params)
    torch.set_num_threads(params.threads)
    torch.use_deterministic_algorithms(mode=True)
    train, test = (
        [example for _, example in stream_examples(paths.family, paths.sides, side)]
        for side in ("train", "test")
    )
    judge = judge_of(train, params)
    runs = sorted(paths.models.glob(f"*/*/{WEIGHTS}"))
    drawn: list[Example] = []
    scores: dict[str, dict[str, dict[str, dict[str, float]]]] = {}
    for weights in runs:
        model = prior_from(weights)
        drawn = drawn or drawn_bodies(model, test, params)
        name, seed = weights.parts[-3:-1]
        scores.setdefault(name, {})[seed] = score(model, judge, test, drawn, params)
    facts = {"extractor": extractor.fingerprint(judge.extractor), "test": len(test)}
    write_json(paths.scores, facts | {"models": scores})


def judge_of(train: Sequence[Example], params: Params) -> Judge:
    """Train the extractor on both characters of the real variations."""
    motions = [example.varied for example in train]
    seen = [m for role in (0, 1) for m in characters(motions, train, role)]
    skeleton = train[0].template.skeleton
    fitted = extractor.fit(seen, skeleton, params.extractor).finish()
    return Judge(fitted, body_of(skeleton), params.limits)


def prior_from(weights: Path) -> SkeletonPrior:
    """Read a trained model."""
    facts, state = read_weights(weights)
    return training.from_state(facts["model"], state)


def drawn_bodies(model: SkeletonPrior, test: Sequence[Example], params: Params) -> list[Example]:
    """Draw bodies for each source of the test side, and let the solver move them."""
    random = torch.Generator().manual_seed(params.random_seed)
    sources = {example.source: example.template for example in test}
    found = []
    for name, template in sources.items():
        scales = generate_bodies(model, params.bodies, random=random)
        people, n_joints = (template.person_a, template.person_b), len(template.skeleton.joints)
        scene = Scene(people, (template.skeleton,) * 2, template.fps)
        made = vary(prepare(scene, params.solver), scales.reshape(len(scales), -1))
        for own, points in zip(scales, made.points.astype(np.float32), strict=True):
            first, second = (np.ascontiguousarray(p) for p in np.split(points, [n_joints], axis=1))
            varied = replace(template, person_a=first, person_b=second)
            found.append(Example(name, template, own, varied))
    return found


def score(
    model: SkeletonPrior,
    judge: Judge,
    test: Sequence[Example],
    drawn: Sequence[Example],
    params: Params,
) -> dict[str, dict[str, float]]:
    """Measure both tasks."""
    random = torch.Generator().manual_seed(params.random_seed)
    likeliest = list(varied(model, test, None))
    sampled = list(varied(model, drawn, random))
    one = drawn[0]
    (samples,) = retarget(
        model, one.template, one.scales[None], samples=params.bodies, random=random
    )
    diversity = sample_diversity(np.stack([oriented(motion, one) for motion in samples]))
    generated = judge.generated(sampled, drawn) | judge.distance(sampled, drawn, test)
    return {
        "retargeting": judge.retargeted(likeliest, test),
        "generation": generated | {"diversity": diversity},
    }


def varied(
    model: SkeletonPrior, examples: Sequence[Example], random: torch.Generator | None
) -> Iterator[Interaction]:
    """Vary each example's source to its body, a source's bodies together."""
    by_source: dict[str, list[int]] = {}
    for row, example in enumerate(examples):
        by_source.setdefault(example.source, []).append(row)
    found: dict[int, Interaction] = {}
    for rows in by_source.values():
        scales = np.stack([examples[row].scales for row in rows])
        pairs = retarget(model, examples[rows[0]].template, scales, samples=1, random=random)
        for row, (pair,) in zip(rows, pairs, strict=True):
            found[row] = pair
    return iter([found[row] for row in range(len(examples))])


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    for name in ("family", "sides", "models", "scores"):
        parser.add_argument(name, type=Path)
    return parser.parse_args()


if __name__ == "__main__":
    main(arguments())
