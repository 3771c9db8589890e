"""Cut sequences into clips.

Usage: python -m stages.cut SEQUENCES CLIPS
"""

import sys
from dataclasses import dataclass
from pathlib import Path

from pacmo_core.data.splits import check_clip_seconds, cut_sequence
from pacmo_core.store.motions import read_skeleton, stream_motions, write_motions
from pacmo_core.store.tables import ClipRecord, read_rows, write_rows
from stages.common.files import CLIPS, MOTIONS
from stages.common.params import read_params, run_stage


@dataclass(frozen=True)
class Params:
    """The ``cut`` section of ``params.yaml``."""

    clip_seconds: float  # recordings much longer than this are cut into windows of about this

    def __post_init__(self) -> None:
        check_clip_seconds(self.clip_seconds)


def main(sequences: Path, clips: Path) -> None:
    params = read_params("cut", Params)
    records = {row.sequence: row for row in read_rows(sequences / CLIPS, ClipRecord)}
    rows = []
    with write_motions(clips / MOTIONS, read_skeleton(sequences / MOTIONS)) as writer:
        for name, sequence in stream_motions(sequences / MOTIONS):
            for clip, start, motion in cut_sequence(name, sequence, params.clip_seconds):
                writer.add(clip, motion)
                rows.append(records[name].for_clip(clip, start, motion))
    write_rows(clips / CLIPS, ClipRecord, rows)


if __name__ == "__main__":
    run_stage(main, *map(Path, sys.argv[1:]))
