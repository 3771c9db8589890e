"""Trusted as truth: the formula of Yun et al. on values put in, and the 282 clips where at hand."""

import os
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pacmo_core.data.skeleton import SBU15
from pacmo_core.formats.base import FormatError, RawSequence
from pacmo_core.formats.sbu import Sbu

REAL = Path(os.environ.get("PACMO_REAL_DATA", "../shared/data")) / "sbu"
SBU = Sbu(fps=15)
VALUES = np.random.default_rng(0).random((4, 90)).round(5)
ROWS = [",".join(map(str, [55 + t, *values])) for t, values in enumerate(VALUES.tolist())]


def read(tmp_path, data):
    file = tmp_path / "skeleton_pos.txt"
    file.write_bytes(data)
    return interaction_of(SBU, tmp_path)


def interaction_of(form, folder):
    return form.read(RawSequence("clip", (folder / "skeleton_pos.txt",))).interaction


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_values_become_metres_by_the_published_formula(tmp_path, end):
    interaction = read(tmp_path, (end.join(ROWS) + end).encode())
    x, y, z = VALUES.reshape(4, 2, 15, 3)[2, 1, 7]
    wanted = np.array([1280 - 2560 * x, 960 - 1920 * y, z * 10000 / 7.8125]) / 1000
    as_seen = interaction_of(Sbu(fps=15, camera_pitch=0), tmp_path)
    np.testing.assert_allclose(as_seen.person_b[2, 7], wanted, rtol=1e-6)
    # Upright people of a camera that looks up lean away from it, by its pitch.
    level = Rotation.from_euler("x", -SBU.camera_pitch, degrees=True).apply(wanted)
    np.testing.assert_allclose(interaction.person_b[2, 7], level, rtol=1e-5)
    with pytest.raises(ValueError, match="camera_pitch: wanted degrees between .*; got 90"):
        Sbu(fps=15, camera_pitch=90)
    np.testing.assert_array_equal(interaction.times, np.arange(4) / 15)


def test_folders_give_name_action_and_people(tmp_path):
    take = tmp_path / "s01s02" / "05" / "001"
    take.mkdir(parents=True)
    (take / "skeleton_pos.txt").touch()
    (tmp_path / "skeleton_pos.txt").touch()
    sequence, here = SBU.find(tmp_path)
    assert (sequence.name, sequence.recording) == ("s01s02/05/001",) * 2
    assert (sequence.action, sequence.subjects) == ("shaking hands", ("s01", "s02"))
    assert (here.name, here.action, here.subjects) == ("skeleton_pos", "", ("", ""))


@pytest.mark.parametrize(
    ("line", "text", "reason"),
    [
        (1, ROWS[1].rpartition(",")[0], "wanted 91 fields, got 90"),
        (1, "", "wanted 91 fields, got 1"),
        (2, ROWS[2].replace("57,", "58,", 1), "wanted frame 57, got '58'"),
        (0, ROWS[0].replace("55,", "-5,", 1), "wanted a frame number"),
        (3, ROWS[3].rpartition(",")[0] + ",nan", "finite positions; joint right_foot of person 2"),
        (3, ROWS[3].rpartition(",")[0] + ",1e400", "finite positions"),
        (3, ROWS[3].rpartition(",")[0] + ",0x1", "wanted numbers, got '0x1'"),
        (3, ROWS[3].rpartition(",")[0] + ",", "wanted numbers"),
    ],
)
def test_a_fault_is_named_with_file_and_line(tmp_path, line, text, reason):
    lines = [*ROWS[:line], text, *ROWS[line + 1 :]]
    with pytest.raises(FormatError, match=reason) as caught:
        read(tmp_path, "\n".join(lines).encode())
    assert caught.value.line == line + 1


@pytest.mark.parametrize("data", [b"", b"\n", b"\0\0", ROWS[0].encode(), b"\xff\xfe,1\n"])
def test_what_is_no_recording_is_refused(tmp_path, data):
    with pytest.raises(FormatError):
        read(tmp_path, data)


@pytest.mark.skipif(not REAL.is_dir(), reason=f"no published files at {REAL}")
def test_the_published_clips_hold_people_of_human_size_whose_left_is_on_their_left():
    sequences = SBU.find(REAL)
    clips = [SBU.read(sequence).interaction for sequence in sequences]
    assert (len(clips), sum(len(clip.times) for clip in clips)) == (282, 6822)
    hip, knee, left, right, torso = SBU15.indices(
        ["left_hip", "left_knee", "left_shoulder", "right_shoulder", "torso"]
    )
    a = np.concatenate([clip.person_a for clip in clips])
    b = np.concatenate([clip.person_b for clip in clips])
    thigh = np.linalg.norm(a[:, hip] - a[:, knee], axis=-1)
    assert 0.40 < np.median(thigh) < 0.47
    # People face each other; in a right-handed frame with y up, up x forwards points left.
    leftwards = np.cross([0, 1, 0], b[:, torso] - a[:, torso])
    assert (((a[:, left] - a[:, right]) * leftwards).sum(axis=-1) > 0).mean() > 0.85


@pytest.mark.skipif(not REAL.is_dir(), reason=f"no published files at {REAL}")
def test_people_stand_upright_on_a_level_floor_in_the_published_clips():
    feet = SBU15.indices(["left_foot", "right_foot"])
    leans, away, heights = [], [], []
    for sequence in SBU.find(REAL):
        clip = SBU.read(sequence).interaction
        for person in (clip.person_a, clip.person_b):
            body = person[:, SBU15.joints.index("neck")] - person[:, feet].mean(axis=1)
            leans.append(np.median(body / np.linalg.norm(body, axis=-1, keepdims=True), axis=0))
        both = np.concatenate([clip.person_a[:, feet], clip.person_b[:, feet]], axis=1)
        standing = both[1:][np.linalg.norm(np.diff(both, axis=0), axis=-1) * 15 < 0.15]
        if len(standing):
            away.append(standing[:, 2] - standing[:, 2].mean())
            heights.append(standing[:, 1] - standing[:, 1].mean())
    distance, height = np.concatenate(away), np.concatenate(heights)
    assert np.degrees(np.abs(np.median(leans, axis=0)[[0, 2]])).max() < 2
    assert abs(distance @ height / (distance @ distance)) < 0.04
