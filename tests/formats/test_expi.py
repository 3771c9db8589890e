"""Truth: numbers that the test itself writes, after the published description."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pacmo_core.data.skeleton import EXPI18
from pacmo_core.formats.base import FormatError
from pacmo_core.formats.expi import Expi
from tests.formats.valid_sets import FRAMES, numbers, write_expi

FORM = Expi(fps=25.0, up="y")


def test_a_row_is_the_leader_then_the_follower_in_millimetres(tmp_path):
    write_expi(tmp_path / "ExPI")
    (sequence,) = FORM.find(tmp_path)
    assert (sequence.name, sequence.action) == ("ExPI/acro1/a-frame1", "a-frame")
    assert sequence.subjects == ("acro1-leader", "acro1-follower")
    assert sequence.recording == "acro1/a-frame1"
    interaction = FORM.read(sequence).interaction
    places = numbers(0, FRAMES, 108).reshape(FRAMES, 2, 18, 3)
    assert interaction.skeleton == EXPI18
    assert_allclose(interaction.times, np.arange(FRAMES) / 25)
    assert_allclose(interaction.person_a, places[:, 0], atol=1e-6)
    assert_allclose(interaction.person_b, places[:, 1], atol=1e-6)


def test_z_up_is_turned_to_y_up(tmp_path):
    write_expi(tmp_path)
    form = Expi(fps=25.0, up="z")
    x, y, z = np.moveaxis(numbers(0, FRAMES, 108).reshape(FRAMES, 2, 18, 3)[:, 0], -1, 0)
    turned = form.read(form.find(tmp_path)[0]).interaction.person_a
    assert_allclose(turned, np.stack((x, z, -y), -1), atol=1e-6)


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        (lambda lines: lines[1:], ":1: wanted a header of 108 names"),
        (lambda lines: [lines[0].replace(",", "\t"), *lines[1:]], ":1: wanted a header of 108"),
        (lambda lines: lines[:1], "wanted two frames or more; got 0"),
        (lambda lines: [*lines[:2], lines[2] + ",1"], ":3: wanted 108 numbers; got 109"),
        (lambda lines: [*lines[:2], "nan" + lines[2]], ":3: wanted a number; got 'nan"),
        (lambda lines: [*lines[:2], "," + lines[2][lines[2].index(",") + 1 :]], ":3: wanted a num"),
        (lambda lines: [*lines[:2], lines[2].replace(",", " ")], ":3: wanted 108 numbers; got 1"),
    ],
)
def test_a_faulty_file_is_refused_with_its_line_and_the_reason(tmp_path, fault, reason):
    write_expi(tmp_path)
    (sequence,) = FORM.find(tmp_path)
    lines = sequence.files[0].read_text().splitlines()
    sequence.files[0].write_text("\n".join(fault(lines)) + "\n")
    with pytest.raises(FormatError, match=reason):
        FORM.read(sequence)


def test_a_file_outside_the_published_folders_is_listed_with_its_path(tmp_path):
    (tmp_path / "notes.tsv").write_text("a\tb\n")
    (sequence,) = FORM.find(tmp_path)
    assert sequence.name == "notes.tsv"
    with pytest.raises(FormatError, match="wanted a header"):
        FORM.read(sequence)


@pytest.mark.parametrize("settings", [{"fps": -1.0, "up": "y"}, {"fps": 25.0, "up": "Z"}])
def test_settings_that_make_no_sense_are_refused(settings):
    with pytest.raises(ValueError, match=r"fps|up"):
        Expi(**settings)
