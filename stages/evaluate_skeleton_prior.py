"""Judge all skeleton priors of a split: on given bodies, and on bodies that they draw.

Usage: python -m stages.evaluate_skeleton_prior FAMILY SIDES.parquet MODELS SCORES.json
           SAMPLES.parquet

MODELS holds a folder a model, in it one a seed. SAMPLES will hold what plays: for each source one
drawn body, what the solver makes of it and what each model does.
"""

import argparse
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.names import variation_name
from pacmo_core.interaction_mesh import Settings as SolverSettings
from pacmo_core.metrics.body import body_of
from pacmo_core.metrics.retargeting import Limits
from pacmo_core.models import load_skeleton_prior
from pacmo_core.skeleton_prior import features
from pacmo_core.skeleton_prior.data import Example
from pacmo_core.skeleton_prior.features import FeatureExtractorSettings
from pacmo_core.skeleton_prior.vae import SkeletonPrior
from pacmo_core.store.motions import write_motions
from stages._examples import stream_examples
from stages._files import WEIGHTS, write_json
from stages._params import read_params
from stages._prior_scores import ALL, Judge, characters, of_source
from stages._prior_tasks import GeneratedSkeletons, drawn_bodies, generation, retargeting, varied
from stages._priors import read_priors


@dataclass(frozen=True)
class Params:
    """The ``evaluate_skeleton_prior`` section of ``params.yaml``."""

    threads: int
    random_seed: int
    max_variations: int  # of each source
    generated_skeletons: GeneratedSkeletons
    limits: Limits
    extractor: FeatureExtractorSettings
    solver: SolverSettings


def main(paths: argparse.Namespace) -> None:
    params = read_params("evaluate_skeleton_prior", Params)
    wanted = read_priors()
    torch.set_num_threads(params.threads)
    torch.use_deterministic_algorithms(mode=True)
    train, test = (
        [example for _, example in stream_examples(paths.family, paths.sides, side)]
        for side in ("train", "test")
    )
    judge = judge_of(train + test, params)
    chosen = sample(test, params.max_variations, params.random_seed)
    drawn: list[Example] = []
    shown: dict[str, Interaction] = {}
    scores: dict[str, dict[int, dict[str, dict[str, dict[str, float]]]]] = {}
    for name in wanted.models:
        for seed in wanted.seeds:
            model = load_skeleton_prior(paths.models / name / str(seed) / WEIGHTS)
            drawn = drawn or drawn_bodies(model, chosen, params.generated_skeletons, params.solver)
            found = score(model, judge, (chosen, drawn), params)
            scores.setdefault(name, {})[seed] = found
            if seed == wanted.seeds[0]:
                shown |= samples_of(model, name, drawn)
    facts = {"extractor": features.fingerprint(judge.extractor), "tested": len(chosen)}
    write_json(paths.scores, facts | {"train": len(train), "models": scores})
    with write_motions(paths.samples, test[0].template.skeleton) as writer:
        for name, motion in sorted((solver_samples(drawn) | shown).items()):
            writer.add(name, motion)


def judge_of(real: list[Example], params: Params) -> Judge:
    """Train the extractor on both characters of the real variations."""
    motions = [example.variation for example in real]
    seen = [m for role in (0, 1) for m in characters(motions, real, role)]
    skeleton = real[0].template.skeleton
    fitted = features.build_extractor_training(seen, skeleton, params.extractor).finish()
    return Judge(fitted, body_of(skeleton), params.limits)


def sample(test: list[Example], most: int, random_seed: int) -> list[Example]:
    """Draw so many of each source, at most, and keep their order."""
    order = np.random.default_rng(random_seed).permutation(len(test))
    taken: Counter[str] = Counter()
    chosen = set()
    for row in order.tolist():
        taken[test[row].source] += 1
        if taken[test[row].source] <= most:
            chosen.add(row)
    return [test[row] for row in sorted(chosen)]


def score(
    model: SkeletonPrior, judge: Judge, sides: tuple[list[Example], list[Example]], params: Params
) -> dict[str, dict[str, dict[str, float]]]:
    """Measure both tasks: by task, by source, by metric."""
    test, drawn = sides
    found: dict[str, dict[str, dict[str, float]]] = {"retargeting": {}, "generation": {}}
    for source in dict.fromkeys(example.source for example in test):
        given, own = of_source(test, source), of_source(drawn, source)
        random = torch.Generator().manual_seed(params.generated_skeletons.random_seed)
        found["retargeting"][source] = retargeting(model, judge, given)
        found["generation"][source] = generation(
            model, judge, (given, own), params.generated_skeletons.n_samples, random
        )
    return {task: means | {ALL: over_sources(means)} for task, means in found.items()}


def first_of_each(drawn: list[Example]) -> list[Example]:
    """Take the first drawn body of each source."""
    return list({example.source: example for example in reversed(drawn)}.values())


def samples_of(model: SkeletonPrior, name: str, drawn: list[Example]) -> dict[str, Interaction]:
    """Give the likeliest motions of a model on the drawn bodies that are shown."""
    return {
        variation_name(one.source, name): varied(model, [one], None)[0]
        for one in first_of_each(drawn)
    }


def solver_samples(drawn: list[Example]) -> dict[str, Interaction]:
    """Give the sources, and the solver's motions on those bodies."""
    shown = first_of_each(drawn)
    sources = {variation_name(one.source, "source"): one.template for one in shown}
    return sources | {variation_name(one.source, "solver"): one.variation for one in shown}


def over_sources(found: dict[str, dict[str, float]]) -> dict[str, float]:
    """Average over the sources that have a metric."""
    names = dict.fromkeys(name for metrics in found.values() for name in metrics)
    return {
        name: float(np.mean([metrics[name] for metrics in found.values() if name in metrics]))
        for name in names
    }


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    for name in ("family", "sides", "models", "scores", "samples"):
        parser.add_argument(name, type=Path)
    return parser.parse_args()


if __name__ == "__main__":
    main(arguments())
