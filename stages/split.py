"""Assign every clip to a split, for one fold.

Usage: python -m stages.split --fold=K CLIPS SPLITS.parquet METRICS.json
"""

import argparse
import sys
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from pacmo_core.data.splits import ClipOrigin, Split, SplitRule, assign_splits, resolve_method
from pacmo_core.data.variation_splits import SPLITS
from pacmo_core.store.tables import ClipRecord, SplitRecord, read_rows, write_rows
from stages.common.clips import clip_origin
from stages.common.files import CLIPS, write_json
from stages.common.params import ParamsError, read_params, run_stage


@dataclass(frozen=True)
class Params(SplitRule):
    """The ``split`` section of ``params.yaml``."""


def main(clips: Path, splits: Path, metrics: Path, *, fold: int) -> None:
    rule = read_params("split", Params)
    rows = read_rows(clips / CLIPS, ClipRecord)
    origins = [clip_origin(row) for row in rows]
    try:
        split_of_clip = assign_splits(origins, rule, fold)
    except ValueError as fault:  # of the rule, which the user wrote
        raise ParamsError("split", str(fault)) from fault
    write_rows(
        splits, SplitRecord, [SplitRecord(row.clip, split_of_clip[row.clip]) for row in rows]
    )
    counts = summary(origins, split_of_clip, rule)
    sys.stdout.write(f"fold {fold}: {in_words(counts)}\n")
    write_json(metrics, counts)


def summary(
    origins: list[ClipOrigin], splits: dict[str, Split], rule: SplitRule
) -> dict[str, object]:
    """Count clips, people and recordings by split."""
    counts: Counter[str] = Counter(splits.values())
    tested = [origin for origin in origins if splits[origin.clip] == "test"]
    return {
        "clips": len(origins),
        "method": resolve_method(origins, rule),
        "people": len({person for origin in origins for person in origin.people}),
        "tested_people": len({person for origin in tested for person in origin.people}),
        "tested_recordings": len({origin.recording for origin in tested}),
        **{split: counts[split] for split in SPLITS},
    }


def in_words(counts: Mapping[str, object]) -> str:
    """Say in one line what the summary of a fold counts."""
    sizes = ", ".join(f"{counts[split]} {split}" for split in SPLITS if counts[split] != 0)
    people = f" and {counts['people']} people" if counts["people"] else ""
    tested = f" ({counts['tested_people']} people)" if counts["tested_people"] else ""
    return (
        f"{counts['clips']} clips{people}, split by {counts['method']}: {sizes}; "
        f"tested are {counts['tested_recordings']} recordings{tested}"
    )


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    for name in ("clips", "splits", "metrics"):
        parser.add_argument(name, type=Path)
    parser.add_argument("--fold", type=int, required=True)
    return parser.parse_args()


if __name__ == "__main__":
    run_stage(main, **vars(arguments()))
