"""Tables of skeleton priors: the supplement's Tables 1 to 10 with our values in the same cells."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from pacmo_core.figures.numbers import format_number, format_range
from pacmo_core.figures.supplement_tables import (
    FEW_SAMPLES_TABLE,
    SUPPLEMENT_COLUMNS,
    SUPPLEMENT_TABLES,
)
from pacmo_core.figures.tables import Entry, Line, Table, make_entry
from pacmo_core.metrics.catalogue import LOWER, UNKNOWN, Metric

# By model and metric: mean, low, high.
ModelScores = Mapping[str, Mapping[str, Mapping[str, float]]]
# By task and split.
Scores = Mapping[str, Mapping[str, ModelScores]]

OUR_MODEL = "kinematic"
MODELS = {
    "template": Metric("Template", UNKNOWN, "", "a copy of the source on every body"),
    "start": Metric("Start", UNKNOWN, "", "the rule that ours adds to, untrained"),
    OUR_MODEL: Metric("Ours", UNKNOWN, "", "bone rotations added to the start"),
    "kinematic_without_start": Metric(
        "Without the start", UNKNOWN, "", "ours, added to the scaled posture"
    ),
    "paper": Metric("Paper's form", UNKNOWN, "", "offsets from the template, scale of one body"),
    "f_cnn": Metric("F-CNN", UNKNOWN, "", "frame by frame, convolutions over joints"),
    "f_gcn": Metric("F-GCN", UNKNOWN, "", "frame by frame, graph convolutions"),
    "m_cnn": Metric("M-CNN", UNKNOWN, "", "whole motions, convolutions"),
    "m_gcn": Metric("M-GCN", UNKNOWN, "", "whole motions, graph convolutions"),
}
BASELINES = ("f_cnn", "f_gcn", "m_cnn", "m_gcn")
SPLITS = {
    "random": "Random",
    "cross_scale": "Cross-scale",
    "cross_interaction": "Cross-interaction",
    "cross_scale_interaction": "Cross-scale-interaction",
}
FEW_SAMPLES = ("_24", "_12", "_6")  # endings of the splits with fewer training samples
HARDEST = "cross_scale_interaction"
# An interval over fewer motions or seeds than these is said to be so.
FEW_UNITS = 10


@dataclass(frozen=True)
class MetricRow:
    """One block of the supplement's tables: a metric of a task.

    Parameters
    ----------
    task : retargeting or generation
    metric : name; with suffixes ``_first`` and ``_second`` if there is one for each character
    each : whether there is one for each character
    unit : of the displayed values
    factor : from metres to this unit
    """

    task: str
    metric: str
    each: bool
    unit: str
    factor: float

    @property
    def label(self) -> str:
        """Label in the first column."""
        unit = f", {self.unit}" if self.unit else ""
        return f"{self.metric}, {self.task}{unit}"

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the values in a cell; A first, as in the supplement."""
        return (f"{self.metric}_second", f"{self.metric}_first") if self.each else (self.metric,)

    @property
    def is_compared(self) -> bool:
        """Whether rows compete in it: E_b of the rows with forward kinematics is zero."""
        return self.metric != "E_b"


METRIC_ROWS = (
    MetricRow("retargeting", "E_r", each=True, unit="mm", factor=1e3),
    MetricRow("retargeting", "E_b", each=True, unit="mm", factor=1e3),
    MetricRow("retargeting", "JPD", each=False, unit="mm", factor=1e3),
    MetricRow("generation", "FID", each=True, unit="", factor=1.0),
    MetricRow("generation", "E_b", each=True, unit="mm", factor=1e3),
    MetricRow("generation", "JPD", each=False, unit="mm", factor=1e3),
)
PLAUSIBILITY_ROWS = {
    "contacts_preserved": Metric(
        "Contacts kept", "↑", "", "share of contacts over pairs and frames"
    ),
    "foot_skate": Metric("Foot skate", LOWER, "m/s", "of feet that are in stance in the source"),
    "penetrating": Metric(
        "Penetration", LOWER, "", "share of frames in which the bodies penetrate"
    ),
    "diversity": Metric(
        "Diversity", UNKNOWN, "m", "distance of joints between two samples on the same body"
    ),
}
MOTIONS = tuple(SUPPLEMENT_TABLES)


def motion_table(scores: Scores, motion: str) -> Table:
    """Return the table of one motion in the layout of the supplement, with its values below ours.

    Parameters
    ----------
    scores : of one source, or of all
    motion : of the supplement
    """
    printed = [line.split() for line in SUPPLEMENT_TABLES[motion].split("\n") if line.strip()]
    lines = []
    for number, block in enumerate(METRIC_ROWS):
        for row, split in enumerate(SPLITS):
            theirs = dict(zip(SUPPLEMENT_COLUMNS, printed[4 * number + row], strict=True))
            models = scores.get(block.task, {}).get(split, {})
            if not models:
                continue
            entries = tuple(_cell(models, model, block, theirs.get(model, "")) for model in MODELS)
            lines.append(Line(block.label, SPLITS[split], is_model=True, entries=entries))
    return Table(tuple(MODELS.values()), tuple(lines))


def few_samples_table(scores: Scores) -> Table:
    """Return Table 10: start, ours and the best baseline with fewer training samples."""
    lines = []
    for kind in ("", *FEW_SAMPLES):
        split = HARDEST + kind
        if not any(split in task for task in scores.values()):
            continue
        compared = {"Start": ("start",), "Ours": (OUR_MODEL,), "Best baseline": BASELINES}
        for label, models in compared.items():
            entries = tuple(_best_entry(scores, split, models, block) for block in METRIC_ROWS)
            samples = f"{kind[1:]} samples" if kind else "all samples"
            lines.append(Line(label, samples, is_model=label == "Ours", entries=entries))
    for motion, rows in FEW_SAMPLES_TABLE.items():
        for n, text in rows.items():
            cells = tuple(Entry(value, "", "", "") for value in text.split())
            lines.append(
                Line(f"Supplement, {motion}", f"{n} samples", is_model=False, entries=cells)
            )
    metrics = tuple(
        Metric(block.label, LOWER, "", "mean of both characters") for block in METRIC_ROWS
    )
    return Table(metrics, tuple(lines))


def plausibility_table(scores: Scores) -> Table:
    """Return the table of plausibility metrics."""
    lines = []
    for split in dict.fromkeys(split for task in scores.values() for split in task):
        for model, metric in MODELS.items():
            cells = [_cell_values(scores, split, model, name) for name in PLAUSIBILITY_ROWS]
            if any(cells):
                entries = tuple(make_entry(cell, "") for cell in cells)
                lines.append(Line(metric.label, split_label(split), is_model=True, entries=entries))
    return Table(tuple(PLAUSIBILITY_ROWS.values()), tuple(lines))


def split_label(split: str) -> str:
    """Return the name of a split in words."""
    for ending in FEW_SAMPLES:
        if split.endswith(ending):
            return f"{split_label(split.removesuffix(ending))}, {ending[1:]} training samples"
    return SPLITS.get(split, split.replace("_", " "))


def select_source(scores: Mapping[str, Any], family: str, source: str) -> Scores:
    """Select the scores of one source of a family: by task, split, model, metric."""
    return {
        task: {
            split: {
                model: sources[source] for model, sources in models.items() if source in sources
            }
            for split, models in families.get(family, {}).items()
        }
        for task, families in scores.items()
    }


def comparison_sentences(scores: Scores) -> Iterator[str]:
    """Yield for each metric in how many splits the mean of ours is below every other row's."""
    for block in filter(lambda row: row.is_compared, METRIC_ROWS):
        splits = [s for s in SPLITS if OUR_MODEL in scores.get(block.task, {}).get(s, {})]
        won = [s for s in splits if _is_best(scores[block.task][s], block)]
        if splits:
            yield (
                f"{block.label}: the mean of ours is below every other row's in "
                f"{len(won)} of {len(splits)} splits"
            )


def gain_sentence(split: str, gain: Mapping[str, Any]) -> str:
    """Say by how much training lowers the start's errors on one split.

    Parameters
    ----------
    gain : interval by metric, and the numbers of motions and seeds
    """
    cells = {name: gain[name] for name in ("E_r", "JPD")}
    said = " and ".join(_share(name, cell) for name, cell in cells.items())
    if not any(cell["mean"] for cell in cells.values()):
        said = "nothing, as no epoch has a lower validation error"
    motions, seeds = gain["motions"], gain["seeds"]
    few = "" if min(motions, seeds) >= FEW_UNITS else f", fewer than {FEW_UNITS} units"
    return (
        f"What training adds to the start, {SPLITS.get(split, split)}: {said} "
        f"(over {_count(motions, 'motion')} and {_count(seeds, 'seed')}{few})"
    )


def _share(name: str, cell: Mapping[str, float]) -> str:
    sign, verb = (1, "falls") if cell["mean"] >= 0 else (-1, "rises")
    text = f"{name} {verb} by {abs(cell['mean']):.0%}"
    if "low" not in cell:
        return text
    low, high = sorted(100 * sign * cell[bound] for bound in ("low", "high"))
    return f"{text} ({low:.0f} to {high:.0f} %)"


def _count(number: int, name: str) -> str:
    return f"{number} {name}{'s' if number != 1 else ''}"


def _is_best(models: ModelScores, block: MetricRow) -> bool:
    means = {model: _mean(models[model], block) for model in MODELS if model in models}
    ours = means.pop(OUR_MODEL)
    return bool(means) and ours < min(means.values())


def _mean(metrics: Mapping[str, Mapping[str, float]], block: MetricRow) -> float:
    return sum(metrics[part]["mean"] for part in block.parts) / len(block.parts)


def _cell(models: ModelScores, model: str, block: MetricRow, printed: str) -> Entry:
    theirs = f"supplement {printed}" if printed not in ("", "-") else ""
    if model not in models or not all(part in models[model] for part in block.parts):
        return Entry("–", theirs, "", "")
    cells = [models[model][part] for part in block.parts]
    value = "/".join(format_number(block.factor * cell["mean"]) for cell in cells)
    spread = [
        format_range(block.factor * cell["low"], block.factor * cell["high"])
        for cell in cells
        if "low" in cell
    ]
    complete = {
        m: metrics for m, metrics in models.items() if all(part in metrics for part in block.parts)
    }
    others = [_mean(metrics, block) for m, metrics in complete.items() if m != model]
    is_lowest = block.is_compared and others and _mean(complete[model], block) < min(others)
    small = "\n".join([*spread, *([theirs] if theirs else [])])
    return Entry(value, small, "best" if is_lowest else "", "")


def _best_entry(scores: Scores, split: str, models: tuple[str, ...], block: MetricRow) -> Entry:
    scores_of = scores.get(block.task, {}).get(split, {})
    means = [_mean(scores_of[model], block) for model in models if model in scores_of]
    if not means:
        return Entry("–", "", "", "")
    return Entry(format_number(block.factor * min(means)), "", "", "")


def _cell_values(scores: Scores, split: str, model: str, name: str) -> Mapping[str, float]:
    tasks = (scores[task].get(split, {}).get(model, {}) for task in scores)
    return next((metrics[name] for metrics in tasks if name in metrics), {})
