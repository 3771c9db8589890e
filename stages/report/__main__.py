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
import hashlib
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pacmo_core.figures.curves import Curve
from pacmo_core.figures.report import DataSummary, QuarantineRow, Report, render_report
from pacmo_core.models import model_names
from pacmo_core.store.files import write_text
from pacmo_core.store.tables import QuarantineRecord, read_rows
from stages.common.files import MOTIONS, QUARANTINE, read_curve, read_json, write_json
from stages.common.params import PARAMS, Runs, read_params, run_stage
from stages.report.players import gallery, played, variation_sections
from stages.report.skeleton_prior import prior_clips, prior_figures, prior_sections
from stages.report.tables import (
    NOTES,
    main_tables,
    reaction_figures,
    reaction_sections,
    units_note,
)

SUMMARY = "Reactions generated from the partner's motion, measured on clips that no model has seen."

PATHS = (
    *("sequences", "clips", "split", "ingest", "split_reports", "pooled", "variations", "augment"),
    *("priors", "prior_pooled", "curves", "reactions"),
    *("page", "metrics", "rows", "details"),
)
# The curves and reactions that the page shows, in this order.
CURVES = (*model_names("features"), *model_names("reaction"))
REACTIONS = ("oracle", "nearest_neighbour", *model_names("reaction"))
FOLDERS = {"skeleton_prior": "prior"}  # short, so that the table of dvc metrics fits a terminal


@dataclass(frozen=True)
class Params:
    """The ``report`` section of ``params.yaml``."""

    played_clips: int  # at most, one of each action before a second of any
    varied_clips: int  # at most of each dataset, those with the worst variation first
    variations_each: int  # at most, the worst first


def main(paths: argparse.Namespace) -> None:
    params = read_params("report", Params)
    experiment = read_params("experiment", str)
    runs = read_params("runs", Runs)
    ingest, pooled, priors = map(read_json, (paths.ingest, paths.pooled, paths.prior_pooled))
    augment = read_json(paths.augment)
    splits = {fold: read_json(paths.split_reports / f"{fold}.json") for fold in runs.folds}
    reactions = first_runs(paths.reactions, REACTIONS, paths.seed)
    page = Report(
        title=experiment,
        summary=SUMMARY,
        facts=provenance(experiment, runs, pooled) | hashes(paths.clips, reactions),
        data=summarise(ingest, splits, paths.sequences),
        tables=main_tables(pooled),
        notes=(*NOTES, units_note(pooled), halves_note(pooled["rows"])),
        sections=(
            *reaction_sections(pooled, ingest["dataset"]),
            *variation_sections(augment),
            *prior_sections(priors),
        ),
        curves={name: curve(file) for name, file in curve_files(paths.curves, paths.seed).items()},
        clips=tuple(played((paths.clips, paths.split), reactions, params.played_clips)),
        gallery=(
            *gallery(paths.variations, params.varied_clips, params.variations_each),
            *prior_clips(paths.priors / "samples", priors),
        ),
    )
    write_text(paths.page, render_report(page))
    compared = {"pacmo": reaction_figures(pooled), "skeleton_prior": prior_figures(priors)}
    write_json(paths.metrics, compared)
    write_rows_of(paths.rows, compared)
    data = {**ingest, "runs": asdict(runs), "folds": splits}
    tables = {name: pooled[name] for name in ("rows", "differences", "augmentation", "sensitivity")}
    details = {"pacmo": tables, "augment": augment, "skeleton_prior": priors}
    write_json(paths.details, {"experiment": experiment, "data": data, **details})


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
        "Runs": f"{count(runs.folds, 'fold')}, {count(runs.seeds, 'seed')} of each model",
        "Tested on": f"{pacmo['test_reactions']} reactions, either person of each test clip; "
        f"{same_action} of actions that occur in several clips",
        "Features": f"auto-encoder {hashes['extractor']}, one for each fold",
        "Matching": f"matcher {hashes['matcher']}, one for each fold; {candidates} candidates",
    }


def hashes(clips: Path, reactions: dict[str, Path]) -> dict[str, str]:
    """Return the beginnings of the SHA-256 of clips, reactions and parameters."""
    files = {"clips": clips, **reactions}
    return {
        f"SHA-256, {name}": f"{_sha256(folder / MOTIONS)[:16]} {(folder / MOTIONS).as_posix()}"
        for name, folder in files.items()
    } | {"SHA-256, parameters": _sha256(PARAMS)[:16]}


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def count(things: list[int], name: str) -> str:
    """Return a number with its noun."""
    return f"{len(things)} {name}" + ("s" if len(things) > 1 else "")


def summarise(
    ingest: dict[str, Any], splits: dict[int, dict[str, Any]], sequences: Path
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
            "Sequences": f"{ingest['usable']} usable of {ingest['sequences_read']} read; "
            f"{ingest['not_included']} found and not included",
            "Skeleton": ingest["skeleton"],
            "Duration": f"{ingest['minutes']:.1f} minutes, {ingest['frames']} frames",
            "People": str(split["people"]),
            "Actions": actions,
        },
        split={
            name: ", ".join(dict.fromkeys(str(fold[name]) for fold in splits.values()))
            if name == "method"
            else ", ".join(str(fold[name]) for fold in splits.values())
            for name in split
            if name not in ("clips", "people")
        },
    )


def halves_note(rows: dict[str, Any]) -> str:
    """Return a note on the F²ID between two halves of the tested reactions."""
    halves = rows["real"]["f2id_halves"]
    return (
        f"F²ID between two halves of the tested reactions, which have the same distribution, is "
        f"{halves['mean']:.3g} ({halves['low']:.3g} to {halves['high']:.3g}): bias of few samples."
    )


def curve(path: Path) -> Curve:
    """Read a training curve."""
    terms = read_curve(path)
    return Curve(steps=terms.pop("step"), terms=terms, x_label="epoch")


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    for name in PATHS:
        parser.add_argument(f"--{name.replace('_', '-')}", type=Path, required=True)
    parser.add_argument("--seed", type=int, required=True, help="of the runs that are shown")
    return parser.parse_args()


if __name__ == "__main__":
    run_stage(main, arguments())
