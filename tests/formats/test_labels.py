"""Truth: the lines of captures.csv, over the names that each format gives by itself."""

from pathlib import Path
from typing import Any

import pytest

from pacmo_core.formats.base import FormatError, RawSequence
from pacmo_core.formats.labels import find_sequences
from pacmo_core.formats.registry import open_format
from tests.formats.valid_readers import VALID_SETS
from tests.formats.valid_sets import write_bvh_pair, write_tables

BVH = {
    "preset": "pair", "unit": 1.0, "up": "y", "fps": None, "end_sites": False, "skip_frames": 0,
    "max_root_distance": None,
}  # fmt: skip
HEADER = "file,action,person_a,person_b,recording"


def labelled(folder: Path, name: str, settings: dict[str, Any], *lines: str) -> list[RawSequence]:
    (folder / "captures.csv").write_text("\n".join([HEADER, *lines]) + "\n", encoding="utf-8")
    return find_sequences(open_format(name, settings), folder)


@pytest.fixture
def pairs(tmp_path: Path) -> Path:
    write_bvh_pair(tmp_path)
    return tmp_path


def refused(folder: Path, *texts: str) -> None:
    with pytest.raises(FormatError) as caught:
        find_sequences(open_format("bvh", BVH), folder)
    said = str(caught.value)
    assert said.startswith(str(folder / "captures.csv")) and said.isprintable()
    for text in texts:
        assert text in said


@pytest.mark.parametrize("file", ["wave_A.bvh", "wave_B.bvh"])
def test_either_file_of_a_pair_names_it(pairs: Path, file: str) -> None:
    (found,) = labelled(pairs, "bvh", BVH, f'{file},"wave, both hands",anna,ben,monday')
    assert (found.name, found.action) == ("wave", "wave, both hands")
    assert (found.subjects, found.recording) == (("anna", "ben"), "monday")


def test_what_a_line_leaves_empty_stays_as_it_was(pairs: Path) -> None:
    (found,) = labelled(pairs, "bvh", BVH, "wave_A.bvh,wave,,,")
    assert (found.action, found.subjects, found.recording) == ("wave", ("", ""), "wave")


def test_tables_are_named_one_by_one_and_the_rest_keeps_its_names(tmp_path: Path) -> None:
    write_tables(tmp_path)
    found = labelled(tmp_path, "table", {}, "", "take2.parquet,hug,anna,,r", ",,,,")
    assert [(s.action, s.subjects, s.recording) for s in found] == [
        ("", ("", ""), "take0"), ("", ("", ""), "take1"), ("hug", ("anna", ""), "r"),
    ]  # fmt: skip


@pytest.mark.parametrize("name", VALID_SETS)
def test_every_format_takes_the_table(tmp_path: Path, name: str) -> None:
    write, form = VALID_SETS[name]
    write(tmp_path)
    first = form.find(tmp_path)[0]
    path = first.files[0].relative_to(tmp_path).as_posix()
    (tmp_path / "captures.csv").write_text(f"{HEADER}\n{path},embrace,anna,ben,monday\n")
    found = {sequence.name: sequence for sequence in find_sequences(form, tmp_path)}
    assert found.keys() == {sequence.name for sequence in form.find(tmp_path)}
    own = found[first.name]
    assert (own.action, own.subjects, own.recording) == ("embrace", ("anna", "ben"), "monday")


def test_the_names_of_files_are_what_a_line_may_correct(tmp_path: Path) -> None:
    write, form = VALID_SETS["expi"]
    write(tmp_path)
    (tmp_path / "captures.csv").write_text(f"{HEADER}\nacro1/a-frame1/mocap_cleaned.tsv,,x,,\n")
    (found,) = find_sequences(form, tmp_path)
    assert (found.action, found.subjects) == ("a-frame", ("x", "acro1-follower"))


def test_columns_may_be_in_any_order_and_more_and_recording_is_optional(pairs: Path) -> None:
    text = "\ufeffcamera,person_b,person_a,action,file\r\n7,ben,anna,wave,wave_A.bvh\r\n"
    (pairs / "captures.csv").write_bytes(text.encode())
    (found,) = find_sequences(open_format("bvh", BVH), pairs)
    assert (found.action, found.subjects) == ("wave", ("anna", "ben"))
    assert found.recording == "wave"


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ([HEADER, "nod_A.bvh,nod,,,"], ":2: 'nod_A.bvh' is the file of no capture"),
        ([HEADER, "../wave_A.bvh,nod,,,"], ":2: '../wave_A.bvh' is the file of no capture"),
        ([HEADER, "", "wave_A.bvh,x,,,", "wave_A.bvh,x,,,"], ":4: 'wave_A.bvh' is of the capture"),
        ([HEADER, "wave_A.bvh,x,,,", "wave_B.bvh,x,,,"], "of the capture of line 2"),
        ([HEADER, "wave_A.bvh,x"], ":2: wanted 5 cells; got 2"),
        ([HEADER, ",x,a,b,"], ":2: no file"),
        ([HEADER, '"wave_A.bvh,x,,,'], ":2: no comma-separated values"),
        ([HEADER, "wave_A.bvh,x\x07,,,"], r"wanted printable text; got 'x\x07'"),
        (["file,action"], ":1: wanted the columns file, action, person_a, person_b; person_a, pe"),
        (["file,file,action,person_a,person_b"], ":1: the column file comes twice"),
        ([], "the file is empty"),
    ],
)
def test_a_faulty_table_is_one_line_with_its_line(pairs: Path, lines: list[str], said: str) -> None:
    (pairs / "captures.csv").write_text("\n".join(lines))
    refused(pairs, said)
