"""What is trusted: what one process trains; torchrun starts two of the very same stage."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML

from stages.common.files import read_curve
from tests.stages.training import prepare

ROOT = Path(__file__).parents[2]
ALONE = [sys.executable, "-m"]
TOGETHER = [*ALONE, "torch.distributed.run", "--standalone", "--nproc-per-node=2", "-m"]
EPOCHS = 3


def train(launcher: list[str], out: str) -> None:
    words = ["--model=pacmo", "--seed=1", "clips", "splits.parquet", f"models/{out}", f"{out}.csv"]
    environment = {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "OMP_NUM_THREADS": "1",
        "GLOO_SOCKET_IFNAME": "lo",
        "DVC_STUDIO_OFFLINE": "true",
    }
    subprocess.run([*launcher, "stages.train", *words], check=True, env=environment)


@pytest.mark.slow
def test_two_processes_train_what_one_does_and_leave_one_model(tmp_path, monkeypatch):
    prepare(tmp_path)
    monkeypatch.chdir(tmp_path)
    yaml, params = YAML(typ="safe"), Path("params.yaml")
    facts = yaml.load(params)
    facts["train_pacmo"]["n_epochs"] = EPOCHS
    yaml.dump(facts, params)
    train(ALONE, "one")
    train(TOGETHER, "two")
    one, two = read_curve(Path("one.csv")), read_curve(Path("two.csv"))
    assert one.keys() == two.keys()
    for name, values in one.items():
        np.testing.assert_allclose(two[name], values, rtol=2e-2, atol=1e-3, err_msg=name)
    assert [path.name for path in Path("models/two").iterdir()] == ["weights.safetensors"]
    train(TOGETHER, "again")
    weights = [Path(f"models/{out}/weights.safetensors").read_bytes() for out in ("two", "again")]
    assert weights[0] == weights[1]
