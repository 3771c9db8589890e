"""The page's part about skeleton priors, out of what ``pool_skeleton_prior`` wrote."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.names import split_variation_name
from pacmo_core.figures.clips import Panel, PlayedClip
from pacmo_core.figures.report import Section
from pacmo_core.figures.skeleton_prior import (
    MODELS,
    MOTIONS,
    SPLITS,
    comparison_sentences,
    few_samples_table,
    motion_table,
    plausibility_table,
    select_source,
)
from pacmo_core.store.motions import stream_motions
from stages.common.files import ALL_SOURCES

PRIOR_LABELS = {"source": "source", "solver": "solver"} | {
    name: metric.label for name, metric in MODELS.items()
}
PRIOR_TASKS = ("retargeting", "generation")
PRIOR_NOTES = (
    "Large: ours, A/B where each character has a figure of its own, B the one whose body changes. "
    "Small: the interval over seeds, and in brackets what the supplement prints, on other motions, "
    "in a unit that it does not state and of features that it does not describe: compare within a "
    "line.",
    "JPD of generation is held against the solver's motion on the drawn body, and FID against the "
    "solver's motions on the same bodies.",
)
FEW_SAMPLES_NOTES = (
    "Weights are chosen on the same validation variations, however few train. Generation compares "
    "among lines of as many samples, not between these: each number of samples has bodies of its "
    "own, drawn by what learnt from so many, and for FID features of its own variations.",
)


def prior_sections(pooled: dict[str, Any]) -> Iterator[Section]:
    """Give the tables of each dataset, motion by motion, then those of all of its motions."""
    scores = {task: pooled[task] for task in PRIOR_TASKS}
    names = iter(MOTIONS)
    for dataset, splits in pooled["data_facts"].items():
        all_sources = select_source(scores, dataset, ALL_SOURCES)
        title = f"Skeleton priors on {dataset}, mean over motions"
        notes = (*PRIOR_NOTES, *comparison_sentences(all_sources), *data_notes(splits))
        yield Section(f"{title}: what the eye sees", plausibility_table(all_sources), notes)
        for source in sources_of(scores, dataset):
            motion = next(names, MOTIONS[-1])
            title = f"Table {MOTIONS.index(motion) + 1} of the supplement, {motion}, and {source}"
            yield Section(title, motion_table(select_source(scores, dataset, source), motion))
        if any(name not in SPLITS for name in splits):
            title = f"Table 10 of the supplement, and ours on {dataset}"
            yield Section(title, few_samples_table(all_sources), FEW_SAMPLES_NOTES)


def sources_of(scores: dict[str, Any], dataset: str) -> list[str]:
    """List a dataset's motions that any split tests."""
    result = {
        source
        for models in scores[PRIOR_TASKS[0]][dataset].values()
        for sources in models.values()
        for source in sources
    }
    return sorted(result - {ALL_SOURCES})


def data_notes(splits: dict[str, Any]) -> Iterator[str]:
    """Say what was trained and tested on, and whose features those are."""
    for split, facts in splits.items():
        yield (
            f"{SPLITS.get(split, split)}: {facts['train']} variations to train on, "
            f"{facts['tested']} tested; features {facts['extractor'][:16]}"
        )


def prior_clips(samples_folder: Path, pooled: dict[str, Any]) -> Iterator[PlayedClip]:
    """Set what the models maker of a drawn body beside the source and the solver's."""
    for dataset, splits in pooled["data_facts"].items():
        samples: dict[str, dict[str, Interaction]] = {}
        split = next(iter(splits))
        for name, motion in stream_motions(samples_folder / dataset / f"{split}.parquet"):
            source, maker = split_variation_name(name)
            samples.setdefault(source, {})[maker] = motion
        for source, by_maker in samples.items():
            panels = tuple(
                Panel(PRIOR_LABELS[maker], by_maker[maker])
                for maker in PRIOR_LABELS
                if maker in by_maker
            )
            yield PlayedClip(source, f"{dataset}, a drawn body", panels)


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
