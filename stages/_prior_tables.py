"""The page's part about skeleton priors, out of what ``pool_skeleton_prior`` wrote."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.names import split_variation_name
from pacmo_core.figures.clips import Panel, PlayedClip
from pacmo_core.figures.priors import (
    MODELS,
    NAMES,
    SPLITS,
    eye_table,
    fewer_table,
    motion_table,
    of_source,
    verdicts,
)
from pacmo_core.figures.report import Section
from pacmo_core.store.motions import stream_motions
from stages._prior_scores import ALL

LABELS = {"source": "source", "solver": "solver"} | {
    name: metric.label for name, metric in MODELS.items()
}
TASKS = ("retargeting", "generation")
NOTES = (
    "Large: ours, A/B where each character has a figure of its own, B the one whose body changes. "
    "Small: the interval over seeds, and in brackets what the supplement prints, on other motions, "
    "in a unit that it does not state and of features that it does not describe: compare within a "
    "line.",
    "JPD of generation is held against the solver's motion on the drawn body, and FID against the "
    "solver's motions on the same bodies.",
)
NOTES_FEWER = (
    "Weights are chosen on the same validation variations, however few train. Generation compares "
    "among lines of as many samples, not between these: each number of samples has bodies of its "
    "own, drawn by what learnt from so many, and for FID features of its own variations.",
)


def prior_sections(pooled: dict[str, Any]) -> Iterator[Section]:
    """Give the tables of each family, motion by motion, then those of all of its motions."""
    scores = {task: pooled[task] for task in TASKS}
    names = iter(NAMES)
    for family, splits in pooled["made_with"].items():
        whole = of_source(scores, family, ALL)
        title = f"Skeleton priors on {family}, mean over motions"
        notes = (*NOTES, *verdicts(whole), *made_with(splits))
        yield Section(f"{title}: what the eye sees", eye_table(whole), notes)
        for source in sources_of(scores, family):
            motion = next(names, NAMES[-1])
            title = f"Table {NAMES.index(motion) + 1} of the supplement, {motion}, and {source}"
            yield Section(title, motion_table(of_source(scores, family, source), motion))
        if any(name not in SPLITS for name in splits):
            title = f"Table 10 of the supplement, and ours on {family}"
            yield Section(title, fewer_table(whole), NOTES_FEWER)


def sources_of(scores: dict[str, Any], family: str) -> list[str]:
    """List a family's motions that any split tests."""
    found = {
        source
        for models in scores[TASKS[0]][family].values()
        for sources in models.values()
        for source in sources
    }
    return sorted(found - {ALL})


def made_with(splits: dict[str, Any]) -> Iterator[str]:
    """Say what was trained and tested on, and whose features those are."""
    for split, facts in splits.items():
        yield (
            f"{SPLITS.get(split, split)}: {facts['train']} variations to train on, "
            f"{facts['tested']} tested; features {facts['extractor'][:16]}"
        )


def prior_clips(priors: Path, pooled: dict[str, Any]) -> Iterator[PlayedClip]:
    """Set what the models made of a drawn body beside the source and the solver's."""
    for family, splits in pooled["made_with"].items():
        shown: dict[str, dict[str, Interaction]] = {}
        split = next(iter(splits))
        for name, motion in stream_motions(priors / "samples" / family / f"{split}.parquet"):
            source, made = split_variation_name(name)
            shown.setdefault(source, {})[made] = motion
        for source, made_by in shown.items():
            panels = tuple(Panel(LABELS[made], made_by[made]) for made in LABELS if made in made_by)
            yield PlayedClip(source, f"{family}, a drawn body", panels)
