"""Truth: what was written, and the order of names that one file of all would have."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacmo_core.store.motion_folders import SEPARATOR, clip_of, file_of, in_order, stream_folder
from pacmo_core.store.motions import write_motions
from tests.augmentation.sources import source

NAMES = st.text("ab09_./-#", min_size=1, max_size=6)
FIXED = settings(derandomize=True, deadline=None, max_examples=100)


@FIXED
@given(st.sets(NAMES, max_size=8))
def test_each_clip_has_a_file_of_its_own_that_bears_its_name(clips: set[str]) -> None:
    files = {file_of(Path("folder"), clip) for clip in clips}
    assert len(files) == len(clips)
    assert {file.parent for file in files} <= {Path("folder")}
    assert {clip_of(file) for file in files} == clips


@FIXED
@given(st.sets(NAMES, max_size=8), st.sets(NAMES, min_size=1, max_size=3))
def test_variations_ascend_over_all_clips(clips: set[str], kinds: set[str]) -> None:
    names = [f"{clip}{SEPARATOR}{kind}" for clip in in_order(clips) for kind in sorted(kinds)]
    assert names == sorted(names)


def test_a_folder_streams_what_was_written_and_polars_reads_it(tmp_path: Path) -> None:
    own = source(0)
    clips = ["one", "one#0001", "one1", "s01/02"]
    for clip in clips:
        with write_motions(file_of(tmp_path, clip), own.skeleton) as writer:
            for kind in ("x", "y"):
                writer.add(f"{clip}~{kind}", own)
    found = list(stream_folder(tmp_path))
    assert [name for name, _ in found] == sorted(
        f"{clip}~{kind}" for clip in clips for kind in "xy"
    )
    for _, motion in found:
        np.testing.assert_array_equal(motion.person_a, own.person_a)
    table = pl.scan_parquet(tmp_path / "*.parquet").collect()
    assert set(table["clip"]) == {name for name, _ in found}


def test_no_folder_is_told_by_its_name(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="nowhere: no folder of motions"):
        next(stream_folder(tmp_path / "nowhere"))
