"""What is trusted: the system's own lock, and real processes that are killed."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pacmo_core.project.lock import (
    WRITER_VARIABLE,
    BusyError,
    kill_orphans,
    lock_holder,
    writer_environment,
    writer_lock,
)
from pacmo_core.project.processes import is_alive, marked_processes
from pacmo_core.project.records import read_runs, record_run
from pacmo_core.project.workspace import configure_logging, log_event
from tests.waiting import wait_until

ROOT = Path(__file__).parents[2]

HOLD = """\
import sys, time
from pathlib import Path
from pacmo_core.project.lock import writer_lock
with writer_lock("held", Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def holder(tmp_path):
    """Hold the lock in another process."""
    command = [sys.executable, "-c", HOLD, str(tmp_path / "lock")]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=environment) as process:
        assert process.stdout.readline() == b"held\n"
        yield process
        process.kill()


def test_one_writer_at_a_time_and_the_error_names_it(tmp_path, holder):
    path = tmp_path / "lock"
    with (
        pytest.raises(BusyError, match=f'"job": "held", "pid": {holder.pid}'),
        writer_lock("x", path),
    ):
        pytest.fail("two writers")
    assert '"held"' in lock_holder(path)


def test_a_killed_holder_holds_nothing(tmp_path, holder):
    holder.kill()
    holder.wait()
    with writer_lock("next", tmp_path / "lock"):
        assert '"next"' in lock_holder(tmp_path / "lock")
    assert lock_holder(tmp_path / "lock") == ""


def test_what_a_killed_writer_started_is_ended_and_nothing_else(tmp_path):
    path = tmp_path / "lock"
    sleep = ["sleep", "60"]
    orphan = subprocess.Popen(sleep, env={**os.environ, WRITER_VARIABLE: str(path.resolve())})
    others = [
        subprocess.Popen(sleep, env={**os.environ, WRITER_VARIABLE: str(path.resolve()) + "2"}),
        subprocess.Popen(sleep),
    ]
    wait_until(lambda: orphan.pid in marked_processes(writer_environment(path)))
    assert kill_orphans(path) == [orphan.pid]
    assert orphan.wait() == -signal.SIGKILL and not is_alive(orphan.pid)
    assert [other.poll() for other in others] == [None, None]
    for other in others:
        other.kill()
        other.wait()


def test_a_process_that_is_dead_and_not_waited_for_does_not_live():
    process = subprocess.Popen([sys.executable, "-c", ""])
    deadline = time.monotonic() + 30
    while is_alive(process.pid) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not is_alive(process.pid)
    assert process.wait() == 0
    assert is_alive(os.getpid())


def test_a_run_is_recorded_from_its_begin_with_what_it_did(tmp_path):
    with record_run("nightly", tmp_path) as run:
        assert [r.outcome for r in read_runs(tmp_path)] == ["running"]
        run.facts["taken"] = ["a"]
    (read,) = read_runs(tmp_path)
    assert (read.outcome, read.facts, read.number) == ("done", {"taken": ["a"]}, 1)


def test_a_run_that_fails_says_why_and_still_fails(tmp_path):
    with pytest.raises(ValueError, match="too bad"), record_run("nightly", tmp_path):
        raise ValueError("too\nbad".replace("\n", " "))
    assert read_runs(tmp_path)[0].reason == "ValueError: too bad"


def test_a_run_that_never_ended_is_called_killed_by_the_next(tmp_path):
    with record_run("one", tmp_path):
        left = (tmp_path / "000001.json").read_text()
    (tmp_path / "000001.json").write_text(left)
    with record_run("two", tmp_path):
        pass
    assert [(run.job, run.outcome) for run in read_runs(tmp_path)] == [
        ("one", "killed"),
        ("two", "done"),
    ]


def test_a_broken_record_is_reported_and_hides_no_other(tmp_path):
    (tmp_path / "000001.json").write_text('{"number"')
    with record_run("two", tmp_path):
        pass
    broken, two = read_runs(tmp_path)
    assert "cannot be read" in broken.reason and two.number == 2


def test_a_log_line_is_json_with_its_facts(tmp_path):
    configure_logging(tmp_path / "log.jsonl")
    configure_logging(tmp_path / "log.jsonl")
    log_event("taken in", capture="a", number=3)
    lines = (tmp_path / "log.jsonl").read_text().splitlines()
    line = json.loads(lines[-1])
    assert (line["event"], line["capture"], line["number"]) == ("taken in", "a", 3)
    assert len([text for text in lines if "taken in" in text]) == 1
