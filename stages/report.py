"""Put everything on one page, and its data beside it.

Usage: python -m stages.report --sequences DIR --clips DIR --sides FILE --ingest JSON --splits DIR
           --pacmo JSON --variations DIR --augment JSON --priors DIR --prior-scores JSON
           --curve CSV ... --reactions ROW=DIR ... --page HTML --metrics JSON

Curves and clips are of the first fold and seed, tables of all.
"""

import argparse
import hashlib
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pacmo_core.figures.curves import Curve
from pacmo_core.figures.report import DataSummary, QuarantineRow, Report, render_report
from pacmo_core.store.files import write_text
from pacmo_core.store.tables import QuarantineRecord, read_rows
from stages._files import MOTIONS, QUARANTINE, read_curve, read_json, write_json
from stages._gallery import gallery, variation_sections
from stages._params import PARAMS, read_params
from stages._played import played
from stages._prior_tables import prior_clips, prior_sections
from stages._priors import Runs
from stages._tables import NOTES, main_tables, sections

SUMMARY = "Reactions generated from the partner's motion, measured on clips that no model has seen."

PATHS = (
    *("sequences", "clips", "sides", "ingest", "splits", "pacmo"),
    *("variations", "augment", "priors", "prior_scores", "page", "metrics"),
)


@dataclass(frozen=True)
class Params:
    """The ``report`` section of ``params.yaml``."""

    played_clips: int  # at most, one an action before a second of any
    varied_clips: int  # at most of either family, those with the worst variation first
    variations_each: int  # at most, the worst first


def main(paths: argparse.Namespace) -> None:
    params = read_params("report", Params)
    experiment = read_params("experiment", str)
    runs = read_params("runs", Runs)
    ingest, pacmo, priors = map(read_json, (paths.ingest, paths.pacmo, paths.prior_scores))
    splits = {fold: read_json(paths.splits / f"{fold}.json") for fold in runs.folds}
    reactions = dict(word.split("=") for word in paths.reactions)
    page = Report(
        title=experiment,
        summary=SUMMARY,
        facts=made_by(experiment, runs, pacmo) | hashes(paths.clips, reactions),
        data=summarise(ingest, splits, paths.sequences),
        tables=main_tables(pacmo),
        notes=(*NOTES, halves_note(pacmo["rows"])),
        sections=(
            *sections(pacmo, ingest["dataset"]),
            *variation_sections(read_json(paths.augment)),
            *prior_sections(priors),
        ),
        curves={model_of(path): curve(path) for path in paths.curve},
        clips=tuple(played((paths.clips, paths.sides), reactions, params.played_clips)),
        gallery=(
            *gallery(paths.variations, params.varied_clips, params.variations_each),
            *prior_clips(paths.priors, priors),
        ),
    )
    write_text(paths.page, render_report(page))
    data = {**ingest, "runs": asdict(runs), "folds": splits}
    tables = {"pacmo": pacmo["rows"], "pacmo_differences": pacmo["differences"]}
    tables["pacmo_augmentation"] = pacmo["augmentation"]
    more = {
        "pacmo_sensitivity": pacmo["sensitivity"],
        "augment": read_json(paths.augment),
        "skeleton_prior": priors,
    }
    write_json(paths.metrics, {"experiment": experiment, "data": data, **tables, **more})


def made_by(experiment: str, runs: Runs, pacmo: dict[str, Any]) -> dict[str, str]:
    """Say what made the page."""
    hashes = {
        kind: ", ".join(digest[:16] for digest in pacmo[f"{kind}_sha256"].values())
        for kind in ("extractor", "matcher")
    }
    same_act = sum(n["same_act_reactions"] for n in pacmo["n"].values())
    candidates = min(n["matching_candidates"] for n in pacmo["n"].values())
    return {
        "Made by": f"dvc repro, after pacmo use {experiment}",
        "Parameters": f"{PARAMS}, with whatever was edited there since",
        "Runs": f"{counted(runs.folds, 'fold')}, {counted(runs.seeds, 'seed')} of each model",
        "Tested on": f"{pacmo['test_reactions']} reactions, either person of each test clip; "
        f"{same_act} of acts that others perform too",
        "Features": f"auto-encoder {hashes['extractor']}, a fold each",
        "Matching": f"matcher {hashes['matcher']}, a fold each; among {candidates} partners",
    }


def hashes(clips: Path, reactions: dict[str, str]) -> dict[str, str]:
    """Say which bytes the tables and the clips are of: the beginnings of SHA-256."""
    files = {"clips": clips, **{row: Path(folder) for row, folder in reactions.items()}}
    return {
        f"SHA-256, {name}": f"{_sha256(folder / MOTIONS)[:16]} {(folder / MOTIONS).as_posix()}"
        for name, folder in files.items()
    } | {"SHA-256, parameters": _sha256(PARAMS)[:16]}


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def counted(things: list[int], name: str) -> str:
    """Say how many there are."""
    return f"{len(things)} {name}" + ("s" if len(things) > 1 else "")


def summarise(
    ingest: dict[str, Any], splits: dict[int, dict[str, Any]], sequences: Path
) -> DataSummary:
    """Say what was read, what was put aside and why, and how clips were put on sides."""
    aside = read_rows(sequences / QUARANTINE, QuarantineRecord)
    split = splits[min(splits)]
    actions = ", ".join(f"{name or 'unnamed'} ({n})" for name, n in ingest["actions"].items())
    return DataSummary(
        files_read=ingest["files_read"],
        clips=split["clips"],
        quarantined=tuple(QuarantineRow(q.file, q.line or None, q.reason) for q in aside),
        facts={
            "Data set": f"{ingest['dataset']} ({ingest['format']})",
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
    """Say how far two halves of the tested reactions are apart."""
    halves = rows["real"]["f2id_halves"]
    return (
        f"Two halves of the tested reactions, of one law but half the size, are at F²ID "
        f"{halves['mean']:.3g} ({halves['low']:.3g} to {halves['high']:.3g}): bias of few samples."
    )


def model_of(path: Path) -> str:
    """Name the model of a curve ``FOLD/MODEL.csv`` or ``FOLD/MODEL/SEED.csv``."""
    return path.parent.name if path.stem.isdigit() else path.stem


def curve(path: Path) -> Curve:
    """Read a training curve."""
    terms = read_curve(path)
    return Curve(steps=terms.pop("step"), terms=terms, x_label="round")


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    for name in PATHS:
        parser.add_argument(f"--{name.replace('_', '-')}", type=Path, required=True)
    parser.add_argument("--curve", type=Path, action="append", required=True)
    parser.add_argument("--reactions", action="append", required=True)
    return parser.parse_args()


if __name__ == "__main__":
    main(arguments())
