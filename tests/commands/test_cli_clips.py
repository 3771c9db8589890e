"""What is trusted: the rows that were written; the files of the experiments."""

import shutil
from dataclasses import replace

import pytest
from typer.testing import CliRunner

from pacmo_core.commands.cli import app
from pacmo_core.data.skeleton import SBU15
from pacmo_core.project.experiments import compose_params
from pacmo_core.store.motions import write_motions
from pacmo_core.store.tables import ClipRecord, QuarantineRecord, SplitRecord, write_rows
from tests.figures.samples import interaction

ROWS = [
    QuarantineRecord("one", "one.bvh", "ab", 12, "no second person"),
    QuarantineRecord("two", "two.bvh", "cd", 0, "the same body twice"),
]


CLIP = ClipRecord(
    *("one", "one", "set", "waving", "s01", "s02", "one", "sbu15"), 15.0, 2.0, 31, 0, "f", "ab",
    *(0.1, 2.0, 0.0, 0), False,
)  # fmt: skip


def pacmo(*words):
    return CliRunner().invoke(app, [*map(str, words)])


def test_quarantine_lists_files_lines_and_reasons(tmp_path):
    write_rows(tmp_path / "quarantine.parquet", QuarantineRecord, ROWS)
    said = pacmo("quarantine", tmp_path)
    assert said.exit_code == 0
    assert "one.bvh" in said.stdout and "no second person" in said.stdout and "12" in said.stdout
    assert "2 of 2" in said.stdout
    assert "1 of 2" in pacmo("quarantine", tmp_path, "--matching", "twice").stdout


def test_clips_are_listed_with_their_side_in_a_fold_that_is_named(tmp_path):
    write_rows(tmp_path / "clips.parquet", ClipRecord, [CLIP])
    write_rows(tmp_path / "1.parquet", SplitRecord, [SplitRecord("one", "validation")])
    plain, sided = (
        pacmo("clips", tmp_path),
        pacmo("clips", tmp_path, "--splits", tmp_path / "1.parquet"),
    )
    assert "waving" in plain.stdout and "validation" not in plain.stdout
    assert "validation" in sided.stdout and "1 of 1" in sided.stdout


def test_a_name_is_never_cut_whatever_the_width(tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "40")
    name = "a recording with a long name " * 6 + "[bold]#0003"
    write_rows(tmp_path / "clips.parquet", ClipRecord, [replace(CLIP, clip=name)])
    said = pacmo("clips", tmp_path).stdout.splitlines()
    assert said[1].startswith(f"{name}  waving")
    write_rows(tmp_path / "quarantine.parquet", QuarantineRecord, [replace(ROWS[0], file=name)])
    assert name in pacmo("quarantine", tmp_path).stdout


def test_clips_that_have_reactions_name_the_models(tmp_path):
    rows = [CLIP, replace(CLIP, clip="two")]
    write_rows(tmp_path / "clips/clips.parquet", ClipRecord, rows)
    for place in ("1/pacmo/1", "2/pacmo/1", "1/gru/1"):
        with write_motions(tmp_path / "reactions" / place / "motions.parquet", SBU15) as writer:
            writer.add("one#a#0", interaction(1))
            writer.add("one#b#0", interaction(2))
    head, one, two, _ = pacmo("clips", tmp_path / "clips").stdout.splitlines()
    assert head.split()[-1] == "reactions"
    assert one.endswith("gru pacmo")
    assert not two.endswith("pacmo")
    elsewhere = pacmo("clips", tmp_path / "clips", "--reactions", tmp_path / "none").stdout
    assert "reactions" not in elsewhere
    assert "1 of 2" in pacmo("clips", tmp_path / "clips", "--matching", "pacmo").stdout


def test_before_the_first_run_the_line_says_what_makes_the_table(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for command, table in (("clips", "data/clips/clips"), ("quarantine", "sequences/quarantine")):
        said = pacmo(command)
        assert said.exit_code == 1
        assert f"{table}.parquet: ./run makes" in said.stderr and said.stderr.count("\n") == 1


@pytest.mark.parametrize("content", [None, b"nonsense"])
def test_a_folder_without_a_readable_table_is_one_line(tmp_path, content):
    if content:
        (tmp_path / "clips.parquet").write_bytes(content)
    said = pacmo("clips", tmp_path)
    assert said.exit_code == 1
    assert "clips.parquet" in said.stderr and said.stderr.count("\n") == 1


def test_use_writes_the_parameters_of_an_experiment(tmp_path, monkeypatch):
    wanted = compose_params("smallest")
    shutil.copytree("experiments", tmp_path / "experiments")
    (tmp_path / "params.yaml").write_text(compose_params("default"))
    monkeypatch.chdir(tmp_path)
    assert pacmo("use", "smallest").output == ""
    params = tmp_path / "params.yaml"
    assert params.read_text() == wanted
    params.write_text(wanted.replace("max_variations: 2", "max_variations: 3"))
    said = pacmo("use", "default").output
    assert said.startswith("params.yaml differed from its experiment: saved as history/params/")


def test_an_unknown_experiment_ends_with_1_and_one_line():
    said = pacmo("use", "largest")
    assert said.exit_code == 1
    assert "no experiment largest" in said.stderr and said.stderr.count("\n") == 1
    assert "did you mean" not in said.stderr  # nothing that there is is like it
    assert "did you mean sbu_finetuned?" in pacmo("use", "sbu_finetund").stderr


def test_experiments_are_listed():
    assert {"default", "smallest", "sbu", "duo_mocap"} <= set(pacmo("experiments").stdout.split())


def test_the_clips_of_a_file_are_listed_as_view_and_export_take_them(tmp_path):
    file = tmp_path / "reactions.parquet"
    pair = interaction(0)
    with write_motions(file, pair.skeleton) as writer:
        for number in range(5):
            writer.add(f"one#000{number}", pair)
    said = pacmo("clips", file)
    assert said.exit_code == 0, said.output
    named = said.stdout.splitlines()[1:6]
    assert named == [f"{file}:one#000{number}" for number in range(5)]
    for command in (["export", file, "--out", tmp_path / "x.glb"], ["view", file, "--no-open"]):
        refused = pacmo(*command)
        assert refused.exit_code == 1
        assert f"FILE:NAME: {named[0]}, {named[1]}, {named[2]} ... (5 in all" in refused.stderr
        assert f"pacmo clips {file})" in refused.stderr
    assert pacmo("export", named[3], "--out", tmp_path / "x.glb").exit_code == 0


def test_several_files_are_listed_one_after_the_other(tmp_path):
    files = [tmp_path / "one.parquet", tmp_path / "two.parquet"]
    pair = interaction(0)
    for file in files:
        with write_motions(file, pair.skeleton) as writer:
            writer.add(file.stem, pair)
    said = pacmo("clips", *files).stdout.splitlines()
    assert said[1:] == [f"{files[0]}:one", f"{files[1]}:two", "2 of 2"]
    for other, reason in ((tmp_path, ": wanted one folder, or Parquet"), (tmp_path / "no", "no ")):
        refused = pacmo("clips", files[0], other)
        assert refused.exit_code == 1
        assert f"{other}{reason}" in refused.stderr or f"{reason}{other}" in refused.stderr


@pytest.mark.parametrize("option", [["--variations"], ["--splits", "x"], ["--reactions", "x"]])
def test_options_of_a_folder_are_refused_beside_several_files(tmp_path, option):
    refused = pacmo("clips", "one.parquet", "two.parquet", *option)
    assert refused.exit_code == 1
    assert refused.stderr == f"pacmo: {option[0]} is of one folder; got two.parquet too\n"


def test_a_folder_of_captures_lists_them(tmp_path):
    (tmp_path / "walk.bvh").write_text("")
    (tmp_path / "notes.md").write_text("")
    said = pacmo("clips", tmp_path)
    assert said.exit_code == 0
    assert "walk.bvh  bvh" in said.stdout and "1 of 1" in said.stdout
