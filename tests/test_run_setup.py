"""What is trusted: a file that an installation creates and that no other may meet."""

import subprocess
import sys
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path

import pytest

RUN = Path(__file__).parents[1] / "run"
# The script, with an installation that takes as long as the test says and tolerates no other.
SET_UP = """\
import fcntl, sys
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import SimpleNamespace
run = SourceFileLoader("run", sys.argv[1]).load_module()
run.VENV = Path("venv"); run.STAMP = run.VENV / "stamp"

def install(expected):
    with Path("installing").open("x"):
        print("installs", flush=True)
        Path("installed").open("a").write("once ")
        sys.stdin.readline()
    Path("installing").unlink()
    run.VENV.mkdir()
    run.STAMP.write_text(expected)

def flock(file, kind):
    print("waits", flush=True)
    fcntl.flock(file, kind)

run.install = install
run.fcntl = SimpleNamespace(flock=flock, LOCK_EX=fcntl.LOCK_EX)
run.set_up()
"""


def start(folder: Path) -> "subprocess.Popen[str]":
    command = [sys.executable, "-W", "ignore", "-c", SET_UP, str(folder / "run")]
    return subprocess.Popen(
        command, cwd=folder, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )


def test_of_two_setups_at_once_one_installs_and_the_other_waits_for_it(tmp_path):
    for name in ("run", "requirements.lock", "pyproject.toml"):
        (tmp_path / name).write_bytes((RUN.parent / name).read_bytes())
    with start(tmp_path) as one, start(tmp_path) as other:
        # Both have found no environment by now.
        assert [process.stdout.readline() for process in (one, other)] == ["waits\n"] * 2
        for process in (one, other):
            process.stdin.write("go on\n")
            process.stdin.flush()
        assert [process.wait(timeout=120) for process in (one, other)] == [0, 0]
    assert (tmp_path / "installed").read_text() == "once "


def test_setup_says_that_it_is_done_and_what_to_do_next(capsys: pytest.CaptureFixture[str]) -> None:
    loader = SourceFileLoader("run_script", str(RUN))
    run = module_from_spec(spec_from_loader("run_script", loader))
    loader.exec_module(run)
    run.set_up = lambda: None
    run.main(["setup"])
    said = capsys.readouterr().out
    assert said.count("\n") == 1
    assert said.startswith("set up: ./run ")
