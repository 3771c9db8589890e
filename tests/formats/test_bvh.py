"""Truth: a plain recursive walk with 4×4 matrices, written here from the format's description."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from pacmo_core.formats.base import FormatError
from pacmo_core.formats.bvh import Bvh, read_bvh
from tests.formats.bvh_faults import FAULTS
from tests.formats.real_files import real_folder
from tests.formats.valid_sets import FRAMES, bvh_text, numbers, table

VALID = bvh_text(seed=3)


def written(folder: Path, text: str | bytes) -> Path:
    file = folder / "person.bvh"
    file.write_bytes(text.encode() if isinstance(text, str) else text)
    return file


def turn4(axis: str, degrees: float) -> np.ndarray:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    rows = {
        "x": [[1, 0, 0], [0, c, -s], [0, s, c]],
        "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]],
        "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]],
    }
    matrix = np.eye(4)
    matrix[:3, :3] = rows[axis]
    return matrix


def oracle(bvh: Bvh, frame: int) -> np.ndarray:
    """Walk the tree joint by joint with one matrix each."""
    values = iter(bvh.motion[frame])
    world: list[np.ndarray] = []
    for joint, parent in enumerate(bvh.parents):
        shift, rotation = np.eye(4), np.eye(4)
        shift[:3, 3] = bvh.offsets[joint]
        for channel in bvh.channels[joint]:
            value = next(values)
            row = "xyz".index(channel[0])
            if channel.endswith("rotation"):
                rotation = rotation @ turn4(channel[0], value)
            else:
                shift[row, 3] = value
        above = world[parent] if parent >= 0 else np.eye(4)
        world.append(above @ shift @ rotation)
    return np.array([matrix[:3, 3] for matrix in world])


def test_positions_are_those_of_a_plain_walk_over_the_tree(tmp_path):
    bvh = read_bvh(written(tmp_path, VALID))
    places = bvh.positions()
    assert places.shape == (FRAMES, 7, 3)
    for frame in range(FRAMES):
        assert_allclose(places[frame], oracle(bvh, frame), atol=1e-12)


def test_positions_of_the_root_are_in_the_world_whatever_its_offset(tmp_path):
    plain = read_bvh(written(tmp_path, VALID.replace("OFFSET 0.1 0.2 0.3", "OFFSET 0 0 0")))
    raised = read_bvh(written(tmp_path, VALID.replace("OFFSET 0.1 0.2 0.3", "OFFSET 0 97 0")))
    assert raised.offsets[0].tolist() == [0, 97, 0]
    assert_allclose(raised.positions(), plain.positions(), atol=1e-12)
    assert_allclose(plain.positions()[:, 0], plain.motion[:, :3], atol=1e-12)


def test_the_tree_is_read_with_an_end_site_before_its_siblings(tmp_path):
    bvh = read_bvh(written(tmp_path, VALID))
    assert bvh.joints == (
        *("Hips", "Spine", "Spine_end", "LeftArm", "LeftArm_end", "RightArm", "RightArm_end"),
    )
    assert bvh.parents == (-1, 0, 1, 1, 3, 1, 5)
    assert bvh.end_sites == (2, 4, 6)
    assert bvh.channels[5] == ("yposition", "zrotation", "yrotation", "xrotation")
    assert bvh.frame_time == 0.033333


def test_a_quarter_turn_about_z_carries_the_arm_from_x_to_y(tmp_path):
    text = (
        "HIERARCHY\nROOT a {\nOFFSET 0 0 0\nCHANNELS 1 Zrotation\nEnd Site {\nOFFSET 2 0 0\n}\n}\n"
        "MOTION\nFrames: 1\nFrame Time: 0.01\n90\n"
    )
    assert_allclose(read_bvh(written(tmp_path, text)).positions()[0, 1], (0, 2, 0), atol=1e-15)


@settings(derandomize=True, max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_bones_without_position_channels_keep_their_length(tmp_path_factory, seed):
    bvh = read_bvh(written(tmp_path_factory.mktemp("bvh"), bvh_text(seed)))
    places = bvh.positions()
    for joint in (1, 2, 3, 4, 6):
        bone = places[:, joint] - places[:, bvh.parents[joint]]
        wanted = np.linalg.norm(bvh.offsets[joint])
        assert_allclose(np.linalg.norm(bone, axis=-1), wanted, rtol=1e-12)


@pytest.mark.parametrize(
    "spelt",
    [
        VALID.replace("\n", "\r\n"),
        VALID.replace("\n", "\r"),
        "\ufeff" + VALID,
        VALID.replace("\n{", " {"),
        VALID.replace("    }\n  }\n}", "}}}").replace("HIERARCHY", "hierarchy"),
        VALID.replace("Frames: ", "Frames:\t").replace("MOTION", " MOTION "),
        VALID + "\n\n",
    ],
)
def test_spelling_that_means_the_same_reads_the_same(tmp_path, spelt):
    plain = read_bvh(written(tmp_path, VALID))
    other = read_bvh(written(tmp_path, spelt))
    assert other.joints == plain.joints
    assert (other.motion == plain.motion).all()


@pytest.mark.parametrize(("text", "reason"), FAULTS)
def test_a_faulty_file_is_refused_with_its_line_and_the_reason(tmp_path, text, reason):
    with pytest.raises(FormatError, match=reason.replace("1e+09", r"1e\+09")):
        read_bvh(written(tmp_path, text))


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(FormatError, match="cannot be read"):
        read_bvh(tmp_path / "nothing.bvh")


def test_a_tree_a_thousand_deep_needs_no_recursion(tmp_path):
    names = "".join(f"JOINT j{i} {{\nOFFSET 0 1 0\nCHANNELS 0\n" for i in range(999))
    hierarchy = f"HIERARCHY\nROOT a {{\nOFFSET 0 0 0\nCHANNELS 1 Xrotation\n{names}{'}' * 1000}\n"
    text = f"{hierarchy}MOTION\nFrames: 2\nFrame Time: 0.01\n{table(numbers(0, 2, 1))}"
    assert_allclose(
        np.linalg.norm(read_bvh(written(tmp_path, text)).positions()[:, -1]), 999 * 2**0.5
    )


@pytest.mark.parametrize(
    ("path", "joints", "ends"),
    [
        ("duo_mocap/salsa_raw/Easy_01_male.bvh", 34, 7),
        ("cmu_18_19/18_19_rory/18_01_poses.bvh", 27, 5),
        ("skeleton_priors/uniform-B/0000_0.75_retarget_C1.bvh", 17, 5),
    ],
)
def test_real_files_agree_with_the_plain_walk(path, joints, ends):
    bvh = read_bvh(real_folder(path.partition("/")[0]) / path.partition("/")[2])
    assert (len(bvh.joints), len(bvh.end_sites)) == (joints, ends)
    places = bvh.positions()
    for frame in (0, len(places) // 2, len(places) - 1):
        assert_allclose(places[frame], oracle(bvh, frame), atol=1e-9)


def test_bodies_of_the_scaled_set_scale_as_their_names_say():
    folder = real_folder("skeleton_priors") / "uniform-B"
    lengths = {
        file.name.split("_")[1]: np.linalg.norm(read_bvh(file).offsets, axis=1)
        for file in sorted(folder.glob("*.bvh"))
    }
    for scale, length in lengths.items():
        assert_allclose(length, lengths["0.75"] * float(scale) / 0.75, atol=1e-4)
