"""Reference: the processes that /proc shows, and the files of a run that nothing disturbed."""

import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from benchmarks.faults import hashes
from benchmarks.interrupts import VARIABLE, interrupt, lock_entries
from pacmo_core.project.processes import marked_processes
from pacmo_core.project.records import read_runs
from pacmo_core.project.workspace import RUNS
from tests.flows.projects import ROOT, drop, environment, make_project
from tests.flows.test_serve import free_port

pytestmark = pytest.mark.slow
COMMAND = [sys.executable, "-m", "flows.run", "reproduce"]
N_MOMENTS = 4
LIMIT_S = 120.0  # a wait that ends by then; no process takes as long


def own_environment() -> dict[str, str]:
    return {name: value for name, value in environment().items() if name != "PREFECT_API_URL"}


@pytest.fixture
def project(tmp_path, monkeypatch):
    """Lay out a project with captures in it, and no server."""
    make_project(tmp_path)
    drop(tmp_path, range(2))
    (tmp_path / "data/inbox").rename(tmp_path / "data/captures/lab/inbox")
    # The module is imported from the repository: interrupt sets the path to the project.
    for name in ("flows", "pacmo_core", "stages"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    return tmp_path


def clear(folder: Path) -> None:
    for words in (["rm", "-rf", "sides.txt", "models", "reports", "dvc.lock", ".dvc/cache"],):
        subprocess.run(words, cwd=folder, check=True)


def test_ctrl_c_at_any_moment_ends_all_processes_and_the_next_run_goes_on(project, monkeypatch):
    monkeypatch.setattr("benchmarks.interrupts.LIMIT_S", LIMIT_S)
    start = time.monotonic()
    subprocess.run(COMMAND, env=own_environment(), check=True)
    seconds = time.monotonic() - start
    expected = hashes(project), lock_entries(project)
    choice = random.Random(1)
    for _ in range(N_MOMENTS):
        clear(project)
        result = interrupt(COMMAND, project, choice.uniform(0, seconds))
        assert result.remaining == []
        assert result.in_one_line, result.text
        subprocess.run(COMMAND, env=own_environment(), check=True)
        assert (hashes(project), lock_entries(project)) == expected


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGINT])
def test_a_signal_in_a_stage_ends_the_run_and_its_record_says_so(project, number):
    make = Path("make.py")
    text = make.read_text().replace("import json, sys", "import json, sys, time")
    make.write_text(text.replace('== "split":', '== "split":\n    time.sleep(600)'))
    mark = {VARIABLE: str(project)}
    process = subprocess.Popen(
        COMMAND, env={**own_environment(), **mark}, stderr=subprocess.PIPE, text=True
    )
    while not any(_command(pid).endswith("make.py split") for pid in marked_processes(mark)):
        assert process.poll() is None
        time.sleep(0.05)
    process.send_signal(number)
    assert process.wait(timeout=LIMIT_S) == 130
    assert marked_processes(mark) == []
    text = process.communicate()[1]
    assert text.splitlines()[-1].startswith("interrupted: ") and "Traceback" not in text
    (run,) = read_runs(RUNS)
    assert (run.outcome, run.reason) == ("killed", "interrupted")


def test_serving_ends_on_ctrl_c_with_its_server(project):
    mark, port = {VARIABLE: str(project)}, free_port()
    with Path("serve.log").open("wb") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "flows.serve", "--port", str(port)],
            env={**own_environment(), "PREFECT_HOME": str(project / ".prefect"), **mark},
            stdout=log,
            stderr=log,
        )
    while "prefect deployment run" not in Path("serve.log").read_text():
        assert process.poll() is None
        time.sleep(0.1)
    assert f"http://127.0.0.1:{port}" in Path("serve.log").read_text()
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=LIMIT_S) == 130
    assert marked_processes(mark) == []
    text = Path("serve.log").read_text()
    assert "interrupted: " in text and "Traceback" not in text


def _command(pid: int) -> str:
    try:
        return (
            (Path("/proc") / str(pid) / "cmdline")
            .read_bytes()
            .replace(b"\0", b" ")
            .decode()
            .strip()
        )
    except OSError:
        return ""
