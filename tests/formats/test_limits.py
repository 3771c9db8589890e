"""Truth: the limits that ``data.limits`` states, and files just beyond them."""

import os
import socket
import time
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from pacmo_core.data import limits
from pacmo_core.formats import mat
from pacmo_core.formats.base import Format, FormatError, RawSequence, Reading, read_capture
from pacmo_core.formats.registry import DEFAULT_SETTINGS, open_format
from tests.formats.valid_sets import bvh_text
from tests.strategies import make_interaction

SETTINGS = {**DEFAULT_SETTINGS, "bvh": {**DEFAULT_SETTINGS["bvh"], "unit": 1.0, "up": "y"}}
FORMATS = ("ntu", "sbu", "duetdance", "expi", "bvh", "cmu", "interhuman")
NAMES = {"duetdance": "male.mat", "interhuman": "x.npy", "cmu": "18_01.amc"}


def capture(name: str, folder: Path) -> RawSequence:
    file = folder / NAMES.get(name, "x.txt")
    return RawSequence("x", (file,) if name in ("ntu", "sbu", "expi") else (file, file))


def listen(path: Path) -> None:
    here = Path.cwd()
    os.chdir(path.parent)  # a socket's path has at most 107 bytes
    try:
        with socket.socket(socket.AF_UNIX) as server:
            server.bind(path.name)
    finally:
        os.chdir(here)


def sparse(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(2 << 30)


SPECIAL = {
    "a named pipe": os.mkfifo,
    "a socket": listen,
    "a device": lambda path: path.symlink_to("/dev/zero"),
    "a folder": Path.mkdir,
    "cannot be read: No such file": lambda path: path.symlink_to("nothing"),
    "wanted at most 128 MiB; got 2048 MiB": sparse,
}


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("reason", SPECIAL)
def test_what_is_no_file_or_too_large_is_refused_unopened(
    tmp_path: Path, name: str, reason: str
) -> None:
    sequence = capture(name, tmp_path)
    SPECIAL[reason](sequence.files[0])
    if name == "cmu":
        SPECIAL[reason](tmp_path / "18.asf")
    reader = open_format(name, SETTINGS[name])
    with pytest.raises(FormatError, match=reason):
        reader.read(sequence)  # by the reader alone, as in ``find``
    with pytest.raises(FormatError, match=reason):
        read_capture(reader, sequence)


class AnyFormat(Format):
    """A format that checks nothing."""

    def find(self, root: Path) -> list[RawSequence]:  # noqa: D102
        return []

    def read(self, sequence: RawSequence) -> Reading:  # noqa: D102
        return Reading(make_interaction(np.random.default_rng(0), 20))


def test_the_limits_hold_for_formats_that_check_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "x").write_text("x")
    sequence = RawSequence("x", (tmp_path / "x",))
    assert read_capture(AnyFormat(), sequence)
    monkeypatch.setattr(limits, "MAX_POSITIONS", 79)
    with pytest.raises(FormatError, match="at most 19 frames of 4 joints; got 20"):
        read_capture(AnyFormat(), sequence)


def test_a_short_text_of_many_joints_and_frames_is_refused_at_once(tmp_path: Path) -> None:
    head = "HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 1 Xposition\n"
    joints = "".join(f"JOINT j{i}\n{{\nOFFSET 0 0 0\nCHANNELS 0\n" for i in range(900))
    text = head + joints + "}" * 901 + "\nMOTION\nFrames: 60000\nFrame Time: 0.04\n" + "1\n" * 60000
    (tmp_path / "x_A.bvh").write_text(text)
    start = time.process_time()
    with pytest.raises(FormatError, match="wanted at most 492 frames of 901 joints; got 60000"):
        read_capture(open_format("bvh", SETTINGS["bvh"]), RawSequence("x", (tmp_path / "x_A.bvh",)))
    assert time.process_time() - start < 5


def test_too_many_lines_are_refused_by_their_number(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pacmo_core.formats.tables.MAX_LINES", 10)
    (tmp_path / "x.bvh").write_text(bvh_text(0))
    with pytest.raises(FormatError, match="wanted at most 10 lines"):
        open_format("bvh", SETTINGS["bvh"]).read(RawSequence("x", (tmp_path / "x.bvh",)))


@pytest.mark.parametrize("end", ["\n", "\r", "\r\n"])
def test_a_line_that_is_too_long_is_refused_before_it_becomes_words(
    tmp_path: Path, end: str
) -> None:
    text = f"HIERARCHY{end}ROOT a{end}{{{end}OFFSET" + " 0" * (1 << 20) + end
    (tmp_path / "x.bvh").write_bytes(text.encode())
    with pytest.raises(FormatError, match=r"x.bvh:4: wanted lines of at most 1048576 bytes"):
        open_format("bvh", SETTINGS["bvh"]).read(RawSequence("x", (tmp_path / "x.bvh",)))


def test_the_directory_of_a_mat_file_is_read_once_for_all_its_variables(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clips = {f"v{i}_1": np.full((3, 15, 3), i / 100) for i in range(60)}
    for sex in ("male", "female"):
        (tmp_path / sex).mkdir()
        savemat(tmp_path / sex / "salsa.mat", clips)
    heads = []
    real = mat._variable
    monkeypatch.setattr(mat, "_variable", lambda *words: heads.append(1) or real(*words))
    reader = open_format("duetdance", {"fps": 25.0})
    found = reader.find(tmp_path)
    first = [reader.read(sequence).interaction.person_a[0, 0, 0] for sequence in found]
    assert sorted(first) == pytest.approx([i / 100 for i in range(60)])
    assert len(heads) == 2 * 60


def test_a_mat_file_that_changes_is_read_again(tmp_path: Path) -> None:
    savemat(tmp_path / "x.mat", {"a": np.ones((2, 2))})
    assert mat.list_variables(tmp_path / "x.mat") == ["a"]
    savemat(tmp_path / "x.mat", {"bb": np.ones((20, 2))})
    assert mat.list_variables(tmp_path / "x.mat") == ["bb"]


def test_a_mat_file_of_too_many_variables_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mat, "MAX_VARIABLES", 3)
    savemat(tmp_path / "x.mat", {f"v{i}": np.ones((2, 2)) for i in range(4)})
    with pytest.raises(FormatError, match="wanted at most 3 variables"):
        mat.list_variables(tmp_path / "x.mat")


@pytest.mark.parametrize(
    ("old", "new"),
    [("OFFSET 0 0.5 0", "OFFSET 0 ٣ 0"), ("0.033333", "٠.٠٣"), (f"Frames: {6}", "Frames: ٦")],
)
def test_digits_of_other_scripts_are_refused(tmp_path: Path, old: str, new: str) -> None:
    text = bvh_text(0)
    assert old in text
    (tmp_path / "x.bvh").write_text(text.replace(old, new))
    with pytest.raises(FormatError, match="wanted a number"):
        open_format("bvh", SETTINGS["bvh"]).read(RawSequence("x", (tmp_path / "x.bvh",) * 2))


def test_control_characters_in_reasons_are_escaped_and_long_reasons_cut(tmp_path: Path) -> None:
    error = FormatError(tmp_path / "x", "got \x1b[2J\n\u202e" + "y" * 9000)
    assert error.reason.startswith(r"got \x1b[2J\n\u202e")
    assert error.reason.isprintable()
    assert len(error.reason) < 600
