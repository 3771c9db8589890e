"""Truth: arrays that the test itself saves, in MATLAB's and in text form, and real text files."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.io import savemat

from pacmo_core.data.skeleton import DUET15
from pacmo_core.formats.base import FormatError, RawSequence
from pacmo_core.formats.duetdance import DuetDance
from pacmo_core.formats.mat import list_variables, read_variable
from tests.formats.real_files import real_folder
from tests.formats.valid_sets import FRAMES, numbers, write_duetdance, write_duetdance_text

FORM = DuetDance(fps=25.0)


def reason(root: Path) -> str:
    """Read the last of what is found, and return why it was refused."""
    with pytest.raises(FormatError) as caught:
        FORM.read(FORM.find(root)[-1])
    return str(caught.value)


def test_a_clip_is_one_variable_of_the_mans_file_and_of_the_womans(tmp_path):
    write_duetdance(tmp_path)
    first, second = FORM.find(tmp_path)
    assert [f.relative_to(tmp_path).as_posix() for f in first.files] == [
        *("male/salsa.mat", "female/salsa.mat"),
    ]
    assert first == RawSequence("salsa/vid1_1", first.files, "salsa", ("", ""), "salsa/vid1")
    for i, sequence in enumerate((first, second), start=1):
        interaction = FORM.read(sequence).interaction
        assert interaction.skeleton == DUET15
        assert_allclose(interaction.times, np.arange(FRAMES + i) / 25)
        assert_allclose(interaction.person_a, numbers(i, FRAMES + i, 15, 3), atol=1e-6)
        assert_allclose(interaction.person_b, numbers(10 + i, FRAMES + i, 15, 3), atol=1e-6)


def test_text_of_two_dancers_pairs_in_both_layouts(tmp_path):
    write_duetdance_text(tmp_path / "one")
    (sequence,) = FORM.find(tmp_path / "one")
    folder = tmp_path / "two" / "04" / "001"
    folder.mkdir(parents=True)
    for file, name in zip(sequence.files, "AB", strict=True):
        (folder / f"skeleton_{name}.txt").write_bytes(file.read_bytes())
    (again,) = FORM.find(tmp_path / "two")
    assert sequence.name == again.name == "04/001"
    assert sequence.action == again.action == "salsa"
    wanted = numbers(1, FRAMES, 45).reshape(FRAMES, 15, 3)
    for found in (sequence, again):
        assert_allclose(FORM.read(found).interaction.person_b, wanted, atol=1e-6)


def test_clips_and_files_of_one_dancer_are_listed_and_refused(tmp_path):
    write_duetdance(tmp_path)
    savemat(tmp_path / "female" / "salsa.mat", {"vid2_1": numbers(0, 8, 15, 3), "solo_1": 1.0})
    savemat(tmp_path / "female" / "jive.mat", {"vid3_1": numbers(0, 8, 15, 3)})
    found = {sequence.name: sequence for sequence in FORM.find(tmp_path)}
    assert list(found) == [
        *("female/jive.mat", "salsa-female/solo_1", "salsa-male/vid1_1", "salsa/vid2_1"),
    ]
    assert len(FORM.read(found["salsa/vid2_1"]).interaction.times) == 8
    for name in ("female/jive.mat", "salsa-male/vid1_1"):
        with pytest.raises(FormatError, match="no second person"):
            FORM.read(found[name])


@pytest.mark.parametrize(
    ("variables", "wanted"),
    [
        ({"x_1": np.array([1, "a"], dtype=object)}, "x_1: wanted plain real numbers; got a cell"),
        ({"x_1": {"a": 1}}, "x_1: wanted plain real numbers; got a struct"),
        ({"x_1": "text"}, "x_1: wanted plain real numbers; got a char"),
        ({"x_1": np.zeros((4, 15, 3), complex)}, "x_1: wanted plain real numbers; got a complex"),
        ({"x_1": np.full((4, 15, 3), np.nan)}, r"\(0, 0, 0\) has nan"),
        ({"x_1": np.zeros((4, 45))}, r"x_1: wanted \(T, 15, 3\); got \(4, 45\)"),
        ({"x_1": np.zeros((1, 15, 3))}, "wanted two frames or more; got 1"),
    ],
)
def test_a_matlab_file_with_anything_but_places_is_refused(tmp_path, variables, wanted):
    for sex in ("male", "female"):
        (tmp_path / sex).mkdir()
        savemat(tmp_path / sex / "jive.mat", variables)
    with pytest.raises(FormatError, match=wanted):
        FORM.read(FORM.find(tmp_path)[0])


@pytest.mark.parametrize("dtype", ["f8", "f4", "i2", "u1", "i8"])
@pytest.mark.parametrize("compressed", [False, True])
def test_numbers_of_every_kind_come_out_as_they_went_in(tmp_path, dtype, compressed):
    file = tmp_path / "x.mat"
    wanted = {
        "first": (numbers(0, 4, 15, 3) * 50 + 75).astype(dtype),
        "a_much_longer_name_1": np.arange(6, dtype=dtype).reshape(2, 3),
        "one": np.ones((1, 1), dtype),
    }
    savemat(file, wanted, do_compression=compressed)
    assert list_variables(file) == list(wanted)
    for name, array in wanted.items():
        assert (read_variable(file, name) == array).all()
        assert read_variable(file, name).shape == array.shape


def test_a_file_of_level_4_is_refused(tmp_path):
    savemat(tmp_path / "x.mat", {"x": numbers(0, 4, 4)}, format="4")
    with pytest.raises(FormatError, match="no MATLAB file of level 5"):
        list_variables(tmp_path / "x.mat")


def test_a_shape_too_large_to_believe_is_refused_before_it_is_read(tmp_path):
    file = tmp_path / "x.mat"
    savemat(file, {"x": numbers(0, 4, 15, 3)})
    shape = np.array([4, 15, 3], "<i4").tobytes()
    file.write_bytes(file.read_bytes().replace(shape, b"\xff\xff\xff\x7f" * 3))
    with pytest.raises(FormatError, match=r"x: \(2147483647, .* is more than"):
        read_variable(file, "x")


@pytest.mark.parametrize("content", [b"", b"MATLAB", b"\x00" * 200, b"MATLAB 5.0" + b" " * 300])
def test_what_is_no_matlab_file_is_refused(tmp_path, content):
    write_duetdance(tmp_path)
    (tmp_path / "female" / "salsa.mat").write_bytes(content)
    assert "no MATLAB file" in str(
        [str(fault) for fault in (refusal(s) for s in FORM.find(tmp_path)) if fault]
    )


def refusal(sequence: RawSequence) -> FormatError | None:
    try:
        FORM.read(sequence)
    except FormatError as error:
        return error
    return None


@pytest.mark.parametrize(
    ("old", "new", "wanted"),
    [
        ("3,", "4,", "2: frame 4 follows frame 2"),
        (",", ";", "1: wanted 46 numbers; got 45"),
        ("3,", "x,", "2: wanted a number; got 'x'"),
        ("3,", "3,,", "2: wanted 46 numbers; got 47"),
    ],
)
def test_faulty_text_is_refused_with_its_line_and_the_reason(tmp_path, old, new, wanted):
    write_duetdance_text(tmp_path)
    (sequence,) = FORM.find(tmp_path)
    lines = sequence.files[0].read_text().split("\n")
    row = 0 if old == "," else 1
    lines[row] = lines[row].replace(old, new, 1)
    sequence.files[0].write_text("\n".join(lines))
    assert f"skeleton_pos.txt:{wanted}" in reason(tmp_path)


def test_a_rate_that_no_video_has_is_refused():
    with pytest.raises(ValueError, match="fps"):
        DuetDance(fps=0)


def test_real_text_of_one_dancer_is_listed_and_refused():
    sequences = FORM.find(real_folder("duetdance_one_person"))
    assert len(sequences) == 21
    assert all("no second person" in str(refusal(sequence)) for sequence in sequences)


def test_a_real_dancer_paired_with_himself_has_joints_where_their_names_say():
    folder = real_folder("duetdance_one_person") / "01" / "001"
    file = folder / "skeleton_pos.txt"
    person = FORM.read(RawSequence("x", (file, file))).interaction.person_a
    at = {joint: person[:, i] for i, joint in enumerate(DUET15.joints)}
    assert_allclose(at["pelvis"], (at["left_hip"] + at["right_hip"]) / 2, atol=1e-5)
    assert_allclose(at["neck"], (at["left_shoulder"] + at["right_shoulder"]) / 2, atol=1e-5)
    assert (at["head"][:, 1] > at["pelvis"][:, 1]).all()
    assert (at["pelvis"][:, 1] > at["left_ankle"][:, 1]).all()
