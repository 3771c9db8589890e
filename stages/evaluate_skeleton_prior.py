"""Evaluate all skeleton priors of a split, on the test variations' bodies and on sampled ones.

Usage: python -m stages.evaluate_skeleton_prior VARIATIONS SPLITS.parquet MODELS SCORES.json
           SAMPLES.parquet

VARIATIONS is the folder of one dataset. MODELS holds MODEL/SEED. Two rows stand beside the models
under the same protocol, on the same bodies: ``template``, a copy of the source, and ``start``, the
untrained start of the kinematic model. SAMPLES gets motions to play: for each source, on one
sampled body, the solver's variation and each row's.
"""

import argparse
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import TypeAdapter

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.names import variation_name
from pacmo_core.interaction_mesh import Scene, Settings, prepare
from pacmo_core.interaction_mesh import retarget as retarget_by_optimisation
from pacmo_core.metrics import motion_features, retargeting
from pacmo_core.metrics.motion_features import FeatureExtractor, FeatureExtractorSettings
from pacmo_core.metrics.naturalness import naturalness
from pacmo_core.metrics.plausibility import BodyJoints, find_body_joints
from pacmo_core.metrics.retargeting import Pair, RetargetingLimits, sample_diversity
from pacmo_core.models import load_skeleton_prior
from pacmo_core.skeleton_prior.data import Example, canonical_frame, is_b_first
from pacmo_core.skeleton_prior.inference import generate_skeletons, retarget
from pacmo_core.skeleton_prior.training import build_start
from pacmo_core.skeleton_prior.vae import SkeletonPrior
from pacmo_core.store.files import file_hash
from pacmo_core.store.motions import write_motions
from stages.common.examples import stream_examples
from stages.common.files import (
    ALL_SOURCES,
    SOLVER,
    START,
    TEMPLATE,
    WEIGHTS,
    read_json,
    write_json,
)
from stages.common.params import PriorRuns, read_params, read_prior_runs, run_stage

# ``retarget`` of a row: from a source and scales (V, 2, E) to the samples on each body.
Retargeter = Callable[..., Iterator[list[Interaction]]]

# Samples of each body for the energy score.
SCORED_SAMPLES = 4
# Sampled bodies that are compared with those trained on.
N_BODIES = 1000
# The supplement's B is the first character, its A the second, which depends on the first.
CHARACTERS = ("first", "second")


@dataclass(frozen=True)
class PriorEvaluator:
    """The evaluation that all models of a split share.

    Parameters
    ----------
    extractor : of the features of the Fréchet distance
    body : joints that the metrics use
    limits : distances and speeds that define contact, stance and penetration
    solver : settings with which the solver measures motions
    """

    extractor: FeatureExtractor
    body: BodyJoints
    limits: RetargetingLimits
    solver: Settings

    def retargeted(
        self, motions: Sequence[Interaction], ground_truths: Sequence[Example]
    ) -> dict[str, float]:
        """Compare motions on the test variations' bodies with the solver's."""
        rows = [
            self._errors(
                oriented(motion, ground_truth),
                oriented(ground_truth.variation, ground_truth),
                ground_truth,
            )
            for motion, ground_truth in zip(motions, ground_truths, strict=True)
        ]
        return _mean_rows(rows) | _ratio_of_sums(
            [self._sums(m, t) for m, t in zip(motions, ground_truths, strict=True)]
        )

    def generated(
        self, motions: Sequence[Interaction], ground_truths: Sequence[Example]
    ) -> dict[str, float]:
        """Compare motions on sampled bodies with the solver's on the same bodies."""
        rows = []
        for motion, ground_truth in zip(motions, ground_truths, strict=True):
            predicted, expected = (
                oriented(motion, ground_truth),
                oriented(ground_truth.variation, ground_truth),
            )
            errors = self._errors(predicted, expected, ground_truth)
            rows.append({name: errors[name] for name in errors if not name.startswith("E_r")})
        return _mean_rows(rows)

    def distance(
        self,
        result: Sequence[Interaction],
        bodies: Sequence[Example],
        real: Sequence[Example],
        name: str,
    ) -> dict[str, float]:
        """Return the Fréchet distance of motions from real ones, of each character."""
        distances = {}
        for role, character in enumerate(CHARACTERS):
            predicted = self.features(result, bodies, role)
            expected = self.features([example.variation for example in real], real, role)
            distances[f"{name}_{character}"] = retargeting.frechet_distance(expected, predicted)
        return distances

    def features(
        self, motions: Sequence[Interaction], examples: Sequence[Example], role: int
    ) -> NDArray[np.float64]:
        """Return one character's features, in the frames of the sources."""
        return self.extractor.features(list(characters(motions, examples, role)))

    def _errors(self, predicted: Pair, expected: Pair, ground_truth: Example) -> dict[str, float]:
        template = oriented(ground_truth.template, ground_truth)
        scales = (
            ground_truth.scales[::-1] if is_b_first(ground_truth.scales) else ground_truth.scales
        )
        skeleton = ground_truth.template.skeleton
        paths = retargeting.joint_error(predicted, expected)
        bones = retargeting.bone_error(predicted, template, scales, skeleton)
        columns = {"E_r": paths, "E_b": bones}
        return {
            f"{metric}_{name}": float(values[role])
            for metric, values in columns.items()
            for role, name in enumerate(CHARACTERS)
        } | {"JPD": retargeting.pair_distance_error(predicted, expected)}

    def _sums(self, motion: Interaction, ground_truth: Example) -> dict[str, tuple[float, float]]:
        predicted, template = (
            oriented(motion, ground_truth),
            oriented(ground_truth.template, ground_truth),
        )
        kept, touching = retargeting.contacts_preserved(predicted, template, self.limits)
        skate, standing = retargeting.foot_skate(
            predicted, template, ground_truth.template.times, self.body, self.limits
        )
        merged = retargeting.penetrating_frames(predicted, self.body, self.limits)
        return {
            "contacts_preserved": (kept, touching),
            "foot_skate": (float(skate), float(standing)),
            "penetrating": (merged, len(predicted)),
        }


def select_source(examples: Sequence[Example], source: str) -> list[Example]:
    """Select the examples of one source."""
    return [example for example in examples if example.source == source]


def oriented(motion: Interaction, ground_truth: Example) -> Pair:
    """Return ``(T, 2, J, 3)`` metres; the first character is the one whose body changes."""
    people = [motion.person_a, motion.person_b]
    return np.stack(people[::-1] if is_b_first(ground_truth.scales) else people, axis=1)


def characters(
    motions: Sequence[Interaction], examples: Sequence[Example], role: int
) -> Iterator[NDArray[np.float32]]:
    """Yield one character's motions in the canonical frames of their sources."""
    for motion, example in zip(motions, examples, strict=True):
        sampled_of_source = np.ascontiguousarray(oriented(motion, example)[:, role])
        yield canonical_frame(example.template).to_local(sampled_of_source)


def _mean_rows(rows: Sequence[dict[str, float]]) -> dict[str, float]:
    return {name: float(np.mean([row[name] for row in rows])) for name in rows[0]}


def _ratio_of_sums(rows: Sequence[dict[str, tuple[float, float]]]) -> dict[str, float]:
    """Divide sums over all motions; a ratio without a denominator is absent."""
    totals = {name: np.sum([row[name] for row in rows], axis=0) for name in rows[0]}
    return {name: float(part / whole) for name, (part, whole) in totals.items() if whole}


@dataclass(frozen=True)
class GeneratedSkeletons:
    """The skeletons that are sampled for generation.

    Parameters
    ----------
    per_source : skeletons for each source, at least 2
    n_samples : motions on one of them, for the diversity
    random_seed : int
    """

    per_source: int
    n_samples: int
    random_seed: int


def sample_body_examples(
    model: SkeletonPrior, test: Sequence[Example], bodies: GeneratedSkeletons, solver: Settings
) -> list[Example]:
    """Sample bodies for each source of the test split; the solver retargets the source to them."""
    random = torch.Generator().manual_seed(bodies.random_seed)
    sources = {example.source: example.template for example in test}
    result = []
    for name, template in sources.items():
        scales = generate_skeletons(model, bodies.per_source, random=random)
        points = solve_bodies(template, scales, solver)
        n_joints = len(template.skeleton.joints)
        for sampled_of_source, both in zip(scales, points, strict=True):
            first, second = (np.ascontiguousarray(p) for p in np.split(both, [n_joints], axis=1))
            varied = replace(template, person_a=first, person_b=second)
            result.append(Example(name, template, sampled_of_source, varied))
    return result


def solve_bodies(
    template: Interaction, scales: NDArray[np.float64], solver: Settings
) -> NDArray[np.float32]:
    """Retarget a source to bodies ``(V, 2, E)`` by the solver: ``(V, T, 2 J, 3)`` metres."""
    people = (template.person_a, template.person_b)
    scene = Scene(people, (template.skeleton,) * 2, template.fps)
    solution = retarget_by_optimisation(prepare(scene, solver), scales.reshape(len(scales), -1))
    return solution.points.astype(np.float32)


def evaluate_retargeting(
    row: Retargeter, evaluator: PriorEvaluator, test: Sequence[Example], random: torch.Generator
) -> dict[str, float]:
    """Evaluate the motions of one source at the latents' mean on the test variations' bodies.

    ``energy_score`` is that of samples, ``energy_score_mean`` that of this motion alone.
    ``spread`` is the mean distance of joints between two samples on a body; ``solver_spread`` that
    between two solutions of the solver on a body, where it has several.
    """
    at_mean = predict(row, test, None)
    scales, scores, spreads = np.stack([example.scales for example in test]), [], []
    drawn = row(test[0].template, scales, samples=SCORED_SAMPLES, random=random)
    for samples, mean, example in zip(drawn, at_mean, test, strict=True):
        truth = oriented(example.variation, example)
        several = np.stack([oriented(sample, example) for sample in samples])
        one = oriented(mean, example)[None]
        scores.append([retargeting.energy_score(motions, truth) for motions in (several, one)])
        spreads.append(sample_diversity(several))
    several_score, one_score = np.mean(scores, axis=0)
    return (
        evaluator.retargeted(at_mean, test)
        | {"energy_score": float(several_score), "energy_score_mean": float(one_score)}
        | {"spread": float(np.mean(spreads))}
        | solver_spread(test)
    )


def solver_spread(test: Sequence[Example]) -> dict[str, float]:
    """Return the mean distance of joints between two solutions of a body; empty without two."""
    solutions: dict[bytes, list[Pair]] = {}
    for example in test:
        body = solutions.setdefault(example.scales.tobytes(), [])
        body.append(oriented(example.variation, example))
    spreads = [sample_diversity(np.stack(body)) for body in solutions.values() if len(body) > 1]
    return {"solver_spread": float(np.mean(spreads))} if spreads else {}


def evaluate_generation(
    row: Retargeter,
    evaluator: PriorEvaluator,
    splits: tuple[Sequence[Example], Sequence[Example]],
    n_samples: int,
    random: torch.Generator,
) -> dict[str, float]:
    """Evaluate sampled motions of one source on sampled bodies.

    How natural they look is measured as a row gives them, as the finish leaves them, and of the
    solver's motions.

    Parameters
    ----------
    splits : test variations; the solver's variations on the sampled bodies
    n_samples : motions of one body, for their diversity
    """
    real, sampled = splits
    motions = predict(row, sampled, random)
    one = sampled[0]
    scales = np.stack([example.scales for example in sampled])
    solved = [example.variation for example in sampled]
    finished = predict(row, sampled, random, finish=True)
    seen = {"": motions, "finished_": finished, "solver_": solved}
    measured = {
        f"{whose}{name}": value
        for whose, several in seen.items()
        for name, value in naturalness(one.template, evaluator.solver, scales, several).items()
    }
    (samples,) = row(one.template, one.scales[None], samples=n_samples, random=random)
    return {
        **evaluator.generated(motions, sampled),
        **evaluator.distance(motions, sampled, sampled, "FID"),
        **evaluator.distance(motions, sampled, real, "FID_test"),
        **measured,
        "diversity": sample_diversity(np.stack([oriented(motion, one) for motion in samples])),
    }


def predict(
    row: Retargeter,
    examples: Sequence[Example],
    random: torch.Generator | None,
    *,
    finish: bool = False,
) -> list[Interaction]:
    """Retarget one source to the body of each example."""
    scales = np.stack([example.scales for example in examples])
    template = examples[0].template
    drawn = row(template, scales, samples=1, random=random, finish=finish)
    return [pair for (pair,) in drawn]


def copy_template(
    source: Interaction,
    scales: NDArray[np.float64],
    *,
    samples: int,
    random: torch.Generator | None,
    finish: bool = False,
) -> Iterator[list[Interaction]]:
    """Return the source itself on every body: what a model must be better than."""
    del random, finish
    yield from ([source] * samples for _ in scales)


@dataclass(frozen=True)
class Params:
    """The ``evaluate_skeleton_prior`` section of ``params.yaml``."""

    threads: int
    random_seed: int
    max_variations: int  # of each source
    temperature: float  # of samples: standard deviation of the latents
    generated_skeletons: GeneratedSkeletons
    limits: RetargetingLimits
    extractor: FeatureExtractorSettings


def main(paths: argparse.Namespace) -> None:
    params = read_params("evaluate_skeleton_prior", Params)
    solver = TypeAdapter(Settings).validate_python(read_json(paths.dataset / SOLVER))
    runs = read_prior_runs()
    torch.set_num_threads(params.threads)
    torch.use_deterministic_algorithms(mode=True)
    train, test = (
        [example for _, example in stream_examples(paths.dataset, paths.splits, split)]
        for split in ("train", "test")
    )
    evaluator = make_evaluator(train + test, params, solver)
    selected = sample_test_examples(test, params.max_variations, params.random_seed)
    one = load_skeleton_prior(paths.models / runs.models[0] / str(runs.seeds[0]) / WEIGHTS)
    sampled = sample_body_examples(one, selected, params.generated_skeletons, solver)
    samples: dict[str, Interaction] = {}
    scores: dict[str, dict[int, dict[str, dict[str, dict[str, float]]]]] = {}
    for name, seed, row in rows(one, paths.models, runs, params.temperature):
        result = evaluate_row(row, evaluator, (selected, sampled), params)
        scores.setdefault(name, {})[seed] = result
        if seed == runs.seeds[0] and name != TEMPLATE:  # which is the source
            samples |= samples_of(row, name, sampled)
    facts = {
        "extractor": motion_features.fingerprint(evaluator.extractor),
        "tested": len(selected),
        "bodies": compare_bodies(one, train),
        "weights": weights_hashes(paths.models, runs),
    }
    write_json(paths.scores, facts | {"train": len(train), "models": scores})
    with write_motions(paths.samples, test[0].template.skeleton) as writer:
        for name, motion in sorted((solver_samples(sampled) | samples).items()):
            writer.add(name, motion)


def weights_hashes(models: Path, runs: PriorRuns) -> dict[str, dict[int, str]]:
    """Hash the files of weights that the scores are of: by model, by seed."""
    return {
        name: {seed: file_hash(models / name / str(seed) / WEIGHTS) for seed in runs.seeds}
        for name in runs.models
    }


def compare_bodies(model: SkeletonPrior, train: Sequence[Example]) -> dict[str, float]:
    """Compare sampled bodies with those trained on: precision and coverage."""
    random = torch.Generator().manual_seed(0)
    generated = generate_skeletons(model, N_BODIES, random=random)[:, 1]
    real = [e.scales[1 if is_b_first(e.scales) else 0] for e in train]
    precision, coverage = retargeting.precision_and_coverage(np.stack(real), generated)
    return {"precision": precision, "coverage": coverage}


def rows(
    one: SkeletonPrior, models: Path, runs: PriorRuns, temperature: float
) -> Iterator[tuple[str, int, Retargeter]]:
    """Yield the rows of the table with their seeds; the first two have nothing to seed."""
    first_seed = runs.seeds[0]
    yield TEMPLATE, first_seed, copy_template
    yield START, first_seed, partial(retarget, build_start(one.config))
    for name in runs.models:
        for seed in runs.seeds:
            model = load_skeleton_prior(models / name / str(seed) / WEIGHTS)
            yield name, seed, partial(retarget, model, temperature=temperature)


def make_evaluator(real: list[Example], params: Params, solver: Settings) -> PriorEvaluator:
    """Train the extractor on both characters of the real variations."""
    motions = [example.variation for example in real]
    interaction = [m for role in (0, 1) for m in characters(motions, real, role)]
    skeleton = real[0].template.skeleton
    fitted = motion_features.build_extractor_training(
        interaction, skeleton, params.extractor
    ).finish()
    return PriorEvaluator(fitted, find_body_joints(skeleton), params.limits, solver)


def sample_test_examples(test: list[Example], most: int, random_seed: int) -> list[Example]:
    """Sample at most ``most`` examples of each source; their order is unchanged."""
    order = np.random.default_rng(random_seed).permutation(len(test))
    n_selected: Counter[str] = Counter()
    selected = set()
    for row in order.tolist():
        n_selected[test[row].source] += 1
        if n_selected[test[row].source] <= most:
            selected.add(row)
    return [test[row] for row in sorted(selected)]


def evaluate_row(
    row: Retargeter,
    evaluator: PriorEvaluator,
    splits: tuple[list[Example], list[Example]],
    params: Params,
) -> dict[str, dict[str, dict[str, float]]]:
    """Evaluate both tasks; return the figures by task, source and metric."""
    test, sampled = splits
    result: dict[str, dict[str, dict[str, float]]] = {"retargeting": {}, "generation": {}}
    for source in dict.fromkeys(example.source for example in test):
        test_of_source, sampled_of_source = (
            select_source(test, source),
            select_source(sampled, source),
        )
        random = torch.Generator().manual_seed(params.generated_skeletons.random_seed)
        result["retargeting"][source] = evaluate_retargeting(row, evaluator, test_of_source, random)
        result["generation"][source] = evaluate_generation(
            row,
            evaluator,
            (test_of_source, sampled_of_source),
            params.generated_skeletons.n_samples,
            random,
        )
    return {task: means | {ALL_SOURCES: mean_over_sources(means)} for task, means in result.items()}


def first_of_each(sampled: list[Example]) -> list[Example]:
    """Take the first sampled body of each source."""
    return list({example.source: example for example in reversed(sampled)}.values())


def samples_of(row: Retargeter, name: str, sampled: list[Example]) -> dict[str, Interaction]:
    """Give a row's motions at the latents' mean, finished, on the bodies that are samples."""
    return {
        variation_name(one.source, name): predict(row, [one], None, finish=True)[0]
        for one in first_of_each(sampled)
    }


def solver_samples(sampled: list[Example]) -> dict[str, Interaction]:
    """Give the sources, and the solver's motions on those bodies."""
    samples = first_of_each(sampled)
    sources = {variation_name(one.source, "source"): one.template for one in samples}
    return sources | {variation_name(one.source, "solver"): one.variation for one in samples}


def mean_over_sources(result: dict[str, dict[str, float]]) -> dict[str, float]:
    """Average over the sources that have a metric."""
    names = dict.fromkeys(name for metrics in result.values() for name in metrics)
    return {
        name: float(np.mean([metrics[name] for metrics in result.values() if name in metrics]))
        for name in names
    }


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    for name in ("dataset", "splits", "models", "scores", "samples"):
        parser.add_argument(name, type=Path)
    return parser.parse_args()


if __name__ == "__main__":
    run_stage(main, arguments())
