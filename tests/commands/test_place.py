"""Truth: files written by ``./run pacmo`` where the user stands, with weights of the project."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pacmo_core.commands.weights import TRAINED_HERE
from pacmo_core.reaction.inference import PACKAGED
from tests.commands.test_captures_in import pair

__all__ = ["pair"]  # a fixture

ROOT = Path(__file__).parents[2]
# The program, with an environment that is set up.
WITHOUT_SET_UP = """
import os, sys
from importlib.machinery import SourceFileLoader
from pathlib import Path
run = SourceFileLoader("run", sys.argv[1]).load_module()
run.set_up = lambda: None
run.BIN = Path(sys.argv[2])
run.main(sys.argv[3:])
"""


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """Make a project with a trained model, and a command ``pacmo`` of these sources."""
    project = tmp_path / "project"
    weights = project / TRAINED_HERE
    weights.parent.mkdir(parents=True)
    shutil.copy(PACKAGED, weights)
    shutil.copy(ROOT / "run", project / "run")
    pacmo = project / "bin" / "pacmo"
    pacmo.parent.mkdir()
    module = "from pacmo_core.commands.cli import main; main()"
    pacmo.write_text(
        f"#!{sys.executable}\nimport sys; sys.path.insert(0, {str(ROOT)!r})\n{module}\n"
    )
    pacmo.chmod(0o755)
    return project


def run(project: Path, folder: Path, *words: object) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-W", "ignore", "-c", WITHOUT_SET_UP, project / "run",
               project / "bin", *words]  # fmt: skip
    return subprocess.run(
        list(map(str, command)), cwd=folder, capture_output=True, text=True, check=False
    )


@pytest.mark.slow
def test_files_are_where_the_user_stands_and_weights_are_the_projects(
    project: Path, pair: list[Path], tmp_path: Path
) -> None:
    assert [file.parent for file in pair] == [tmp_path, tmp_path]
    said = run(project, tmp_path, "pacmo", "react", pair[0].name, "--out", "new.bvh")
    assert said.returncode == 0, said.stderr
    assert f"{project / TRAINED_HERE} was trained on" in said.stdout
    assert (tmp_path / "new_0_B.bvh").is_file()
    listed = run(project, tmp_path, "pacmo", "clips")
    assert f"no {project / 'data' / 'clips'}" in listed.stderr
    assert not (project / "new_0_B.bvh").exists()


@pytest.mark.slow
def test_other_commands_keep_the_root_and_so_do_those_of_the_project(
    project: Path, tmp_path: Path
) -> None:
    where = run(project, tmp_path, "python3", "-c", "import os; print(os.getcwd())")
    assert where.stdout.strip() == str(project)
    (project / "dvc.yaml").touch()
    (project / "experiments").mkdir()
    (project / "experiments" / "mine.yaml").write_text("{}\n")
    assert "mine" in run(project, tmp_path, "pacmo", "experiments").stdout.split()
