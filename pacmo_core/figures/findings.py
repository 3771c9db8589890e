"""What a run found, in one sentence a model, generated from its figures.

Better and worse mean that the interval of the paired difference excludes zero; what no interval
decides is said to be undecided. No sentence depends on which model it is about.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pacmo_core.figures.numbers import format_estimate
from pacmo_core.figures.skeleton_prior import METRIC_ROWS, SPLITS, MetricRow, Scores
from pacmo_core.figures.skeleton_prior import MODELS as PRIOR_MODELS
from pacmo_core.figures.tables import (
    BETTER,
    BETWEEN,
    OPEN,
    WORSE,
    Cell,
    Rows,
    finite_value,
    has_interval,
    metric_verdict,
)
from pacmo_core.figures.variations import measure_label
from pacmo_core.metrics.catalogue import (
    BASELINES,
    HEADLINE_MODELS,
    MAIN_COLUMNS,
    METRICS,
    PARTNER_COLUMNS,
    ROWS,
    improvement_sign,
)

# The metrics by which models are compared: those of the first tables that have a better direction,
# and of plausibility those that tell finished models apart.
_COLUMNS = (*MAIN_COLUMNS, *PARTNER_COLUMNS, "foot_skate", "lurches")
COMPARED = tuple(name for name in _COLUMNS if improvement_sign(name))
MATCHING = "matching"
CLOSENESS = "f2id"
FLOOR = "f2id_floor"
FINISHED_COPY = "nearest_neighbour_finished"
WITHOUT_FINISH = "_without_finish"  # ending of the row of a finished model's reactions before it
FEW_UNITS = "too few units"  # the verdict on a difference without an interval


@dataclass(frozen=True)
class Finding:
    """What was found about one model.

    Parameters
    ----------
    subject : label of the model, with which the sentence begins
    text : the rest of the sentence, with its verb and full stop
    """

    subject: str
    text: str


def reaction_findings(pooled: Mapping[str, Any], finished: Collection[str] = ()) -> list[Finding]:
    """Return a sentence for each of the headline models.

    Parameters
    ----------
    pooled : ``rows``, ``differences`` and ``sensitivity``, as ``pool_pacmo`` writes them
    finished : the models whose reactions are finished
    """
    return [
        Finding(
            _label(model), f"{'; '.join(_clauses(pooled, model, finished)).removeprefix('it ')}."
        )
        for model in HEADLINE_MODELS
        if model in pooled["rows"]
    ]


def _clauses(pooled: Mapping[str, Any], model: str, finished: Collection[str]) -> Iterator[str]:
    """Yield the clauses of a model's sentence; the first begins with "it"."""
    rows: Rows = pooled["rows"]
    baselines = [name for name in BASELINES if name in rows and name != model]
    for baseline in baselines:
        verdicts = compare(pooled["differences"], model, baseline)
        yield comparison_clause(_label(baseline), verdicts)
    if not baselines:
        yield "it has no baseline in this run"
    yield from _finish_clause(model, baselines, finished)
    yield from _closeness(rows[model])
    seen = pooled["sensitivity"].get(f"{model}_any_action")
    if seen is not None:
        yield _dependence(seen.get(MATCHING, {}))


def _finish_clause(
    model: str, baselines: Sequence[str], finished: Collection[str]
) -> Iterator[str]:
    """State which of the compared models are finished, if not all or none are."""
    groups = {
        wanted: [_label(name) for name in baselines if (name in finished) == wanted]
        for wanted in (True, False)
    }
    *others, last = groups[model not in finished] or [""]
    if last:
        differing = f"{', '.join(others)} and {last}" if others else last
        own, other = ("finished", "not") if model in finished else ("not finished", "finished")
        yield f"its reactions are {own}, those of {differing} are {other}"


def finish_note(rows: Collection[str], finished: Collection[str]) -> str:
    """Return which rows are finished; empty if none is.

    Parameters
    ----------
    rows : names of the rows of a table
    finished : the models whose reactions are finished
    """
    labels = [_label(name) for name in ROWS if name in rows and name in finished]
    if not labels:
        return ""
    text = (
        f"Finished, with bones of exact length, feet planted and predicted contacts closed, are "
        f"the reactions of: {'; '.join(labels)}. Those of all other rows are as generated or "
        "copied, so a part of a difference from these may be due to the finish."
    )
    without = [f"{name}{WITHOUT_FINISH}" for name in finished]
    shown = "; ".join(_label(name) for name in without if name in rows)
    return f"{text} What the finish changes is seen beside: {shown}." if shown else text


def compare(differences: Rows, first: str, second: str) -> dict[str, str]:
    """Return by metric whether the first model is better, worse or neither (open).

    Without an interval it is ``FEW_UNITS``. Metrics whose difference was not measured are left out.
    """
    cells = differences.get(f"{first}{BETWEEN}{second}")
    swap = cells is None
    cells = differences.get(f"{second}{BETWEEN}{first}", {}) if cells is None else cells
    opposite = {BETTER: WORSE, WORSE: BETTER, OPEN: OPEN, FEW_UNITS: FEW_UNITS}
    verdicts = {
        name: metric_verdict(name, cells[name]) if has_interval(cells[name]) else FEW_UNITS
        for name in COMPARED
        if finite_value(cells.get(name, {}), "mean") is not None
    }
    return {name: opposite[v] for name, v in verdicts.items()} if swap else verdicts


def comparison_clause(baseline: str, verdicts: Mapping[str, str]) -> str:
    """Return a clause that compares a model with a baseline by its verdicts."""
    if not verdicts:
        return f"it was not compared with {baseline}"
    decided = {name: verdict for name, verdict in verdicts.items() if verdict != FEW_UNITS}
    without = count(len(verdicts) - len(decided), "metric")
    if not decided:
        return (
            f"whether it beats {baseline} is not decided: too few units are tested for an "
            f"interval of {without}"
        )
    text = _decided_clause(baseline, decided)
    few = f", and too few units are tested for an interval of {without}"
    return text if len(decided) == len(verdicts) else text + few


def _decided_clause(baseline: str, verdicts: Mapping[str, str]) -> str:
    total = count(len(verdicts), "metric")
    better, worse = (
        [_in_list(name) for name, verdict in verdicts.items() if verdict == wanted]
        for wanted in (BETTER, WORSE)
    )
    behind = f"worse in {len(worse)} ({', '.join(worse)})" if worse else "worse in none"
    if better:
        ahead = f"in {len(better)} of {total} ({', '.join(better)})"
        return f"it is better than {baseline} {ahead} and {behind}"
    open_or_worse = (
        f"better in none of {total}, {behind}"
        if worse
        else f"no difference in {total} is significant"
    )
    return f"it does not beat {baseline}: {open_or_worse}"


def _closeness(cells: Mapping[str, Cell]) -> Iterator[str]:
    """State the distance to real motion."""
    distance = _finite_estimate(cells.get(CLOSENESS, {}))
    if distance:
        yield f"its {METRICS[CLOSENESS].label} is {format_estimate(distance)}"


def _dependence(cell: Cell) -> str:
    """State whether reactions fit their own partner better than another."""
    low, high = finite_value(cell, "low"), finite_value(cell, "high")
    if low is None or high is None:
        measured = finite_value(cell, "mean") is not None
        why = "is not decided: too few units are tested" if measured else "was not measured"
        return f"whether its reactions depend on the partner {why}"
    if low > 0:
        return "its reactions fit their own partner better than another one"
    if high < 0:
        return "its reactions fit another partner better than their own"
    return "that its reactions depend on the partner is not shown"


def comparison_note(confidence: float, pooled: Mapping[str, Any]) -> str:
    """Return what better and worse mean, and on how much data they rest."""
    estimate = _finite_estimate(pooled["rows"].get("real", {}).get(FLOOR, {}))
    label = METRICS[CLOSENESS].label
    floor = (
        f" {label} is the distance from the tested motion; another sample of real motion, with "
        f"other partners, is at {format_estimate(estimate)}."
        if estimate
        else ""
    )
    seeds = max((len(seeds) for seeds in pooled["seeds"].values()), default=0)
    compared = ", ".join(map(_in_list, COMPARED))
    return (
        f"Compared: {compared}; further ones in the table of paired differences. "
        f"Better and worse: the {100 * confidence:g} % interval of the paired difference excludes "
        f"zero; of 100 such intervals about {100 * (1 - confidence):.2g} do so by chance. "
        f"{count(pooled['test_reactions'], 'reaction')} tested in "
        f"{count(len(pooled['folds']), 'fold')}, {count(seeds, 'seed')} of each model.{floor}"
    )


def variation_findings(augment: Mapping[str, Any]) -> list[Finding]:
    """Return a sentence for each dataset of variations."""
    result = []
    for dataset, facts in augment.items():
        text = (
            f"was asked for {count(facts['planned'], 'variation')} of {dataset}: "
            f"{facts['accepted']:,} are within all limits"
        )
        if facts["failed"]:
            text += f", {facts['failed']:,} are beyond one and left out of training"
            often = max(facts["failed_by"], key=facts["failed_by"].__getitem__, default="")
            text += f" (most often by {measure_label(often)})" if often else ""
        if facts["refused"]:
            text += f", {facts['refused']:,} are of clips that it refused"
        result.append(Finding("InteractionMesh", f"{text}."))
    return result


def prior_findings(scores: Scores, dataset: str) -> list[Finding]:
    """Return a sentence for each skeleton prior that is the best somewhere, and one for the rest.

    The scores are those of one dataset, over all of its motions.
    """
    cells = [
        (block, models)
        for block in METRIC_ROWS
        if block.is_compared
        for split in SPLITS
        if len(models := _complete(scores.get(block.task, {}).get(split, {}), block)) > 1
    ]
    result, others = [], []
    for model, metric in PRIOR_MODELS.items():
        of_model = [(block, models) for block, models in cells if model in models]
        lowest = [_is_lowest(model, models, block) for block, models in of_model]
        if any(lowest):
            text = _prior_sentence(model, dataset, of_model, sum(lowest))
            result.append(Finding(f"Skeleton prior “{metric.label}”", text))
        elif lowest:
            others.append(f"“{metric.label}”")
    if others:
        subject = "Other skeleton priors" if result else "Skeleton priors"
        text = f"have the lowest value of all models in no comparison on {dataset}"
        result.append(Finding(subject, f"{text}: {', '.join(others)}."))
    return result


def _prior_sentence(
    model: str, dataset: str, cells: Sequence[tuple[MetricRow, Mapping[str, Any]]], n_lowest: int
) -> str:
    measured = [cell for cell in cells if _has_intervals(*cell)]
    certain = [_is_lowest(model, models, block, key=("high", "low")) for block, models in measured]
    text = (
        f"has the lowest value of all models in {n_lowest} of "
        f"{count(len(cells), 'comparison')} on {dataset}"
    )
    if not measured:
        return f"{text}, each of one motion and one seed only, so that no difference is certain."
    text += f"; in {sum(certain)} its interval over motions and seeds lies below all others"
    if without := len(cells) - len(measured):
        text += f"; {without} of the {len(cells)} are of one motion and one seed, without interval"
    return f"{text}."


def _has_intervals(block: MetricRow, models: Mapping[str, Any]) -> bool:
    return all("low" in metrics[part] for metrics in models.values() for part in block.parts)


def _complete(models: Mapping[str, Any], block: MetricRow) -> dict[str, Any]:
    return {
        model: metrics
        for model, metrics in models.items()
        if all(part in metrics for part in block.parts)
    }


def _is_lowest(
    model: str,
    models: Mapping[str, Any],
    block: MetricRow,
    *,
    key: tuple[str, str] = ("mean", "mean"),
) -> bool:
    """Return whether a value of a model, by its key, is below that of all others, by theirs."""

    def value(name: str, of: str) -> float:
        return float(sum(models[name][part][of] for part in block.parts) / len(block.parts))

    others = [name for name in models if name != model]
    return all(value(model, key[0]) < value(name, key[1]) for name in others)


def _finite_estimate(cell: Cell) -> dict[str, float]:
    values = {key: finite_value(cell, key) for key in ("mean", "low", "high")}
    known = {key: value for key, value in values.items() if value is not None}
    return known if "mean" in known else {}


def _in_list(metric: str) -> str:
    """Return the label of a metric without a comma, which would divide it in a list."""
    return METRICS[metric].label.replace(", ", " of ")


def _label(row: str) -> str:
    return ROWS.get(row, (row.replace("_", " "), ""))[0]


def count(number: int, noun: str) -> str:
    """Return a number with its noun: ``1 metric``, ``1,000 metrics``."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"
