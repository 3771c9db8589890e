"""Trusted as truth: the positions put in, and the seven digits of the published files."""

import numpy as np
import pytest

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import NTU25, SBU15
from pacmo_core.formats.base import RawSequence
from pacmo_core.formats.ntu import Ntu
from pacmo_core.formats.write_ntu import format_frames, format_ntu

IDS = (72057594037932185, 72057594037932186)  # one float64 for both


def people(n_frames=12, seed=0):
    generator = np.random.default_rng(seed)
    poses = generator.normal([0, 0, 3], 0.3, size=(2, 1, 25, 3))
    poses = poses + np.cumsum(generator.normal(scale=0.01, size=(2, n_frames, 25, 3)), axis=1)
    return Interaction(NTU25, np.arange(n_frames) / 30, *poses.astype(np.float32))


def test_what_is_written_is_read_back_to_seven_digits(tmp_path):
    written = people()
    file = tmp_path / "S001C001P001R001A050.skeleton"
    file.write_bytes(format_ntu(written, IDS))
    reading = Ntu(fps=30, max_gap=0, max_link_distance=0, min_visible_share=1).read(
        RawSequence("x", (file,))
    )
    assert reading.filled_frames == 0
    np.testing.assert_array_equal(reading.interaction.times, written.times)
    for person in ("person_a", "person_b"):
        got, wanted = getattr(reading.interaction, person), getattr(written, person)
        np.testing.assert_allclose(got, wanted, rtol=6e-7)


def test_body_ids_keep_all_their_digits():
    lines = format_ntu(people(n_frames=2), IDS).split(b"\n")
    ids = [int(line.split()[0]) for line in lines if len(line.split()) == 10]
    assert ids == [*IDS, *IDS]


def test_pixels_are_a_pinhole_image_with_y_downwards():
    pose = np.tile(np.array([0, 0, 2], np.float32), (25, 1))
    pose[1] = [1, 1, 2]
    first, second = format_frames([{1: pose}]).splitlines()[4:6]
    centre, corner = np.array(first.split(), float), np.array(second.split(), float)
    assert corner[3] - centre[3] == pytest.approx(367 / 2)
    assert corner[6] - centre[6] == pytest.approx(-1057 / 2)


def test_a_joint_behind_the_camera_is_refused():
    pose = np.zeros((25, 3), np.float32)
    with pytest.raises(ValueError, match="before the camera"):
        format_frames([{1: pose}])


@pytest.mark.parametrize("ids", [(1, 1), IDS])
def test_one_id_for_two_and_other_skeletons_are_refused(ids):
    zeros = np.ones((2, 15, 3), np.float32)
    other = Interaction(SBU15, np.arange(2) / 30, zeros, zeros)
    with pytest.raises(ValueError, match="two body IDs"):
        format_ntu(people() if ids == (1, 1) else other, ids)
