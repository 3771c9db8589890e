"""Read raw captures into Parquet; quarantine unusable ones with the reason.

Usage: python -m stages.ingest [--cache=DIR] RAW SEQUENCES METRICS.json

DIR caches readings across runs (DVC does not manage it): only new captures are read, and the
result has the same bytes as without it. DASK_SCHEDULER_ADDRESS names a cluster that reads them;
its workers must have RAW under the same path.
"""

import argparse
import json
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

from pacmo_core.data.names import matches_any
from pacmo_core.data.quality import QualityLimits
from pacmo_core.formats.base import RawSequence, check_fps
from pacmo_core.formats.inference import OTHER_AXIS
from pacmo_core.formats.joint_names import parse_joints
from pacmo_core.formats.rigs import RIGS
from pacmo_core.ingestion import (
    PUBLISHED,
    Capture,
    IngestionSettings,
    ReadingCache,
    read_sequences,
)
from pacmo_core.store.motions import write_motions
from pacmo_core.store.tables import ClipRecord, QuarantineRecord, write_rows
from stages.common.captures import find_captures, open_captures
from stages.common.files import CLIPS, MOTIONS, QUARANTINE, SCRIPTS, scheduler_address, write_json
from stages.common.params import StageError, read_params, run_stage

MAX_NAMES = 4  # of files in a message
ALL_REASONS = "pacmo quarantine {} lists the reason of each"


@dataclass(frozen=True)
class Params:
    """The ``ingest`` section of ``params.yaml``."""

    dataset: str
    raw: str  # the folder, which is also on the command line
    format: str
    settings: dict[str, Any]  # facts that files of this format lack
    include: tuple[str, ...]  # patterns of file paths under raw
    drop_joints: tuple[str, ...]
    skeleton: str  # a published one, in whose joints motions are stored; empty: the captures' own
    joint_names: tuple[str, ...]  # a preset of names, or words JOINT=JOINT
    limits: QualityLimits
    contact_distance: float  # metres between joints that touch
    stated_fps: float | None  # that the dataset states, for formats whose files have times

    def __post_init__(self) -> None:
        if self.stated_fps is not None:
            check_fps(self.stated_fps, "stated_fps")
        if self.skeleton not in ("", *PUBLISHED):
            raise ValueError(
                f"skeleton: wanted one of {', '.join(PUBLISHED)}, or '' for the captures' own; "
                f"got {self.skeleton!r}"
            )
        if self.joint_names and not self.skeleton:
            raise ValueError("joint_names: wanted a skeleton, whose joints they are; got none")
        wrong = [word for word in self.joint_names if "=" not in word and word not in RIGS]
        if wrong:  # nor a file, which DVC would not know
            raise ValueError(
                f"joint_names: wanted {', '.join(RIGS)}, or words JOINT=JOINT; got {wrong[0]!r}"
            )


def main(raw: Path, sequences: Path, metrics: Path, *, cache: Path | None = None) -> None:
    params = read_params("ingest", Params)
    found = find_captures(open_captures("ingest", params.format, params.settings), raw)
    included = [sequence for sequence in found if is_included(sequence, raw, params.include)]
    if not included:
        raise StageError(
            f"{raw}: found {len(found)} captures of format {params.format}, "
            f"none of them under {', '.join(params.include)}"
        )

    settings = ingestion_settings(params, raw)
    quarantined: list[QuarantineRecord] = []
    reading_cache = ReadingCache(cache, settings_key(params)) if cache else None
    readings = read_sequences(settings, included, reading_cache, scheduler_address())
    captures = split_usable(readings, quarantined)
    first = next(captures, None)
    if first is None:
        write_rows(sequences / QUARANTINE, QuarantineRecord, quarantined)
        raise StageError(f"{raw}: {none_usable(quarantined)}; {ALL_REASONS.format(sequences)}")
    rows = []
    with write_motions(sequences / MOTIONS, first[1].skeleton) as writer:
        for facts, interaction in chain([first], captures):
            writer.add(facts.clip, interaction)
            rows.append(facts)
    on_their_sides = [row for row in quarantined if OTHER_AXIS in row.reason]
    if len(on_their_sides) > len(rows):  # people who lie down would pass, and lie in the air
        raise StageError(
            f"{raw}: {len(on_their_sides)} of {len(included)} captures are on their sides: "
            f"{on_their_sides[0].file}: {on_their_sides[0].reason}"
        )
    write_rows(sequences / CLIPS, ClipRecord, rows)
    write_rows(sequences / QUARANTINE, QuarantineRecord, quarantined)
    counts = {
        "sequences_read": len(included),
        "files_read": sum(len(sequence.files) for sequence in included),
        "not_included": len(found) - len(included),
        "usable": len(rows),
        "quarantined": len(quarantined),
    }
    write_json(
        metrics, {"dataset": params.dataset, "format": params.format, **counts, **summarise(rows)}
    )


def ingestion_settings(params: Params, raw: Path) -> IngestionSettings:
    """Return the settings with which the captures in a folder are read."""
    return IngestionSettings(
        dataset=params.dataset,
        root=raw,
        format=open_captures("ingest", params.format, params.settings),
        drop_joints=params.drop_joints,
        limits=params.limits,
        contact_distance=params.contact_distance,
        stated_fps=params.stated_fps,
        synthetic=(raw / SCRIPTS).exists(),
        skeleton=PUBLISHED[params.skeleton] if params.skeleton else None,
        joint_names=replace(parse_joints(params.joint_names), how="joint_names: [{}]"),
    )


def is_included(sequence: RawSequence, root: Path, patterns: tuple[str, ...]) -> bool:
    """Return whether a pattern matches the path of the sequence's first file under the root."""
    path = sequence.files[0].relative_to(root).as_posix()
    return matches_any(path, patterns)


def split_usable(
    outcomes: Iterator[Capture | QuarantineRecord], quarantined: list[QuarantineRecord]
) -> Iterator[Capture]:
    """Yield the usable captures; append the others to ``quarantined``."""
    for outcome in outcomes:
        if isinstance(outcome, QuarantineRecord):
            quarantined.append(outcome)
        else:
            yield outcome


def none_usable(quarantined: list[QuarantineRecord]) -> str:
    """Say why no capture is usable: the most common reason, which one file's own may hide.

    Reasons that differ in numbers and in names of files alone count as one; the first is shown.
    """
    by_kind: dict[str, list[QuarantineRecord]] = {}
    for row in quarantined:
        by_kind.setdefault(_kind_of_reason(row.reason), []).append(row)
    common = max(by_kind.values(), key=len)
    names = ", ".join(row.file for row in common[:MAX_NAMES])
    more = " ..." if len(common) > MAX_NAMES else ""
    text = f"no capture of {len(quarantined)} is usable; {len(common)}: {common[0].reason}"
    return f"{text}; there are {names}{more}"


def _kind_of_reason(reason: str) -> str:
    """Return a reason without numbers and names of files."""
    words = (word for word in reason.split() if not re.search(r"\d|\.[A-Za-z]", word))
    return " ".join(words)


def summarise(rows: list[ClipRecord]) -> dict[str, object]:
    """Summarise the usable sequences."""
    return {
        "frames": sum(row.frames for row in rows),
        "minutes": round(sum(row.duration for row in rows) / 60, 3),
        "skeleton": rows[0].skeleton,
        "synthetic": sum(row.synthetic for row in rows),
        "actions": dict(sorted(Counter(row.action for row in rows).items())),
    }


def settings_key(params: Params) -> str:
    """Return a cache key of all that a reading depends on besides its files."""
    lists = [Path(name).read_text("utf-8") for name in params.settings.get("skip_lists", ())]
    return json.dumps([asdict(params), lists], sort_keys=True)


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--cache", type=Path, help="folder of the cache")
    for name in ("raw", "sequences", "metrics"):
        parser.add_argument(name, type=Path)
    return parser.parse_args()


if __name__ == "__main__":
    run_stage(main, **vars(arguments()))
