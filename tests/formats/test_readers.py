"""Truth: the contract of a raw format, held against every reader of files with two people."""

import numpy as np
import pytest

from pacmo_core.formats.base import FormatError
from tests.formats.valid_readers import VALID_SETS
from tests.formats.valid_sets import FRAMES

EACH = pytest.mark.parametrize("name", VALID_SETS)


@EACH
def test_a_valid_set_is_found_in_order_and_read(tmp_path, name):
    write, form = VALID_SETS[name]
    write(tmp_path)
    sequences = form.find(tmp_path)
    assert sequences
    assert [s.name for s in sequences] == sorted({s.name for s in sequences})
    for sequence in sequences:
        reading = form.read(sequence)
        assert len(reading.interaction.times) >= FRAMES
        assert reading.filled_frames == 0
        assert not np.array_equal(reading.interaction.person_a, reading.interaction.person_b)


@EACH
def test_reading_twice_gives_the_same_bytes(tmp_path, name):
    write, form = VALID_SETS[name]
    write(tmp_path)
    once, twice = (form.read(form.find(tmp_path)[0]).interaction for _ in range(2))
    assert once.person_a.tobytes() == twice.person_a.tobytes()
    assert once.person_b.tobytes() == twice.person_b.tobytes()


@EACH
def test_an_empty_folder_holds_nothing(tmp_path, name):
    assert VALID_SETS[name][1].find(tmp_path) == []


@EACH
def test_each_file_emptied_or_cut_is_refused_by_name(tmp_path, name):
    write, form = VALID_SETS[name]
    write(tmp_path)
    (sequence, *_) = form.find(tmp_path)
    for file in sequence.files:
        whole = file.read_bytes()
        for part in (b"", whole[: len(whole) // 3], whole[:-30]):
            file.write_bytes(part)
            with pytest.raises(FormatError) as caught:
                form.read(sequence)
            assert file.name in str(caught.value)
        file.write_bytes(whole)
