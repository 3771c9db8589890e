"""The sections on skeleton priors, from the output of ``pool_skeleton_prior``."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.names import split_variation_name
from pacmo_core.figures.report import Section
from pacmo_core.figures.skeleton_prior import (
    MODELS,
    MOTIONS,
    SPLITS,
    comparison_sentences,
    few_samples_table,
    gain_sentence,
    motion_table,
    plausibility_table,
    select_source,
    split_label,
)
from pacmo_core.figures.viewer import Panel, PlayedClip
from pacmo_core.store.motions import stream_motions
from stages.common.files import ALL_SOURCES

PRIOR_LABELS = {"source": "Source", "solver": "InteractionMesh"} | {
    name: metric.label for name, metric in MODELS.items()
}
MAX_SOURCES = 12  # that have tables of their own, and are played
PRIOR_TASKS = ("retargeting", "generation")
PRIOR_NOTES = (
    "Large: ours, A/B for metrics of one character, B the one whose body changes. Small: the "
    "interval over motions and seeds, and the supplement's value, which is of other motions, in an "
    "unstated unit and of undescribed features: compare within a line. Marked: the lowest mean of "
    "its line.",
    "E_r: error of the joints' positions; E_b: of the bone lengths; JPD: of the distances between "
    "joints of the two bodies; FID: Fréchet distance of the features of clips.",
    "E_b of the rows Start, Ours and Without the start is zero by construction, and not compared.",
    "JPD of generation compares with InteractionMesh's motion on the sampled body, FID "
    "with its motions on the same bodies.",
)
FEW_SAMPLES_NOTES = (
    "Weights are selected on the same validation variations for any number of training samples. "
    "Generation is comparable among lines with the same number of samples only: each number has "
    "other sampled bodies and other features for FID.",
)


def prior_sections(pooled: dict[str, Any]) -> Iterator[Section]:
    """Yield the tables of each dataset: of all its motions, then of some motions."""
    scores = {task: pooled[task] for task in PRIOR_TASKS}
    names = iter(MOTIONS)
    for dataset, splits in pooled["data_facts"].items():
        all_sources = select_source(scores, dataset, ALL_SOURCES)
        title = f"Skeleton priors on {dataset}, mean over motions"
        gains = pooled["gain"].get(dataset, {})
        sources = sources_of(scores, dataset)
        shown = some_sources(sources)
        notes = (
            *(gain_sentence(split, gain) for split, gain in gains.items()),
            *PRIOR_NOTES,
            *comparison_sentences(all_sources),
            *data_notes(splits),
            *shown_notes(len(shown), len(sources)),
        )
        yield Section(f"{title}: plausibility", plausibility_table(all_sources), notes)
        for source in shown:
            motion = next(names, MOTIONS[-1])
            title = f"Table {MOTIONS.index(motion) + 1} of the supplement, {motion}, and {source}"
            yield Section(title, motion_table(select_source(scores, dataset, source), motion))
        if any(name not in SPLITS for name in splits):
            title = f"Table 10 of the supplement, and ours on {dataset}"
            yield Section(title, few_samples_table(all_sources), FEW_SAMPLES_NOTES)


def sources_of(scores: dict[str, Any], dataset: str) -> list[str]:
    """List the motions of a dataset that occur in a test split."""
    result = {
        source
        for models in scores[PRIOR_TASKS[0]][dataset].values()
        for sources in models.values()
        for source in sources
    }
    return sorted(result - {ALL_SOURCES})


def some_sources(sources: list[str]) -> list[str]:
    """Select at most ``MAX_SOURCES`` sources, evenly: a page shows no more of hundreds."""
    step = -(-len(sources) // MAX_SOURCES)
    return sources[:: max(1, step)]


def shown_notes(n_shown: int, n_sources: int) -> Iterator[str]:
    """Say where all motions are, if the page leaves some out."""
    if n_shown < n_sources:
        yield f"{n_shown} of {n_sources} motions are shown; reports/skeleton_prior.json has all."


def data_notes(splits: dict[str, Any]) -> Iterator[str]:
    """Yield the numbers of training and test variations of each split."""
    for split, facts in splits.items():
        yield (
            f"{split_label(split)}: {facts['train']:,} variations to train on, "
            f"{facts['tested']:,} tested; features {facts['extractor'][:16]}"
        )


def prior_clips(samples_folder: Path, pooled: dict[str, Any]) -> Iterator[PlayedClip]:
    """Yield, for a sampled body, the source, the solver's motion and each model's."""
    for dataset, splits in pooled["data_facts"].items():
        samples: dict[str, dict[str, Interaction]] = {}
        for fold in next(iter(splits.values()))["folds"]:
            for name, motion in stream_motions(samples_folder / dataset / f"{fold}.parquet"):
                source, model = split_variation_name(name)
                samples.setdefault(source, {})[model] = motion
        for source in some_sources(list(samples)):
            by_model = samples[source]
            panels = tuple(
                Panel(PRIOR_LABELS[model], by_model[model])
                for model in PRIOR_LABELS
                if model in by_model
            )
            yield PlayedClip(f"{dataset}, {source}", "On a sampled body", panels)


def prior_figures(pooled: dict[str, Any]) -> dict[str, dict[str, float]]:
    """List the figures that people compare of each dataset, split and model.

    E_r and JPD of given bodies in metres, FID of sampled bodies.
    """
    figures: dict[str, dict[str, float]] = {}
    for dataset, splits in pooled["retargeting"].items():
        for split, models in splits.items():
            for model, sources in models.items():
                given = sources[ALL_SOURCES]
                sampled = pooled["generation"][dataset][split][model][ALL_SOURCES]
                columns = {
                    "e_r": _mean(given, "E_r_first", "E_r_second"),
                    "jpd": _mean(given, "JPD"),
                    "fid": _mean(sampled, "FID_first", "FID_second"),
                }
                figures[f"{dataset}.{split}.{model}"] = columns
    return figures


def _mean(cells: dict[str, dict[str, float]], *metrics: str) -> float:
    """Average over both characters, rounded."""
    return float(f"{sum(cells[metric]['mean'] for metric in metrics) / len(metrics):.3g}")
