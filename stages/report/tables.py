"""The tables of reactions, from the output of ``pool_pacmo``."""

from collections.abc import Iterable, Iterator
from typing import Any

from pacmo_core.figures.paper_tables import CAVEATS, PAPER_TABLES, difference_note, side_by_side
from pacmo_core.figures.report import Section
from pacmo_core.figures.tables import (
    AUGMENTATION_TITLE,
    augmentation_table,
    augmentation_verdict,
    difference_table,
    insensitive_metrics,
    sensitivity_table,
    undecided_metrics,
)
from pacmo_core.metrics.bootstrap import MIN_UNITS
from pacmo_core.metrics.catalogue import (
    CONTACT_COLUMNS,
    FURTHER_COLUMNS,
    MAIN_COLUMNS,
    MAIN_ROWS,
    MODELS,
    PARTNER_COLUMNS,
    PLAUSIBILITY_COLUMNS,
    SAME_ACTION_ROWS,
    UNTRAINED,
)
from pacmo_core.metrics.context import MIN_UNITS_OF_HALVES
from pacmo_core.models import model_names

Pooled = dict[str, Any]

# What reports/metrics.json and `dvc metrics` show; reports/details.json has everything.
COMPARED_ROWS = (
    *("real", "oracle", "wrong_partner", *UNTRAINED, *model_names("reaction")),
    *("pacmo_without_finish", "regression_without_finish", "gru_without_finish"),
    "flow_matching_without_finish",
)
COMPARED_COLUMNS = (
    *("contacts_met", "false_contacts", "f2id", "matching", "ape", "energy_score", "dispersion"),
)

ROUGH_UNITS = 10  # below which an interval is called rough
NO_ORACLE = "recorded captures have no known distribution of reactions"
COMPARISONS = {
    "any_action": "Real, over all actions",
    "same_action": "Real, within each action",
    "pacmo_any_action": "PaCMO, over all actions",
    "pacmo_same_action": "PaCMO, within each action",
}
REAL_COMPARISONS = {"any_action": "across actions", "same_action": "within one action"}
NOTES = (
    "Real motion is a second sample of real reactions: as many as are tested, drawn by clip from "
    "training. Its F²ID is the noise floor: the distance between two samples of real motion of "
    "this size. A row with reactions to the tested partners shares their sampling error, and may "
    "lie below it; F²ID excess is free of that: F²ID to the real motion of other tested people, "
    "less that of the real pairs tested. No training clip has a part in it.",
    "A contact is a captured frame in which the nearest joints of the two are within 10 cm. It is "
    "met where the generated two are within 15 cm, and false where the captured two are farther "
    "apart than 25 cm. What captured motion scores by construction, 0 or 1, is in its row.",
    "The nearest neighbour copies the training reaction whose partner moved most alike, in either "
    "direction, by the mean squared distance of joints over normalised time. MMD of pairs and the "
    "noise floor compare with training motion, which favours copies of it.",
    "Features depend on the auto-encoder and matching on the matcher, whose hashes are below: "
    "figures are comparable only under the same ones.",
    "Positions are seen from the partner's first pose. MMD is unbiased with the median bandwidth, "
    "so it may fall below zero. APE and AVE are of the root joint, as in the paper's tables; "
    "reports/details.json has them of all joints too.",
    "A metric of reactions alone does not depend on the partner: permuting the real reactions "
    "among partners leaves MMD at zero. F²ID and diversity are of both people's features.",
)
DIFFERENCE_NOTES = (
    "Over the same replicates and seeds. Marked: the first is significantly better, its "
    "interval excludes zero on the better side.",
)


AUGMENTATION_NOTES = (
    "The same settings, seeds, steps, batches and noise; in each epoch a clip is replaced by one "
    "of its variations half of the time. No variation is of a tested clip.",
    "Over people: bootstrap intervals for these trainings. Over folds: Student's interval of the "
    "differences of folds, which have other people and trainings. Marked: significantly better "
    "over folds. One of twenty such intervals excludes zero by chance.",
)


def main_tables(pooled: Pooled) -> dict[str, dict[str, Any]]:
    """Select the rows and columns of the first tables."""
    selected = {
        "pacmo": (MAIN_ROWS, MAIN_COLUMNS),
        "pacmo_partner": (MAIN_ROWS, PARTNER_COLUMNS),
        "pacmo_contact": (MAIN_ROWS, CONTACT_COLUMNS),
        "pacmo_contact_by_action": (MAIN_ROWS, action_columns(pooled)),
        "pacmo_plausibility": (MAIN_ROWS, PLAUSIBILITY_COLUMNS),
        "pacmo_same_action": (SAME_ACTION_ROWS, PARTNER_COLUMNS),
        "pacmo_further": (MAIN_ROWS, FURTHER_COLUMNS),
    }
    tables = {
        name: select_cells(pooled, rows, columns) for name, (rows, columns) in selected.items()
    }
    return {name: rows for name, rows in tables.items() if rows}


def action_columns(pooled: Pooled) -> list[str]:
    """List the metrics of contacts met in one action, as far as an action has contacts."""
    prefix = "contacts_met."
    return sorted({name for row in pooled["rows"].values() for name in row if prefix in name})


def units_note(pooled: Pooled) -> str:
    """Return a note on what the intervals resample, and how many of these are tested."""
    units, numbers = {*pooled["unit"].values()}, [n["test_units"] for n in pooled["n"].values()]
    few = min(numbers) < ROUGH_UNITS
    return (
        f"Intervals resample each {' or '.join(sorted(units))} with all its clips "
        f"({' + '.join(map(str, numbers))} tested), and seeds where there are several; they are "
        "pooled over folds."
        + (
            f" With fewer than {ROUGH_UNITS} they are rough, and mostly too narrow; with fewer "
            f"than {MIN_UNITS} in a fold, or {MIN_UNITS_OF_HALVES} where their halves are compared "
            "(F²ID excess and F²ID of distances), there is no interval and no verdict."
            if few
            else ""
        )
    )


def select_cells(pooled: Pooled, rows: Iterable[str], columns: Iterable[str]) -> dict[str, Any]:
    """Select rows and columns; a missing cell has its reason."""
    result = pooled["rows"]
    present = [column for column in columns if any(column in result.get(row, {}) for row in rows)]
    table = {
        row: {column: cell(pooled, row, column) for column in present}
        for row in rows
        if row in result
    }
    if present and "oracle" in rows and "oracle" not in result:
        table["oracle"] = {column: {"missing": NO_ORACLE} for column in present}
    return table


def cell(pooled: Pooled, row: str, metric: str) -> dict[str, Any]:
    """Return a figure with its interval, or the reason why it is missing."""
    missing = pooled.get("absent", {}).get(row, {}).get(metric, "")
    result: dict[str, Any] = pooled["rows"][row].get(metric, {"missing": missing})
    return result


def reaction_sections(pooled: Pooled, dataset: str) -> Iterator[Section]:
    """Yield the further tables: differences, sensitivity to the partner, the paper's tables."""
    models = {f"pacmo_minus_{row}" for row in (*MODELS, "oracle")}
    differences = {name: cells for name, cells in pooled["differences"].items() if name in models}
    yield Section("Paired differences", difference_table(differences), DIFFERENCE_NOTES)
    augmentation = augmentation_rows(pooled)
    if augmentation:
        notes = (augmentation_verdict(augmentation), *AUGMENTATION_NOTES)
        yield Section(AUGMENTATION_TITLE, augmentation_table(augmentation), notes)
    sensitivity = pooled["sensitivity"]
    yield Section(
        "Sensitivity to the partner: true pairs minus permuted ones",
        sensitivity_table(sensitivity, COMPARISONS),
        sensitivity_notes(sensitivity),
    )
    for paper in PAPER_TABLES:
        title = f"Table {paper.number} of the paper, {paper.name}, beside ours"
        caveats = CAVEATS if paper is PAPER_TABLES[-1] else ()
        yield Section(
            title, side_by_side(paper, pooled["rows"]), (difference_note(paper, dataset), *caveats)
        )


def augmentation_rows(pooled: Pooled) -> dict[str, Any]:
    """Return PaCMO with and without variations and their differences; empty if not trained."""
    result = pooled.get("augmentation", {})
    rows = pooled["rows"]
    if not result:
        return {}
    return {"with": rows["pacmo_augmented"], "without": rows["pacmo"], **result}


def sensitivity_notes(sensitivity: dict[str, Any]) -> tuple[str, ...]:
    """Yield notes on the metrics that do not depend on the partner."""
    notes = [
        "Marked: the metric separates true pairs from permuted ones: its interval excludes zero."
    ]
    for name, where in REAL_COMPARISONS.items():
        if name not in sensitivity:
            notes.append(f"Not measured {where}: no action is tested in two clips.")
            continue
        insensitive, undecided = (
            select(sensitivity[name]) for select in (insensitive_metrics, undecided_metrics)
        )
        if undecided:
            notes.append(
                f"Not decided {where}, as too few units are tested for an interval: "
                f"{'; '.join(undecided)}."
            )
        if insensitive:
            notes.append(
                f"These do not depend on the partner {where}, and the gate does not use them: "
                f"{'; '.join(insensitive)}."
            )
        elif not undecided:
            notes.append(f"All of these depend on the partner {where}.")
    return tuple(notes)


def reaction_figures(pooled: Pooled) -> dict[str, dict[str, float]]:
    """Return the compared figures of each row, rounded to three significant digits."""
    return {
        row: {
            name: float(f"{cells[name]['mean']:.3g}") for name in COMPARED_COLUMNS if name in cells
        }
        for row, cells in pooled["rows"].items()
        if row in COMPARED_ROWS
    }
