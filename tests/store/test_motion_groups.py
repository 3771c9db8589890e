"""What is trusted: clips as they were written, and reading one at a time."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pacmo_core.store.motion_groups import MotionGroups
from pacmo_core.store.motions import read_motion, write_motions
from tests.augmentation.sources import source

NAMES = [f"clip{number:02d}" for number in range(20)]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    clips = [source(number, n_frames=5 + number) for number in range(len(NAMES))]
    with write_motions(tmp_path / "motions.parquet", clips[0].skeleton) as writer:
        for name, clip in zip(NAMES, clips, strict=True):
            writer.add(name, replace(clip, skeleton=clips[0].skeleton))
    return tmp_path / "motions.parquet"


@pytest.mark.parametrize("order", [NAMES, NAMES[::-1], [*NAMES[::7], *NAMES[::3]]])
def test_whatever_the_order_a_clip_is_what_one_reading_gives(file: Path, order: list[str]) -> None:
    groups = MotionGroups(file)
    for name in order:
        found, wanted = groups.read(name), read_motion(file, name)
        assert found.skeleton == wanted.skeleton
        for field in ("times", "person_a", "person_b"):
            np.testing.assert_array_equal(getattr(found, field), getattr(wanted, field))


def test_a_row_group_is_read_once_for_all_its_clips(file: Path) -> None:
    groups = MotionGroups(file)
    for name in NAMES:
        groups.read(name)
    assert groups._group.cache_info().misses == 3


@pytest.mark.parametrize("name", ["clip", "clip07a", "clip99"])
def test_a_clip_that_is_not_there_is_named(file: Path, name: str) -> None:
    with pytest.raises(KeyError, match=f"no clip {name}"):
        MotionGroups(file).read(name)
