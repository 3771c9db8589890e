"""Truth: arrays that the test itself saves; one that would run code when unpickled must not."""

import os
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pacmo_core.data.skeleton import INTERHUMAN22
from pacmo_core.formats.base import FormatError
from pacmo_core.formats.interhuman import InterHuman
from tests.formats.valid_sets import FRAMES, numbers, write_interhuman

FORM = InterHuman(fps=30.0, up="y")


class Spiteful:
    """Make a folder when unpickled."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __reduce__(self):
        return os.mkdir, (str(self.folder),)


def test_the_first_66_columns_are_22_joints(tmp_path):
    write_interhuman(tmp_path)
    (sequence,) = FORM.find(tmp_path)
    assert (sequence.name, sequence.recording) == ("7", "7")
    interaction = FORM.read(sequence).interaction
    assert interaction.skeleton == INTERHUMAN22
    assert_allclose(interaction.times, np.arange(FRAMES) / 30)
    for seed, person in enumerate((interaction.person_a, interaction.person_b)):
        wanted = numbers(seed, FRAMES, 70)[:, :66].reshape(FRAMES, 22, 3)
        assert_allclose(person, wanted, atol=1e-6)


def test_z_up_is_turned_to_y_up(tmp_path):
    write_interhuman(tmp_path)
    form = InterHuman(fps=30.0, up="z")
    x, y, z = np.moveaxis(numbers(0, FRAMES, 70)[:, :66].reshape(FRAMES, 22, 3), -1, 0)
    turned = form.read(form.find(tmp_path)[0]).interaction.person_a
    assert_allclose(turned, np.stack((x, z, -y), -1), atol=1e-6)


@pytest.mark.parametrize(
    ("array", "reason"),
    [
        (np.zeros((FRAMES, 65)), r"wanted \(T, 66 or more\); got \(6, 65\)"),
        (np.zeros(FRAMES), r"got \(6,\)"),
        (np.zeros((FRAMES, 22, 3)), r"got \(6, 22, 3\)"),
        (np.zeros((FRAMES, 66), complex), "wanted an array of real numbers; got complex128"),
        (np.full((FRAMES, 66), "1"), "wanted an array of real numbers; got <U1"),
        (np.full((FRAMES, 66), np.nan), r"\(0, 0, 0\) has nan"),
        (np.full((FRAMES, 66), 5000.0), r"frame 0, joint pelvis is at \[5000.0"),
        (np.zeros((0, 66)), r"no array of numbers|7.npy: 0 frames; 7.npy has 6"),
        (np.zeros((FRAMES + 1, 66)), r"7.npy: 7 frames; 7.npy has 6"),
    ],
)
def test_an_array_of_another_kind_is_refused(tmp_path, array, reason):
    write_interhuman(tmp_path)
    np.save(tmp_path / "person2" / "7.npy", array)
    with pytest.raises(FormatError, match=reason):
        FORM.read(FORM.find(tmp_path)[0])


def test_nothing_is_ever_unpickled(tmp_path):
    write_interhuman(tmp_path)
    trap = tmp_path / "trap"
    array = np.full((FRAMES, 66), None, dtype=object)
    array[0, 0] = Spiteful(trap)
    np.save(tmp_path / "person2" / "7.npy", array, allow_pickle=True)
    with pytest.raises(FormatError, match="no array of numbers"):
        FORM.read(FORM.find(tmp_path)[0])
    assert not trap.exists()


@pytest.mark.parametrize("content", [b"", b"\x93NUMPY", b"PK\x03\x04", b"\x80\x04.", b"text"])
def test_what_is_no_array_is_refused(tmp_path, content):
    write_interhuman(tmp_path)
    (tmp_path / "person1" / "7.npy").write_bytes(content)
    with pytest.raises(FormatError, match="no array of numbers"):
        FORM.read(FORM.find(tmp_path)[0])


def test_a_header_that_claims_more_than_the_file_holds_costs_nothing(tmp_path):
    write_interhuman(tmp_path)
    file = tmp_path / "person1" / "7.npy"
    file.write_bytes(file.read_bytes().replace(b"(6, 70)", b"(999999999, 70)"))
    with pytest.raises(FormatError, match="no array of numbers"):
        FORM.read(FORM.find(tmp_path)[0])


def test_one_person_alone_is_listed_and_refused(tmp_path):
    write_interhuman(tmp_path)
    (tmp_path / "person2" / "7.npy").unlink()
    (sequence,) = FORM.find(tmp_path)
    assert sequence.name == "person1/7.npy"
    with pytest.raises(FormatError, match="no second person"):
        FORM.read(sequence)


@pytest.mark.parametrize("settings", [{"fps": 0.0, "up": "y"}, {"fps": 30.0, "up": "up"}])
def test_settings_that_make_no_sense_are_refused(settings):
    with pytest.raises(ValueError, match=r"fps|up"):
        InterHuman(**settings)
