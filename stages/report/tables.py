"""The tables of the page, out of what ``pool_pacmo`` wrote."""

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
)
from pacmo_core.metrics.catalogue import (
    FURTHER_COLUMNS,
    MAIN_COLUMNS,
    MAIN_ROWS,
    MODELS,
    PARTNER_COLUMNS,
    SAME_ACTION_ROWS,
)
from pacmo_core.models import model_names

Pooled = dict[str, Any]

# What reports/metrics.json and `dvc metrics` show; reports/details.json has everything.
COMPARED_ROWS = ("real", "oracle", "wrong_partner", *model_names("reaction"))
COMPARED_COLUMNS = {
    **{name: name for name in ("f2id", "mmd_s", "diversity", "matching", "ape")},
    "contact_agreement": "contacts",
}

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
    "lie below it; F²ID excess is free of that: F²ID to further real motion, less that of the real "
    "pairs tested.",
    "Features depend on the auto-encoder and matching on the matcher, whose hashes are below: "
    "figures are comparable only under the same ones.",
    "Positions are seen from the partner's first pose. MMD is unbiased with the median bandwidth, "
    "so it may fall below zero. APE and AVE are of the root joint, as in the paper's tables; "
    "reports/details.json has them of all joints too.",
    "A metric of reactions alone does not depend on the partner: permuting the real reactions "
    "among partners leaves MMD at zero. F²ID and diversity are of both people's features.",
    "Intervals resample clips, and seeds where there are several, and are pooled over folds.",
)
DIFFERENCE_NOTES = (
    "Over the same resampled clips and seeds. Marked: the first is significantly better, its "
    "interval excludes zero on the better side.",
)


AUGMENTATION_NOTES = (
    "The same settings, seeds, steps and draws of rows and noise; in each epoch a clip is shown as "
    "it was captured or, as often, as one of its variations. No variation comes of a tested clip.",
    "Over clips: the bootstrap, with these trainings. Over folds: Student's interval of the folds' "
    "differences, in which people and trainings are others. Marked: with variations it is better "
    "for certain over folds. Of twenty such intervals one is clear of zero by luck.",
)


def main_tables(pooled: Pooled) -> dict[str, dict[str, Any]]:
    """Choose the rows and columns of the page's first tables."""
    selected = {
        "pacmo": (MAIN_ROWS, MAIN_COLUMNS),
        "pacmo_partner": (MAIN_ROWS, PARTNER_COLUMNS),
        "pacmo_same_action": (SAME_ACTION_ROWS, PARTNER_COLUMNS),
        "pacmo_further": (MAIN_ROWS, FURTHER_COLUMNS),
    }
    tables = {
        name: select_cells(pooled, rows, columns) for name, (rows, columns) in selected.items()
    }
    return {name: rows for name, rows in tables.items() if rows}


def select_cells(pooled: Pooled, rows: Iterable[str], columns: Iterable[str]) -> dict[str, Any]:
    """Choose rows and columns, with the reason of what is missing."""
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
    """Give a figure with its interval, or the reason why there is none."""
    missing = pooled.get("absent", {}).get(row, {}).get(metric, "")
    result: dict[str, Any] = pooled["rows"][row].get(metric, {"missing": missing})
    return result


def reaction_sections(pooled: Pooled, dataset: str) -> Iterator[Section]:
    """Give the further tables: differences, what sees the partner, the paper's."""
    models = {f"pacmo_minus_{row}" for row in (*MODELS, "oracle")}
    differences = {name: cells for name, cells in pooled["differences"].items() if name in models}
    yield Section("Paired differences", difference_table(differences), DIFFERENCE_NOTES)
    augmentation = augmentation_rows(pooled)
    if augmentation:
        notes = (augmentation_verdict(augmentation), *AUGMENTATION_NOTES)
        yield Section(AUGMENTATION_TITLE, augmentation_table(augmentation), notes)
    sensitivity = pooled["sensitivity"]
    yield Section(
        "Which metrics see the partner: true pairs less shuffled ones",
        sensitivity_table(sensitivity, COMPARISONS),
        sensitivity_notes(sensitivity),
    )
    for paper in PAPER_TABLES:
        title = f"Table {paper.number} of the paper, {paper.name}, and ours beside it"
        caveats = CAVEATS if paper is PAPER_TABLES[-1] else ()
        yield Section(
            title, side_by_side(paper, pooled["rows"]), (difference_note(paper, dataset), *caveats)
        )


def augmentation_rows(pooled: Pooled) -> dict[str, Any]:
    """Set the two rows beside their differences, where PaCMO was trained on variations too."""
    result = pooled.get("augmentation", {})
    rows = pooled["rows"]
    if not result:
        return {}
    return {"with": rows["pacmo_augmented"], "without": rows["pacmo"], **result}


def sensitivity_notes(sensitivity: dict[str, Any]) -> tuple[str, ...]:
    """Name the metrics that real pairs and wrong ones look alike to."""
    notes = ["Marked: the metric tells true pairs from wrong ones, its interval clear of zero."]
    for name, where in REAL_COMPARISONS.items():
        unseeing = insensitive_metrics(sensitivity[name]) if name in sensitivity else None
        if unseeing is None:
            notes.append(f"Nothing is known {where}: no act is tested in two clips.")
        elif unseeing:
            notes.append(
                f"These do not see the partner {where}, and gate nothing: {'; '.join(unseeing)}."
            )
        else:
            notes.append(f"All of these see the partner {where}.")
    return tuple(notes)


def reaction_figures(pooled: Pooled) -> dict[str, dict[str, float]]:
    """List the figures that people compare of each row, rounded to what intervals support."""
    return {
        row: {
            name: float(f"{cells[column]['mean']:.3g}")
            for column, name in COMPARED_COLUMNS.items()
            if column in cells
        }
        for row, cells in pooled["rows"].items()
        if row in COMPARED_ROWS
    }
