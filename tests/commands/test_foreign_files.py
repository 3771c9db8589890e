"""Truth: the folder that ``--out`` names, and one line on stderr with exit code 1."""

import json
import os
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from pacmo_core.commands.captures import OutputSpace, TwoPersonCapture, write_two_people
from pacmo_core.commands.cli import app
from pacmo_core.commands.react_files import Reactions, write_reactions
from pacmo_core.data.interaction import Interaction
from pacmo_core.data.names import file_stem
from pacmo_core.data.skeleton import SBU15
from pacmo_core.formats.registry import select_person
from pacmo_core.formats.write_bvh import format_bvh
from pacmo_core.project.workspace import CommandError, one_line
from pacmo_core.store.motions import write_motions
from pacmo_core.store.tables import QuarantineRecord, write_rows
from tests.commands.test_react import weights  # noqa: F401  # a fixture
from tests.reaction.problems import delayed_mirror

ROOT = Path(__file__).parents[2]
CLIP = delayed_mirror(1, np.arange(40) / 15)
NAMES = ["/tmp/x", "../../x", "..", ".", "a/../../b", "x" * 400, "a\0b", "\x1b[31m", "é" * 200]


def pacmo(*words: object) -> Result:
    return CliRunner().invoke(app, list(map(str, words)))


def refused(result: Result, *texts: str) -> None:
    assert result.exit_code == 1, result.output
    assert result.stderr.count("\n") == 1
    assert result.stderr.strip("\n").isprintable()
    for text in texts:
        assert text in result.stderr


@pytest.fixture
def stored(tmp_path: Path) -> Path:
    with write_motions(tmp_path / "motions.parquet", SBU15) as writer:
        writer.add("one", CLIP)
    return tmp_path / "motions.parquet"


@pytest.mark.parametrize("name", NAMES)
def test_a_name_is_one_part_of_a_path(name: str) -> None:
    stem = file_stem(name)
    assert Path(stem).parts == (stem,)
    assert stem.isprintable()
    assert stem not in (".", "..")
    assert len(stem.encode()) < 200


@pytest.mark.parametrize("name", NAMES)
def test_reactions_to_a_clip_of_any_name_stay_in_the_folder(tmp_path: Path, name: str) -> None:
    out = tmp_path / "one" / "two" / "out"
    samples = CLIP.person_b[None]
    written = write_reactions(
        Reactions(name, SBU15, CLIP.times, CLIP.person_a, samples), out, OutputSpace()
    )
    assert {file.resolve().parent for file in written.files} == {out.resolve()}
    assert sorted(path for path in tmp_path.rglob("*") if path.is_file()) == sorted(written.files)


@pytest.mark.parametrize("name", NAMES)
def test_variations_of_a_clip_of_any_name_stay_in_the_folder(tmp_path: Path, name: str) -> None:
    out = tmp_path / "one" / "two" / "out"
    a, b = (select_person(CLIP, person, name) for person in "ab")
    duo = TwoPersonCapture(name, (tmp_path / "motions.parquet",), ({}, {}), (a, b), (a, b))
    ones = np.ones(len(SBU15.bones))
    files = write_two_people(duo, (ones, ones), "label", out).files
    assert {file.resolve().parent for file in files} == {out.resolve()}


@pytest.mark.parametrize("fps", ["inf", "nan", "1e300", "0", "-1"])
def test_a_rate_of_frames_that_is_none_is_refused(
    weights: Path,  # noqa: F811
    stored: Path,
    fps: str,
) -> None:
    words = ("react", stored, "--clip", "one", "--person", "a", "--weights", weights)
    refused(pacmo(*words, "--out", stored.parent / "x.parquet", "--to-fps", fps), "fps must be")


def test_more_samples_or_frames_than_fit_are_refused(
    weights: Path,  # noqa: F811
    stored: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    words = ("react", stored, "--clip", "one", "--person", "a", "--weights", weights)
    words = (*words, "--out", stored.parent / "x.parquet", "--samples")
    refused(pacmo(*words, 10**9), "--samples must be 1 to 1000; got 1000000000")
    monkeypatch.setattr("pacmo_core.commands.react.MAX_POSITIONS", 300)
    refused(pacmo(*words, 9), "got 9 x 40")
    refused(pacmo("vary", stored, "--clip", "one", "--out", "x", "--samples", 10**9), "1 to 1000")


def test_an_export_of_more_frames_than_fit_is_refused(stored: Path) -> None:
    times = np.arange(40) * 9.9
    long = Interaction(SBU15, times, CLIP.person_a, CLIP.person_b)
    with write_motions(stored, SBU15) as writer:
        writer.add("one", long)
    result = pacmo("export", f"{stored}:one", "--out", stored.parent / "x.csv", "--to-fps", 9999)
    refused(result, "--to-fps", "frames of 15 joints")


@pytest.mark.parametrize(
    "line",
    [
        '{"time": "1", "pose": []}',
        '{"time": 0, "pose": [["1"]]}',
        '{"time": 0, "pose": ' + "[" * 100_000,
        '{"time": 0, "pose": [[1e400, 0, 0]]}',
        '{"time": ' + "9" * 400 + ', "pose": [[0, 0, 0]]}',
        "0 " + "٣ " * 45,
        "0 " + "1_0 " * 45,
    ],
)
def test_a_frame_that_is_none_is_refused_with_its_line(
    weights: Path,  # noqa: F811
    line: str,
) -> None:
    words = ["react", "--stream", "--weights", str(weights)]
    result = CliRunner().invoke(app, words, input=f"{line}\n")
    assert result.exit_code == 1, result.output
    assert result.stderr.splitlines()[-1].startswith("pacmo: line 1: ")


def test_null_in_json_is_a_joint_that_was_not_tracked(weights: Path) -> None:  # noqa: F811
    poses = [pose.tolist() for pose in CLIP.person_a[:2]]
    poses[1][3][:2] = None, 0  # an integer beside it
    words = ["react", "--stream", "--weights", str(weights)]
    text = "".join(
        json.dumps({"time": i / 15, "pose": pose}) + "\n" for i, pose in enumerate(poses)
    )
    result = CliRunner().invoke(app, words, input=text)
    assert result.exit_code == 0, result.output
    assert "line 2: a pose must be of finite numbers" in result.stderr
    first, second = (json.loads(line)["reactions"] for line in result.stdout.splitlines())
    assert first == second


def test_a_stream_goes_on_after_frames_that_are_late_or_lost_and_after_a_day(
    weights: Path,  # noqa: F811
) -> None:
    poses = [" ".join(f"{x:.4f}" for x in pose.reshape(-1)) for pose in CLIP.person_a[:3]]
    lost = poses[0].replace(poses[0].split()[0], "nan", 1)
    frames = [(0, poses[0]), (0.1, poses[1]), (0.1, poses[2]), (0.05, poses[0]), (0.2, lost),
              (86400, poses[0]), (3, poses[0])]  # fmt: skip
    words = ["react", "--stream", "--weights", str(weights)]
    text = "".join(f"{time} {pose}\n" for time, pose in frames)
    result = CliRunner().invoke(app, words, input=text)
    assert result.exit_code == 0, result.output
    for line, fault in ((3, "later than 0.1 s; got 0.1"), (4, "got 0.05"), (5, "finite numbers")):
        assert re.search(rf"line {line}: .*{fault}.*the reaction stays as it was", result.stderr)
    answers = [line.split() for line in result.stdout.splitlines()]
    assert [float(answer[0]) for answer in answers] == [time for time, _ in frames]
    assert all(answer[1:] == answers[1][1:] for answer in answers[2:5])
    for again in answers[5:]:  # as at the beginning, but for the noise
        np.testing.assert_allclose(
            np.array(again[1:], float), np.array(answers[0][1:], float), atol=1.0
        )


@pytest.mark.parametrize("suffix", ["parquet", "bvh", "skeleton"])
def test_a_pipe_as_an_argument_is_refused(
    tmp_path: Path,
    weights: Path,  # noqa: F811
    suffix: str,
) -> None:
    pipe = tmp_path / f"x.{suffix}"
    os.mkfifo(pipe)
    options = ("--clip", "x") if suffix == "parquet" else ()
    options += ("--from-unit", 1, "--from-up", "y") if suffix == "bvh" else ()
    out = tmp_path / "out.parquet"
    for words in (("react", "--weights", weights), ("augment", "--b-scale", "uniform=1.1")):
        second = (pipe,) if words[0] == "augment" and suffix == "bvh" else ()
        result = pacmo(words[0], pipe, *second, *words[1:], *options, "--out", out)
        refused(result, "wanted a file; got a named pipe")
    result = pacmo("react", pipe, "--weights", pipe, "--out", out)
    refused(result, "wanted a file; got a named pipe")


def test_a_folder_as_weights_and_a_text_as_parameters_are_one_line(tmp_path: Path) -> None:
    for person, motion in (("A", CLIP.person_a), ("B", CLIP.person_b)):
        (tmp_path / f"x_{person}.bvh").write_text(format_bvh(motion, 15, SBU15))
    files = [tmp_path / "x_A.bvh", tmp_path / "x_B.bvh"]
    words = ("--from-unit", 1, "--from-up", "y", "--out", tmp_path / "out")
    refused(pacmo("react", files[0], "--weights", tmp_path, *words), "wanted a file; got a folder")
    refused(pacmo("vary", *files, "--weights", tmp_path, *words), "wanted a file; got a folder")
    scale = ("--b-scale", "uniform=0.9")
    for params, reason in (
        (ROOT / "README.md", "README.md: not YAML"),
        (tmp_path, "a folder; wanted a file"),
    ):
        refused(pacmo("augment", *files, *scale, "--params", params, *words), reason)
    assert not (tmp_path / "out").exists()


def test_the_cells_of_a_list_are_text_and_escaped(tmp_path: Path) -> None:
    row = QuarantineRecord("s", "[/red]\x1b[2J", "0", 1, "[bold]reason\n")
    write_rows(tmp_path / "quarantine.parquet", QuarantineRecord, [row])
    result = pacmo("quarantine", tmp_path)
    assert result.exit_code == 0
    assert r"[/red]\x1b[2J" in result.stdout
    assert r"[bold]reason\n" in result.stdout


def test_an_error_is_one_line_without_control_characters() -> None:
    assert one_line(CommandError("a\nb \x1b[2J\u202e\udcff")) == r"a b \x1b[2J\u202e\udcff"
    assert one_line(FileNotFoundError(2, "no such file", "a\x07")) == r"a\x07: no such file"
    assert one_line(MemoryError()) == "MemoryError"
