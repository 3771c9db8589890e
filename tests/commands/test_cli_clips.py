"""What is trusted: the rows that were written; the files of the experiments."""

import shutil

import pytest
from typer.testing import CliRunner

from pacmo_core.commands.cli import app
from pacmo_core.project.experiments import compose_params
from pacmo_core.store.tables import ClipRecord, QuarantineRecord, SplitRecord, write_rows

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
    assert said.startswith("the edited params.yaml is saved as history/params/")


def test_an_unknown_experiment_ends_with_1_and_one_line():
    said = pacmo("use", "largest")
    assert said.exit_code == 1
    assert "no experiment largest" in said.stderr and said.stderr.count("\n") == 1


def test_experiments_are_listed():
    assert {"default", "smallest", "sbu", "duo_mocap"} <= set(pacmo("experiments").stdout.split())
