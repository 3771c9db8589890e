"""Truth: the motions that were written; NumPy's and Polars' own writers of faulty files."""

import io
import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from pacmo_core.data.skeleton import mirror_by_name
from pacmo_core.formats.base import FormatError, RawSequence, Reading
from pacmo_core.formats.resample import from_y_up
from pacmo_core.formats.sbu import Sbu
from pacmo_core.formats.table import Table
from pacmo_core.formats.write_tables import TABLE_WRITERS, JointTable
from pacmo_core.store.motions import write_motions
from tests.figures.samples import interaction
from tests.formats.real_files import real_folder
from tests.formats.rigged import people

SEEN = interaction(1)
SKELETON = SEEN.skeleton
UNEVEN = SEEN.times + np.random.default_rng(0).uniform(0, 0.01, len(SEEN.times))
SUFFIXES = pytest.mark.parametrize("suffix", TABLE_WRITERS)
ARRAYS: dict[str, Any] = {
    "joints": np.array(["hips", "left_foot", "right_foot"]),
    "parents": np.array([-1, 0, 0]),
    "fps": 30.0,
    "unit": 0.0005,
    "up": "z",
    "person_a": np.arange(36, dtype=np.int16).reshape(4, 3, 3),
    "person_b": np.arange(36, dtype=np.int16).reshape(4, 3, 3) + 2000,
    "of_another_program": np.array([{"not": "ours"}], dtype=object),
}
CSV = """# fps: 30
# unit: 0.01
# up: y
# parents: -1 0
label,time,person_a.hip.x,person_a.hip.y,person_a.hip.z,person_a.foot.x,person_a.foot.y,person_a.foot.z,\
person_b.foot.x,person_b.foot.y,person_b.foot.z,person_b.hip.x,person_b.hip.y,person_b.hip.z
"a, b",0,1,2,3,4,5,6,7,8,9,10,11,12
c,0.0333333,1,2,3,4,5,6,7,8,9,10,11,12
"""


FACTS = {"fps": "30", "unit": "1", "up": "y", "parents": "-1"}


def read(file: Path, **settings: Any) -> Reading:
    return Table(**settings).read(RawSequence("one", (file,)))


def npz(folder: Path, **changes: Any) -> Path:
    """Write ``ARRAYS`` with changes; None leaves an array out."""
    arrays = {name: array for name, array in (ARRAYS | changes).items() if array is not None}
    np.savez(folder / "one.npz", allow_pickle=True, **arrays)
    return folder / "one.npz"


def parquet(folder: Path, table: pl.DataFrame) -> Path:
    table.write_parquet(folder / "one.parquet", metadata=FACTS)
    return folder / "one.parquet"


def refused(file: Path, *texts: str, **settings: Any) -> None:
    with pytest.raises(FormatError) as caught:
        read(file, **settings)
    said = str(caught.value)
    assert said.startswith(str(file)) and said.isprintable()
    for text in texts:
        assert text in said


@SUFFIXES
@pytest.mark.parametrize(("up", "unit"), [("y", 1.0), ("z", 0.01), ("z", 0.0254), ("y", 0.001)])
@pytest.mark.parametrize("times", [SEEN.times, UNEVEN], ids=["even", "uneven"])
def test_what_is_written_is_read_within_a_micrometre(
    tmp_path: Path, suffix: str, up: str, unit: float, times: np.ndarray
) -> None:
    people = [(from_y_up(m, up) / unit).astype(np.float32) for m in (SEEN.person_a, SEEN.person_b)]
    file = tmp_path / f"one{suffix}"
    file.write_bytes(TABLE_WRITERS[suffix](JointTable(SKELETON, times, people, up, unit)))
    back = read(file).interaction
    assert back.skeleton.joints == SKELETON.joints
    assert back.skeleton.parents == SKELETON.parents
    assert back.skeleton.left_right == mirror_by_name(SKELETON.joints)
    np.testing.assert_allclose(back.times, times - times[0], atol=2e-9)
    np.testing.assert_allclose(back.person_a, SEEN.person_a, atol=1e-6)
    np.testing.assert_allclose(back.person_b, SEEN.person_b, atol=1e-6)


def test_integers_times_the_unit_are_metres_and_further_arrays_are_not_opened(
    tmp_path: Path,
) -> None:
    back = read(npz(tmp_path)).interaction
    x, y, z = np.moveaxis(ARRAYS["person_b"] * 0.0005, -1, 0)
    np.testing.assert_allclose(back.person_b, np.stack([x, z, -y], axis=-1), atol=1e-6)
    np.testing.assert_allclose(back.times, np.arange(4) / 30)


def test_settings_state_what_the_file_does_not_or_replace_it(tmp_path: Path) -> None:
    file = npz(tmp_path, unit=None, up=None, fps=None)
    back = read(file, unit=0.001, up="y", fps=60.0).interaction
    np.testing.assert_allclose(back.person_a, ARRAYS["person_a"] * 0.001, atol=1e-6)
    assert back.fps == pytest.approx(60)
    assert read(npz(tmp_path), fps=15.0).interaction.fps == pytest.approx(15)
    for fault in ({"unit": 0.0}, {"up": "x"}, {"fps": -1.0}, {"object": "no"}):
        with pytest.raises(ValueError, match="must be"):
            Table(**fault)


def test_an_object_is_a_joint_of_who_holds_it(tmp_path: Path) -> None:
    place = np.array([[200, -400, 500]] * 4, np.int16)
    file = npz(tmp_path, object=place)
    assert read(file).interaction.skeleton.joints == ("hips", "left_foot", "right_foot")
    back = read(file, object=True).interaction
    assert back.skeleton.joints == ("hips", "left_foot", "right_foot", "object")
    assert back.skeleton.parents == (-1, 0, 0, 0)
    np.testing.assert_allclose(back.person_a[:, 3], [[0.1, 0.25, 0.2]] * 4, atol=1e-6)
    np.testing.assert_array_equal(back.person_b[:, 3], back.person_b[:, 0])
    np.testing.assert_array_equal(back.person_a[:, :3], read(file).interaction.person_a)
    turned = npz(tmp_path, object=place, parents=np.array([2, 2, -1]))
    other = read(turned, object=True).interaction
    assert other.skeleton.parents == (2, 2, -1, 2)
    np.testing.assert_array_equal(other.person_b[:, 3], other.person_b[:, 2])
    alone = Table(object=True).read_single(npz(tmp_path, object=place, person_b=None))
    assert alone is not None
    np.testing.assert_array_equal(alone[2], back.person_a)


def test_an_object_that_is_not_there_is_refused(tmp_path: Path) -> None:
    refused(npz(tmp_path), "no object: wanted (T, 3) in an NPZ file; got joints", object=True)
    wrong = npz(tmp_path, object=np.zeros((4, 2)))
    refused(wrong, "object: wanted (4, 3) numbers; got (4, 2) of float64", object=True)
    far = npz(tmp_path, object=np.full((4, 3), 9000.0))
    refused(far, "object: 7.79 m from the nearest hand at first: wanted at most 1 m", object=True)
    nowhere = npz(tmp_path, object=np.full((4, 3), np.nan))
    refused(nowhere, "person_a: frame 0, joint object is not finite", object=True)
    file = tmp_path / "one.csv"
    file.write_text(CSV)
    refused(file, "no object: wanted (T, 3) in an NPZ file", object=True)
    names = np.array(["hips", "object", "foot"])
    refused(npz(tmp_path, joints=names, object=np.zeros((4, 3))), "already", object=True)


@pytest.mark.parametrize("name", ["joints", "parents", "unit", "up", "person_a", "person_b"])
def test_a_missing_array_is_named_with_those_that_are_there(tmp_path: Path, name: str) -> None:
    refused(npz(tmp_path, **{name: None}), f"no {name}: wanted joints, parents", "; got ")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"fps": None}, "neither fps nor times"),
        ({"fps": 0.0}, "fps must be"),
        ({"fps": np.nan}, "fps must be"),
        ({"fps": np.ones(4)}, "fps: wanted a number; got (4,)"),
        ({"times": np.arange(4) / 20}, "fps is 30, but times give 20"),
        ({"times": np.zeros(4)}, "times: wanted seconds that increase"),
        ({"times": np.array([0, 1, np.nan, 3])}, "times: wanted seconds that increase"),
        ({"times": np.arange(3) / 30}, "each of 4 frames; got (3,)"),
        ({"times": np.arange(4) * 1e6, "fps": None}, "times: fps must be"),
        ({"unit": 0.0}, "unit must be"),
        ({"unit": np.inf}, "unit must be"),
        ({"unit": "feet"}, "unit: wanted metres per unit, or m, cm, mm, in, "),
        ({"unit": np.array(["mm", "cm"])}, "unit: wanted text; got (2,)"),
        ({"unit": 1000.0}, "at most 1000 m"),
        ({"up": "x"}, "up must be one of ('y', 'z'); got 'x'"),
        ({"up": 1}, "up: wanted text"),
        ({"joints": np.array(["a", "b", "a"])}, "joints: 'a' is the name of two"),
        ({"joints": np.array(["a", "b\n", "c"])}, "joints: wanted printable names; got 'b\\n'"),
        ({"joints": np.arange(3)}, "joints: wanted 1 to 1000 names"),
        ({"joints": np.array(["a"] * 3, dtype=object)}, "pickled"),
        ({"parents": np.array([-1, 2, 1])}, "must form one tree"),
        ({"parents": np.array([-1, -1, 0])}, "must form one tree"),
        ({"parents": np.array([-1, 0, 9])}, "must form one tree"),
        ({"parents": np.array([-1, 0])}, "an integer for each of 3 joints"),
        ({"parents": np.array([-1.0, 0, 0.5])}, "an integer for each of 3 joints"),
        ({"parents": np.array([np.nan, 0, 0])}, "an integer for each of 3 joints"),
        ({"parents": np.array([0, 1, 1])}, "counted from 1, as in MATLAB: wanted parents - 1"),
        ({"parents": np.array([-1, 1, 1])}, "counted from 1, as in MATLAB: wanted parents - 1"),
        ({"parents": np.array([[0.0], [1.0], [1.0]])}, "counted from 1, as in MATLAB"),
        ({"parents": np.array([0, 0, 0])}, "'hips' is its own parent: wanted -1 for the root"),
        ({"person_a": np.zeros((4, 2, 3))}, "person_a: wanted (T, 3, 3)"),
        ({"person_a": np.float64(1)}, "person_a: wanted (T, 3, 3)"),
        ({"person_b": np.zeros((5, 3, 3))}, "person_b: wanted (T, 3, 3)"),
        ({"person_b": np.full((4, 3, 3), np.nan)}, "person_b: frame 0, joint hips is not finite"),
        ({"person_b": np.zeros((4, 3, 3), complex)}, "complex128"),
        ({"person_a": np.zeros((1, 3, 3)), "person_b": np.zeros((1, 3, 3))}, "two frames or more"),
    ],
)
def test_what_an_npz_states_wrongly_is_said(
    tmp_path: Path, changes: dict[str, Any], said: str
) -> None:
    refused(npz(tmp_path, **changes), said)


def header_only(file: Path, shape: str, dtype: str = "<f8") -> Path:
    """Write an NPZ whose person_a is a header without numbers."""
    text = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    with zipfile.ZipFile(file, "w") as archive:
        for name in ("joints", "parents", "up", "unit", "fps"):
            written = io.BytesIO()
            np.save(written, np.array(ARRAYS[name]))
            archive.writestr(f"{name}.npy", written.getvalue())
        header = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text
        archive.writestr("person_a.npy", header)
    return file


def test_an_array_larger_than_any_capture_is_refused_before_it_is_unpacked(
    tmp_path: Path,
) -> None:
    file = tmp_path / "one.npz"
    refused(header_only(file, "(1000000000, 3, 3)"), "person_a: (1000000000, 3, 3) of float64")
    refused(header_only(file, "(-4, 3, 3)"), "person_a: (-4, 3, 3)")
    refused(header_only(file, "(4, 3, 3)"), "person_a: no array")
    refused(header_only(file, "(4, 3, 3)", "O"), "pickled")


@pytest.mark.parametrize("suffix", [".npz", ".parquet"])
def test_a_file_of_something_else_is_refused(tmp_path: Path, suffix: str) -> None:
    file = tmp_path / f"one{suffix}"
    file.write_bytes(b"nothing of the kind" * 100)
    refused(file, "no NPZ file" if suffix == ".npz" else "not a complete Parquet file")
    with zipfile.ZipFile(tmp_path / "other.npz", "w") as archive:
        archive.writestr("readme.txt", "nothing")
    refused(tmp_path / "other.npz", "no joints", "got none")


def test_a_csv_of_text_columns_and_joints_in_another_order_is_read(tmp_path: Path) -> None:
    file = tmp_path / "one.csv"
    # As a spreadsheet writes it: a mark at the start, lines filled up with commas, CRLF.
    rows = CSV.replace("# up: y", "# up: y,,,,").replace("\n", "\r\n")
    file.write_bytes(b"\xef\xbb\xbf" + rows.encode())
    back = read(file).interaction
    assert back.skeleton.joints == ("hip", "foot")
    np.testing.assert_allclose(back.person_a[0], [[0.01, 0.02, 0.03], [0.04, 0.05, 0.06]])
    np.testing.assert_allclose(back.person_b[0], [[0.1, 0.11, 0.12], [0.07, 0.08, 0.09]])


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("# up: y\n", "", "no up: wanted"),
        ("# up: y\n", "# up: y\n# up: z\n", ":4: up comes twice"),
        ("# fps: 30", "# fps: fast", "fps: wanted a number; got 'fast'"),
        ("# fps: 30", "# fps: ٣", "fps: wanted a number"),
        ("# parents: -1 0", "# parents: hip 0", "parents: wanted indices"),
        ("person_b.hip.z", "person_b.hip.y", "the column 'person_b.hip.y' comes twice"),
        ("person_b.hip.z", "person_b.hip.w", "the column 'person_b.hip.w': wanted person_b.JOINT"),
        ("person_b.hip.z", "person_b.z", "the column 'person_b.z': wanted"),
        ("person_b.hip.z", "label2", "no column 'person_b.hip.z'"),
        ("person_b.hip.", "person_b.head.", "only one person has the joint"),
        ("10,11,12\nc", "10,11,twelve\nc", ":6: wanted a number; got 'twelve'"),
        ("10,11,12\nc", "10,11,nan\nc", ":6: wanted a number"),
        ("10,11,12\nc", "10,11\nc", ":6: wanted 14 values; got 13"),
        ('"a, b"', '"a, b', ":6: no comma-separated values"),
        ("\nc,0.0333333", "\nc,0", "times: wanted seconds that increase"),
        ("label,", "person_c.hip.x,", "columns of person_c: wanted those of person_a and person_b"),
        ("label,", "Person_A.hip.x,", "columns of Person_A: wanted those of person_a and person_b"),
    ],
)
def test_what_a_csv_states_wrongly_is_said(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert old in CSV
    (tmp_path / "one.csv").write_text(CSV.replace(old, new), encoding="utf-8")
    refused(tmp_path / "one.csv", said)


@pytest.mark.parametrize(("separator", "name"), [(";", "semicolons"), ("\t", "tabs")])
def test_other_separators_than_commas_are_named(tmp_path: Path, separator: str, name: str) -> None:
    (tmp_path / "one.csv").write_text(CSV.replace('"a, b"', "a").replace(",", separator))
    refused(tmp_path / "one.csv", f":5: columns separated by {name}: wanted commas")


def test_without_times_no_frame_may_be_missing(tmp_path: Path) -> None:
    file = tmp_path / "one.csv"
    counted = CSV.replace("label,time", "label,frame").replace('"a, b",0,', "a,7,")
    file.write_text(counted.replace("c,0.0333333", "c,8"))
    assert len(read(file).interaction.times) == 2
    file.write_text(counted.replace("c,0.0333333", "c,10"))
    refused(file, "the column frame goes from 7 to 10: wanted every frame, or a column time")
    file.write_text(CSV.replace("label", "frame"))  # whose words say nothing beside times
    assert len(read(file).interaction.times) == 2


def test_a_csv_of_remarks_alone_is_refused(tmp_path: Path) -> None:
    (tmp_path / "one.csv").write_text("# fps: 30\n# unit: 1\n")
    refused(tmp_path / "one.csv", "names of the columns")


COORDINATES = {f"person_{p}.hip.{axis}": [1.0, 2.0] for p in "ab" for axis in "xyz"}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"person_b.hip.x": ["1", "2"]}, "'person_b.hip.x': wanted a column of numbers"),
        ({"person_b.hip.x": [[1.0], [2.0]]}, "'person_b.hip.x': wanted a column of numbers"),
        ({"person_b.hip.x": [1.0, None]}, "'person_b.hip.x': a row has no value"),
        ({"person_b.hip.x": [1.0, np.nan]}, "person_b: frame 1, joint hip is not finite"),
    ],
)
def test_what_a_parquet_states_wrongly_is_said(
    tmp_path: Path, change: dict[str, Any], said: str
) -> None:
    further = {"note": ["a", "b"]}
    assert read(parquet(tmp_path, pl.DataFrame(COORDINATES | further))).interaction.fps == 30
    refused(parquet(tmp_path, pl.DataFrame(COORDINATES | change)), said)


def test_a_parquet_of_several_row_groups_is_read_whole(tmp_path: Path) -> None:
    table = pl.DataFrame({name: np.arange(50.0) for name in COORDINATES})
    table.write_parquet(tmp_path / "one.parquet", metadata=FACTS, row_group_size=7)
    assert len(read(tmp_path / "one.parquet").interaction.times) == 50


def test_a_file_of_clips_is_no_table(tmp_path: Path) -> None:
    with write_motions(tmp_path / "one.parquet", SKELETON) as writer:
        writer.add("one", SEEN)
    refused(tmp_path / "one.parquet", "a file of clips")


def test_files_are_found_by_their_names_in_every_folder(tmp_path: Path) -> None:
    for name in ("a.npz", "b/a.csv", "b/c.parquet", "b/c.npz", "captures.csv", "b/captures.csv"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    found = Table().find(tmp_path)
    names = ["a", "b/a", "b/c.npz", "b/c.parquet", "b/captures"]
    assert [sequence.name for sequence in found] == names
    assert [sequence.recording for sequence in found] == names


def test_a_table_of_one_person_is_that_persons(tmp_path: Path) -> None:
    single = Table().read_single(npz(tmp_path, person_b=None))
    assert single is not None
    skeleton, times, motion = single
    assert skeleton.joints == ("hips", "left_foot", "right_foot")
    assert times.shape == (4,) and motion.shape == (4, 3, 3)
    assert Table().read_single(npz(tmp_path)) is None


def test_recorded_handovers_are_read() -> None:
    folder = real_folder("handover")
    found = Table().find(folder)
    assert len(found) == 200
    back = Table().read(found[0]).interaction
    assert (len(back.skeleton.joints), back.fps) == (34, pytest.approx(30))
    # z up in the file: the heads are above the feet.
    head, foot = (back.skeleton.joints.index(name) for name in ("head", "left_foot"))
    for motion in (back.person_a, back.person_b):
        assert 1.2 < np.median(motion[:, head, 1] - motion[:, foot, 1]) < 2.0


@SUFFIXES
def test_a_table_is_written_the_same_twice(suffix: str) -> None:
    table = JointTable(SKELETON, SEEN.times, [SEEN.person_a, SEEN.person_b], "y", 1.0)
    assert TABLE_WRITERS[suffix](table) == TABLE_WRITERS[suffix](table)


@pytest.mark.parametrize(("unit", "metres"), [("mm", 0.001), (["CM"], 0.01), ("inches", 0.0254)])
def test_a_unit_may_be_a_word_and_parents_a_matrix_of_real_numbers(
    tmp_path: Path, unit: object, metres: float
) -> None:
    """As ``scipy.io.loadmat`` returns the text and the vector of a MATLAB file."""
    file = npz(tmp_path, unit=np.array(unit), up="y", parents=np.array([[-1.0, 0.0, 0.0]]))
    back = read(file).interaction
    np.testing.assert_allclose(back.person_a, ARRAYS["person_a"] * metres, atol=1e-6)
    assert back.skeleton.parents == (-1, 0, 0)


def test_a_unit_may_be_a_word_in_csv_and_parquet(tmp_path: Path) -> None:
    (tmp_path / "one.csv").write_text(CSV.replace("unit: 0.01", "unit: cm"))
    (tmp_path / "two.csv").write_text(CSV)
    a, b = (read(tmp_path / name).interaction for name in ("one.csv", "two.csv"))
    np.testing.assert_array_equal(a.person_a, b.person_a)


def matrix_of(layout: str) -> np.ndarray:
    """Return a matrix of a person with a row a frame."""
    motion = people().person_a
    if layout == "blocks":
        return motion.transpose(0, 2, 1).reshape(len(motion), -1)
    return motion.reshape(len(motion), -1)


@pytest.mark.parametrize(
    ("layout", "said"),
    [
        ("blocks", "if the coordinates of a frame are all x, all y, all z: wanted array.reshape("),
        ("interleaved", "x y z of joint after joint: wanted array.reshape(T, J, 3)"),
    ],
)
def test_coordinates_in_another_layout_are_refused_with_the_right_one(
    tmp_path: Path, layout: str, said: str
) -> None:
    matrix, body = matrix_of(layout), people().skeleton
    n_joints = len(body.joints)
    wrong = (
        matrix.reshape(-1, n_joints, 3)
        if layout == "blocks"
        else matrix.reshape(-1, 3, n_joints).transpose(0, 2, 1)
    )
    facts = {"joints": body.joints, "parents": body.parents, "fps": 30, "up": "y"}
    np.savez(tmp_path / "x.npz", person_a=wrong, person_b=wrong, unit=1.0, **facts)
    refused(tmp_path / "x.npz", "person_a: bones of no body, but of one ", said)


def test_recorded_people_are_bodies_in_their_own_layout_alone(tmp_path: Path) -> None:
    for file in sorted(real_folder("handover").glob("*.npz"))[::20]:
        arrays = dict(np.load(file))
        assert len(read(file).interaction.times) == len(arrays["person_a"])
        n_frames, n_joints, _ = arrays["person_a"].shape
        for name in ("person_a", "person_b"):
            arrays[name] = arrays[name].transpose(0, 2, 1).reshape(n_frames, n_joints, 3)
        np.savez(tmp_path / "x.npz", **arrays)
        refused(tmp_path / "x.npz", "person_a: bones of no body", "reshape(T, 3, J)")


def test_recorded_people_of_a_noisy_sensor_are_bodies_too(tmp_path: Path) -> None:
    reader = Sbu(fps=15)
    for sequence in reader.find(real_folder("sbu"))[::12]:
        clip = reader.read(sequence).interaction
        facts = {"joints": clip.skeleton.joints, "parents": clip.skeleton.parents, "fps": 15}
        people = {"person_a": clip.person_a, "person_b": clip.person_b}
        np.savez(tmp_path / "x.npz", **facts, **people, unit=1.0, up="y")
        assert len(read(tmp_path / "x.npz").interaction.times) == len(clip.times)


def test_a_missing_unit_is_said_with_the_one_that_makes_a_person(tmp_path: Path) -> None:
    clip = people()
    facts = {"joints": clip.skeleton.joints, "parents": clip.skeleton.parents, "fps": 30}
    motions = {"person_a": 1000 * clip.person_a, "person_b": 1000 * clip.person_b}
    np.savez(tmp_path / "x.npz", **facts, **motions, up="y")
    refused(tmp_path / "x.npz", "no unit: wanted ", "; unit 0.001 would make a person of 1.")
