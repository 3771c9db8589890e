"""What is trusted: a real Prefect server with its own data base, and the files nights leave."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import httpx
import pytest

from flows.nightly import is_covered
from flows.server import is_healthy, start_server
from pacmo_core.project.records import read_runs
from tests.flows.projects import drop, environment, make_project, set_params
from tests.waiting import wait_until

pytestmark = pytest.mark.slow
PATIENCE_S = 240.0


def free_port() -> int:
    with socket.socket() as door:
        door.bind(("127.0.0.1", 0))
        return door.getsockname()[1]


@pytest.fixture
def project(tmp_path, monkeypatch):
    make_project(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def serving(project):
    """Start what serves the deployments, with its own server; end both with the test."""
    begun = []

    def start(port):
        command = [sys.executable, "-m", "flows.serve", "--port", str(port)]
        alone = {
            **{k: v for k, v in environment().items() if k != "PREFECT_API_URL"},
            "PREFECT_HOME": str(project / ".prefect"),
        }
        with Path("serve.log").open("ab") as out:
            process = subprocess.Popen(
                command, env=alone, stdout=out, stderr=out, start_new_session=True
            )
        begun.append(process)
        return process

    yield start
    for process in begun:
        stop(process)


def stop(process):
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def wait_for_nights(count):
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        ended = [run for run in read_runs(Path("history/runs")) if run.ended]
        if len(ended) >= count:
            return ended
        time.sleep(0.5)
    pytest.fail(f"{count} nights did not end:\n" + Path("serve.log").read_text()[-4000:])


def ask(port, path, **facts):
    return httpx.post(f"http://127.0.0.1:{port}/api/{path}/filter", json=facts, timeout=30).json()


def test_the_scheduled_nightly_promotes_and_then_holds_and_says_so_on_the_servers_page(
    project, serving
):
    drop(project, range(10), spoilt=(1, 4, 7))
    port = free_port()
    process = serving(port)
    (first,) = wait_for_nights(1)[:1]
    assert (first.facts["verdict"], len(first.facts["accepted"])) == ("promoted", 7)
    assert len(first.facts["quarantined"]) == 3
    set_params(project, f2id=0.9)
    held = next(run for run in wait_for_nights(3) if run.outcome == "rejected")
    assert "F²ID rose to 0.9" in held.reason

    runs = ask(port, "flow_runs", sort="START_TIME_ASC")
    states = [run["state"]["name"] for run in runs if run["auto_scheduled"] and run["start_time"]]
    assert states[0] == "Done" and "Rejected" in states
    tables = {a["key"]: a["data"] for a in ask(port, "artifacts") if a["key"]}
    assert {"metrics", "decision", "history"} <= tables.keys()
    assert "f2id" in json.dumps(tables["decision"])

    # The server and all it serves die in the night; the next one takes up where they were.
    stop(process)
    before = len(read_runs(Path("history/runs")))
    drop(project, range(10, 11))
    serving(port)
    later = wait_for_nights(before + 1)[before:]
    assert "s01s02/01/010" in later[0].facts["accepted"]


def test_a_server_that_restarts_during_a_nightly_costs_at_most_that_nightly(
    project, serving, monkeypatch
):
    drop(project, range(2))
    whole = Path("make.py").read_text()
    slow = whole.replace("import json, sys", "import json, sys, time")
    Path("make.py").write_text(
        slow.replace(
            '== "split":', '== "split":\n    while not Path("go").exists(): time.sleep(0.05)'
        )
    )
    port = free_port()
    monkeypatch.setenv("PREFECT_HOME", str(project / ".prefect"))
    server = running_server(port)
    serving(port)
    wait_until(lambda: "running" in [run.outcome for run in read_runs(Path("history/runs"))])
    server.kill()
    server.wait()
    server = running_server(port)
    Path("go").touch()
    try:
        (first,) = wait_for_nights(1)[:1]
        assert first.outcome in ("done", "failed")
        later = first if first.outcome == "done" else wait_for_nights(2)[1]
        assert later.outcome == "done" and later.facts["verdict"] == "promoted"
        assert sorted(p.parent.name for p in Path("data/captures/lab").rglob("skeleton*")) == [
            "000",
            "001",
        ]
    finally:
        server.kill()
        server.wait()


def running_server(port):
    process = start_server({}, port).process
    deadline = time.monotonic() + PATIENCE_S
    while not is_healthy(f"http://127.0.0.1:{port}/api"):
        assert process.poll() is None and time.monotonic() < deadline
        time.sleep(0.5)
    return process


def test_seven_late_nightlies_are_one(project, monkeypatch):
    drop(project, range(1))
    now = datetime.now(UTC)
    late = [now - timedelta(days=day) for day in range(7, 0, -1)]
    script = (
        "import sys; from datetime import datetime; from prefect import flow; "
        "from flows.nightly import run_nightly\n"
        "for at in sys.argv[1:]: flow(run_nightly)('', datetime.fromisoformat(at))"
    )
    command = [sys.executable, "-c", script, *(at.isoformat() for at in late)]
    subprocess.run(command, env=environment(), check=True)
    outcomes = [run.outcome for run in read_runs(Path("history/runs"))]
    assert outcomes == ["done", *["skipped"] * 6]


def test_a_clock_that_has_jumped_back_does_not_cancel_later_nightlies(project):
    drop(project, range(1))
    subprocess.run(
        [sys.executable, "-m", "flows.run", "nightly"],
        env=environment(),
        check=True,
        capture_output=True,
    )
    (run,) = read_runs(Path("history/runs"))
    began = datetime.fromisoformat(run.started)
    a_year_ago = began - timedelta(days=365)
    assert is_covered(began - timedelta(hours=1), [run], began)
    assert not is_covered(a_year_ago - timedelta(hours=1), [run], a_year_ago)


def test_a_configured_server_that_does_not_respond_is_an_error(project):
    dead = f"http://127.0.0.1:{free_port()}/api"
    done = subprocess.run(
        [sys.executable, "-m", "flows.serve"],
        env={**environment(), "PREFECT_API_URL": dead},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert f"PREFECT_API_URL is {dead}; no Prefect server responds there" in done.stderr
