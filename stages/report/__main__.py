"""Write the report: an HTML page, the compared figures and the detailed ones as JSON.

Usage: python -m stages.report --sequences DIR --clips DIR --split FILE --ingest JSON
           --split-reports DIR --pooled JSON --variations DIR --augment JSON --priors DIR
           --prior-pooled JSON --curves DIR --reactions DIR --seed S
           --page HTML --metrics JSON --rows DIR --details JSON

Curves and clips are of the first fold and seed, tables of all. METRICS holds the figures that
people compare, ROWS the same in a file for each row of the tables, for ``dvc metrics``; DETAILS
holds all figures with intervals.
"""

import argparse
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pacmo_core.figures.curves import Curve
from pacmo_core.figures.findings import (
    FINISHED_COPY,
    Finding,
    comparison_note,
    count,
    finish_note,
    prior_findings,
    reaction_findings,
    variation_findings,
)
from pacmo_core.figures.numbers import format_estimate, format_number
from pacmo_core.figures.report import DataSummary, QuarantineRow, Report, render_report
from pacmo_core.figures.skeleton_prior import select_source
from pacmo_core.models import MODELS, model_names
from pacmo_core.store.files import file_hash, write_text
from pacmo_core.store.tables import QuarantineRecord, read_rows
from stages.common.files import (
    ALL_SOURCES,
    MOTIONS,
    QUARANTINE,
    read_curve,
    read_json,
    write_json,
)
from stages.common.params import PARAMS, Runs, read_params, run_stage
from stages.report.players import gallery, played, row_label, variation_sections
from stages.report.skeleton_prior import (
    PRIOR_TASKS,
    prior_clips,
    prior_figures,
    prior_sections,
)
from stages.report.tables import (
    NOTES,
    main_tables,
    reaction_figures,
    reaction_sections,
    units_note,
)

PATHS = (
    *("sequences", "clips", "split", "ingest", "split_reports", "pooled", "variations", "augment"),
    *("priors", "prior_pooled", "curves", "reactions"),
    *("page", "metrics", "rows", "details"),
)
# The curves and reactions that the page shows, in this order.
CURVES = (*model_names("features"), *model_names("reaction"))
REACTIONS = ("oracle", "nearest_neighbour", *model_names("reaction"))
# What the page says of the split of each fold, by the names of ``stages.split``.
SPLIT_FACTS = {
    "method": "Split by",
    "tested_people": "People tested",
    "tested_recordings": "Recordings tested",
    "train": "Clips to train on",
    "validation": "Clips to select weights on",
    "test": "Clips to test on",
    "dropped": "Clips left out",
}
FOLDERS = {"skeleton_prior": "prior"}  # short, so that the table of dvc metrics fits a terminal


@dataclass(frozen=True)
class Params:
    """The ``report`` section of ``params.yaml``."""

    played_clips: int  # at most, one of each action before a second of any
    variations_each: int  # variations side by side with their source, at most


def main(paths: argparse.Namespace) -> None:
    params = read_params("report", Params)
    experiment = read_params("experiment", str)
    runs = read_params("runs", Runs)
    # One row without a model is finished, whatever the parameters.
    finished = [*read_params("react.finish", list[str]), FINISHED_COPY]
    limits = read_params("augment.limits", dict[str, float])
    start = read_params("train_pacmo.start.weights", str)
    ingest, pooled, priors = map(read_json, (paths.ingest, paths.pooled, paths.prior_pooled))
    augment = read_json(paths.augment)
    splits = {fold: read_json(paths.split_reports / f"{fold}.json") for fold in runs.folds}
    reactions = first_runs(paths.reactions, REACTIONS, paths.seed)
    page = Report(
        title=experiment,
        summary=summary(ingest, pooled),
        findings=findings((pooled, finished), augment, priors),
        findings_note=comparison_note(pooled["confidence"], pooled),
        facts=provenance(experiment, runs, pooled) | hashes(paths.clips, reactions),
        data=summarise(ingest, splits, paths.sequences, start),
        tables=main_tables(pooled),
        notes=(
            *NOTES,
            units_note(pooled),
            halves_note(pooled["rows"]),
            finish_note(pooled["rows"], finished),
        ),
        sections=(
            *reaction_sections(pooled, ingest["dataset"]),
            *variation_sections(augment),
            *prior_sections(priors),
        ),
        curves={
            MODELS[name].label: curve(file)
            for name, file in curve_files(paths.curves, paths.seed).items()
        },
        clips=tuple(played((paths.clips, paths.split), reactions, params.played_clips)),
        gallery=tuple(gallery(paths.variations, params.variations_each, limits)),
        generated=tuple(prior_clips(paths.priors / "samples", priors)),
    )
    write_text(paths.page, render_report(page))
    compared = {"pacmo": reaction_figures(pooled), "skeleton_prior": prior_figures(priors)}
    write_json(paths.metrics, compared)
    write_rows_of(paths.rows, compared)
    data = {**ingest, "runs": asdict(runs), "folds": splits}
    tables = {name: pooled[name] for name in ("rows", "differences", "augmentation", "sensitivity")}
    details = {"pacmo": tables, "augment": augment, "skeleton_prior": priors}
    write_json(paths.details, {"experiment": experiment, "data": data, **details})


def findings(
    reactions: tuple[dict[str, Any], list[str]], augment: dict[str, Any], priors: dict[str, Any]
) -> tuple[Finding, ...]:
    """Return the sentences with which the page opens: reactions, variations, skeleton priors."""
    scores = {task: priors[task] for task in PRIOR_TASKS}
    return (
        *reaction_findings(*reactions),
        *variation_findings(augment),
        *(
            finding
            for dataset in priors["data_facts"]
            for finding in prior_findings(select_source(scores, dataset, ALL_SOURCES), dataset)
        ),
    )


def summary(ingest: dict[str, Any], pooled: dict[str, Any]) -> str:
    """Return what the page is about; only synthetic captures have an oracle."""
    synthetic = ", synthetic captures," if "oracle" in pooled["rows"] else ""
    return (
        f"Reactions generated from the partner's motion, by models trained on "
        f"{ingest['dataset']}{synthetic} and measured on clips that none of them has seen."
    )


def first_runs(folder: Path, names: Iterable[str], seed: int) -> dict[str, Path]:
    """List the folders ``ROW/SEED`` that exist; rows without a model have the seed 1."""
    trained = model_names("reaction")
    runs = {name: folder / name / str(seed if name in trained else 1) for name in names}
    return {name: path for name, path in runs.items() if path.exists()}


def curve_files(folder: Path, seed: int) -> dict[str, Path]:
    """List the training curves ``MODEL.csv`` and ``MODEL/SEED.csv`` that exist."""
    paths = [(name, folder / f"{name}.csv") for name in CURVES]
    paths += [(name, folder / name / f"{seed}.csv") for name in CURVES]
    return {name: file for name, file in paths if file.exists()}


def write_rows_of(folder: Path, compared: dict[str, dict[str, dict[str, float]]]) -> None:
    """Write a file for each row, so that ``dvc metrics show`` prints a line for each."""
    for table, rows in compared.items():
        for row, figures in rows.items():
            write_json(folder / FOLDERS.get(table, table) / f"{row}.json", figures)


def provenance(experiment: str, runs: Runs, pacmo: dict[str, Any]) -> dict[str, str]:
    """Return the provenance of the page."""
    hashes = {
        kind: ", ".join(digest[:16] for digest in pacmo[f"{kind}_sha256"].values())
        for kind in ("extractor", "matcher")
    }
    same_action = sum(n["same_action_reactions"] for n in pacmo["n"].values())
    candidates = min(n["matching_candidates"] for n in pacmo["n"].values())
    return {
        "Command": f"./run repro {experiment}",
        "Parameters": f"{PARAMS}, including any later edits",
        "Runs": f"{count(len(runs.folds), 'fold')}, {count(len(runs.seeds), 'seed')} of each model",
        "Tested on": f"{pacmo['test_reactions']} reactions, either person of each test clip; "
        f"{same_action} of actions that occur in several clips",
        "Features": f"auto-encoder {hashes['extractor']}, one for each fold",
        "Matching": f"matcher {hashes['matcher']}, one for each fold; {candidates} candidates",
    }


def hashes(clips: Path, reactions: dict[str, Path]) -> dict[str, str]:
    """Return the beginnings of the SHA-256 of clips, reactions and parameters."""
    files = {name: folder / MOTIONS for name, folder in {"clips": clips, **reactions}.items()}
    return {
        f"SHA-256, {row_label(name)}": f"{file_hash(file)[:16]} {file.as_posix()}"
        for name, file in files.items()
    } | {"SHA-256, parameters": file_hash(PARAMS)[:16]}


def captures_text(ingest: dict[str, Any], start: str) -> str:
    """Say whether what the models were trained and tested on is recorded or synthetic.

    Parameters
    ----------
    ingest : the metrics of the stage
    start : the weights that PaCMO continued from, or none
    """
    kinds = {0: "recorded", ingest["usable"]: "synthetic: not evidence for recorded motion"}
    kind = kinds.get(ingest["synthetic"], f"{ingest['synthetic']} synthetic, the others recorded")
    trained = f"PaCMO continued on them from {start}, the other" if start else "all"
    return f"{kind}; {trained} models below were trained on them"


def summarise(
    ingest: dict[str, Any], splits: dict[int, dict[str, Any]], sequences: Path, start: str
) -> DataSummary:
    """Summarise the captures, the quarantine and the splits."""
    quarantined = read_rows(sequences / QUARANTINE, QuarantineRecord)
    split = splits[min(splits)]
    actions = ", ".join(f"{name or 'unnamed'} ({n})" for name, n in ingest["actions"].items())
    return DataSummary(
        files_read=ingest["files_read"],
        clips=split["clips"],
        quarantined=tuple(QuarantineRow(q.file, q.line or None, q.reason) for q in quarantined),
        facts={
            "Dataset": f"{ingest['dataset']} ({ingest['format']})",
            "Captures": captures_text(ingest, start),
            "Sequences": f"{ingest['usable']:,} usable of {ingest['sequences_read']:,} read; "
            f"{ingest['not_included']:,} found and not included",
            "Skeleton": ingest["skeleton"],
            "Duration": f"{format_number(ingest['minutes'])} minutes, {ingest['frames']:,} frames",
            "People": str(split["people"]),
            "Actions": actions,
        },
        split={label: by_fold(splits, name) for name, label in SPLIT_FACTS.items()},
    )


def by_fold(splits: dict[int, dict[str, Any]], name: str) -> str:
    """Return a fact of every fold, once where all folds have the same."""
    values = [f"{v:,}" if isinstance(v := fold[name], int) else str(v) for fold in splits.values()]
    return values[0] if len(set(values)) == 1 else "; ".join(values)


def halves_note(rows: dict[str, Any]) -> str:
    """Return a note on the F²ID between two halves of the tested reactions."""
    halves = rows["real"]["f2id_halves"]
    return (
        "F²ID between two halves of the tested reactions, which have the same distribution, is "
        f"{format_estimate(halves)}: bias of few samples."
    )


def curve(path: Path) -> Curve:
    """Read a training curve."""
    terms = read_curve(path)
    steps = terms.pop("step")
    words = {name.replace("_", " ").capitalize(): values for name, values in terms.items()}
    return Curve(steps=steps, terms=words, x_label="epoch")


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    for name in PATHS:
        parser.add_argument(f"--{name.replace('_', '-')}", type=Path, required=True)
    parser.add_argument("--seed", type=int, required=True, help="of the runs that are shown")
    return parser.parse_args()


if __name__ == "__main__":
    run_stage(main, arguments())
