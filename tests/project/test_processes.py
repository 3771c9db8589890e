"""What is trusted: real processes, found by two independent ways."""

import os
import subprocess
import sys
import time
from pathlib import Path
from uuid import uuid4

import pytest

from pacmo_core.project import processes
from pacmo_core.project.processes import is_alive, kill_marked, marked_processes


@pytest.fixture(params=["/proc", "psutil"])
def way(request, monkeypatch):
    if request.param == "psutil":  # as on a system without /proc
        monkeypatch.setattr(processes, "PROC", Path("/nowhere"))


@pytest.mark.usefixtures("way")
def test_processes_are_found_by_their_mark_and_ended_with_their_children():
    mark = {"PACMO_TEST_MARK": uuid4().hex}
    child = "import subprocess, sys; subprocess.run([sys.executable, '-c', 'input()'])"
    parent = subprocess.Popen(
        [sys.executable, "-c", child], env={**os.environ, **mark}, stdin=subprocess.PIPE
    )
    deadline = time.monotonic() + 60
    while len(found := marked_processes(mark)) < 2 and time.monotonic() < deadline:
        time.sleep(0.01)
    assert parent.pid in found and len(found) == 2
    assert is_alive(parent.pid)
    ended, remaining = kill_marked(mark)
    assert set(ended) == set(found) and remaining == []
    assert not is_alive(parent.pid)
    parent.communicate()
    assert not is_alive(parent.pid)


def test_a_signal_after_the_work_does_not_change_the_exit_code():
    # atexit runs where a process that is done still has to end.
    code = (
        "import atexit, os, signal, sys\n"
        "from pacmo_core.project.processes import end_on_signal\n"
        "atexit.register(lambda: os.kill(os.getpid(), getattr(signal, sys.argv[1])))\n"
        "with end_on_signal(lambda: 'interrupted'):\n"
        "    pass\n"
    )
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        done = subprocess.run(
            [sys.executable, "-c", code, name], capture_output=True, text=True, check=False
        )
        assert (done.returncode, done.stderr) == (0, "")
