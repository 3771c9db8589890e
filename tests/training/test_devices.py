"""What is trusted: one process with the whole batch."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from pacmo_core.reaction import wgan
from pacmo_core.reaction.settings import AdamSettings
from pacmo_core.reaction.wgan import WganTrainer
from pacmo_core.store.weights import read_weights
from pacmo_core.training.devices import ProcessGroup
from tests.reaction.problems import PACMO, clips

TORCHRUN = [
    sys.executable, "-m", "torch.distributed.run",
    "--nnodes=1", "--nproc-per-node=2", "--rdzv-backend=c10d", "--rdzv-endpoint=127.0.0.1:0",
    "--local-addr=127.0.0.1", "-m",
]  # fmt: skip
# A rate of zero: Adam makes whole steps of round-off, and the second batch would show them.
AT_REST = {name: AdamSettings(0.0, (0.0, 0.9)) for name in ("generator", "critic")}
ROOT = Path(__file__).parents[2]


def gradients() -> dict[str, torch.Tensor]:
    """Take a step of each network, five pairs a batch, so that two shares are not equal."""
    settings = replace(PACMO, batch_size=5, bone_length_weight=2.0, **AT_REST)
    fit = wgan.build_training(clips(8), settings)
    training = fit.trainer
    assert isinstance(training, WganTrainer)
    terms = training.step()
    found = {f"term/{name}": torch.tensor(value) for name, value in terms.items()}
    for part, network in (("critic", training.critic), ("generator", training.generator)):
        for name, parameter in network.named_parameters():
            assert parameter.grad is not None
            found[f"{part}/{name}"] = parameter.grad
    return found


@pytest.mark.slow
def test_two_processes_take_the_gradients_of_one(tmp_path):
    environment = {**os.environ, "GLOO_SOCKET_IFNAME": "lo", "PYTHONPATH": str(ROOT)}
    command = [*TORCHRUN, "tests.training.two_processes", str(tmp_path)]
    subprocess.run(command, check=True, env=environment, cwd=ROOT)
    alone = gradients()
    first, second = (read_weights(tmp_path / f"{rank}.safetensors")[1] for rank in (0, 1))
    assert alone.keys() == first.keys() == second.keys()
    for name, wanted in alone.items():
        torch.testing.assert_close(first[name], wanted, rtol=1e-4, atol=1e-6)
        assert torch.equal(first[name], second[name]), name


@pytest.mark.parametrize(("n", "size"), [(5, 2), (7, 3), (3, 3), (32, 5)])
def test_shares_hold_every_row_once_and_hardly_differ(n, size):
    shares = [ProcessGroup(rank, size).rows(n) for rank in range(size)]
    assert [row for share in shares for row in range(n)[share]] == list(range(n))
    lengths = [share.stop - share.start for share in shares]
    assert max(lengths) - min(lengths) <= 1


def test_fewer_rows_than_processes_are_refused():
    with pytest.raises(ValueError, match="a row a process, 4; got 3"):
        ProcessGroup(0, 4).rows(3)


def test_one_process_alone_changes_no_bit():
    values = [torch.rand(3), torch.rand(2, 2)]
    assert all(a is b for a, b in zip(ProcessGroup(0, 1).mean(values, 7), values, strict=True))
