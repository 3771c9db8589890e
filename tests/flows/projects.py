"""A small project: captures in SBU's format, three DVC stages, weights that are a text.

The stages are stand-ins; the inbox, the gate, the promoted models and the flows are real.
"""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from flows.nightly import nightly
from pacmo_core.project.records import RunRecord, read_runs
from pacmo_core.project.workspace import RUNS

ROOT = Path(__file__).parents[2]
DVC_YAML = """\
stages:
  split:
    cmd: python make.py split
    deps: [data/captures/lab, make.py]
    outs: [sides.txt]
  train_pacmo:
    cmd: python make.py train
    deps: [sides.txt, make.py]
    params: [model]
    outs: [models/1/pacmo/1]
  report:
    cmd: python make.py report
    deps: [models/1/pacmo/1, make.py]
    outs: [reports/details.json, reports/metrics.json]
"""
MAKE = """\
import json, sys
from pathlib import Path
weights = Path("models/1/pacmo/1/weights.safetensors")
if sys.argv[1] == "split":
    files = sorted(Path("data/captures/lab").rglob("*.txt"))
    Path("sides.txt").write_text("\\n".join(map(str, files)))
elif sys.argv[1] == "train":
    f2id = Path("params.yaml").read_text().split("f2id: ")[1].split()[0].strip("}")
    weights.parent.mkdir(parents=True, exist_ok=True)
    weights.write_text(f2id + "\\n" + Path("sides.txt").read_text())
else:
    f2id = float(weights.read_text().splitlines()[0])
    row = {k: {"mean": x, "low": x - 0.1, "high": x + 0.1}
           for k, x in (("f2id", f2id), ("f2id_floor", 0.5))}
    Path("reports").mkdir(exist_ok=True)
    facts = {"experiment": "lab", "data": {}, "pacmo": {"rows": {"pacmo": row}}}
    Path("reports/details.json").write_text(json.dumps(facts))
    Path("reports/metrics.json").write_text("{}")
"""
PARAMS = """\
experiment: lab
runs: {{folds: [1], seeds: [1]}}
ingest:
  dataset: lab
  raw: data/captures/lab
  format: sbu
  settings: {{fps: 15}}
  include: ["*"]
  drop_joints: []
  skeleton: ""
  joint_names: []
  limits:
    min_frames: 10
    max_rate_jitter: 0.5
    max_rate_error: 0.02
    max_bone_length_variation: 0.2
    max_joint_speed: 25
    max_body_speed: 8
    min_person_distance: 0.1
  contact_distance: 0.1
  stated_fps:
model: {{f2id: {f2id}}}
nightly:
  gate: {{row: pacmo, metrics: [f2id], max_noise_floor_ratio: 2.0}}
  min_new_captures: {min_new_captures}
  min_free_gb: 0.0
  max_stage_hours: 0.1
  settle_s: 0.0
prune: {{max_cache_days: 0.0, n_runs: 2, n_promoted: 1}}
"""
CRON = """\
deployments:
  - name: nightly
    entrypoint: flows/nightly.py:nightly
    description: every minute
    schedules: [{cron: "* * * * *", timezone: UTC}]
    concurrency_limit: {limit: 1, collision_strategy: CANCEL_NEW}
    parameters: {experiment: ""}
"""


def make_project(folder: Path) -> None:
    """Lay out a DVC project with no captures yet."""
    (folder / "data/captures/lab").mkdir(parents=True)
    (folder / "data/captures/lab/readme.txt").write_text("captures of the lab")
    (folder / "dvc.yaml").write_text(DVC_YAML)
    (folder / "make.py").write_text(MAKE)
    (folder / "prefect.yaml").write_text(CRON)
    (folder / ".dvcignore").write_bytes((ROOT / ".dvcignore").read_bytes())
    set_params(folder)
    dvc = [sys.executable, "-m", "dvc"]
    subprocess.run([*dvc, "init", "-q", "--no-scm"], cwd=folder, check=True)
    subprocess.run([*dvc, "config", "core.analytics", "false"], cwd=folder, check=True)
    subprocess.run([*dvc, "config", "cache.type", "hardlink"], cwd=folder, check=True)


def set_params(folder: Path, f2id: float = 0.5, min_new_captures: int = 1) -> None:
    """Say how good the model is to come out."""
    (folder / "params.yaml").write_text(PARAMS.format(f2id=f2id, min_new_captures=min_new_captures))


def capture(seed: int, n_frames: int = 12) -> str:
    """Write two people who sway a little, a metre apart, as SBU does."""
    random = np.random.default_rng(seed)
    body = random.uniform(-0.1, 0.1, (15, 3))
    sway = np.cumsum(random.normal(0, 0.002, (n_frames, 1, 3)), axis=0)
    people = [body + sway + centre for centre in ([0.3, 0.5, 2.0], [0.7, 0.5, 2.0])]
    rows = np.stack(people, axis=1).reshape(n_frames, -1)
    return "".join(
        f"{i + 1}," + ",".join(f"{x:.6f}" for x in row) + "\n" for i, row in enumerate(rows)
    )


def drop(folder: Path, takes: range, spoilt: tuple[int, ...] = ()) -> None:
    """Drop captures into the inbox, some of them cut short in a line."""
    for take in takes:
        file = folder / f"data/inbox/s01s02/01/{take:03d}/skeleton_pos.txt"
        file.parent.mkdir(parents=True)
        text = capture(take)
        file.write_text(text[: len(text) // 2] if take in spoilt else text)


def environment() -> dict[str, str]:
    """Make the project's code importable from elsewhere."""
    return {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}


def run_flow(folder: Path, name: str, *words: str) -> "subprocess.CompletedProcess[str]":
    """Run a flow by its command."""
    command = [sys.executable, "-m", "flows.run", name, *words]
    return subprocess.run(
        command, cwd=folder, env=environment(), capture_output=True, text=True, check=False
    )


def start_nightly() -> "subprocess.Popen[bytes]":
    """Start a nightly as a process."""
    command = [sys.executable, "-m", "flows.run", "nightly"]
    return subprocess.Popen(command, env=environment())


def run_nightly() -> RunRecord:
    """Run a nightly in this process and return its record."""
    nightly()
    return read_runs(RUNS)[-1]
