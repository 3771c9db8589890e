"""Truth: the plain BVH reader, the known facts of each dataset, and files broken on purpose."""

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pacmo_core.formats.base import FormatError, RawSequence, to_y_up
from pacmo_core.formats.bvh import read_bvh
from pacmo_core.formats.bvh_pairs import BvhPairs
from tests.formats.valid_sets import FRAMES, bvh_text, write_bvh_pair


def pairs(preset="pair", **settings) -> BvhPairs:
    plain = {
        "unit": 1.0 if preset == "pair" else None,
        "up": "y" if preset == "pair" else None,
        "fps": None,
        "end_sites": preset == "pair",
        "skip_frames": 0,
        "max_root_distance": None,
    }
    return BvhPairs(preset=preset, **{**plain, **settings})


def only(form: BvhPairs, root: Path) -> RawSequence:
    (sequence,) = form.find(root)
    return sequence


def reason(form: BvhPairs, sequence: RawSequence) -> str:
    with pytest.raises(FormatError) as caught:
        form.read(sequence)
    return str(caught.value)


def test_a_pair_is_both_files_on_the_clock_of_their_frame_time(tmp_path):
    write_bvh_pair(tmp_path)
    sequence = only(pairs(), tmp_path)
    assert (sequence.name, [file.name for file in sequence.files]) == (
        *("wave", ["wave_A.bvh", "wave_B.bvh"]),
    )
    interaction = pairs().read(sequence).interaction
    assert_allclose(interaction.times, np.arange(FRAMES) * 0.033333)
    assert_allclose(interaction.person_a, read_bvh(sequence.files[0]).positions(), atol=1e-6)
    assert_allclose(interaction.person_b, read_bvh(sequence.files[1]).positions(), atol=1e-6)
    assert interaction.skeleton.left_right == ((3, 5), (4, 6))


def test_z_up_becomes_y_up_by_a_rotation():
    turned = to_y_up(np.eye(3), "z").T
    assert_allclose(turned @ (0, 0, 1), (0, 1, 0))
    assert_allclose(turned @ turned.T, np.eye(3))
    assert np.linalg.det(turned) == pytest.approx(1)


def test_settings_scale_turn_and_cut(tmp_path):
    write_bvh_pair(tmp_path)
    plain = pairs().read(only(pairs(), tmp_path)).interaction
    form = pairs(unit=0.01, up="z", skip_frames=2, fps=60.0, end_sites=False)
    interaction = form.read(only(form, tmp_path)).interaction
    assert interaction.skeleton.joints == ("Hips", "Spine", "LeftArm", "RightArm")
    assert interaction.skeleton.parents == (-1, 0, 1, 1)
    assert_allclose(interaction.times, np.arange(FRAMES - 2) / 60)
    x, y, z = np.moveaxis(plain.person_a[2:, [0, 1, 3, 5]], -1, 0)
    assert_allclose(interaction.person_a, np.stack((x, z, -y), -1) * 0.01, atol=1e-6)


def test_a_walk_in_is_left_out(tmp_path):
    write_bvh_pair(tmp_path)
    whole = pairs().read(only(pairs(), tmp_path)).interaction
    distance = np.linalg.norm(whole.person_a[:, 0] - whole.person_b[:, 0], axis=-1)
    near = float(np.sort(distance[:-1])[0]) + 1e-4
    form = pairs(max_root_distance=near)
    cut = form.read(only(form, tmp_path)).interaction
    assert len(cut.times) == FRAMES - distance[:-1].argmin()
    assert cut.times[0] == 0
    assert "the roots stay" in reason(pairs(max_root_distance=1e-3), only(form, tmp_path))


def test_two_files_named_outright_are_a_pair(tmp_path):
    for seed, name in enumerate(("one.bvh", "two.bvh")):
        (tmp_path / name).write_text(bvh_text(seed))
    sequence = RawSequence("mine", (tmp_path / "one.bvh", tmp_path / "two.bvh"))
    assert len(pairs().read(sequence).interaction.times) == FRAMES


def test_one_of_two_files_is_listed_and_refused(tmp_path):
    write_bvh_pair(tmp_path)
    (tmp_path / "wave_B.bvh").unlink()
    sequence = only(pairs(), tmp_path)
    assert sequence.name == "wave_A.bvh"
    assert "no second person" in reason(pairs(), sequence)


def test_a_broken_file_is_named_before_its_missing_partner(tmp_path):
    (tmp_path / "wave_A.bvh").write_text(bvh_text(0).replace("Frames: 6", "Frames: 4"))
    assert "says 4 frames, the file has 6 rows" in reason(pairs(), only(pairs(), tmp_path))


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        (bvh_text(1, frames=5), "wave_B.bvh: 5 frames; wave_A.bvh has 6"),
        (bvh_text(1).replace("0.033333", "0.01"), "wave_B.bvh: 100 frames a second; wave_A"),
        (
            bvh_text(1).replace("LeftArm", "Arm"),
            r"not the joints of wave_A.bvh: \['Arm",
        ),
        (bvh_text(1).replace("OFFSET 0 0.5 0", "OFFSET 0 5000 0"), "joint Spine is at"),
        (bvh_text(1).replace("OFFSET 0.4 0 0", "OFFSET 0 0 0"), "LeftArm_end has zero length"),
    ],
)
def test_two_files_that_do_not_match_are_refused(tmp_path, text, wanted):
    write_bvh_pair(tmp_path)
    (tmp_path / "wave_B.bvh").write_text(text)
    assert re.search(wanted, reason(pairs(), only(pairs(), tmp_path)))


def test_a_single_frame_is_no_motion(tmp_path):
    for person in "AB":
        (tmp_path / f"x_{person}.bvh").write_text(bvh_text(0, frames=1))
    assert "wanted two frames or more; got 1" in reason(pairs(), only(pairs(), tmp_path))


@pytest.mark.parametrize(
    "settings",
    [
        {"preset": "unknown"},
        {"unit": None},
        {"up": None},
        {"up": "x"},
        {"unit": -1.0},
        {"unit": float("inf")},
        {"unit": 0.0, "preset": "duo_mocap"},
        {"up": "", "preset": "duo_mocap"},
        {"skip_frames": -1},
        {"fps": 0.0},
    ],
)
def test_settings_that_make_no_sense_are_refused(settings):
    with pytest.raises(ValueError, match=r"preset|unit|up|skip_frames|fps"):
        pairs(**settings)


def test_names_tell_pairs_units_and_recordings_of_the_duo_set(tmp_path):
    for folder in ("salsa", "salsa_raw", "acts"):
        (tmp_path / folder).mkdir()
    for name in (
        *("salsa/Easy_01_female_30fps.bvh", "salsa/Easy_01_male_30fps.bvh"),
        *("salsa_raw/Easy_01_female.bvh", "salsa_raw/Easy_01_male.bvh"),
        *("acts/crawl001_S1_part_30fps.bvh", "acts/crawl001_S2_part_30fps.bvh"),
        *("acts/ROM.bvh", "acts/push_S1.BVH", "acts/push_S2.bvh"),
    ):
        (tmp_path / name).write_text(bvh_text(0))
    form = pairs("duo_mocap")
    found = {sequence.name: sequence for sequence in form.find(tmp_path)}
    assert list(found) == [
        *("acts/ROM.bvh", "acts/crawl001_part_30fps", "acts/push"),
        *("salsa/Easy_01_30fps", "salsa_raw/Easy_01"),
    ]
    crawl, salsa = found["acts/crawl001_part_30fps"], found["salsa/Easy_01_30fps"]
    assert (crawl.recording, crawl.action, crawl.subjects) == ("crawl001", "crawl", ("S1", "S2"))
    assert (salsa.action, salsa.subjects) == ("salsa", ("salsa-female", "salsa-male"))
    assert salsa.recording == found["salsa_raw/Easy_01"].recording == "Easy_01"
    metres = form.read(salsa).interaction.person_a
    inches = form.read(found["salsa_raw/Easy_01"]).interaction.person_a
    assert_allclose(inches, metres * 0.0254, atol=1e-6)


def test_odd_letters_and_equal_names_still_give_each_sequence_a_name_of_its_own(tmp_path):
    for name in ("a b_S1.bvh", "a b_S2.bvh", "x_1_S1.bvh", "x_1_S2.bvh", "x_1_female.bvh"):
        (tmp_path / name).write_text(bvh_text(0))
    (tmp_path / "x_1_male.bvh").write_text(bvh_text(0))
    names = [sequence.name for sequence in pairs("duo_mocap").find(tmp_path)]
    assert names == ["a-u20-b", "x_1.S1-S2", "x_1.female-male"]


def test_folders_of_cmu_pairs_are_read_as_they_are_delivered(tmp_path):
    folders = ("18_19_Justin", "18_19_rory", "20_21_Justin1", "20_21_rory1")
    for number, folder in enumerate((*folders, "22_23_justin", "22_23_Rory")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / f"{folder[:2]}_01_poses.bvh").write_text(bvh_text(number))
    form = pairs(preset="cmu_18_19")
    found = form.find(tmp_path)
    assert [sequence.name for sequence in found] == ["18_19/18_01", "20_21/20_01", "22_23/22_01"]
    assert [len(sequence.files) for sequence in found] == [2, 2, 2]
    assert "Justin" in found[1].files[0].parent.name
    for sequence in found:
        form.read(sequence)


@pytest.mark.parametrize(
    ("preset", "wanted"),
    [
        ("pair", "NAME_A.bvh and NAME_B.bvh"),
        ("cmu_18_19", "20_21_Justin/20_01_poses.bvh and 20_21_rory/20_01_poses.bvh"),
        ("duo_mocap", "hug001_S1.bvh and hug001_S2.bvh"),
    ],
)
def test_a_file_without_a_partner_is_told_which_names_the_preset_pairs(tmp_path, preset, wanted):
    (tmp_path / "wave_1.bvh").write_text(bvh_text(0))
    assert wanted in reason(pairs(preset=preset), only(pairs(preset=preset), tmp_path))
