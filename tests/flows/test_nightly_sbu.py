"""What is trusted: real captures, the pipeline itself, and the server's own account of its runs."""

import os
import shutil
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import httpx
import pyarrow.parquet as pq
import pytest
from ruamel.yaml import YAML

from flows.server import start_server, wait_until_healthy
from pacmo_core.project.records import RunRecord, read_runs
from tests.flows.projects import ROOT, environment
from tests.flows.test_serve import free_port, stop

SBU = Path(os.environ.get("PACMO_REAL_DATA", ROOT.parent / "shared" / "data")) / "sbu"
IN = ("s01s02", "s02s01", "s01s03", "s03s04", "s04s03", "s05s03")  # pairs that are in already
NEW = "s04s02"
SPOILT = (2, 5, 8)
PATIENCE_S = 3600.0
NETWORK = {"width": 8, "n_points": 17, "modes": [8, 6, 4, 4, 4, 6, 8]}
LAB = {
    "experiment": "lab",
    "runs": {"priors": {"datasets": []}},
    "ingest": {
        "dataset": "lab",
        "raw": "data/captures/lab",
        "format": "sbu",
        "settings": {"fps": 15},
        "drop_joints": [],
    },
    "split": {"method": "listed", "test_pairs": [["s05+s03", "s03+s04"]]},
    "augment": {
        "clips": {"max_clips": 1},
        "plan": {"single": {"max_variations": 1}, "n_random": 1},
    },
    "train_autoencoder": {**NETWORK, "n_epochs": 4},
    "train_matcher": {"width": 8, "n_points": 17, "modes": [6, 4, 4], "n_epochs": 2},
    "train_gru": {"hidden": 16, "n_epochs": 1},
    "train_regression": {**NETWORK, "n_epochs": 2},
    "train_pacmo": {**NETWORK, "n_epochs": 12, "warmup_epochs": 4, "validate_from": 6},
    "train_pacmo_paper": {**NETWORK, "n_epochs": 2, "validate_from": 1, "n_critic": 2},
    "evaluate_pacmo": {"n_samples": 50, "repeats": 2, "bootstrap": 50, "second_samples": 2},
    "report": {"played_clips": 1},
    # Of networks as small as these no figure is good; only that a worse one is held is asked.
    "nightly": {"gate": {"max_noise_floor_ratio": 1e6}, "settle_s": 1.0},
}
# Steps so long that nothing is learnt.
RUINED = {
    "n_epochs": 6,
    "warmup_epochs": 1,
    "validate_from": 1,
    "ema_decay": 0.0,
    "generator": {"learning_rate": 0.3},
}

pytestmark = [
    pytest.mark.slow,
    pytest.mark.scheduled,
    pytest.mark.skipif(not SBU.is_dir(), reason=f"no captures at {SBU}"),
]


@pytest.fixture
def lab(tmp_path, monkeypatch):
    """Clone the project, captures of some pairs in it, with a night every minute."""
    subprocess.run(["git", "clone", "-q", str(ROOT), str(tmp_path / "lab")], check=True)
    monkeypatch.chdir(tmp_path / "lab")
    for pair in IN:
        shutil.copytree(SBU / pair, Path("data/captures/lab") / pair)
    schedule = Path("prefect.yaml").read_text()
    assert "0 2 * * *" in schedule
    Path("prefect.yaml").write_text(schedule.replace("0 2 * * *", "* * * * *"))
    set_lab()
    return Path.cwd()


def set_lab(**training):
    """Write the experiment and use it."""
    facts = {**LAB, "train_pacmo": {**LAB["train_pacmo"], **training}}
    YAML(typ="safe").dump(facts, Path("experiments/lab.yaml"))
    command = [sys.executable, "-m", "pacmo_core.commands.cli", "use", "lab"]
    subprocess.run(command, env=here(), check=True, capture_output=True)


def here() -> dict[str, str]:
    """Run the clone's own code, and a server with a data base of its own."""
    home = Path(".prefect").resolve()
    own = {k: v for k, v in environment().items() if k != "PREFECT_API_URL"}
    return {**own, "PYTHONPATH": str(Path.cwd()), "PREFECT_HOME": str(home)}


@contextmanager
def serving():
    """Serve the clone's schedules."""
    command = [sys.executable, "-m", "flows.serve", "--port", str(free_port())]
    with Path("serve.log").open("wb") as out:
        process = subprocess.Popen(
            command, env=here(), stdout=out, stderr=out, start_new_session=True
        )
    try:
        yield
    finally:
        stop(process)


def states_on_the_server(home: Path) -> list[str]:
    """Ask a server that is started anew on the same data base how its scheduled runs ended."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PREFECT_HOME", str(home))
        server = start_server({}, free_port())
        try:
            wait_until_healthy(server)
            query = {"sort": "START_TIME_ASC"}
            address = f"{server.address}/flow_runs/filter"
            runs = httpx.post(address, json=query, timeout=60).json()
        finally:
            server.process.kill()
            server.process.wait()
    return [run["state"]["name"] for run in runs if run["auto_scheduled"] and run["start_time"]]


def drop_ten() -> list[str]:
    """Drop a pair's first ten captures into the inbox, three of them cut short."""
    files = sorted((SBU / NEW).rglob("skeleton_pos.txt"))[:10]
    for number, file in enumerate(files):
        place = Path("data/inbox") / file.relative_to(SBU)
        place.parent.mkdir(parents=True)
        text = file.read_text()
        place.write_text(text[: len(text) // 2] if number in SPOILT else text)
    return [file.parent.relative_to(SBU).as_posix() for file in files]


def wait_for(outcome: str, verdict: str) -> RunRecord:
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        for run in read_runs(Path("history/runs")):
            if run.outcome == "failed":
                pytest.fail(run.reason)
            if run.outcome == outcome and run.facts.get("verdict") == verdict:
                return run
        time.sleep(1)
    pytest.fail(f"no night was {verdict}:\n" + Path("serve.log").read_text()[-4000:])


def wait_until_the_server_knows(state: str) -> None:
    """Wait for what is said after a run has been written down."""
    deadline = time.monotonic() + 60
    while f"in state {state}" not in Path("serve.log").read_text():
        if time.monotonic() > deadline:
            pytest.fail(f"no run ended {state}:\n" + Path("serve.log").read_text()[-4000:])
        time.sleep(0.2)


def test_ten_captures_go_from_the_inbox_to_a_promotion_and_a_worse_model_is_held(lab):
    names = drop_ten()
    current = Path("promoted/current/models/1/pacmo/1/weights.safetensors")
    with serving():
        first = wait_for("done", "promoted")
        good = current.read_bytes()
        set_lab(**RUINED)
        second = wait_for("rejected", "rejected")
        wait_until_the_server_knows("Rejected")

    spoilt = {names[number] for number in SPOILT}
    assert (
        set(first.facts["quarantined"]) == spoilt
        and set(first.facts["accepted"]) == set(names) - spoilt
    )
    assert len(list(Path("data/quarantine").rglob("reason.json"))) == len(SPOILT)
    clips = set(pq.read_table("data/clips/clips.parquet")["sequence"].to_pylist())
    assert set(first.facts["accepted"]) <= clips and not spoilt & clips

    assert "; current " in second.reason and current.read_bytes() == good
    assert Path("models/1/pacmo/1/weights.safetensors").read_bytes() != good
    rows = pq.read_table("history/decisions/decisions.parquet").to_pylist()
    assert [row["verdict"] for row in rows if row["verdict"] != "unchanged"] == [
        "promoted",
        "rejected",
    ]
    report = Path("history/report.html").read_text()
    assert 'id="history"' in report and "rejected" in report

    states = states_on_the_server(lab / ".prefect")
    assert states[0] == "Done" and "Rejected" in states
