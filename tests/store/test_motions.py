"""What is trusted: the arrays that went in; polars' own reading of the file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacmo_core.data.interaction import Interaction
from pacmo_core.store import motions
from pacmo_core.store.files import StoreError
from pacmo_core.store.motions import (
    MotionReader,
    clip_of_file,
    motion_file,
    read_motion,
    read_skeleton,
    stream_folder,
    stream_motions,
    write_motions,
)
from tests.augmentation.sources import source
from tests.strategies import SMALL, interactions, make_interaction, make_set


def write(path, clips):
    with write_motions(path, SMALL) as writer:
        for name, clip in clips.items():
            writer.add(name, clip)


def equal(one: Interaction, other: Interaction) -> bool:
    return one.skeleton == other.skeleton and all(
        np.array_equal(getattr(one, name), getattr(other, name))
        for name in ("times", "person_a", "person_b")
    )


@settings(derandomize=True, deadline=None, max_examples=25)
@given(clip=interactions())
def test_what_is_written_is_read_bit_for_bit(tmp_path_factory, clip):
    path = tmp_path_factory.mktemp("store") / "motions.parquet"
    write(path, {"only": clip})
    assert equal(read_motion(path, "only"), clip)


def test_streaming_gives_every_clip_in_order(tmp_path):
    clips = make_set(np.random.default_rng(1), 21)
    write(tmp_path / "m.parquet", clips)
    streamed = dict(stream_motions(tmp_path / "m.parquet"))
    assert list(streamed) == list(clips)
    assert all(equal(streamed[name], clips[name]) for name in clips)
    assert read_skeleton(tmp_path / "m.parquet") == SMALL


def test_polars_shows_a_row_a_frame_with_poses_as_arrays(tmp_path):
    clips = make_set(np.random.default_rng(2), 3)
    write(tmp_path / "m.parquet", clips)
    frame = pl.read_parquet(tmp_path / "m.parquet")
    assert frame.columns == ["clip", "frame", "time", "person_a", "person_b"]
    assert frame.schema["person_a"] == pl.Array(pl.Float32, (4, 3))
    assert frame.schema["clip"] == pl.String
    one = frame.filter(pl.col("clip") == "clip0001")
    np.testing.assert_array_equal(one["person_b"].to_numpy(), clips["clip0001"].person_b)


def test_one_clip_is_read_from_its_row_group_alone(tmp_path, monkeypatch):
    write(tmp_path / "m.parquet", make_set(np.random.default_rng(3), 40))
    read = []
    real = motions.pq.ParquetFile.read_row_group
    monkeypatch.setattr(
        motions.pq.ParquetFile,
        "read_row_group",
        lambda self, group: read.append(group) or real(self, group),
    )
    read_motion(tmp_path / "m.parquet", "clip0019")
    assert read == [2]


def test_writing_twice_gives_the_same_bytes(tmp_path):
    clips = make_set(np.random.default_rng(4), 10)
    write(tmp_path / "one.parquet", clips)
    write(tmp_path / "two.parquet", clips)
    assert (tmp_path / "one.parquet").read_bytes() == (tmp_path / "two.parquet").read_bytes()


def test_a_run_that_breaks_off_leaves_the_old_file(tmp_path):
    path = tmp_path / "m.parquet"
    write(path, make_set(np.random.default_rng(5), 3))
    before = path.read_bytes()
    with pytest.raises(RuntimeError, match="killed"), write_motions(path, SMALL) as writer:
        writer.add("a", make_interaction(np.random.default_rng(6)))
        raise RuntimeError("killed")
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["m.parquet"]


def test_clips_must_ascend_and_share_the_skeleton(tmp_path):
    clip = make_interaction(np.random.default_rng(7))
    with pytest.raises(ValueError, match="ascending order; got a after b"):
        write(tmp_path / "m.parquet", {"b": clip, "a": clip})
    other = clip.without(["head"])
    with pytest.raises(ValueError, match=r"wanted skeleton small \(4 joints\), got small-3"):
        write(tmp_path / "m.parquet", {"a": clip, "b": other})


def test_an_unknown_clip_is_named(tmp_path):
    write(tmp_path / "m.parquet", make_set(np.random.default_rng(8), 2))
    with pytest.raises(KeyError, match="no clip clip9"):
        read_motion(tmp_path / "m.parquet", "clip9")


@pytest.mark.parametrize("content", [b"", b"PAR1", b"not parquet at all" * 100])
def test_a_file_that_is_not_parquet_is_refused_by_name(tmp_path, content):
    path = tmp_path / "broken.parquet"
    path.write_bytes(content)
    with pytest.raises(StoreError, match="broken.parquet"):
        next(stream_motions(path))


def test_a_file_cut_short_is_refused(tmp_path):
    path = tmp_path / "m.parquet"
    write(path, make_set(np.random.default_rng(9), 5))
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(StoreError, match="not a complete Parquet file"):
        next(stream_motions(path))


def test_another_version_of_the_schema_is_refused(tmp_path):
    pl.DataFrame({"clip": ["a"], "frame": [0]}).write_parquet(tmp_path / "foreign.parquet")
    with pytest.raises(StoreError, match="wanted schema version 1, got none"):
        next(stream_motions(tmp_path / "foreign.parquet"))


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


def test_a_folder_is_not_recognised_by_its_name(tmp_path: Path) -> None:
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
