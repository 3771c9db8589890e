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
