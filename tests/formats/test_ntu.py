"""Trusted as truth: poses put into files byte by byte, and one published file where at hand."""

import os
from pathlib import Path

import numpy as np
import pytest

from pacmo_core.data.skeleton import NTU25
from pacmo_core.formats.base import FormatError, RawSequence
from pacmo_core.formats.ntu import Ntu, read_skip_list
from pacmo_core.formats.write_ntu import format_frames

REAL = Path(os.environ.get("PACMO_REAL_DATA", "../shared/data")) / "ntu"
SETTINGS = {"fps": 30.0, "max_gap": 3, "max_link_distance": 0.3, "min_visible_share": 0.5}
NTU = Ntu(**SETTINGS)
BODY = 27  # lines


def pose(person, frame):
    """Walk along x, at another depth for each person."""
    joints = np.random.default_rng(person).normal(scale=0.2, size=(25, 3))
    return (joints + np.array([0.02 * frame, 0, 2 + person])).astype(np.float32)


def frames(*presence):
    """Build frames from strings, one a person: a letter is the body's number, ``.`` unseen."""
    return [
        {ord(row[t]): pose(person, t) for person, row in enumerate(presence) if row[t] != "."}
        for t in range(len(presence[0]))
    ]


def read(tmp_path, data, reader=NTU):
    file = tmp_path / "S001C002P003R004A050.skeleton"
    file.write_bytes(data if isinstance(data, bytes) else format_frames(data))
    return reader.read(RawSequence("clip", (file,)))


def test_a_name_gives_action_people_and_recording(tmp_path):
    for name in ("S001C002P003R004A050", "S001C003P003R004A050", "mine"):
        (tmp_path / f"{name}.skeleton").touch()
    first, second, mine = NTU.find(tmp_path)
    assert first.name == "S001C002P003R004A050"
    assert (first.action, first.subjects) == ("A050 punch or slap", ("P003", ""))
    assert first.recording == second.recording == "S001P003R004A050"
    assert (mine.name, mine.action, mine.recording) == ("mine", "", "mine")


def test_equal_file_names_are_distinguished_by_folder(tmp_path):
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "S001C002P003R004A050.skeleton").touch()
    assert [s.name[:4] for s in NTU.find(tmp_path)] == ["one/", "two/"]


@pytest.mark.parametrize("end", [b"\n", b"\r\n"])
def test_both_line_ends_give_the_poses(tmp_path, end):
    data = format_frames(frames("aaaa", "bbbb")).replace(b"\n", end)
    interaction = read(tmp_path, data).interaction
    wanted = np.stack([pose(0, t) for t in range(4)])
    np.testing.assert_allclose(interaction.person_a, wanted, rtol=1e-6)
    np.testing.assert_array_equal(interaction.times, np.arange(4) / 30)


def test_a_short_gap_is_filled_by_a_straight_line_and_counted(tmp_path):
    reading = read(tmp_path, frames("aaa..aaa", "bbbbbbbb"))
    assert reading.filled_frames == 2
    wanted = np.stack([pose(0, t) for t in range(8)])  # the walk is itself a straight line
    np.testing.assert_allclose(reading.interaction.person_a, wanted, atol=1e-6)


def test_a_long_gap_is_refused_at_the_line_where_the_body_was_last_seen(tmp_path):
    with pytest.raises(FormatError, match=r"not visible for 4 frames; wanted at most 3") as caught:
        read(tmp_path, frames("aa....aa", "bbbbbbbb"))
    assert caught.value.line == 2 + 1 + 2 * BODY + 1


def test_a_body_under_a_new_number_is_the_same_person(tmp_path):
    reading = read(tmp_path, frames("aaaa..cccc", "bbbbbbbbbb"))
    assert reading.filled_frames == 2
    wanted = np.stack([pose(0, t) for t in range(10)])
    np.testing.assert_allclose(reading.interaction.person_a, wanted, atol=1e-6)


def test_two_people_lost_at_once_each_come_back_as_themselves(tmp_path):
    reading = read(tmp_path, frames("aaaa.dddd", "bbbb.cccc"))
    for person, motion in enumerate((reading.interaction.person_a, reading.interaction.person_b)):
        wanted = np.stack([pose(person, t) for t in range(9)])
        np.testing.assert_allclose(motion, wanted, atol=1e-6)


def test_a_body_that_comes_back_elsewhere_is_not_stitched(tmp_path):
    shown = frames("aaaaa.....", "bbbbbbbbbb")
    for t in range(5, 10):
        shown[t][99] = pose(2, t)
    reader = Ntu(**SETTINGS | {"min_visible_share": 0.6})
    with pytest.raises(FormatError, match=r"wanted two bodies .* got 3 in all"):
        read(tmp_path, shown, reader)


def test_of_three_who_stay_the_one_who_stands_still_is_furniture(tmp_path):
    shown = frames("aaaaaaaa", "bbbbbbbb")
    shown = [{7: pose(5, 0), **bodies} for bodies in shown]
    interaction = read(tmp_path, shown).interaction
    np.testing.assert_allclose(interaction.person_a[3], pose(0, 3), rtol=1e-5)
    np.testing.assert_allclose(interaction.person_b[3], pose(1, 3), rtol=1e-5)


def test_late_arrival_and_early_departure_are_cut_off_and_not_counted(tmp_path):
    reading = read(tmp_path, frames("..aaaaaa", "bbbb.b.."))
    assert reading.filled_frames == 1
    np.testing.assert_allclose(reading.interaction.person_b[0], pose(0, 2), rtol=1e-5)
    np.testing.assert_allclose(reading.interaction.times, np.arange(4) / 30)


@pytest.mark.parametrize(
    ("shown", "reason"),
    [
        (("aaaa",), "wanted two bodies"),
        (("....",), "got 0 in all"),
        (("aaa...", "...bbb"), "never visible together"),
    ],
)
def test_fewer_than_two_people_are_refused(tmp_path, shown, reason):
    with pytest.raises(FormatError, match=reason):
        read(tmp_path, frames(*shown))


LINES = format_frames(frames("aaa", "bbb")).splitlines()
JOINT = LINES[10].split()


@pytest.mark.parametrize(
    ("line", "text", "reason"),
    [
        (0, b"4", "body count of frame 3 of 4, got the end"),
        (0, b"999999999999", "got the end"),
        (0, b"-3", "frame count"),
        (0, b"2", "wanted the end after 2 frames"),
        (1, b"3", "frame 0|10 fields|9 more fields"),
        (1, b"7", "wanted 0 to 6 bodies, got 7"),
        (2, b"7.2e16 0 1 1 1 1 0 0 0 2", "body ID"),
        (2, b"97 0", "body ID and 9 more"),
        (2 + BODY, LINES[2], "body 97 twice in frame 0"),
        (3, b"24", "wanted 25 joints"),
        (3, b"\xff\xfe", "joint count"),
        (10, b" ".join(JOINT[:11]), "wanted 12 fields, got 11"),
        (10, b"", "wanted 12 fields, got 0"),
        (10, b" ".join([b"nan", *JOINT[1:]]), "finite"),
        (10, b" ".join([b"1e400", *JOINT[1:]]), "finite"),
        (10, b" ".join([b"1_0", *JOINT[1:]]), "wanted numbers, got '1_0'"),
        (10, b" ".join([b"1.2.3", *JOINT[1:]]), "wanted numbers, got '1.2.3'"),
        (10, b" ".join([*JOINT[:11], b"two"]), "wanted numbers, got 'two'"),
        (10, b" ".join([*JOINT[:11], b"\0"]), "wanted numbers"),
    ],
)
def test_a_fault_is_named_with_file_and_line(tmp_path, line, text, reason):
    lines = [*LINES[:line], text, *LINES[line + 1 :], b""]
    with pytest.raises(FormatError, match=reason) as caught:
        read(tmp_path, b"\n".join(lines))
    assert caught.value.line is not None
    if line >= 2:
        assert caught.value.line == line + 1


def test_a_pixel_that_the_camera_could_not_map_is_no_fault(tmp_path):
    fields = [*JOINT[:5], b"-Infinity", b"NaN", *JOINT[7:]]
    read(tmp_path, b"\n".join([*LINES[:10], b" ".join(fields), *LINES[11:], b""]))


@pytest.mark.parametrize("data", [b"", b"\n \r\n", b"\0" * 100, b"\x89PNG\r\n\x1a\n", b"2\r0\r0\r"])
def test_what_is_no_text_of_ours_is_refused(tmp_path, data):
    with pytest.raises(FormatError):
        read(tmp_path, data)


def test_a_listed_or_absent_sample_is_refused(tmp_path):
    published = tmp_path / "missing.txt"
    published.write_text("2 samples:\n\nS001C002P003R004A050\nS001C002P006R001A008\n")
    names = read_skip_list(published.read_text())
    assert len(names) == 2
    with pytest.raises(FormatError, match="missing skeletons"):
        read(tmp_path, frames("aaa", "bbb"), Ntu(**SETTINGS, skip_lists=(str(published),)))
    with pytest.raises(FormatError, match="cannot be read"):
        NTU.read(RawSequence("x", (tmp_path / "none.skeleton",)))


@pytest.mark.skipif(not REAL.is_dir(), reason=f"no published files at {REAL}")
def test_a_published_file_holds_two_people_whose_left_is_on_their_left():
    (sequence,) = NTU.find(REAL / "two_person")
    reading = NTU.read(sequence)
    interaction = reading.interaction
    assert (reading.filled_frames, len(interaction.times)) == (0, 74)
    apart = np.linalg.norm(interaction.person_a[:, 0] - interaction.person_b[:, 0], axis=-1)
    assert 0.9 < apart.min() < apart.max() < 1.25
    np.testing.assert_array_equal(
        interaction.person_a[0, 0], np.float32([-0.8514767, 0.1916033, 3.384463])
    )
    foot, ankle, left, right = NTU25.indices(
        ["right_foot", "right_ankle", "left_shoulder", "right_shoulder"]
    )
    for motion in (interaction.person_a, interaction.person_b):
        # In a right-handed frame with y up, up x forwards points to the left.
        leftwards = np.cross([0, 1, 0], motion[:, foot] - motion[:, ankle])
        sides = (leftwards * (motion[:, left] - motion[:, right])).sum(axis=-1)
        assert (sides > 0).mean() > 0.8
    for alone in NTU.find(REAL / "single_person"):
        with pytest.raises(FormatError, match="got 1 in all"):
            NTU.read(alone)
