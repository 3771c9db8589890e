"""Truth: what was written, and the order of names that one file of all would have."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacmo_core.store.motions import (
    MotionReader,
    clip_of_file,
    motion_file,
    read_motion,
    stream_folder,
    write_motions,
)
from tests.augmentation.sources import source

NAMES = st.text("ab09_./-#", min_size=1, max_size=6)
FIXED = settings(derandomize=True, deadline=None, max_examples=100)


@FIXED
@given(st.sets(NAMES, max_size=8))
def test_each_clip_has_a_file_of_its_own_that_bears_its_name(clips: set[str]) -> None:
    files = {motion_file(Path("folder"), clip) for clip in clips}
    assert len(files) == len(clips)
    assert {file.parent for file in files} <= {Path("folder")}
    assert {clip_of_file(file) for file in files} == clips


def test_a_folder_streams_what_was_written_and_polars_reads_it(tmp_path: Path) -> None:
    own = source(0)
    clips = ["one", "one#0001", "one1", "s01/02"]
    for clip in clips:
        with write_motions(motion_file(tmp_path, clip), own.skeleton) as writer:
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


CLIP_NAMES = [f"clip{number:02d}" for number in range(20)]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    clips = [source(number, n_frames=5 + number) for number in range(len(CLIP_NAMES))]
    with write_motions(tmp_path / "motions.parquet", clips[0].skeleton) as writer:
        for name, clip in zip(CLIP_NAMES, clips, strict=True):
            writer.add(name, replace(clip, skeleton=clips[0].skeleton))
    return tmp_path / "motions.parquet"


@pytest.mark.parametrize(
    "order", [CLIP_NAMES, CLIP_NAMES[::-1], [*CLIP_NAMES[::7], *CLIP_NAMES[::3]]]
)
def test_whatever_the_order_a_clip_is_what_one_reading_gives(file: Path, order: list[str]) -> None:
    groups = MotionReader(file)
    for name in order:
        found, wanted = groups.read(name), read_motion(file, name)
        assert found.skeleton == wanted.skeleton
        for field in ("times", "person_a", "person_b"):
            np.testing.assert_array_equal(getattr(found, field), getattr(wanted, field))


def test_a_row_group_is_read_once_for_all_its_clips(file: Path) -> None:
    groups = MotionReader(file)
    for name in CLIP_NAMES:
        groups.read(name)
    assert groups._group.cache_info().misses == 3


@pytest.mark.parametrize("name", ["clip", "clip07a", "clip99"])
def test_a_clip_that_is_not_there_is_named(file: Path, name: str) -> None:
    with pytest.raises(KeyError, match=f"no clip {name}"):
        MotionReader(file).read(name)
