"""What is trusted: the bytes of params.yaml while somebody else holds the lock."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from flows.reproduce import reproduce
from flows.run import main
from pacmo_core.commands.cli import app
from pacmo_core.project.lock import lock_holder
from pacmo_core.project.records import read_runs
from pacmo_core.project.workspace import EXIT_BUSY, LOCK, RUNS, CommandError
from tests.flows.projects import ROOT

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("prefect_server")]
HOLD = """\
from pacmo_core.project.lock import writer_lock
from pacmo_core.project.workspace import LOCK
with writer_lock("reproduce", LOCK):
    print(flush=True)
    input()
"""
DEFAULT = "experiment: default\nruns: {folds: [1], seeds: [1]}\nfirst: 1\n"
OTHER = DEFAULT.replace("default", "other").replace("1\n", "2\n")


@pytest.fixture
def project(pipeline):
    """Lay out two experiments; the first stage copies the parameters, so that outputs name them."""
    Path("params.yaml").write_text(DEFAULT)
    Path("experiments").mkdir()
    Path("experiments/other.yaml").write_text("experiment: other\nfirst: 2\n")
    return pipeline


@pytest.fixture
def busy(project):
    """Let another process hold the lock, as a run does."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", HOLD], env=environment, **pipes) as process:
        assert process.stdout.readline() == b"\n"
        yield process
        process.communicate(b"\n")


COMMANDS = [["use", "other"], ["tidy"], ["report"], ["rollback", "--why", "x"]]


@pytest.mark.parametrize("words", COMMANDS, ids=lambda words: words[0])
def test_no_command_writes_while_a_run_does(busy, words):
    Path("models/2").mkdir(parents=True)
    before = Path("params.yaml").read_bytes()
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 1 and 'busy: {"job": "reproduce"' in done.stderr
    assert Path("params.yaml").read_bytes() == before and Path("models/2").exists()
    assert not RUNS.exists()


def test_a_second_experiment_is_refused_while_the_first_runs(busy, capsys):
    before = Path("params.yaml").read_bytes()
    assert main(["reproduce", "--experiment", "other"]) == EXIT_BUSY
    assert Path("params.yaml").read_bytes() == before


def test_an_experiment_taken_up_before_the_run_has_the_lock_stops_the_run(project, monkeypatch):
    """Two starts at once: one prepares, the other takes up its experiment, the first one runs."""
    flows = []
    monkeypatch.setattr("flows.run.run_flow", lambda _, arguments, __: flows.append(arguments) or 0)
    assert main(["reproduce", "--experiment", "default"]) == 0
    assert main(["reproduce", "--experiment", "other"]) == 0
    first, second = flows
    with pytest.raises(CommandError, match="params.yaml was changed after this run had begun"):
        reproduce(**first)
    assert [run.outcome for run in read_runs(RUNS)] == ["failed"]
    assert not Path("raw.txt").exists()
    reproduce(**second)
    assert "first: 2" in Path("both.txt").read_text()


def test_parameters_that_change_during_a_run_end_it(project):
    stage = Path("stage.py")
    stage.write_text(stage.read_text() + 'Path("params.yaml").write_text("first: 3\\n")\n')
    with pytest.raises(CommandError, match="params.yaml was changed"):
        reproduce([])
    assert not Path("both.txt").exists()
    (run,) = read_runs(RUNS)
    assert run.outcome == "failed" and "run ./run again" in run.reason
    assert lock_holder(LOCK) == ""
